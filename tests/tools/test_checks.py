"""What is checked of tools before anything runs: each flaw its sentence."""

import re
from contextlib import nullcontext
from functools import cache

import numpy as np
import pytest
from mpi4py import MPI

from fabric_fenicsx.meshes.double_dome import double_dome
from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.tools.checks import (
    check_motion,
    check_punch,
    check_start,
    check_triangles,
    height,
)
from fabric_fenicsx.tools.double_dome import DoubleDome
from fabric_fenicsx.tools.implicit import ImplicitSurface
from fabric_fenicsx.tools.primitives import Plane, Sphere, Torus
from fabric_fenicsx.tools.surfaces import Flipped, Offset, Turned
from fabric_fenicsx.tools.tool import Tool
from fabric_fenicsx.tools.triangulated import TriangulatedSurface

HALF = 235.0, 135.0


@cache
def punch():
    return double_dome(size=20, turn=15)


def changed(scale=1.0, shift=0.0):
    points, cells = punch()
    return points * scale + shift, cells


def checked(points, cells, thickness=1.0):
    """The warnings about a punch, and the surface."""
    warnings = []
    return warnings, check_punch(
        TriangulatedSurface(points, cells), "punch.stl", HALF, thickness, warnings.append
    )


def test_a_good_punch():
    warnings, surface = checked(*punch())
    assert warnings == [] and surface.evaluate([[200, 120, 2]]).gap == pytest.approx([2])


def test_a_punch_that_is_turned_is_turned_back():
    points, cells = punch()
    warnings, surface = checked(points, cells[:, ::-1])
    assert warnings == ["punch.stl: the normals of its flange point down, so it was turned round"]
    assert surface.evaluate([[200, 120, 2]]).gap == pytest.approx([2])


def ball(radius=60.0):
    u, v = np.meshgrid(
        np.linspace(0, 2 * np.pi, 25)[:-1], np.linspace(0, np.pi, 13)[1:-1], indexing="ij"
    )
    points = radius * np.column_stack(
        [(np.cos(u) * np.sin(v)).ravel(), (np.sin(u) * np.sin(v)).ravel(), np.cos(v).ravel()]
    )
    i, j = (a.ravel() for a in np.meshgrid(np.arange(24), np.arange(10), indexing="ij"))
    p, q = 11 * i + j, 11 * ((i + 1) % 24) + j
    cells = np.vstack([np.column_stack([p, p + 1, q]), np.column_stack([p + 1, q + 1, q])])
    top, low, i = len(points), len(points) + 1, np.arange(24)
    caps = [
        np.column_stack([11 * i, 11 * ((i + 1) % 24), top + 0 * i]),
        np.column_stack([11 * i + 10, low + 0 * i, 11 * ((i + 1) % 24) + 10]),
    ]
    return np.vstack([points, [[0, 0, radius], [0, 0, -radius]]]), np.vstack([cells, *caps])


def hole():
    points, cells = punch()
    return points, np.delete(
        cells, np.linalg.norm(points[cells].mean(1) - [152, 0, 60], axis=1).argmin(), 0
    )


def fork():
    points, cells = punch()
    apex = points[cells[0]].mean(0) + [0, 0, 30]
    return np.vstack([points, apex]), np.vstack([cells, [[*cells[0][:2], len(points)]]])


@pytest.mark.parametrize(
    "surface, words",
    [
        (
            ball,
            (
                "punch.stl has no flange in z = 0 under the ply's edge at (-235, -135): the "
                "nearest surface lies 211 mm off"
            ),
        ),
        (hole, "punch.stl is open at (149"),
        (fork, "punch.stl has 1 edges with more than two triangles, one at ("),
        (
            lambda: changed(1 / 1000),
            "punch.stl is 0.52 mm large, which speaks of metres; allowed is a surface in mm",
        ),
        (
            lambda: changed(1 / 25.4),
            "punch.stl is 20.47 mm large, which speaks of inches; allowed is a surface in mm",
        ),
        (
            lambda: changed(1000),
            "punch.stl is 520000 mm large; allowed is a surface in mm, up to 50 times",
        ),
        (
            lambda: changed([0.8, 1, 1]),
            "punch.stl has no flange in z = 0 under the ply's edge at (",
        ),
        (
            lambda: changed(shift=[0, 0, 0.2]),
            "punch.stl has no flange in z = 0 under the ply's edge at (",
        ),
        (lambda: double_dome(size=40, turn=44), "punch.stl has facets that are"),
    ],
)
def test_flaws(surface, words):
    with pytest.raises(InputError) as error:
        checked(*surface())
    assert str(error.value).startswith(words) and "allowed" in str(error.value)


