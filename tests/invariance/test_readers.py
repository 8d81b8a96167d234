"""The same outline or surface is read from any spelling of any format: drawn numbers, written in
drawn ways, are read back as they were. Lengths are multiples of 1/8 mm, which all formats hold."""

import locale
import struct

import ezdxf
import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fabric_fenicsx.io import read
from fabric_fenicsx.io.outlines import read_outline

EIGHTH = st.integers(-2400, 2400).map(lambda k: k / 8)
LENGTH = st.integers(8, 400).map(lambda k: k / 8)
FIXED = "{:.3f}", "{:.4f}", "{:+.5f}", "{:.9g}"
NUMBERS = *FIXED, "{:.9e}", "{:.9E}"
CASES = str.lower, str.upper, str.title


def drawn(check, examples, *strategies):
    """Call `check` with numbers of the strategies, and a function that picks one of its
    arguments."""
    how = {"derandomize": True, "deadline": None, "database": None, "max_examples": examples}

    @settings(suppress_health_check=[*HealthCheck], **how)
    @given(st.tuples(*strategies), st.data())
    def once(numbers, data):
        check(*numbers, lambda *some: data.draw(st.sampled_from(some)))

    once()


# -- surfaces


@st.composite
def surfaces(draw):
    """Corners (n, 3) in any order and quadrilaterals (m, 4) of a sheared grid with heights."""
    x, y = (np.cumsum(draw(st.lists(LENGTH, min_size=2, max_size=4))) for _ in "xy")
    i, j = np.indices((len(x), len(y)))
    heights = draw(st.lists(EIGHTH, min_size=i.size, max_size=i.size))
    x, y = x[i] + draw(EIGHTH) + j * draw(LENGTH), y[j] + draw(EIGHTH)
    node = np.array(draw(st.permutations(range(i.size)))).reshape(i.shape)
    quads = np.stack([node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]], -1)
    points = np.empty((i.size, 3))
    points[node.ravel()] = np.column_stack([x.ravel(), y.ravel(), heights])
    return points, quads.reshape(-1, 4)


def rows(pick, points, between=" ", numbers=NUMBERS):
    number = pick(*numbers)
    return [between.join(number.format(each) for each in x) for x in points.tolist()]


def numbered(pick, count):
    """Numbers of nodes or elements, with gaps if so picked."""
    return pick(1, 7) + pick(1, 3) * np.arange(count)


def abaqus(pick, points, cells):
    case, nodes, end = pick(*CASES), numbered(pick, len(points)), pick("\n", "\r\n")
    last = pick("", ",")
    kind = pick(*{3: ("S3", "M3D3", "STRI3"), 4: ("S4R", "M3D4", "R3D4")}[cells.shape[1]])
    words = [case("*Heading"), "a ply", case("*Node")] if pick(0, 1) else [case("*Node, nset=all")]
    exponent = pick("e", "D")
    for node, row in zip(nodes, rows(pick, points, pick(",", ", "))):
        words.append(f"{node}, {row.replace('e', exponent)}{last}")
    words.append(case(f"*Element, type={kind}"))
    for number, cell in zip(numbered(pick, len(cells)), nodes[cells].tolist()):
        words.append(", ".join(map(str, [number, *cell])))
    return end.join(words) + end


def nastran(pick, points, cells):
    form, nodes = pick("free", "small", "large"), numbered(pick, len(points))
    name, lines = {3: "CTRIA3", 4: "CQUAD4"}[cells.shape[1]], pick(["CEND", "BEGIN BULK"], [])
    short = pick(lambda word: word, lambda word: word.replace("0.", ".", 1).rstrip("0") or ".0")
    for node, x in zip(nodes, points.tolist()):
        words = [short(f"{each:.3f}") if abs(each) < 1 else f"{each:.3f}" for each in x]
        if form == "large":
            words = [pick("{:.8E}", "{:.8f}").format(each) for each in x]
            lines.append(f"{'GRID*':8}{node:16d}{'':16}{words[0]:>16}{words[1]:>16}")
            lines.append(f"{'*':8}{words[2]:>16}")
        elif form == "small":
            lines.append(f"GRID    {node:8d}{'':8}" + "".join(f"{word:>8}" for word in words))
        else:
            lines.append(f"GRID,{node},,{','.join(words)}")
    for number, cell in zip(numbered(pick, len(cells)), nodes[cells].tolist()):
        words = [name, number, 1, *cell]
        wide = "".join(f"{each!s:8}" for each in words)
        lines.append(",".join(map(str, words)) if form == "free" else wide)
    return pick("\n", "\r\n").join([*lines, "ENDDATA", ""])


