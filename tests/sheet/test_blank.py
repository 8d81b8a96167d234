"""Blanks: their cells and yarns, and numbers at cells, nodes and parts."""

import math

import numpy as np
import pytest
import shapely
import ufl
from builders import COMM, near, rotation
from builders import sheet as rectangle
from dolfinx import fem

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.sheet.sources import moved_sheet
from fabric_fenicsx.sheet.specimen import own_model, specimen, yarns_through_corners


@pytest.mark.parametrize("angle, lines", [(0, 0), (45, 4), (100, 4)])
def test_edges_follow_the_yarns_through_the_corners(angle, lines):
    yarns = math.radians(angle)
    points, cells, _ = specimen(200, 50, 40, 10, "yarns", yarns=yarns)
    edges = np.sort(np.stack([cells, np.roll(cells, -1, 1)], 2).reshape(-1, 2), 1)
    edges = points[np.unique(edges, axis=0)][:, :, :2]
    segments = yarns_through_corners(200, 50, yarns)
    assert len(segments) == lines
    for start, end in segments:
        assert set(np.abs(start) / [200, 50]) <= {0.0, 1.0}
        direction = (end - start) / np.linalg.norm(end - start)
        assert math.sin(2 * (math.atan2(*direction[::-1]) - yarns)) == pytest.approx(0, abs=1e-12)
        off = np.abs((edges - start) @ [-direction[1], direction[0]]).max(1)
        covered = np.linalg.norm(np.diff(edges[off < 2e-6], axis=1), axis=2).sum()  # 1e-6 mm: grid
        assert covered == pytest.approx(np.linalg.norm(end - start), rel=1e-7)


def test_diagonals_and_yarns_through_corners():
    for pattern, sums in (("left", [1, 1]), ("right", [0, 2])):
        points, cells, _ = specimen(1, 1, 1, 1, pattern)
        shared = np.intersect1d(*cells)
        assert sorted(points[shared].sum(1)) == sums
    start, end = yarns_through_corners(200, 50, 0.3, 1.0).swapaxes(0, 1)
    angles = np.arctan2(*(end - start).T[::-1]) % math.pi
    assert np.sort(angles) == pytest.approx([0.3, 0.3, 1.3, 1.3])


def test_graded_cells_are_moved_by_a_sine_along_both_diagonals():
    """So cells are smallest across the lines at 45 deg through corners, 0.05 of even ones there."""
    x = specimen(200, 50, 48, 12)[0]
    s, d = ([1, 1] * x[:, :2]).sum(1), ([1, -1] * x[:, :2]).sum(1)
    s, d = (v - 0.95 * 50 / (2 * np.pi) * np.sin(2 * np.pi * v / 50) for v in (s, d))
    points = specimen(200, 50, 48, 12, "graded")[0]
    assert points[:, :2] == pytest.approx(np.column_stack([s + d, s - d]) / 2, abs=1e-9)
    whole, other = (specimen(length, 50, 36, 12, "graded")[0][:, 0] for length in (150, 117))
    assert other == pytest.approx(np.interp(whole, [0, 50, 100, 150], [0, 50, 67, 117]), abs=1e-9)
    with pytest.raises(ff.InputError, match="99 x 50 mm .* 2 widths or more"):
        specimen(99, 50, 48, 12, "graded")


@pytest.mark.versions
@pytest.mark.parametrize("kind", ["triangle6", "quad9"])
def test_curved_cells(tmp_path, kind):
    import gmsh

    options = {"RecombineAll": float(kind == "quad9"), "RecombinationAlgorithm": 3.0}
    with own_model(gmsh, MeshSizeMax=3.0, **options):
        gmsh.model.occ.addDisk(0, 0, 0, 10, 10)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(tmp_path / "disk.msh"))
    blank = ff.Blank.read(tmp_path / "disk.msh")
    assert blank.mesh.geometry.dim == 2 and not blank.warnings
    assert total(1.0 * ufl.dx(blank.mesh)) == pytest.approx(100 * math.pi, rel=1e-3)


@pytest.mark.versions
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_fibres_on_a_curved_blank(cell):
    """Quarter of a cylinder of radius 50 about the y axis, 40 long."""

    def curved(x):
        return np.column_stack([50 * np.sin(x[:, 0]), x[:, 1], 50 * np.cos(x[:, 0])])

    fibres = {"a": (1.0, 0.0, -1.0), "up": (1.0, 0.0, 1.0)}
    blank = rectangle(math.pi / 2, 40, 24, 6, cell=cell, shape=curved, **fibres)
    a, b = (f.x.array.reshape(-1, 3) for f in (blank.a0, blank.b0))
    x = blank.mesh.geometry.x[compat.geometry_dofmap(blank.mesh)].mean(1)
    radial = x * [1, 0, 1] / np.linalg.norm(x * [1, 0, 1], axis=1, keepdims=True)
    assert np.allclose(np.linalg.norm(a, axis=1), 1) and np.allclose(np.linalg.norm(b, axis=1), 1)
    assert np.abs((a * radial).sum(1)).max() < 0.04  # facets of the cylinder
    assert np.allclose(np.cross(a, b)[:, [0, 2]] @ [1, 1] > 0, True)
    assert np.abs((a * b).sum(1)).max() < 1e-12


