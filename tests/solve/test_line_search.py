"""Line search, options of the solver and what a step has to meet."""

import dataclasses

import numpy as np
import pytest
from petsc4py import PETSc

import fabric_fenicsx as ff
from fabric_fenicsx.solve.line_search import LineSearch
from fabric_fenicsx.solve.progress import Report, SolveFailed
from fabric_fenicsx.solve.settings import Settings
from fabric_fenicsx.solve.step_criteria import imbalance, missing_work, off_path


class Along:
    """An energy of one variable, instead of a scene's."""

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
    LineSearch(objective)(x, objective(x), d, report)
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


def test_a_job_has_every_setting_and_the_coarser_run_takes_them_all():
    """Of what a mesh twice as coarse is off by, some are looser: 2 or 4 times."""
    given = {"viscosity": "off", "linear_solver": "mumps-lu", "milestones": (0.5,), "every": 7}
    loose = {"max_step": 0.3, "accuracy": 0.01, "balance": 0.04, "path_tolerance": 2e-4}
    limits = ff.Limits(strain=0.2, cell_size=3.0)
    job = ff.Tensile(nx=4, element="P1").job(steps=5, limits=limits, **given, **loose)
    assert {each.name for each in dataclasses.fields(Settings)} <= {*vars(job)}
    coarse = vars(job.coarser_settings())
    assert given.items() <= coarse.items() and coarse["tolerance"] == 1e-8
    looser = {"max_step": 0.6, "accuracy": 0.02, "balance": 0.08, "path_tolerance": 8e-4}
    assert {name: coarse[name] for name in loose} == pytest.approx(looser) and coarse["steps"] == 3
    loose = coarse["limits"]
    assert (loose.strain, loose.cell_size, loose.imbalance, loose.shear) == (0.8, 12, 0.2, 340)
    coarse = Settings(steps=2, max_step=0.7, path_tolerance=0.05).coarser_settings()
    assert (coarse.steps, coarse.max_step, coarse.path_tolerance) == (2, 1.0, 0.1)
    assert Settings(steps=20).largest_step == 0.05 and Settings(max_step=0.5).largest_step == 0.5


@pytest.mark.parametrize(
    "work, rise, stored, contact, share",
    [
        (100.0, 97.0, 5.0, 1.0, 0.03),
        (97.0, -100.0, 5.0, 1.0, 1.97),
        (16.0, 0.0, 1e3, 50.0, 0.16),  # little of what was stored
        (16.0, 0.0, 1e3, -500.0, 0.032),  # or of what contact stores
        (0.0, 0.0, 0.0, 0.0, 0.0),
    ],
)
def test_work_that_is_missing_is_compared_with_the_largest(work, rise, stored, contact, share):
    assert missing_work(work, rise, stored, contact) == pytest.approx(share)


def test_limits_of_a_step():
    """Of work that is missing and of the straight path, twice the accuracy, if asked for."""
    told = "3 % of the step's work is missing from the energies; expected 2 %"
    assert imbalance(0.03, 0.02) == told
    assert not imbalance(0.03, None) and not imbalance(0.02, 0.02)
    assert "by more than the accuracy of 0.01" in off_path(0.0201, 0.01)
    assert not off_path(0.0199, 0.01) and not off_path(9.0, None)