def gmsh(pick, points, cells):
    """Version 2.2."""
    nodes, kind = numbered(pick, len(points)), {3: 2, 4: 3}[cells.shape[1]]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", len(points)]
    lines += [f"{node} {row}" for node, row in zip(nodes, rows(pick, points))]
    lines += ["$EndNodes", "$Elements", len(cells)]
    for number, cell in zip(numbered(pick, len(cells)), nodes[cells].tolist()):
        lines.append(" ".join(map(str, [number, kind, 2, 1, 1, *cell])))
    return pick("\n", "\r\n").join(map(str, [*lines, "$EndElements", ""]))


def vtk(pick, points, cells):
    """A legacy file, of a grid or a surface, in text or binary."""
    sized = np.insert(cells, 0, cells.shape[1], axis=1)
    is_grid, is_binary = pick(0, 1), pick(0, 1)
    kinds = np.full((len(cells), 1), {3: 5, 4: 9}[cells.shape[1]])
    blocks = [(f"POINTS {len(points)} double", points, ">f8")]
    blocks.append((f"{('POLYGONS', 'CELLS')[is_grid]} {len(cells)} {sized.size}", sized, ">i4"))
    blocks += [(f"CELL_TYPES {len(cells)}", kinds, ">i4")] * is_grid
    of = ("POLYDATA", "UNSTRUCTURED_GRID")[is_grid]
    form = ("ASCII", "BINARY")[is_binary]
    data = f"# vtk DataFile Version 3.0\na ply\n{form}\nDATASET {of}\n".encode()
    for head, values, kind in blocks:
        text = "\n".join(" ".join(map(repr, row)) for row in values.tolist())
        body = values.astype(kind).tobytes() if is_binary else text.encode()
        data += f"{head}\n".encode() + body + b"\n"
    return data


def obj(pick, points, cells):
    tail, corner = pick("", " 1.0", " 0.5 0.5 0.5", " 1.0 0.5 0.5 0.5"), pick("{}", "{0}//1")
    lines = ["# a tool", "o tool"] if pick(0, 1) else []
    lines += [f"v {row}{tail}" for row in rows(pick, points)]
    lines += ["vn 0 0 1"] * (corner != "{}")
    shift = pick(1, -len(points))  # numbers from the first point, or back from the last
    lines += [f"f {' '.join(corner.format(k + shift) for k in cell)}" for cell in cells.tolist()]
    return "\n".join([*lines, ""])


def stl(pick, points, cells):
    if pick(0, 1):
        head = pick(b"", b"solid tool").ljust(80, pick(b" ", b"\0")) + struct.pack("<I", len(cells))
        return head + b"".join(struct.pack("<12fH", 0, 0, 1, *x.ravel(), 0) for x in points[cells])
    case, lines = pick(*CASES), ["solid tool"]
    for x in points[cells]:
        vertices = [f"{pick('  ', chr(9))}vertex {row}" for row in rows(pick, x)]
        lines += ["facet normal 0 0 1", "outer loop", *vertices, "endloop", "endfacet"]
    return case(pick("\n", "\r\n").join([*lines, "endsolid tool", ""]))


# how a surface is written, whether quadrilaterals may be, and numbers of examples
SURFACES = [(".inp", abaqus, True, 12), (".bdf", nastran, True, 10), (".msh", gmsh, True, 10)]
SURFACES += [(".vtk", vtk, True, 12), (".obj", obj, True, 10), (".stl", stl, False, 12)]


