"""Hard scenes against PETSc's minimiser, which has another line search and no shifts."""

import numpy as np
import pytest
from petsc4py import PETSc
from petsc_solvers import run


@pytest.mark.parametrize(
    "scene, iterations", [("wrinkles", 195), ("slack net", 64), ("pressed on a ball", 110)]
)
def test_states_are_those_of_tao_in_not_many_more_iterations(scene, iterations):
    """At most a quarter more than today."""
    PETSc.Log.begin()
    own, other = (run(scene, solver, np.inf) for solver in ("", "nls preonly"))
    assert own["energy_Nmm"] == pytest.approx(other["energy_Nmm"], rel=1e-6)
    assert own["force_N"] == pytest.approx(other["force_N"], rel=1e-6)
    assert own["load"] == 1 and own["negative_pivots"] == 0 and own["iterations"] <= iterations


def test_a_correction_is_cut_before_the_sheet_is_sent_away():
    """Under a tool finer than the cells; without that the run ends at 15 % of the stroke."""
    PETSc.Log.begin()
    row = run("sharp tool", "", np.inf)
    assert (row["load"], row["rejected"]) == (1, 0) and row["iterations"] <= 191


def test_buckled_metal_is_no_saddle():
    """SNES and TAO end in the flat one, with 65 times the energy."""
    PETSc.Log.begin()
    row = run("metal buckles", "", np.inf)
    assert row["negative_pivots"] == 0 and 0 < row["energy_Nmm"] < 100
    assert row["load"] == 1 and row["iterations"] <= 250