def test_a_punch_with_cracks_has_its_flange():
    points, cells = punch()
    apart = points[cells].reshape(-1, 3)
    moved = apart + np.random.default_rng(0).uniform(-1e-4, 1e-4, apart.shape)
    assert checked(moved, np.arange(len(apart)).reshape(-1, 3))[0] == []
    moved = apart + np.random.default_rng(0).uniform(-0.1, 0.1, apart.shape)
    with pytest.raises(InputError, match="punch.stl is open at .* without holes or cracks"):
        checked(moved, np.arange(len(apart)).reshape(-1, 3))


def test_doubts():
    warnings, _ = checked(*double_dome(size=20, turn=28), thickness=2.0)
    assert len(warnings) == 1 and warnings[0].startswith("punch.stl is coarse: its facets turn by ")
    points, cells = punch()
    some = cells.copy()
    some[5::7] = some[5::7, ::-1]
    warnings, _ = checked(points, some)
    assert warnings == [
        (
            f"punch.stl: {len(some[5::7])} of {len(some)} triangles were turned round "
            "to agree with the others"
        )
    ]
    check_triangles(TriangulatedSurface(*ball(10)), "ball", 1.0, warnings.append)
    assert len(warnings) == 1


@pytest.mark.mpi
def test_motion():
    comm = MPI.COMM_WORLD
    x = np.linspace(-20, 20, 41)
    places = np.column_stack([np.repeat(x, 41), np.tile(x, 41), np.zeros(41 * 41)])[
        comm.rank :: comm.size
    ]

    def moved(surface, start, end):
        tool = Tool(surface, lambda load: (0, 0, start + load * (end - start)), name="punch")
        check_motion([tool], places, 1.0, comm)
        assert tool.displacement[2] == start

    moved(Sphere(10, [3, 4, -10]), -0.5, 2)
    moved(Sphere(10, [3, 4, -10]), -5, -0.54)  # as near as a flange has to be
    for start, end, words in (
        (
            -0.1,
            2,
            (
                r"punch cuts into the blank by 0.4 mm at \(3, 4, 0\) before anything "
                r"moves; allowed is up to 0.05 mm"
            ),
        ),
        (
            -5,
            -1,
            (
                "punch never reaches the blank: at the end of its stroke it is "
                "still 0.5 mm off or more"
            ),
        ),
    ):
        with pytest.raises(InputError, match=words):
            moved(Sphere(10, [3, 4, -10]), start, end)


@pytest.mark.parametrize(
    "surface, deep, place",
    [
        (Sphere(10, (3, 4, -9.5)), 0.7, "(3, 4, 0)"),
        (Plane((0, 0, 5), (0, 0, 1)), 5.2, "(0, 0, 0)"),  # the sheet is on its wrong side
    ],
)
def test_a_tool_that_the_sheet_is_in_at_the_start(surface, deep, place):
    x, y = np.meshgrid(np.arange(7.0), np.arange(9.0))
    places = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel() - 1e-16])
    words = f"ball is {deep} mm deep in the sheet's face at {place} before anything moves; allowed "
    with pytest.raises(InputError, match=re.escape(words) + "is up to 0.2 mm, .*: begin its path"):
        check_start(Tool(surface, name="ball"), places, 0.4, MPI.COMM_SELF)
    lowered = Tool(surface, lambda load: (0, 0, 0.2 - deep), name="ball")  # up to its middle
    check_start(lowered, places, 0.4, MPI.COMM_SELF)


