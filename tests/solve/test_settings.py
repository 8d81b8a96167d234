"""Options of the solver: each checked where it is declared."""

import dataclasses

import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.solve.settings import Settings


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Settings(steps=0), "`steps` is 0"),
        (lambda: Settings(viscosity="on"), "`viscosity` is 'on'.* auto, off"),
        (lambda: Settings(milestones=[2.0]), "one of `milestones` is 2.0"),
        (lambda: ff.Limits(strain=0), "`Limits.strain` is 0"),
    ],
)
def test_a_value_that_is_refused_is_named(make, words):
    with pytest.raises(ff.InputError, match=words):
        make()


def test_a_job_has_every_setting_and_the_coarser_run_takes_them_all():
    job = ff.Tensile(nx=4, element="P1").job(steps=5, viscosity="off", linear_solver="mumps-lu")
    coarse = job.coarser_settings()
    assert (coarse.steps, coarse.viscosity, coarse.linear_solver) == (3, "off", "mumps-lu")
    assert {each.name for each in dataclasses.fields(Settings)} <= {*vars(job)}
