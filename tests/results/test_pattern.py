"""The flat pattern of trimmed plies whose flat shapes are known."""

import ezdxf
import made_results
import numpy as np
import pytest
import pyvista
import shapely

from fabric_fenicsx.cli import main
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.io.outlines import read_outline, read_trim_line
from fabric_fenicsx.results.pattern import Plane, edge_distance, flat_pattern, write_pattern
from fabric_fenicsx.results.ply import SYMMETRIC
from fabric_fenicsx.results.states import save
from fabric_fenicsx.sheet.specimen import specimen

RADIUS = 50.0
SQUARE = np.array([[-20.0, -10, 0], [20, -10, 0], [20, 10, 0], [-20, 10, 0], [-20, -10, 0]])


def rolled(x):
    """Places (n, 3) of a ply, flat in (n, 3), that is rolled on a cylinder along y."""
    angle = x[:, 0] / RADIUS
    return np.column_stack([RADIUS * np.sin(angle), x[:, 1], RADIUS * (np.cos(angle) - 1)])


def folded(x):
    return np.column_stack([abs(x[:, 0]), x[:, 1], 0.2 * x[:, 0]])


def dense(line):
    """A line with points each 0.5 mm, so that it can follow a ply."""
    line = shapely.segmentize(shapely.LineString(line), 0.5)
    return shapely.get_coordinates(line, include_z=True)


def ply(form=np.array, low=(-60.0, -40.0), nx=40, symmetric=()):
    """A ply from `low` to (60, 40), formed by a function of flat places."""
    size = np.array([60.0, 40.0]) - low
    points, cells, _ = specimen(*size, nx, nx, "crossed")
    x = np.pad(points[:, :2] - points[:, :2].min(0) + low, ((0, 0), (0, 1)))
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: cells}, x)
    grid.point_data["u"] = form(x) - x
    grid.cell_data["number"] = np.arange(float(len(cells)))
    grid.field_data[SYMMETRIC] = list(symmetric)
    return grid


def test_the_pattern_of_a_flat_ply_is_the_trim_line():
    """A ring inside is a hole."""
    pattern = flat_pattern(ply(), [SQUARE, SQUARE / 2], 0.1)
    assert (pattern.net.area, pattern.net.length) == pytest.approx((600, 180))
    assert len(pattern.net.interiors) == 1
    pattern = flat_pattern(ply(), [SQUARE], 0.1)
    assert pattern.net.equals_exact(pattern.net.envelope, 1e-9, normalize=True)
    assert (pattern.net.area, pattern.net.length) == pytest.approx((800, 120), rel=1e-12)
    assert pattern.formed_area == pytest.approx(800, rel=1e-12)


@pytest.mark.versions
def test_cells_are_split_along_the_line_and_keep_their_fields():
    grid, line = ply(), SQUARE + [0.3, 0.2, 0]
    part = flat_pattern(grid, [line], 0.1).part
    centres = part.x[part.cells].mean(1)
    assert np.array_equal(grid.find_containing_cell(centres), part.fields["number"])
    assert part.x.min(0) == pytest.approx(line.min(0)) and len(part.x) > 400


@pytest.mark.versions
@pytest.mark.parametrize("half, error", [(30.0, 1e-9), (30.7, 5e-4)])  # at nodes, between them
def test_a_plane_cuts_a_rolled_ply_to_a_rectangle(half, error):
    depth = RADIUS * (np.cos(half / RADIUS) - 1)
    pattern = flat_pattern(ply(rolled), Plane((0, 0, depth), (0, 0, 1)), 0.1)
    assert pattern.net.bounds == pytest.approx((-half, -40, half, 40), rel=error)
    assert pattern.net.area == pytest.approx(2 * half * 80, rel=error)
    assert pattern.net.length == pytest.approx(4 * half + 160, rel=error)
    assert pattern.formed_area == pytest.approx(pattern.net.area, rel=1e-3)


def test_an_oblique_plane_cuts_a_rolled_ply_along_a_cosine():
    """On z = m y - 20: R (cos(x / R) - 1) = m y - 20."""
    m = 0.2
    pattern = flat_pattern(ply(rolled), Plane((0, 0, -20), (0, -m, 1)), 0.1)
    x, y = np.array(pattern.net.exterior.coords).T
    inside = (abs(x) < 59.9) & (abs(y) < 39.9)
    assert inside.sum() > 40
    assert m * y[inside] == pytest.approx(rolled(np.c_[x, y])[inside, 2] + 20, abs=0.06)


