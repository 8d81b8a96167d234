"""Sheets with an outline of their own, their cells, and rings of lines."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
import pyvista
import shapely
from builders import COMM
from shapely import affinity

import fabric_fenicsx as ff
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.io.outlines import joined, mirrored_half, sheet_of
from fabric_fenicsx.sheet import sources
from fabric_fenicsx.sheet.mesh_checks import checked_mesh
from fabric_fenicsx.sheet.sources import PATTERNS, outline_mesh

YARNS = np.radians([30, 120])
NOTCHED = [(0, 0), (200, 0), (200, 60), (180, 60), (180, 80), (200, 80), (200, 150), (0, 150)]
HOLE = shapely.get_coordinates(shapely.Point(60, 90).buffer(15, quad_segs=200))
# with a neck of 0.5 mm between slots, a small hole and a spline's close points
WILD = [(0, 0), (100, 0), (100, 38), (60, 38), (60, 40), (100, 40), (100, 80), (0, 80), (0, 42)]
WILD += [(58, 42), (58, 40.5), (0, 40)]
BOX = shapely.box(0, 0, 100, 100)
SHEETS = {
    "notch and hole": shapely.Polygon(NOTCHED, [HOLE]),
    "slots": shapely.Polygon(WILD, [shapely.Point(30, 20).buffer(1.5, 50).exterior]),
    "ellipse": affinity.scale(shapely.Point(0, 0).buffer(1, 1000), 50, 30),
}


def corners_angles(points, cells):
    """Angles of triangles [deg], (m, 3)."""
    x = points[cells][:, :, :2]
    sides = np.linalg.norm(np.roll(x, -1, 1) - np.roll(x, 1, 1), axis=2)
    p, q, r = sides.T, np.roll(sides.T, -1, 0), np.roll(sides.T, 1, 0)
    return np.degrees(np.arccos((q**2 + r**2 - p**2) / (2 * q * r)))


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("name", SHEETS)
def test_cells_fill_the_sheet_and_are_none_thin(name, pattern):
    points, cells, kind, told = outline_mesh(SHEETS[name], 8.0, pattern, YARNS)
    sheet, _, _, warnings = checked_mesh(points, cells, kind, "it")  # no overlaps, slits, turns
    arms = sheet[cells[:, 1:]] - sheet[cells[:, :1]]
    area = np.linalg.det(arms).sum() / 2
    assert not warnings and area == pytest.approx(SHEETS[name].area, rel=4e-3)
    assert corners_angles(points, cells).min() > 15 and not told
    for corner in NOTCHED if name == "notch and hole" else ():
        assert abs(points[:, :2] - corner).sum(1).min() < 1e-9
    moved = affinity.translate(SHEETS[name], 1234.567, -98.7)  # cells are the same anywhere
    there = outline_mesh(moved, 8.0, pattern, YARNS)[0] - [1234.567, -98.7, 0]
    here, there = (x[np.lexsort(x.round(6).T)] for x in (points, there))
    assert there == pytest.approx(here, abs=1e-8)


@pytest.mark.parametrize("between", [90, 60])
def test_inner_cells_follow_both_yarns(between):
    yarns = np.radians([30, 30 + between])
    points, cells, _, _ = outline_mesh(SHEETS["notch and hole"], 8.0, "along", yarns)
    edges = (np.roll(points[cells], -1, 1) - points[cells])[:, :, :2]
    edges /= np.linalg.norm(edges, axis=2, keepdims=True)
    across = np.stack([-np.sin(yarns), np.cos(yarns)])
    along = (abs(edges @ across) < 1e-9).any(2).any(1)
    middles = shapely.points(points[cells].mean(1))
    inner = ~shapely.dwithin(SHEETS["notch and hole"].boundary, middles, 20)
    assert inner.sum() > 500 and along[inner].all()


def test_squares_that_touch_in_a_corner_alone_are_left_out():
    for angle in range(0, 90, 7):  # some have such squares
        yarns = np.radians([angle, angle + 90])
        points, cells, kind, _ = outline_mesh(SHEETS["slots"], 6.0, "along", yarns)
        checked_mesh(points, cells, kind, "it")


def test_cells_are_of_the_size():
    sheet = shapely.Polygon(NOTCHED)
    cells = outline_mesh(sheet, 8.0)[1]
    assert len(cells) == pytest.approx(sheet.area / (np.sqrt(3) / 4 * 64), rel=0.05)


@pytest.mark.parametrize("side, count", [(108, 8), (112, 10)])
def test_squares_are_half_of_their_size_off_the_outline(side, count):
    """They are of 10 mm about the middle, each of four triangles."""
    box = shapely.box(0, 0, side, side)
    points, cells, *_ = outline_mesh(box, 10.0, "along", (0, np.pi / 2))
    x = points[cells][:, :, :2]
    sides = np.sort(np.linalg.norm(np.roll(x, -1, 1) - x, axis=2), 1)
    assert (abs(sides - [50**0.5, 50**0.5, 10]) < 1e-5).all(1).sum() == 4 * count**2


def test_sizes_at_short_edges_narrow_places_and_curves():
    """They grow by 0.4 of the distance: from 1 to 8 mm over 17.5 mm; 4 mm have two cells across;
    nodes are within 0.02 of the size of a curve."""
    chamfered = shapely.Polygon([(0, 0), (99.4, 0), (100, 0.8), (100, 80), (0, 80)])
    points = outline_mesh(chamfered, 8.0)[0]
    count = (abs(points[:, 1]) < 1e-9).sum() - 1
    assert count == pytest.approx(np.log(8) / 0.4 + (99.4 - 17.5) / 8, abs=1)
    points = outline_mesh(shapely.box(0, 0, 100, 80) - shapely.box(30, 4, 70, 70), 8.0)[0]
    low = np.sort(points[(abs(points[:, 1]) < 1e-9) & (abs(points[:, 0] - 50) < 15), 0])
    assert np.diff(low).mean() == pytest.approx(2 + 0.4 * 2, rel=0.12)
    r = np.hypot(*outline_mesh(shapely.Point(0, 0).buffer(50, 1000), 8.0)[0].T[:2])
    assert r[r > 49].min() > 50 - 0.17


def holed(side):
    return shapely.box(0, 0, 100, 80) - shapely.box(50, 40, 50 + side, 40 + side)


def narrow(width):
    return shapely.box(0, 0, 100, 80) - shapely.box(40, width, 60, 20)


LIMITS = [  # a sheet, size and pattern with what is told of it, and one without
    ((holed(0.79), 8.0), "a hole of 0.", (holed(0.81), 8.0)),
    ((narrow(0.75), 8.0), "the outline is 0.", (narrow(0.82), 8.0)),
    ((narrow(0.0079), 8.0), "comes within 0.", (narrow(0.0081), 8.0)),
    ((SHEETS["ellipse"], 30.1), "expected up to half of it", (SHEETS["ellipse"], 29.9)),
    ((BOX, 0.1519), "mm, about 1e6 cells", (BOX, 0.152)),
    ((BOX, 0.1999, "along"), "mm, about 1e6 cells", (BOX, 0.2001, "along")),
]


@pytest.mark.parametrize("beyond, words, within", LIMITS)
def test_outlines_just_within_and_just_beyond_a_limit(beyond, words, within, monkeypatch):
    for filled in ("_filled", "_along"):  # for time
        monkeypatch.setattr(sources, filled, lambda *_: (np.empty((0, 2)), []))
    for given, is_told in ((beyond, True), (within, False)):
        try:
            told = outline_mesh(*given)[3]
        except InputError as error:
            told = error
        assert (words in str(told)) == is_told


RINGS = [(100, 50), (300, 50), (300, 200), (100, 200)], [(150, 100), (200, 100), (200, 150)]
AREA = 200 * 150 - 50 * 50 / 2


@pytest.fixture
def table(shared_path):
    """A file of `RINGS`."""
    path = shared_path / "ply.csv"
    if COMM.rank == 0:
        rings = ("\n".join(f"{x},{y}" for x, y in ring) for ring in RINGS)
        path.write_text("x,y\n" + "\n\n".join(rings))
    COMM.barrier()
    return path


@pytest.mark.mpi
@pytest.mark.parametrize("pattern", ["unstructured", "along"])
def test_a_sheet_has_its_holes_place_and_yarns(table, pattern):
    made = {"size": 10.0, "pattern": pattern, "fibre_angle": 30}
    for given in table, RINGS:
        blank = ff.Blank.outline(given, **made)
        assert COMM.allreduce(blank.areas().sum()) == pytest.approx(AREA)
        assert np.ravel(blank.extent()) == pytest.approx([100, 50, 300, 200])
        assert blank.straight[0] == pytest.approx([np.cos(np.pi / 6), 0.5])
        assert blank.degree == 2 and not blank.warnings


@pytest.mark.mpi
def test_errors_reach_all_ranks(table):
    crossed = [[(0, 0), (100, 80), (100, 0), (0, 80)]]
    with pytest.raises(ff.InputError, match="bounds no sheet: self-intersect"):
        ff.Blank.outline(crossed)
    for wrong in ({"element": "Q1"}, {"pattern": "crossed"}):
        with pytest.raises(ff.InputError, match=f"`{[*wrong][0]}` is .*; expected .* for an out"):
            ff.Blank.outline(table, **wrong)


@pytest.mark.parametrize(
    "words, area", [("specimen --length 30 --width 20", 600), ("outline ply.csv --size 10", 8000)]
)
def test_flat_meshes_fill_their_outlines(tmp_path, monkeypatch, words, area):
    monkeypatch.chdir(tmp_path)
    Path("ply.csv").write_text("x,y\n0,0\n100,0\n100,80\n0,80\n")
    words = [*words.split(), "--pattern", "along", "--fibre-angle", "30", "made.vtu"]
    monkeypatch.setattr(sys, "argv", words)
    script = Path(__file__).parents[2] / f"meshes/{words[0]}.py"
    runpy.run_path(str(script), run_name="__main__")
    assert pyvista.read("made.vtu").area == pytest.approx(area)


def box(left, right):
    return shapely.box(left, -50, right, 50)


@pytest.mark.parametrize("gap, closes", [(0.009, True), (0.011, False)])
def test_ends_meet_up_to_a_ten_thousandth_of_the_extent(gap, closes):
    lines = [[(0, 0), (100 - gap, 0)], [(100, 0), (100, 50)], [(0, 0), (0, 50), (100, 50)]]
    lines = [np.array(line, float) for line in lines]
    if closes:
        assert shapely.Polygon(joined(lines, "it")[0]).area == pytest.approx(5000, rel=1e-4)
    else:
        with pytest.raises(InputError, match="is open at .* 0.011 mm away.* up to 0.01 mm apart"):
            joined(lines, "it")


def test_the_ring_of_the_largest_area_is_the_outline():
    x = np.repeat(np.linspace(10, 90, 33), 2)  # in and out along a hole, of a longer ring
    teeth = np.column_stack([x, 20 + 50 * (np.arange(66) % 4 // 2)])
    hole = np.vstack([teeth, [[90, 10], [10, 10]]])
    sheet = sheet_of([hole, shapely.get_coordinates(shapely.box(0, 0, 100, 80))], "it")
    assert sheet.area == pytest.approx(8000 - shapely.Polygon(hole).area)


def test_the_middle_of_the_extent_is_centred():
    sheet = ff.Blank.outline([[(0, 0), (4, 0), (0, 2)]], size=0.5, centred=True, comm=COMM)
    assert np.ravel(sheet.extent()) == pytest.approx([-2, -1, 2, 1])


@pytest.mark.parametrize(
    "sheet, half",
    [
        (box(-100, 100), 0),
        (box(-100, 100.39), 0),  # up to twice 0.001 of the extent, from both sides
        (box(-100, 100.41), None),
        (box(-0.09, 100), -0.09),  # begins at the plane
        (box(-0.11, 100), None),
    ],
)
def test_half_of_a_sheet_that_is_its_own_mirror_image(sheet, half):
    if half is None:
        with pytest.raises(InputError, match="is not symmetric about x = 0: .* mm2 differ"):
            mirrored_half(sheet, 0, "it")
    else:
        bounds = mirrored_half(sheet, 0, "it").bounds
        assert bounds == pytest.approx((half, -50, sheet.bounds[2], 50))
        turned = shapely.transform(sheet, lambda x: x[:, ::-1])
        assert mirrored_half(turned, 1, "it").bounds[1] == pytest.approx(half)
