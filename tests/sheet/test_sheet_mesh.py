"""Numbers at the cells, nodes and parts of a sheet, of few cells of unequal area."""

import math

import numpy as np
import pytest
from builders import COMM, near, rotation
from builders import sheet as rectangle
from dolfinx import fem

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.sheet.sources import moved_sheet

KITE = np.array([[0, 0], [4, 0], [0, 2], [-1, 0]], float)  # triangles of 4 and 1 mm2


def kite(**options):
    return ff.Blank.from_arrays(COMM, KITE, [[0, 1, 2], [0, 2, 3]], "triangle", **options)


def node(blank, *place):
    (at,) = np.flatnonzero((abs(blank.coordinates()[:, :2] - place) < 1e-9).all(1))
    return at


def total(form):
    return fem.assemble_scalar(compat.form(form))


def test_a_turned_sheet_lies_and_has_its_yarns_from_its_own_length_on():
    turned, angles = 0.4, {"fibre_angle": 30, "yarn_angle": 70}
    blank = ff.Blank.rectangle(100, 50, nx=2, turned=turned, **angles)
    rad = turned + np.radians([30, 100])
    assert np.transpose(blank.straight) == pytest.approx(np.array([np.cos(rad), np.sin(rad)]))
    assert np.ravel(blank.extent()) == pytest.approx([0, 0, 100, 50])
    node(blank, 100 * math.cos(turned), 100 * math.sin(turned))
    assert blank.diameter() == pytest.approx(math.hypot(100, 50))
    blank.u.interpolate(lambda x: np.array([[2.0], [0.5]]) + 0 * x[:2])
    moved = [2 * math.cos(0.4) - 0.5 * math.sin(0.4), 2 * math.sin(0.4) + 0.5 * math.cos(0.4)]
    assert blank.nodal_displacement() == pytest.approx(
        np.tile(moved, (len(blank.coordinates()), 1))
    )
    own = ff.Field(lambda x, y: 10 + x + 2 * y)
    fan = ff.Blank.rectangle(4, 2, nx=2, turned=0.4, fibre_angle=own, centred=True)
    x, y = fan.centres().T[:2]
    rad = 0.4 + np.radians(10 + x + 2 * y)
    a = fan.a0.x.array.reshape(-1, 2)
    assert a == pytest.approx(np.column_stack([np.cos(rad), np.sin(rad)]))
    assert np.ravel(fan.extent()) == pytest.approx([-2, -1, 2, 1])


def test_cells_follow_the_yarns_in_the_middle():
    fan = ff.Field(lambda x, y: 0.4 * x)
    for centred, middle in ((False, 20), (True, 0), ([False, True], 20)):
        made = {"pattern": "along", "fibre_angle": fan, "centred": centred}
        corners = ff.Blank.rectangle(100, 60, nx=20, **made).corners()
        edges = (np.roll(corners, -1, 1) - corners).reshape(-1, 2)
        eighths = (np.degrees(np.arctan2(*edges.T[::-1])) - middle) / 45
        assert (abs(eighths - eighths.round()) < 1e-6).mean() > 0.5
    outline = [[(0, 0), (100, 0), (100, 60), (0, 60)]]
    made = {"pattern": "along", "fibre_angle": 20, "turned": 0.3, "size": 8.0}
    assert ff.Blank.outline(outline, **made).whole.share_off_the_yarns() < 0.5


def test_defaults_of_cells():
    blank = ff.Blank.rectangle(40, 20, nx=4)
    assert (blank.degree, len(blank.areas())) == (2, 4 * 4 * 2)
    tall = ff.Blank.outline([[(0, 0), (40, 0), (40, 100), (0, 100)]], nx=4)
    x = tall.mesh.geometry.x
    assert sorted(x[abs(x[:, 1]) < 1e-9, 0]) == pytest.approx([0, 10, 20, 30, 40])
    given = ff.Tensile(nx=9, ny=6).coarser((200, 50), times=3)
    assert (given.nx, given.ny) == (3, 2)
    assert ff.Tensile(outline="o.csv", size=4).coarser((200, 50)).size == 8


@pytest.mark.parametrize("spatial", [False, True])
def test_area_ratios_along_turned_axes(spatial):
    turn = rotation(1) if spatial else np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    blank = rectangle(2, 1, 1, 1, "right", turn=turn, spatial=spatial, degree=1)

    def stretched(x):
        s, t = blank.along(x)[:2]
        return [0.3 * s + 0.2 * t, 0.1 * t] + [0.75 * t] * spatial

    blank.u.interpolate(stretched)
    ratio = np.linalg.norm(np.cross([1.3, 0, 0], [0.2, 1.1, 0.75 * spatial]))
    assert blank.area_ratios() == pytest.approx([ratio, ratio])
    assert blank.areas() == pytest.approx([1, 1])


def test_growth_is_by_area_and_of_the_present_displacement():
    blank = kite()
    for far, grown in ((8, 9 / 5), (5, 6 / 5)):  # of 4 mm2 beside 1 mm2
        blank.u.x.array[2 * node(blank, 4, 0)] = far - 4
        growth = blank.whole.growth()
        assert growth[node(blank, 0, 0)] == pytest.approx(grown)
        assert growth[node(blank, 4, 0)] == pytest.approx(far / 4)
        assert growth[node(blank, -1, 0)] == pytest.approx(1)
    flat = kite(degree=2).whole
    areas = {(4, 0): 4 / 12, (0, 0): 5 / 12, (0, 1): 5 / 4, (2, 1): 1.0, (-0.5, 1): 1 / 4}
    found = [flat.flat_areas()[node(flat.blank, *place)] for place in areas]
    assert found == pytest.approx([*areas.values()])
    blank.u.x.array[2 * node(blank, 4, 0)] = 0
    blank.divide({"small": lambda x: x[0] < 0}, "large")
    blank.u.x.array[2 * node(blank, -1, 0)] = -1
    assert blank.part("small").growth()[node(blank, 0, 0)] == pytest.approx(2)
    assert blank.part("large").growth() == pytest.approx(np.ones(4))
    assert total(1.0 * blank.part("small").dx()) == pytest.approx(1)
    for name, length in (("small", 1), ("large", 4)):
        assert total(1.0 * blank.part(name).ds(near(1, 0.0))) == pytest.approx(length)