def in_this_process(work, path):
    """A process of its own takes half a second to start."""
    before = locale.setlocale(locale.LC_ALL)
    found = work(path)
    locale.setlocale(locale.LC_ALL, before)  # VTK leaves another one behind
    if work is read._by_gmsh:
        import gmsh

        gmsh.finalize()
    return found


@pytest.mark.parametrize("name, write, quads, examples", SURFACES)
def test_a_surface_is_read_as_it_was_written(tmp_path, monkeypatch, name, write, quads, examples):
    monkeypatch.setattr(read, "in_child", in_this_process)

    def check(surface, pick):
        points, cells = surface
        if not (quads and pick(0, 1)):
            cells = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
        written = write(pick, points, cells)
        path = tmp_path / f"ply{pick(*CASES)(name)}"
        path.write_bytes(written if isinstance(written, bytes) else written.encode())
        mesh = read.read_surface_mesh(path, "surface file")
        path.unlink()
        ((kind, nodes),) = mesh.cells.items()
        assert kind == {3: "triangle", 4: "quad"}[cells.shape[1]]
        assert len(np.unique(nodes)) == len(points)
        corners = mesh.points[nodes], points[cells]
        found, right = (sorted(x.reshape(len(x), -1).tolist()) for x in corners)
        assert found == right

    drawn(check, examples, surfaces())


# -- outlines


@st.composite
def sheets(draw):
    """Rings (n, 2): a polygon about a place, and perhaps one in it."""
    middle = np.array([draw(EIGHTH), draw(EIGHTH)])

    def ring(least, centre):
        radii = np.array(draw(st.lists(LENGTH, min_size=3, max_size=7))) + least
        angles = 2 * np.pi * np.arange(len(radii)) / len(radii)
        x = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
        return (8 * (centre + x)).round() / 8

    return [ring(130.0, middle), *([ring(2.0, middle)] if draw(st.booleans()) else [])]


def check_outline(path, rings, off=1e-9):
    sheet, _ = read_outline(path)
    path.unlink()
    right = shapely.Polygon(rings[0], rings[1:])
    assert len(sheet.interiors) == len(right.interiors)
    assert sheet.symmetric_difference(right).area <= off * right.area


def test_an_outline_is_read_from_any_table(tmp_path):
    def check(rings, pick):
        delimiter, decimal = pick((";", "."), (";", ","), ("\t", ","), (",", "."))
        unit, factor = pick(("", 1), (" [mm]", 1), (" [cm]", 0.1), (" (m)", 1e-3), (" [um]", 1e3))
        number = pick("{:.7f}", "{:.9f}", "{:.12e}", "{:+.7f}")  # three decimals may be thousands
        order, by_column = pick([0, 1], [1, 0]), pick(0, 1)
        case = pick(str.lower, str.upper)
        quoted = pick("{}", '"{}"') if delimiter in ";,\t" else "{}"
        names = [quoted.format(case("xy"[k]) + unit) for k in order] + ["ring"] * by_column
        has_header = pick(0, 1) or unit or by_column or order == [1, 0]
        lines = pick([], ["# a ply of glass, für Proben"])
        lines += [delimiter.join(names)] if has_header else []
        closed = pick(0, 1)
        for k, ring in enumerate(rings):
            lines += [pick("", delimiter.strip(" "))] if k and not by_column else []
            for x in (factor * np.vstack([ring, ring[:closed]])).tolist():
                cells = [number.format(x[axis]).replace(".", decimal) for axis in order]
                lines.append(delimiter.join(cells + [str(k)] * by_column))
        path = tmp_path / f"ply{pick('.csv', '.CSV', '.txt', '.Txt')}"
        text = pick("\n", "\r\n").join(lines) + pick("", "\n")
        path.write_bytes(text.encode(pick("utf-8", "utf-8-sig", "cp1252")))
        check_outline(path, rings)

    drawn(check, 80, sheets())


def closed(space, ring, pick):
    space.add_lwpolyline(ring.tolist(), close=True)


def old(space, ring, pick):
    space.add_polyline2d(ring.tolist(), close=True)


