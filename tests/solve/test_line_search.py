"""The line search along functions of one variable."""

import numpy as np
import pytest
from petsc4py import PETSc

from fabric_fenicsx.solve.line_search import LineSearch
from fabric_fenicsx.solve.report import Report, SolveFailed


class Along:
    """An energy of one variable, in place of a scene's."""

    INVERTED = 1e30

    def __init__(self, energy, slope):
        self.energy, self.slope = energy, slope
        self.r = PETSc.Vec().createSeq(1, comm=PETSc.COMM_SELF)

    def __call__(self, x):
        self.r.array[:] = self.slope(x.array[0])
        return self.energy(x.array[0])


def searched(energy, slope):
    """Where the search along d = 1 ends, and the report."""
    objective, report = Along(energy, slope), Report()
    x, d = objective.r.duplicate(), objective.r.duplicate()
    x.array[:], d.array[:] = 0.0, 1.0
    LineSearch(objective)(x, objective(x), d, False, report)
    return x.array[0], report


def test_a_newton_step_of_a_parabola_is_taken_whole_and_one_too_short_is_doubled_thrice():
    assert searched(lambda x: (x - 1) ** 2, lambda x: 2 * (x - 1)) == (1.0, Report())
    assert searched(lambda x: -x, lambda x: -1.0)[0] == 8.0
    x, _ = searched(lambda x: 1e16, lambda x: x - 0.25)  # energies differ by rounding
    assert x == pytest.approx(0.25, abs=0.2)


def test_a_kink_is_found_though_the_step_is_a_thousand_times_too_long():
    kink = 1e-3

    def slope(x):
        return x - 1 + 1e4 * max(0.0, x - kink)

    x, report = searched(lambda x: x**2 / 2 - x + 5e3 * max(0.0, x - kink) ** 2, slope)
    assert abs(slope(x)) <= 0.7 and report.cuts > 0


def test_where_the_energy_is_higher_no_flat_slope_is_an_end():
    """At 1 it is 0.5 and flat; it is below 0 up to 0.36, and least at 1/6."""
    x, _ = searched(lambda x: -x + 3.5 * x**2 - 2 * x**3, lambda x: -1 + 7 * x - 6 * x**2)
    assert 0 < x < 0.36


@pytest.mark.parametrize("slope", [1.0, np.nan])
def test_uphill_is_refused(slope):
    with pytest.raises(SolveFailed, match="no state of lower energy"):
        searched(lambda x: x, lambda x: slope)
