"""The membrane's energy: derivatives by hand are those of UFL and of differences."""

import numpy as np
import pytest
from builders import compiled_as_it_stands, rotation, sheet

import fabric_fenicsx as ff

# turned: out of the plane, so a manifold in space; each has its own forms to compile
ELEMENTS = [
    ("triangle", 1, {}, True),
    ("triangle", 2, {"integration": "inner"}, False),
    ("quadrilateral", 1, {"weave_angle": 1.3}, True),
]


class Plain(ff.Term):
    """The energy alone, of which `ufl.derivative` makes residual and tangent."""

    name, energy_kind = "plain", "strain"

    def __init__(self, membrane):
        self.energy = membrane.energy


def residual_and_tangent(scene):
    r, A = scene.u.duplicate(), scene.create_matrix()
    scene.residual(r)
    scene.tangent(A)
    return r, A


@pytest.mark.versions
@pytest.mark.parametrize("cell, degree, options, turned", ELEMENTS)
def test_variations_by_hand_are_those_of_ufl(unbalanced, cell, degree, options, turned):
    """Of nodes that are displaced at random, yarns stretched and compressed."""
    Q = rotation() if turned else None
    yarns = {"a": Q @ [1, 0.4, 0], "b": Q @ [0.1, 1, 0]} if turned else {"a": 0.4, "b": 1.5}
    blank = sheet(40.0, 20.0, 4, 2, "crossed", cell=cell, degree=degree, turn=Q, **yarns)
    random = np.random.default_rng(degree).uniform(-1, 1, blank.u.x.array.size)
    blank.u.x.array[:] = 0.5 / degree * random
    membrane = ff.Membrane(unbalanced, **options)
    with compiled_as_it_stands():
        by_hand = residual_and_tangent(ff.Scene(blank, [membrane]))
        by_ufl = residual_and_tangent(ff.Scene(blank, [Plain(membrane)]))
    for mine, theirs in zip(by_hand, by_ufl):
        mine.axpy(-1, theirs)
        assert mine.norm() <= 1e-12 * theirs.norm()