def test_the_area_of_cells_that_are_turned_over():
    blank = kite()
    at = 2 * node(blank, 4, 0)
    for to, area in ((0.1, 0), (-0.1, 4)):
        blank.u.x.array[at] = to - 4
        assert total(blank.inverted_area()) == pytest.approx(area)
    assert sorted(blank.cell_means(blank.coordinates()[:, 0])) == pytest.approx([-1 / 3, 4 / 3])


@pytest.mark.parametrize("element, count", [("P1", 1), ("P2", 4), ("Q1", 2)])
def test_flat_triangles_are_all_of_a_cell(element, count):
    blank = ff.Blank.rectangle(4, 2, nx=2, ny=2, element=element, spatial=True)
    x = blank.coordinates()[blank.triangles()]
    areas = np.linalg.norm(np.cross(x[:, :, 1] - x[:, :, 0], x[:, :, 2] - x[:, :, 0]), axis=2) / 2
    assert areas == pytest.approx(np.tile(blank.areas()[:, None] / count, count))
    assert x.mean(2).mean(1) == pytest.approx(blank.centres())  # so they do not overlap
    distinct = np.unique(x.mean(2).reshape(-1, 3).round(9), axis=0)
    assert len(distinct) == count * len(areas)


@pytest.mark.parametrize(
    "angles, columns, off",
    [
        ((0.9, 90.0), 10, 0.0),  # within 1 deg
        ((1.1, 90.0), 10, 1.0),
        ((0.0, 60.0), 10, 1.0),  # along yarns a alone
        ((0.0, 90.0), 5, 17 / 40),  # of the next column's cells one does not touch these
        ((0.0, 90.0), 4, 21 / 40),
    ],
)
def test_cells_follow_their_yarns_up_to_half_of_them_off(angles, columns, off):
    def yarns(angle):
        return lambda x: np.radians(angle + 20 * (x[0] > 10 * columns))

    a, b = angles
    made = rectangle(100, 10, 10, 1, spatial=True, degree=None, a=yarns(a), b=yarns(a + b))
    assert made.whole.share_off_the_yarns() == pytest.approx(off)
    assert made.whole.follows_yarns() == (off < 0.5) == (made.degree == 1)


def sine(length):
    """A direction in space with a part so long within the plane."""
    return (length, 0.0, math.sqrt(1 - length**2))


@pytest.mark.parametrize(
    "options",
    [
        ({"a": sine(0.11), "spatial": True}, {"a": sine(0.09), "spatial": True}),
        ({"a": 0.0, "b": 1.5e-3}, {"a": 0.0, "b": 1.3e-3}),
        ({"a": 6.28}, {"a": 6.29}),
        ({"a": (1, 0, 0.9e-6)}, {"a": (1, 0, 1.1e-6)}),
    ],
)
def test_directions_just_allowed_and_just_refused(options):
    kite(**options[0])
    with pytest.raises(ff.InputError, match="fibre direction"):
        kite(**options[1])
    for angle in (-360, 360):
        ff.Blank.rectangle(2, 1, nx=1, fibre_angle=angle)
    with pytest.raises(ff.InputError, match="from -360 to 360"):
        ff.Blank.rectangle(2, 1, nx=1, fibre_angle=361)


def test_a_sheet_is_moved_by_the_middle_of_its_extent():
    points = np.array([[0, 0, 1], [1, 0, 1], [10, 4, 1 + 0.9e-5]])
    moved, (told,) = moved_sheet(points, "s.msh", True, 5.0)
    assert moved == pytest.approx(np.array([[-5, -2, 5], [-4, -2, 5], [5, 2, 5.0]]))
    assert "lies in z = 1 mm and was put in z = 5" in told
    with pytest.raises(ff.InputError, match="allowed is a flat sheet"):
        moved_sheet(points + 2e-6 * np.eye(3)[[0, 0, 2]], "s.msh", False, 5.0)
    for off, doubts in ((0.9e-5, 0), (1.1e-5, 1)):
        assert len(moved_sheet(points, "s.msh", False, 1 - off)[1]) == doubts


@pytest.mark.parametrize("drawn", [0.0, 0.5, 1.0])
def test_points_drawn_towards_the_centre_of_a_cell(drawn):
    """The second moment of the reference triangle about its centre is 1/36."""
    blank = kite()
    points, weights = compat.quadrature(blank.mesh, 2, drawn)
    assert weights @ points == pytest.approx([1 / 6, 1 / 6])
    assert weights @ (points[:, 0] - 1 / 3) ** 2 == pytest.approx(drawn**2 / 36)
    blank.u.x.array[2 * node(blank, 4, 0)] = 3.0
    inside, outside = compat.values_at(blank.u, np.array([[2.0, 0.5, 0], [3, 3, 0]]))
    assert inside == pytest.approx([1.5, 0]) and np.isnan(outside).all()
