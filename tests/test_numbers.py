"""Each number that a user gives is checked by a rule (tests/core/test_rules.py)."""

import re

import numpy as np
import pytest

import fabric_fenicsx as ff

FABRIC = ff.load("komeili")


def blank():
    return ff.Blank.rectangle(2, 1, nx=1, spatial=True)


def scene():
    return ff.Scene(blank(), [ff.Membrane(FABRIC)], supports=ff.clamped_ends(0.1))


# what makes something of a number, and a number that is allowed
TAKERS = {
    "length of a rectangle": (lambda v: ff.Blank.rectangle(v, 50), 20),
    "centre of a ball": (lambda v: ff.Sphere(30, (0, 0, v)), 1),
    "path as a function": (lambda v: ff.Tool(ff.Sphere(3), lambda load: (0, 0, v)), 1),
    "lag of friction": (lambda v: ff.Coulomb(0.2, lag=v), 0.01),
    "stiffness of springs": (lambda v: ff.Springs(lambda x: x[0] < 1, v, arm=(1, 0, 0)), 1),
    "holder's pressure": (lambda v: ff.BlankHolderPressure(v, (0, 0, -1), lambda x: x[0]), 1),
    "value of a support": (lambda v: ff.Support("s", lambda x: x[0] < 1, (0,), (v, 0, 0)), 1),
    "steps of a job": (lambda v: ff.Job(scene(), steps=v), 2),
    "quadrature of a membrane": (lambda v: ff.Membrane(FABRIC, quadrature_degree=v), 2),
    "a yarn's b": (lambda v: ff.Yarn(b=v, d=1.0), 10),
}


def test_each_taker_refuses_what_is_no_number_and_takes_those_of_numpy():
    taken = []
    for name, (make, right) in TAKERS.items():
        for number in (np.array(right), np.float64(right)):
            make(number)
        for wrong in (float("nan"), True, [0.5]):
            try:
                make(wrong)
            except ff.InputError as error:
                taken += [] if re.search(" (is|are) .*; expected ", str(error)) else [name]
            else:
                taken.append(name)
    assert not taken


def test_none_stands_for_a_default_that_depends_on_others_alone():
    with pytest.raises(ff.InputError, match="`strain` is None; expected"):
        ff.Tensile(strain=None)
    assert ff.Tensile(length=None, width=20, nx=4).build().data.length == 200
    assert ff.Job(scene(), path_tolerance=None).path_tolerance is None