def lines(space, ring, pick):
    ends = [*zip(ring.tolist(), np.roll(ring, -1, 0).tolist())]
    for start, end in ends[:: pick(1, -1)]:
        start, end = pick((start, end), (end, start))
        space.add_line(start, end)


def block(space, ring, pick):
    """In two blocks, turned and scaled."""
    inner, outer = (space.doc.blocks.new(f"{name}{len(space.doc.blocks)}") for name in "ab")
    inner.add_lwpolyline((ring * [-0.5, 2]).tolist(), close=True)
    outer.add_blockref(inner.name, (3, 4), {"xscale": -2, "yscale": 0.5, "rotation": 0})
    space.add_blockref(outer.name, (4, -3), {"rotation": 90})
    return lambda x: x @ np.array([[0, 1], [-1, 0]])


def spline(space, ring, pick):
    """Of first degree, whose knots begin anywhere."""
    x = np.vstack([ring, ring[:1]])
    made = space.add_spline(degree=1)
    made.control_points = np.pad(x, ((0, 0), (0, 1)))
    start = pick(0.0, -2.0, 5.0)
    made.knots = start + np.r_[pick(0, -1), np.arange(len(x)), len(x) - pick(0, 1)]


def mirrored(space, ring, pick):
    """Drawn from below."""
    below = {"extrusion": (0, 0, -1)}
    space.add_lwpolyline((ring * [-1, 1]).tolist(), close=True, dxfattribs=below)


UNITS = {1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1e3, 10: 914.4, 14: 100.0, 22: 1e5 / 3937}
DRAWINGS = [closed, old, lines, block, spline, mirrored]


@pytest.mark.parametrize("draw", DRAWINGS)
def test_an_outline_is_read_from_any_drawing(tmp_path, draw):
    def check(rings, pick):
        unit = pick(*UNITS)
        made = ezdxf.new(pick("R2000", "R2010", "R2018"), units=unit)
        moves = [draw(made.modelspace(), ring / UNITS[unit], pick) for ring in rings]
        path = tmp_path / f"ply{pick('.dxf', '.DXF')}"
        made.saveas(path, fmt=pick("asc", "bin"))
        rings = [ring if move is None else move(ring) for ring, move in zip(rings, moves)]
        check_outline(path, rings, 1e-6)

    drawn(check, 8, sheets())


def circle(space, middle, r, pick):
    space.add_circle(middle, r)


def arcs(space, middle, r, pick):
    for start in (0, 120, 240):
        space.add_arc(middle, r, start, start + 120)


def bulges(space, middle, r, pick):
    ends = [(middle[0] - r, middle[1], 1), (middle[0] + r, middle[1], 1)]
    space.add_lwpolyline(ends, format="xyb", close=True)


def ellipse(space, middle, r, pick):
    space.add_ellipse(middle, (0, r), 1.0)


def nurbs(space, middle, r, pick):
    """A rational spline through four quarters."""
    x = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
    made = space.add_spline(degree=2)
    made.control_points = [(middle[0] + r * a, middle[1] + r * b, 0) for a, b in x]
    made.weights = [1, 0.5**0.5] * 4 + [1]
    made.knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]


@pytest.mark.parametrize("draw", [circle, arcs, bulges, ellipse, nurbs])
def test_a_circle_is_one_however_it_is_drawn(tmp_path, draw):
    def check(x, y, r, pick):
        unit = pick(*UNITS)
        made = ezdxf.new(units=unit)
        draw(made.modelspace(), (x / UNITS[unit], y / UNITS[unit]), r / UNITS[unit], pick)
        path = tmp_path / f"ply{pick('.dxf', '.Dxf')}"
        made.saveas(path)
        sheet, _ = read_outline(path)
        off = np.linalg.norm(np.array(sheet.exterior.coords) - [x, y], axis=1) - r
        assert abs(off).max() < 1e-8
        assert np.pi * r**2 >= sheet.area >= np.pi * (r - 0.01) ** 2

    drawn(check, 8, EIGHTH, EIGHTH, LENGTH)