@pytest.mark.versions
def test_a_line_on_a_rolled_ply_unrolls():
    t = np.linspace(0, 2 * np.pi, 721)
    flat = np.column_stack([40 * np.cos(t), 30 * np.sin(t), 0 * t])
    pattern = flat_pattern(ply(rolled, nx=60), [rolled(flat)], 0.1)
    assert pattern.net.area == pytest.approx(np.pi * 1200, rel=2e-4)
    x, y = np.array(pattern.net.exterior.coords).T
    assert np.hypot(x / 40, y / 30) == pytest.approx(1, abs=1e-3)
    assert 0.001 < pattern.off < 0.01  # the ply's facets are below the cylinder


@pytest.mark.parametrize("trim", [Plane((0, 0, -10), (0, 0, 1)), [rolled(dense(SQUARE))]])
def test_a_quarter_has_the_pattern_of_the_whole_ply(trim):
    quarter = flat_pattern(ply(rolled, low=(0.0, 0.0), nx=20, symmetric=(0, 1)), trim, 0.2)
    full = flat_pattern(ply(rolled), trim, 0.2)
    assert quarter.net.bounds == pytest.approx(full.net.bounds, abs=1e-3)
    assert quarter.net.area == pytest.approx(full.net.area, rel=1e-4)
    assert quarter.formed_area == pytest.approx(full.formed_area, rel=1e-4)


@pytest.mark.parametrize(
    "form, trim, words",
    [
        (np.array, [SQUARE + [0, 0, 0.51]], "0.51 mm away from the ply .* expected up to 0.5 mm"),
        (np.array, [SQUARE * 3.01], r"leaves the ply at \(-?60.2, .*\) mm; "),
        (np.array, [SQUARE[[0, 2, 1, 3, 0]]], r"bounds no sheet: self-intersection at \(0, 0\) mm"),
        (np.array, Plane((0, 0, 3), (0, 0, 2)), "which lies from -3 to -3 mm before it"),
        (folded, [SQUARE[:, :2] + [25, 0]], "overlaps itself, .*; expected a trim line with"),
    ],
)
def test_other_lines_are_not_allowed(form, trim, words):
    with pytest.raises(InputError, match=words):
        flat_pattern(ply(form), trim, 0.5)
    flat_pattern(ply(), [SQUARE + [0, 0, 0.49]], 0.5)


@pytest.mark.versions
def test_files_are_blanks_again(tmp_path):
    """The drawing has, beside the lines, the ply's name, its sizes, and an arrow along yarns a,
    here at 30 deg."""
    grid, c, s = ply(rolled), np.cos(np.pi / 6), 0.5
    turn = grid.cell_centers().points[:, 0] / RADIUS
    grid.cell_data["a"] = np.column_stack([c * np.cos(turn), s + 0 * turn, -c * np.sin(turn)])
    pattern = flat_pattern(grid, [rolled(dense(SQUARE)), rolled(dense(SQUARE / 2))], 0.5)
    drawing, table, part = write_pattern(tmp_path / "net", pattern, {"number": "-"}, "ply 2")
    for file in (drawing, table):
        sheet, told = read_outline(file)
        assert sheet.equals_exact(pattern.net, 1e-5, normalize=True) and not told
    drawn = [*ezdxf.readfile(drawing).modelspace()]
    lines = {e.dxf.layer: e.closed for e in drawn if e.dxftype() == "LWPOLYLINE"}
    assert lines == {"OUTLINE": True, "HOLES": True}
    others = {(e.dxf.layer, e.dxftype()): e for e in drawn if e.dxftype() != "LWPOLYLINE"}
    assert others["TEXT", "TEXT"].dxf.text == "ply 2"
    tip, end, *_ = (np.array([*x]) for x in others["YARNS", "LEADER"].vertices)
    assert (tip - end) / np.linalg.norm(tip - end) == pytest.approx([c, s, 0], abs=1e-3)
    sizes = [e.get_measurement() for e in drawn if e.dxf.layer == "DIMENSIONS"]
    assert sizes == pytest.approx([40, 20], abs=0.01)
    formed = pyvista.read(part)
    assert formed.points - formed["u_mm"] == pytest.approx(formed["flat_mm"])
    assert formed.area == pytest.approx(pattern.formed_area) and "number" in formed.cell_data


