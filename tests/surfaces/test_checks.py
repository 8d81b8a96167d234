"""What is checked of tools before anything runs: each flaw its sentence."""

import re

import numpy as np
import pytest
from mpi4py import MPI

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.surfaces import checks, projection
from fabric_fenicsx.surfaces.primitives import Plane, Sphere
from fabric_fenicsx.surfaces.tool import Tool
from fabric_fenicsx.surfaces.triangulated import TriangulatedSurface


def checked(points, cells, thickness=1.0):
    """The warnings about a punch."""
    return checks.check_triangles(TriangulatedSurface(points, cells), "punch.stl", thickness)


def arc(turn, count=4, radius=10.0):
    """Points and triangles of a strip along an arc, whose facets turn by so much [deg]."""
    a = np.radians(turn) * (np.arange(count + 1) - count / 2)
    x, z = radius * np.sin(a), radius * np.cos(a)
    points = np.vstack([np.column_stack([x, 0 * x + y, z]) for y in (0.0, 5.0)])
    k = np.arange(count)
    low = np.column_stack([k, k + 1, k + count + 2])
    return points, np.vstack([low, np.column_stack([k, k + count + 2, k + count + 1])])


def test_facets_that_turn_by_more_than_20_deg_are_doubted():
    (told,) = checked(*arc(21.0))
    assert told.startswith("punch.stl is coarse: its facets turn by 21 d")
    assert not checked(*arc(19.0))


def test_edges_are_sharp_from_35_deg_on_and_between_planes_from_1_deg_on():
    assert [len(TriangulatedSurface(*arc(turn)).sharp) for turn in (33.0, 37.0)] == [0, 3]
    assert [len(grid(angle).sharp) for angle in (0.5, 1.5)] == [0, 8]


def test_facets_off_their_arc_by_a_thickness_are_refused():
    """By 10 (1 - cos 10 deg) mm, 0.152, or by up to half as much again."""
    assert not checked(*arc(20.0 - 1e-6), thickness=0.23)
    with pytest.raises(InputError, match="punch.stl has facets that are 0.2"):
        checked(*arc(20.0), thickness=0.151)


def test_edges_with_three_triangles_are_refused():
    points, cells = arc(10.0)
    cells = np.vstack([cells, [*cells[1][[0, 2]], len(points)]])
    with pytest.raises(InputError, match="punch.stl has 1 edges with more than two triangles, one"):
        checked(np.vstack([points, [0, 2, 30]]), cells)


def test_numbers_of_single_precision_far_from_the_origin_are_refused():
    """At 4.5e6 mm they are 0.5 mm apart, of a surface of 10 mm; at 100 mm all is well."""
    points, cells = arc(10.0)
    near, far = ((points + [x, 0, 0]).astype("f4").astype(float) for x in (100.0, 4.5e6))
    assert not checked(near, cells)
    with pytest.raises(InputError, match="punch.stl has numbers of single precision, which are 0"):
        checked(far, cells, thickness=9.0)


def grid(angle, n=8):
    """Two planes of squares at an angle [deg]."""
    x, y = (each.ravel() for each in np.meshgrid(np.arange(-n, n + 1.0), np.arange(n + 1.0)))
    k = (np.arange(2 * n) + (2 * n + 1) * np.arange(n)[:, None]).ravel()
    up = k + 2 * n + 1
    cells = [np.column_stack([k, k + 1, up + 1]), np.column_stack([k, up + 1, up])]
    z = np.maximum(x, 0) * np.tan(np.radians(angle))
    return TriangulatedSurface(np.column_stack([x, y, z]), np.vstack(cells))


def told_of(size, hole=0.0):
    """The warnings about a square plate of this size, with a square hole, under 100 mm of sheet."""
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    out, inner = square * size, square * hole
    k, n = np.arange(4), (np.arange(4) + 1) % 4
    points = np.column_stack([np.vstack([out, inner]), np.zeros(8)])
    cells = np.vstack([np.column_stack([k, n, n + 4]), np.column_stack([k, n + 4, k + 4])])
    plate = Tool(TriangulatedSurface(points, cells), name="plate")
    return checks.triangle_warnings(plate, 100.0)


def test_a_tool_in_another_unit_is_doubted():
    """Below a fifth of the sheet, if it would be from a tenth to ten times as large in a unit."""
    assert not told_of(21.0)
    assert "its unit may be inches or cm;" in told_of(19.0)[0]
    assert "its unit may be metres or inches;" in told_of(0.5)[0]
    assert "its unit may be metres;" in told_of(0.3)[0]
    assert not checks.unit_doubt(2.1, 100.0, 0.02) and checks.unit_doubt(1.9, 100.0, 0.02)


def test_a_hole_below_a_tenth_of_the_tool_is_told_of():
    assert "has a hole 9 mm wide at (0, 0, 0) mm" in told_of(100.0, 9.0)[0]
    assert not told_of(100.0, 11.0)


def test_the_least_radius_takes_more_than_a_hundredth_of_the_turning(monkeypatch):
    """One of 256 equal triangles has 9 % of the sum of A / R^2, or 0.9 %."""
    surface = grid(0.0).curved
    bends = np.tile([[1 / 40], [-1 / 30]], len(surface.areas))
    for bend, radius in ((1 / 8, 8), (1.5 / 40, 40)):
        bends[0, 0] = bend
        monkeypatch.setattr(projection, "curvatures", lambda patches: bends)
        assert projection.least_radii(surface) == pytest.approx((radius, 30))


@pytest.mark.parametrize(
    "surface, deep, place",
    [
        (Sphere(10, (3, 4, -9.99)), 0.21, "(3, 4, 0)"),
        (Plane((0, 0, 5), (0, 0, 1)), 5.2, "(0, 0, 0)"),  # the sheet is on its wrong side
    ],
)
def test_a_tool_that_the_sheet_is_in_at_the_start(surface, deep, place):
    x, y = np.meshgrid(np.arange(7.0), np.arange(9.0))
    places = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel() - 1e-16])
    words = f"ball penetrates the sheet by {deep} mm at {place} before the first step; expected "
    with pytest.raises(InputError, match=re.escape(words) + "up to 0.2 mm, .*: start its path"):
        checks.check_start(Tool(surface, name="ball"), places, 0.4, MPI.COMM_SELF)
    lowered = Tool(surface, lambda load: (0, 0, 0.2 - deep), name="ball")  # up to its middle
    checks.check_start(lowered, places, 0.4, MPI.COMM_SELF)