@pytest.mark.mpi
def test_fibres_from_angle_vector_and_function_agree():
    arrays = specimen(nx=6, ny=3) if COMM.rank == 0 else (None,) * 3
    angle = 0.7
    vector = [math.cos(angle), math.sin(angle)]
    ways = [angle, [3 * v for v in vector] + [0.0], lambda x: np.full(x.shape[1], angle)]
    for a in [*ways, lambda x: np.outer(vector, np.ones(x.shape[1]))]:
        blank = ff.Blank.from_arrays(COMM, *arrays, a=a)
        assert np.allclose(blank.a0.x.array.reshape(-1, 2), vector, atol=1e-15)
        assert np.allclose(blank.b0.x.array.reshape(-1, 2), [-vector[1], vector[0]], atol=1e-15)


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
    right = np.tile(moved, (len(blank.coordinates()), 1))
    assert blank.nodal_displacement() == pytest.approx(right)
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
    given = ff.Tensile(nx=9, ny=6).with_larger_cells((200, 50), times=3)
    assert (given.nx, given.ny) == (3, 2)
    assert ff.Tensile(outline="o.csv", size=4).with_larger_cells((200, 50)).size == 8


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


@pytest.mark.parametrize(
    "options",
    [
        ({"a": (0.11, 0, 1), "spatial": True}, {"a": (0.09, 0, 1), "spatial": True}),
        ({"a": 0.0, "b": 1.5e-3}, {"a": 0.0, "b": 1.3e-3}),
        ({"a": 6.28}, {"a": 6.29}),
        ({"a": (1, 0, 0.9e-6)}, {"a": (1, 0, 1.1e-6)}),
    ],
)
def test_directions_just_allowed_and_just_refused(options):
    kite(**options[0])
    with pytest.raises(ff.InputError, match="fibre direction"):
        kite(**options[1])
    with pytest.raises(ff.InputError, match="`ny` 4500: 1.62e8 cells, .* about 1940 GB"):
        ff.Blank.rectangle(2, 1, nx=9000)
    for angle in (-360, 360):
        ff.Blank.rectangle(2, 1, nx=1, fibre_angle=angle)
    with pytest.raises(ff.InputError, match="from -360 to 360"):
        ff.Blank.rectangle(2, 1, nx=1, fibre_angle=361)


def test_a_strip_that_is_slit_from_end_to_end_is_two_strips():
    strip = {"length": 100, "nx": 20, "pattern": "crossed", "element": "P1", "fibre_angle": 30}
    slit = {"width": 40, "slits": [[[0, 20], [100, 20]]]}
    strips = (ff.BiasExtension(**strip, **how, strain=0.02) for how in (slit, {"width": 20}))
    two, one = (each.job(steps=2).run(pictures=False).rows[-1] for each in strips)
    assert two["reaction_N"] == pytest.approx(2 * one["reaction_N"], rel=1e-9)
    with pytest.raises(ff.InputError, match="along 0 of the 40 mm of `slits`; expected lines"):
        ff.Blank.rectangle(100, 40, nx=10, slits=[[[20, 17], [60, 17]]])


@pytest.mark.parametrize("pattern", ["unstructured", "along"])
def test_cells_of_an_outline_follow_its_slits(pattern):
    """Which open it: all places on them have two nodes, but the ends inside."""
    rim = [[(0, 0), (100, 0), (100, 60), (0, 60)]]
    slits = [[(50, 60), (50, 20), (80, 20)], [(10, 30), (30, 40)]]
    blank = ff.Blank.outline(rim, size=6, pattern=pattern, fibre_angle=20, slits=slits)
    x, count = np.unique(blank.mesh.geometry.x.round(6), axis=0, return_counts=True)
    off = shapely.distance(shapely.MultiLineString(slits), shapely.points(x))
    tips = np.min([np.hypot(*(x[:, :2] - tip).T) for tip in ((80, 20), *slits[1])], axis=0)
    assert (count == 1 + ((off < 1e-6) & (tips > 1e-6))).all() and count.sum() > len(x) + 12
    assert blank.areas().sum() == pytest.approx(6000)


def test_a_sheet_is_moved_by_the_middle_of_its_extent():
    points = np.array([[0, 0, 1], [1, 0, 1], [10, 4, 1 + 0.9e-5]])
    moved, (told,) = moved_sheet(points, "s.msh", True, 5.0)
    assert moved == pytest.approx(np.array([[-5, -2, 5], [-4, -2, 5], [5, 2, 5.0]]))
    assert "lies in z = 1 mm and was moved to z = 5" in told
    with pytest.raises(ff.InputError, match="expected a flat sheet"):
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