@pytest.mark.parametrize("head", ["x,y,z\n", "", "z [cm],y [cm],x [cm]\n"])
def test_trim_lines_of_tables_and_drawings(tmp_path, head):
    ring = SQUARE[:4] + [0, 0, 7]
    rows = ring[:, ::-1] / 10 if "cm" in head else ring
    (tmp_path / "trim.csv").write_text(head + "\n".join(f"{a},{b},{c}" for a, b, c in rows))
    (line,), told = read_trim_line(tmp_path / "trim.csv")
    assert line == pytest.approx(SQUARE + [0, 0, 7]) and not told
    for high in (0, 1):
        drawing = ezdxf.new(units=4)
        drawing.modelspace().add_polyline3d(SQUARE + np.outer([0, 1, 2, 3, 0], [0, 0, high]))
        drawing.saveas(tmp_path / "trim.dxf")
        (line,), told = read_trim_line(tmp_path / "trim.dxf")
        assert line[3] == pytest.approx([-20, 10, 3] if high else [-20, 10])
        assert ["is projected along z" in words for words in told] == (1 - high) * [True]


def test_the_command(tmp_path, capsys):
    """Of a rolled ply in the folder of a run; the line is 0.3 mm beside two of the four sides."""
    (tmp_path / "fields").mkdir()
    save(tmp_path / "fields/0000_0.vtu", ply(rolled), {"u": "mm"})
    (tmp_path / "fields.pvd").write_text(
        '<VTKFile type="Collection"><Collection>'
        '<DataSet timestep="1" part="0" file="fields/0000_0.vtu"/></Collection></VTKFile>'
    )
    line = np.array([(-60, -40.3, 0), (60, -40.3, 0), (60, 40.3, 0), (-60, 40.3, 0)])
    file = str(tmp_path / "line.csv")
    ring = rolled(dense(line[[*range(4), 0]]))
    np.savetxt(file, ring, delimiter=",", header="x,y,z", comments="")
    for words, status, told in (
        (["--plane", "z=-10", "--out", "no/where"], 2, "no/where.dxf can't be read or written"),
        (["--line", file, "--edge"], 0, "trim line, 0.18"),
        (["--plane", "-10,0,0,1,0,0"], 0, "area 5605"),  # begins with a minus
        (["--plane", "z=-10"], 2, "pattern.dxf exists already; use another file"),
        (["--plane", "z=-10", "--overwrite"], 0, "pattern.dxf, .csv, .vtu: area 5146"),
    ):
        before = {*tmp_path.glob("pattern*")}
        assert main.main(["pattern", str(tmp_path), *words]) == status
        assert told in "".join(capsys.readouterr())
        assert status == 0 or before == {*tmp_path.glob("pattern*")}
    assert {each.suffix for each in tmp_path.glob("pattern.*")} == {".dxf", ".csv", ".vtu"}


def test_distances_of_the_edge_are_both_ways_and_by_length():
    """A ply 100.5 x 10 mm with 50 short cells at its low end, 0.5 mm beside a line there; then the
    line has a spur of 5 mm in space."""
    grid = made_results.strip([0.01] * 50 + [100])
    x = grid.coordinates()
    cells = grid.triangles(grid.whole.cells).reshape(-1, 3)
    ply = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: cells}, x)
    ply.point_data["u"] = 0 * x
    ring = np.array([(0.5, 0, 0), (100.5, 0, 0), (100.5, 10, 0), (0.5, 10, 0), (0.5, 0, 0)])
    mean = (10 * 0.5 + 2 * 0.5 * 0.25) / 221
    assert edge_distance(ply, [ring]) == pytest.approx((0.5, mean), rel=0.01)
    spur = np.array([(100.5, 4, 0), (100.5, 4, 5.0)])
    assert edge_distance(ply, [ring, spur]) == pytest.approx((5.0, mean), rel=0.01)
    assert edge_distance(ply, [ring[:, :2]]) == pytest.approx((0.5, mean), rel=0.01)
