"""Energies by hand against UFL's, flat triangles' and their rates."""

import numpy as np
import pytest
from builders import alone, compiled_as_it_stands, nodal_forces, rotation, sheet
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.material import kernel
from fabric_fenicsx.sheet.specimen import specimen


def made(x):
    """Displacement by which yarns stretch, curve and turn, on one side of the law's kinks."""
    return [
        0.02 * x[0] + 0.004 * x[1] * np.sin(x[0] / 15) + 0.05 * x[1],
        0.015 * x[1] + 0.03 * np.sin(x[0] / 12 + x[1] / 18) + 0.04 * x[0],
    ]


def exact(fabric, yarns):
    """By Gauss's rule of 40 x 40 points on 100 x 60 mm."""
    s, w = np.polynomial.legendre.leggauss(40)
    X, Y = (each.ravel() for each in np.meshgrid(50 + 50 * s, 30 + 30 * s))
    weights, h = np.outer(w, w).ravel() * 50 * 30, 1e-5
    ways = (h, 0), (0, h)
    slopes = [np.subtract(made((X + i, Y + j)), made((X - i, Y - j))) for i, j in ways]
    F = np.eye(2) + np.transpose(slopes, (2, 1, 0)) / (2 * h)
    return weights @ kernel.evaluate(fabric, gradient=F, fibres=yarns).energy * fabric.thickness


@pytest.mark.versions
@pytest.mark.parametrize(
    "cell, degree, pattern",
    [
        ("triangle", 1, "right"),
        pytest.param("triangle", 2, "right", marks=pytest.mark.mpi),
        ("triangle", 3, "right"),
        ("quadrilateral", 1, "crossed"),
        ("quadrilateral", 2, "crossed"),
    ],
)
def test_energies_converge_at_the_rates_of_the_elements(unbalanced, cell, degree, pattern):
    """As the square of cells, on linear ones, and by an order more for each degree."""
    yarns = [[np.cos(t), np.sin(t)] for t in (0.35, 1.83)]
    errors = []
    for n in (1, 2):
        nx = n * (12 if degree == 1 else 6)
        blank = sheet(100, 60, nx, nx * 2 // 3, pattern, cell=cell, degree=degree, a=0.35, b=1.83)
        with compiled_as_it_stands():
            scene = ff.Scene(blank, [ff.Membrane(unbalanced)])
        blank.u.interpolate(made)
        errors.append(abs(scene.energy() / exact(unbalanced, yarns) - 1))
    assert errors[0] < 1e-3 and errors[1] < 1.15 * 0.5 ** (degree + 1) * errors[0]


@pytest.mark.parametrize("integration, share", [("full", 1.0), ("inner", 0.99 * 0.25 + 0.01)])
def test_inner_points_see_half_of_the_gradients(integration, share):
    """But for 1 % of the energy: W = 600 e^2 of e = 0.02 + 0.002 x, which has the means 0.024 and
    0.028 in two triangles, and the variance 0.002^2 6^2 / 18."""
    yarn = ff.Yarn(b=600.0, d=2.0)
    blank = sheet(6, 6, 1, 1, "left", degree=2)
    fabric = ff.WovenFabric(yarn, yarn, s1=0.03, couplings=(), thickness=0.5)
    scene = ff.Scene(blank, [ff.Membrane(fabric, integration=integration)])
    blank.u.interpolate(lambda x: [0.02 * x[0] + 0.001 * x[0] ** 2, 0 * x[0]])
    squares = 0.024**2 + 0.028**2 + 2 * share * 0.002**2 * 2
    assert scene.energy() == pytest.approx(0.5 * 600 * 18 * squares, rel=1e-9)


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


@pytest.mark.parametrize(
    "make", [lambda: ff.Bending(2.0, D_t=1.0), lambda: ff.SheetMetal(ff.load_metal("dc04"))]
)
def test_bending_is_that_of_the_linear_sheet(make):
    """Of the same nodes."""
    found, options = [], {"spatial": True, "a": 0.3, "b": 1.7}
    arrays = specimen(40.0, 30.0, 4, 3, "unstructured")
    fine = ff.Blank.from_arrays(MPI.COMM_SELF, *arrays, degree=2, **options)
    coarse = fine.coordinates()[:, :2], fine.triangles().reshape(-1, 3), "triangle"
    for blank in (fine, ff.Blank.from_arrays(MPI.COMM_SELF, *coarse, **options)):
        term, (x, y, _) = alone(blank, make()), blank.coordinates().T
        w = np.column_stack([0.01 * x * y, -0.02 * x, 2 * np.sin(x / 15) + 0.002 * x * y])
        blank.u.x.array[:] = w.ravel()
        places = np.lexsort(blank.coordinates().round(6).T)
        found.append((term.stored(), nodal_forces(term)[places]))
    (energy, forces), (linear, others) = found
    assert energy == pytest.approx(linear, rel=1e-10)
    assert forces == pytest.approx(others, abs=1e-9 * abs(others).max())
