"""What a run's history says of work and energies."""

import csv
import json

import numpy as np
import pytest
from mpi4py import MPI

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.results.history import History, energy_balance, viscous_warning
from fabric_fenicsx.solve.progress import Accepted
from fabric_fenicsx.solve.report import Report


def test_a_row_has_each_number_under_its_name(tmp_path):
    """The imbalance is of energies of 8 N mm; the residual is the last one. What NumPy gave is kept
    as plain numbers."""
    report = Report(True, "", np.int32(7), 2, 3, 1, 4, np.float32(50), [9.0, 1e-3, 1e-7])
    kinds = {"strain": 4.0, "metal": 1.0, "viscous": 0.25, "bending": 2.75}
    state = Accepted(0.5, kinds, 10.0, report, 5, 1.23456, None)
    history = History(tmp_path / "history.csv", MPI.COMM_SELF)
    history.add(
        state, np.float32(1.5), np.int64(20), lambda taken: {"own": 6.0, "min_stability": 0.1}
    )
    expected = {
        **{"step": 0, "load": 0.5, "displacement_mm": 1.5, "reaction_N": 20.0},
        **{f"{kind}_energy_Nmm": value for kind, value in kinds.items()},
        **{"contact_energy_Nmm": 0.0, "friction_energy_Nmm": 0.0, "external_work_Nmm": 10.0},
        **{"energy_imbalance": 0.25, "iterations": 7, "saddles": 4, "shifts": 2},
        **{"line_search_cuts": 3, "cuts": 5, "negative_pivots": 1, "residual_N": 1e-7},
        **{"force_scale_N": 50.0, "min_stability": 0.1, "wall_s": 1.2346, "own": 6.0},
    }
    assert json.loads(json.dumps(history.rows)) == [expected]
    with pytest.raises(InputError, match="load 0.5 the terms no longer give .* the column own"):
        history.add(state, 1.5, 20.0, lambda taken: {})
    history.close()
    (row,) = csv.DictReader((tmp_path / "history.csv").open())
    assert {name: float(value) for name, value in row.items()} == expected


def row(load, work, strain):
    return {
        **{"load": load, "external_work_Nmm": work, "strain_energy_Nmm": strain - 0.5},
        **{"metal_energy_Nmm": 0.5, "saddles": int(load == 0.1)},
        "energy_imbalance": abs(work - strain) / (strain or 1.0) if load else 0.0,
    }


def test_the_largest_imbalance_is_over_the_largest_energies():
    """6 of 50 N mm are more than 1 of 1, and than 20 of 120 over the work."""
    rows = [row(0.0, 3.0, 1.0), row(0.1, 2.0, 1.0), row(0.5, 56.0, 50.0), row(1.0, 98.0, 100.0)]
    energy = {"strain": 99.5, "metal": 0.5, "external_work": 98.0}
    assert energy_balance(rows, energy) == {
        "energy_imbalance": 0.02,
        "energy_imbalance_largest": {"value": pytest.approx(0.06), "load": 0.5},
        "branches": [0.1],
    }
    still = energy_balance([row(0.0, 0.0, 0.0)], dict.fromkeys(energy, 0.0))
    assert still["energy_imbalance_largest"] == {"value": 0.0, "load": 0.0}


def test_drag_is_compared_with_all_that_stretching_stores():
    """Metal alone stores no "strain", bending is not of stretching, and a sheet that nothing has
    stretched yet stores nothing; told is the first step with more than 1 %."""
    rest = {f"{kind}_energy_Nmm": 9.0 for kind in ("bending", "contact", "friction")}
    rows = [rest | {"strain_energy_Nmm": 0.0, "viscous_energy_Nmm": 0.0}]
    rows.append(rows[0] | {"viscous_energy_Nmm": 0.3})
    assert "has taken more than 1000 % of the strain" in viscous_warning(rows, 0.5)
    rows[1]["metal_energy_Nmm"] = 10.0
    assert "(step 1) the regularisation has taken 3 % of the strain" in viscous_warning(rows, 0.5)
    assert not viscous_warning([rows[1]] * 2, 0.5)
    for drag, told in ((0.101, True), (0.099, False)):
        assert bool(viscous_warning([rows[0], rows[1] | {"viscous_energy_Nmm": drag}], 1)) == told
