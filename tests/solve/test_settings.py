"""Options of the solver: each checked where it is declared."""

import dataclasses

import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.solve.settings import Settings


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
