"""The membrane with all couplings against a manufactured solution: errors fall at the rates of the
elements."""

import numpy as np
import pytest
import ufl
from builders import compiled_as_it_stands, march
from dolfinx import fem
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.mechanics.membrane_energy import energy_density
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.scene.supports import on_edge
from fabric_fenicsx.solve.newton import Newton

COMM = MPI.COMM_WORLD
LENGTH, WIDTH = 100.0, 60.0
ANGLES = np.radians([20.0, 105.0])
YARNS = np.stack([np.cos(ANGLES), np.sin(ANGLES)], 1).tolist()
(AX, AY), (BX, BY) = YARNS
# across a yarn, towards the other: this way both shear the fabric with one sign
INWARDS = [[-AY, AX], [BY, -BX]]
DUAL = np.linalg.inv(np.transpose(YARNS)).tolist()
# Mean stretch of the weft, mean turn of both yarns [rad]: on each side of the law's kinks one state
# that keeps off them.
TENSION, COMPRESSION = (0.014, 0.06), (-0.08, 0.1)


def sought(state, x, sin=np.sin):
    """Displacement [mm] at points x, arrays or UFL's, by which yarns stretch, curve and turn
    towards each other."""
    weft, turned = state
    xi, eta = (d[0] * x[0] + d[1] * x[1] for d in DUAL)  # coordinates along the yarns
    stretch = (
        0.014 * xi + 0.04 * sin(xi / 15 + eta / 12),
        weft * eta + 0.04 * sin(xi / 12 - eta / 18),
    )
    turn = turned * xi + 0.6 * sin(xi / 15), turned * eta + 0.6 * sin(eta / 12)
    directions = *zip(stretch, YARNS), *zip(turn, INWARDS)
    return [sum(size * direction[i] for size, direction in directions) for i in range(2)]


class Source(ff.Term):
    """Body force and traction that the load factor times `sought` asks for, as virtual work of its
    stress: with the whole edge held that is exact, and takes no divergence."""

    name, energy_kind = "source", "load"

    def __init__(self, loaded, state):
        self._loaded, self._state = loaded, state

    def set_up(self, scene):
        blank, mesh, fabric, state = scene.blank, scene.blank.mesh, self._loaded, self._state
        self._now = fem.Constant(mesh, (0.0, *state))
        load, *state = self._now
        u = load * ufl.as_vector(sought(state, ufl.SpatialCoordinate(mesh), ufl.sin))
        F = ufl.variable(ufl.Identity(2) + ufl.grad(u))
        fa, fb = (ufl.dot(F, ufl.as_vector(yarn)) for yarn in YARNS)
        cosine = AX * BX + AY * BY
        W = energy_density(ufl.dot(fa, fa), ufl.dot(fa, fb), ufl.dot(fb, fb), cosine, fabric)
        work = ufl.inner(fabric.thickness * ufl.diff(W, F), ufl.grad(blank.displacement))
        self.energy = -work * fine_dx(blank)

    def set_load(self, load):
        self._now.value = load, *self._state


def fine_dx(blank):
    """Measure whose quadrature error falls faster than any error measured here."""
    return ufl.Measure("dx", blank.mesh, metadata={"quadrature_degree": 2 * blank.degree + 2})


def halved(points, cells):
    """The mesh of triangles with each cut into four alike."""
    edges = np.sort(cells[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    unique, number = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    (a, b, c), (ab, bc, ca) = cells.T, len(points) + number.reshape(-1, 3).T
    cells = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]).transpose(0, 2, 1)
    return np.vstack([points, points[unique].mean(1)]), cells.reshape(-1, 3)


def mesh(cell, pattern, nx, level):
    """Points, cells and kind on rank 0, of nx cells along the length halved `level` times."""
    if COMM.rank > 0:
        return None, None, None
    if pattern == "unstructured":
        points, cells, kind = specimen(LENGTH, WIDTH, nx, nx * 3 // 5, pattern, cell)
        # gmsh's own finer mesh would not be similar, and rates between the two noise
        for _ in range(level):
            points, cells = halved(points, cells)
        return points, cells, kind
    nx *= 2**level
    points, cells, kind = specimen(LENGTH, WIDTH, nx, nx * 3 // 5, pattern, cell)
    bulge = np.sin(np.pi * points[:, 0] / LENGTH) * np.sin(np.pi * points[:, 1] / WIDTH)
    points[:, :2] += bulge[:, None] * [5.0, -3.0]  # no cell stays a rectangle, the edge stays
    return points, cells, kind


def errors(arrays, degree, fabric, state, quadrature_degree=None, integration="full"):
    """Norm in L2 and seminorm in H1 of the solution's error."""
    blank = ff.Blank.from_arrays(COMM, *arrays, degree=degree, a=ANGLES[0], b=ANGLES[1])
    edge = ff.Support(
        "edge", on_edge(blank), (0, 1), lambda x, load: load * np.array(sought(state, x))
    )
    terms = [ff.Membrane(fabric, quadrature_degree, integration), Source(fabric, state)]
    outcome = march(Newton(ff.Scene(blank, terms, [edge]), tolerance=1e-10), steps=2)
    assert outcome.reached == 1 and outcome.rejected == 0, outcome.reason
    numbers = tuple(fem.Constant(blank.mesh, state))  # one form for all states, like the source's
    e = blank.u - ufl.as_vector(sought(numbers, ufl.SpatialCoordinate(blank.mesh), ufl.sin))
    forms = [compat.form(ufl.inner(v, v) * fine_dx(blank)) for v in (e, ufl.grad(e))]
    return [COMM.allreduce(fem.assemble_scalar(form), MPI.SUM) ** 0.5 for form in forms]


@pytest.mark.parametrize(
    "cell, degree, pattern, nx, state",
    [
        ("triangle", 1, "right", 10, TENSION),
        ("triangle", 2, "right", 5, TENSION),
        ("triangle", 3, "right", 5, TENSION),
        ("quadrilateral", 1, "crossed", 10, TENSION),
        ("quadrilateral", 2, "crossed", 5, TENSION),
        pytest.param(
            "triangle", 2, "unstructured", 5, TENSION, marks=[pytest.mark.mpi, pytest.mark.versions]
        ),
        ("triangle", 1, "right", 10, COMPRESSION),
        ("quadrilateral", 2, "crossed", 5, COMPRESSION),
    ],
)
def test_errors_fall_at_the_rates_of_theory(unbalanced, cell, degree, pattern, nx, state):
    with compiled_as_it_stands():
        meshes = [mesh(cell, pattern, nx, n) for n in (1, 2)]
        coarse, fine = (errors(m, degree, unbalanced, state) for m in meshes)
    rates = np.log2(np.divide(coarse, fine))
    assert (rates >= [degree + 0.85, degree - 0.05]).all(), f"{coarse}, {fine}, rates {rates}"


@pytest.mark.long
def test_inner_points_cost_an_order(unbalanced):
    with compiled_as_it_stands():  # studies compile it with the optimiser
        meshes = [mesh("triangle", "right", 5, n) for n in (3, 4)]
        coarse, fine = (errors(m, 2, unbalanced, TENSION, integration="inner") for m in meshes)
    rates = np.log2(np.divide(coarse, fine))
    assert rates[0] >= 1.85 and rates[1] >= 0.95, f"errors {coarse}, {fine}, rates {rates}"
