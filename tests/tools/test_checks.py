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
