"""Outlines of sheets in files: tables, drawings, boundaries of meshes."""

import ezdxf
import meshio
import numpy as np
import pytest

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.core.formatting import rounded
from fabric_fenicsx.io.outlines import read_outline
from fabric_fenicsx.sheet.specimen import specimen

CORNERS = [(0, 0), (100, 0), (100, 80), (0, 80)]


@pytest.fixture
def table(tmp_path):
    """Function of a text to the outline in it, `read_outline`."""

    def read(text, name="ply.csv", **options):
        (tmp_path / name).write_text(text)
        return read_outline(tmp_path / name, **options)

    return read


@pytest.fixture
def drawing(tmp_path):
    """Function of a function that draws in a model space, and the unit, to the outline in it."""

    def read(draw, unit=4, **options):
        made = ezdxf.new()
        made.units = unit
        draw(made.modelspace())
        made.saveas(tmp_path / "ply.dxf")
        return read_outline(tmp_path / "ply.dxf", **options)

    return read


def rectangle(space, **attributes):
    space.add_lwpolyline(CORNERS, close=True, dxfattribs=attributes)


@pytest.mark.parametrize(
    "unit, factor, words",
    [(1, 25.4, "inches"), (6, 1000, "met"), (21, 304.800610, "survey"), (0, 1, "no unit")],
)
def test_the_unit_of_a_drawing_counts_and_is_told(drawing, unit, factor, words):
    sheet, (told,) = drawing(rectangle, unit)
    assert sheet.bounds == pytest.approx((0, 0, 100 * factor, 80 * factor))
    sides = " x ".join(rounded(side * factor, 4) for side in (100, 80))
    assert words in told and told.endswith(f"so it is {sides} mm")


@pytest.mark.parametrize("unit, mm", [(4, 1.0), (1, 25.4)])
def test_chords_of_a_circle_are_within_a_hundredth_of_a_millimetre(drawing, unit, mm):
    def draw(space):
        block = space.doc.blocks.new("round")
        block.add_circle((0, 0), 50 / mm)
        space.add_blockref("round", (0, 0), dxfattribs={"xscale": 2, "yscale": 2})

    points = np.array(drawing(draw, unit)[0].exterior.coords)
    off = 100 - np.hypot(*(points[1:] + points[:-1]).T / 2)
    assert 0.002 < off.max() < 0.0101
    assert np.hypot(*points.T) == pytest.approx(np.full(len(points), 100))


def test_columns_are_in_their_units(table):
    sheet, told = table("x [cm],y [m],ring\n0,0,1\n10,0,1\n10,0.08,1\n")
    assert sheet.bounds == (0, 0, 100, 80) and not told


def test_layers_of_a_drawing(drawing):
    def draw(space):
        rectangle(space, layer="CUT")
        space.add_circle((50, 40), 10, dxfattribs={"layer": "HOLE"})
        space.add_line((0, -5), (10, -5), dxfattribs={"layer": "NOTE"})

    with pytest.raises(InputError, match=r"is open .* of its layers CUT, HOLE, NOTE use `layer`"):
        drawing(draw)
    assert drawing(draw, layer="cut")[0].area == pytest.approx(8000)
    assert len(drawing(draw, layer="CUT, HOLE")[0].interiors) == 1

    def framed(space):
        rectangle(space, layer="PART")
        space.add_circle((50, 40), 90, dxfattribs={"layer": "FRAME"})

    with pytest.raises(InputError, match="lines of PART inside those of FRAME: holes, or a part"):
        drawing(framed)
    assert drawing(framed, layer="PART")[0].area == pytest.approx(8000)


def in_block(space, layer="0", inside="0", **how):
    """A hole in a block on a layer."""
    block = space.doc.blocks.new("HOLE")
    block.add_circle((0, 0), 10, dxfattribs={"layer": inside})
    space.add_blockref("HOLE", (50, 40), dxfattribs={"layer": layer, **how})


@pytest.mark.parametrize(
    "state, draw, holes",
    [
        ("freeze", lambda space: space.add_circle((50, 40), 10, {"layer": "OLD"}), 0),
        ("thaw", lambda space: space.add_circle((50, 40), 10, {"invisible": 1}), 0),
        # what is in a frozen block goes with it, not with one whose layer is off
        ("freeze", lambda space: in_block(space, "OLD", "CUT"), 0),
        ("off", lambda space: in_block(space, "OLD", "CUT"), 1),
        # layer 0 of a block is that of its insert
        ("freeze", lambda space: in_block(space, "CUT"), 1),
    ],
)
def test_what_is_not_seen_is_not_cut(drawing, state, draw, holes):
    def whole(space):
        rectangle(space, layer="CUT")
        for layer in (space.doc.layers.add("OLD"), space.doc.layers.get("0")):
            getattr(layer, state)()
        draw(space)

    sheet, told = drawing(whole)
    assert len(sheet.interiors) == holes and not told


def test_an_array_of_a_block(drawing):
    def draw(space):
        rectangle(space)
        in_block(space, column_count=2, column_spacing=-25, row_count=2, row_spacing=25)

    sheet, _ = drawing(draw)
    middles = {tuple(np.round(hole.centroid.coords[0], 6)) for hole in sheet.interiors}
    assert middles == {(25, 40), (25, 65), (50, 40), (50, 65)}


def test_what_is_not_read_is_named(drawing):
    def draw(space):
        rectangle(space)
        space.add_hatch().paths.add_polyline_path([(10, 10), (20, 10), (20, 20)])
        space.add_polyface().append_face([(1, 1, 0), (2, 1, 0), (2, 2, 0)])
        space.doc.blocks.new("elsewhere").block.dxf.flags = 4  # in another file
        space.add_blockref("elsewhere", (0, 0))

    sheet, (told,) = drawing(draw)
    assert sheet.area == pytest.approx(8000)
    assert "has 1 HATCH, 1 INSERT, 1 POLYLINE, not read; expected L" in told
    with pytest.raises(InputError, match="has no lines, but 1 HATCH; expected LINE, "):
        drawing(lambda space: space.add_hatch())


def test_what_is_wrong_in_a_drawing_is_told(drawing, table):
    def gap(space):
        for start, end in zip(CORNERS, [*CORNERS[1:], (0, 1.5)]):
            space.add_line(start, end)

    def steep(space):
        space.add_polyline3d([(0, 0, 0), (100, 0, 0), (100, 80, 50)], close=True)

    with pytest.raises(InputError, match=r"is open at \(0, 0\) mm: .* 1.5 mm away, at \(0, 1.5\)"):
        drawing(gap)
    with pytest.raises(InputError, match="reaches over 50 mm in z"):
        drawing(steep)
    with pytest.raises(InputError, match="cannot be read .* expected a drawing"):
        table("hello\nworld\n", "ply.dxf")


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_the_boundary_of_a_mesh_is_an_outline(tmp_path, cell):
    points, cells, kind = specimen(100, 50, 10, 5, "right", cell)
    middle = points[cells].mean(1)[:, :2]
    left = (abs(middle - [50, 25]) > 12).any(1)
    meshio.write_points_cells(tmp_path / "ply.vtk", points, [(kind, cells[left])])
    sheet, told = read_outline(tmp_path / "ply.vtk")
    assert len(sheet.interiors) == 1 and sheet.area == pytest.approx(5000 - 600) and not told
    points[:, 2] = points[:, 0]
    meshio.write_points_cells(tmp_path / "ply.vtk", points, [(kind, cells)])
    with pytest.raises(InputError, match="reaches over 100 mm in z"):
        read_outline(tmp_path / "ply.vtk")