class Egg(ImplicitSurface):
    """(x/40)^2 + (y/20)^2 + (z/20)^2 = 1, with something else for F, gradient and Hessian."""

    radii = (10.0, np.inf)

    def __init__(self, changed):
        self.changed = changed

    def implicit(self, x):
        weights = 2 / np.array([[40.0], [20], [20]]) ** 2
        F = (weights * x * x).sum(0) / 2 - 1
        return self.changed(x, F, weights * x, np.eye(3)[:, :, None] * weights)


@pytest.mark.mpi
@pytest.mark.parametrize(
    "changed, words",
    [
        (lambda x, F, g, H: (F, g, H), ""),
        (lambda x, F, g, H: (F, g * [[2], [1], [1]], H), "the gradient of surface Egg of egg is "),
        (
            lambda x, F, g, H: (F, g, 2 * H),
            "the Hessian of surface Egg of egg is not that of its F",
        ),
        (lambda x, F, g, H: (F + np.where(abs(x[0]) < 9, np.nan, 0), g, H), "the gap of surface "),
        (
            lambda x, F, g, H: (F + np.where(x[0] < 9, np.nan, 0), g, H),
            "F of surface Egg of egg is not a number at",
        ),
    ],
)
@pytest.mark.parametrize("beneath", [True, False, "turned"])
def test_an_equation_whose_derivatives_are_wrong_is_named(changed, words, beneath):
    comm = MPI.COMM_WORLD
    x, y = np.meshgrid(np.arange(-40.0, 41, 4), np.arange(-30.0, 31, 4))
    places = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])[comm.rank :: comm.size]
    surface = Egg(changed) if beneath else Flipped(Offset(Egg(changed), 1))
    surface = Turned(Turned(surface, (180, 0, 0)), (180, 0, 0)) if beneath == "turned" else surface
    tool = Tool(surface, (0, 0, 5), name="egg")
    tool.at(-4.1 if beneath else 4.3)
    with pytest.raises(InputError, match=words) if words else nullcontext():
        check_start(tool, places, 0.4, comm)


@pytest.mark.mpi
@pytest.mark.parametrize(
    "times, words", [(0.99, ""), (1.5, "`bound` of surface Bounded of egg is ")]
)
def test_a_bound_beyond_the_distance_is_named(times, words):
    class Bounded(Egg):
        def bound(self, F, x):
            return times * abs(np.linalg.norm(x, axis=0) - 20)

        def implicit(self, x):  # a ball
            r = np.linalg.norm(x, axis=0)
            slope = x / r
            return r - 20, slope, (np.eye(3)[:, :, None] - slope[:, None] * slope) / r

    comm = MPI.COMM_WORLD
    x, y = np.meshgrid(np.arange(-10.0, 11, 4), np.arange(-10.0, 11, 4))
    places = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])[comm.rank :: comm.size]
    tool = Tool(Bounded(None), (0, 0, -21), name="egg")
    tool.at(1.0)
    with pytest.raises(InputError, match=words) if words else nullcontext():
        check_start(tool, places, 0.4, comm)


@pytest.mark.parametrize("low", [(0, 0), (-150, -100)])
@pytest.mark.parametrize(
    "surface, top",
    [
        (Offset(Sphere(40, (37.3, 11.1, -25)), 2), 17),
        (Sphere(1e4, (30, 20, 7 - 1e4)), 7),
        (Torus((20, 10, 3), (0, 0, 1), 60, 8), 11),
        (DoubleDome(), 59.999732),  # its edges' rounding takes the rest
    ],
)
def test_height(surface, top, low):
    assert height(surface, low, (150, 100)) == pytest.approx(top, abs=1e-6)


def test_what_does_not_rise_has_no_height():
    for surface in (Sphere(5, (0, 0, -5)), Sphere(50, (400, 0, 0))):
        with pytest.raises(InputError, match="Sphere of the punch does not rise over z = 0"):
            height(surface, (-50, -50), (50, 50))
