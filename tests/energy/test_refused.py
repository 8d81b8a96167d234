"""What terms refuse of the sheets and options that they are given, in one sentence."""

import pytest
from builders import Elastic, alone, near, sheet

import fabric_fenicsx as ff

FABRIC, END = ff.load("komeili"), near(0, 10.0)
PLANE = ff.Plane((0, 0, 0), (0, 0, 1))
T = FABRIC.thickness_under(0.0)
TURNED = {"frame": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]}
SIDES = lambda x: abs(x[:2] - 5).max(0) > 4.999  # noqa: E731


def square(**options):
    return sheet(10, 10, 2, 2, "left", **{"spatial": True} | options)


def stack(play=0.0):
    return ff.Stack([(square(), T, name) for name in "ab"], 0, play)


def contact(**options):
    return ff.Contact(ff.Tool(PLANE, name="table"), **{"thickness": T, "penalty": 9.0} | options)


def pair(penalty=9.0):
    return ff.SheetContact("a", "b", penalty)


def between(blank, term, membrane=None):
    return ff.Scene(blank, [membrane or ff.Membrane(FABRIC), term])


REFUSED = [
    (lambda: alone(square(degree=3), contact()), "other cells; allowed are P1, Q1, and P2"),
    (lambda: alone(square(), contact(where=near(0, 77.0))), "where no node is"),
    (lambda: alone(square(**TURNED), contact()), "along turned axes; allowed are x, y and z"),
    (lambda: ff.Tool(PLANE, force=lambda s: (1 - s, 0, s)), "0 is .* along that at full load"),
    (lambda: between(stack(-0.5 * T), pair()), "sheets that overlap by 0.537 mm; allowed"),
    (lambda: between(stack(), pair(None), Elastic()), "a penalty, a number above 0, as no term"),
    (lambda: ff.Coulomb({"a": 0.1, "b": -1}), "coefficient of friction is -1"),
    (lambda: between(stack(), ff.SelfContact(T, penalty=1.0)), "asked of a stack; allowed is one"),
    (lambda: alone(square(), ff.Springs(END, 1.0)), "springs need one of `anchor` and `arm`"),
    (lambda: alone(square(), ff.Springs(END, 1.0, anchor=(10, 0, 0))), "an anchor at a node that"),
    (lambda: alone(square(), ff.Bending(1.0, symmetric=SIDES)), "sides in more than one plane"),
    (lambda: alone(square(spatial=False), ff.Bending(1.0)), "`spatial=True`, or `in_plane`"),
    (lambda: alone(square(), ff.Membrane(FABRIC, integration="inner")), "degree 1 on triangles"),
    (lambda: ff.SheetMetal(ff.load_metal("dc04"), 4), "an odd number from 5"),
]


@pytest.mark.parametrize("make, words", REFUSED)
def test_what_terms_refuse(make, words):
    with pytest.raises(ff.InputError, match=words):
        make()
