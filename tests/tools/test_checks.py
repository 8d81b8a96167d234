"""What is checked of tools before anything runs: each flaw its sentence."""

import re
from functools import cache

import numpy as np
import pytest
from dome_triangles import double_dome
from mpi4py import MPI

from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.tools.checks import check_start, check_triangles
from fabric_fenicsx.tools.primitives import Plane, Sphere
from fabric_fenicsx.tools.tool import Tool
from fabric_fenicsx.tools.triangulated import TriangulatedSurface


@cache
def punch():
    return double_dome(size=20, turn=15)


def checked(points, cells, thickness=1.0):
    """The warnings about a punch."""
    warnings = []
    surface = TriangulatedSurface(points, cells)
    check_triangles(surface, "punch.stl", thickness, warnings.append)
    return warnings


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


def fork():
    points, cells = punch()
    apex = points[cells[0]].mean(0) + [0, 0, 30]
    return np.vstack([points, apex]), np.vstack([cells, [[*cells[0][:2], len(points)]]])


@pytest.mark.parametrize(
    "surface, words",
    [
        (fork, "punch.stl has 1 edges with more than two triangles, one at ("),
        (lambda: double_dome(size=40, turn=44), "punch.stl has facets that are"),
    ],
)
def test_flaws(surface, words):
    with pytest.raises(InputError) as error:
        checked(*surface())
    assert str(error.value).startswith(words) and "allowed" in str(error.value)


def test_doubts():
    warnings = checked(*double_dome(size=20, turn=28), thickness=2.0)
    assert len(warnings) == 1 and warnings[0].startswith("punch.stl is coarse: its facets turn by ")
    assert checked(*punch()) == []
    check_triangles(TriangulatedSurface(*ball(10)), "ball", 1.0, warnings.append)
    assert len(warnings) == 1


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
