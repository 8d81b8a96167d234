"""Outlines of sheets, closed rings of lines in a plane, and their files: polygons in CSV, drawings
in DXF, boundaries of meshes."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ..core.errors import InputError
from ..core.files import check_file, ending
from ..core.formatting import coordinates, rounded
from ..core.graph import connected
from .read import read_surface_mesh
from .text_tables import columns_of, read_lines, table_of
from .units import factors

ALLOWED = "a drawing (.dxf), a table of x and y (.csv, .txt), or a mesh"
CURVES = "LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE"  # of DXF
TABLES = ".csv", ".txt", ".xy"
PLANE_TOLERANCE = 1e-6  # extent in z over the others, below which lines lie in a plane
MIRROR_TOLERANCE = 1e-3  # of its extent, by which a sheet may differ from its mirror image


def read_outline(path: Path | str, layer: str | None = None) -> tuple[shapely.Polygon, list[str]]:
    """The sheet that a file's rings bound [mm], and what to say of it, a sentence each.

    The largest ring is the outline, those in it are holes. A table (.csv) has columns x and y, and
    blank lines or a column `ring` between rings. Of a drawing (.dxf) all lines of its `layer`
    count, or of several with commas between them, by default of all that are visible; of any other
    file, a mesh, the boundary.
    """
    path, notes, hint, names = Path(path), [], "", [""]
    source = f"outline {path}"
    check_file(path, "outline", ALLOWED)
    if ending(path) == ".dxf":
        lines, names, notes, hint = _drawing(path, source, layer)
    elif layer is not None:
        raise InputError(f"`layer` is allowed only for a .dxf, not for {source}")
    elif ending(path) in TABLES:
        return sheet_of(_table(path, source), source), []
    else:
        lines = _boundary(path)
    size = np.ptp(np.concatenate(lines), axis=0)
    if size[2] > PLANE_TOLERANCE * size.max():
        raise InputError(
            f"{source} reaches over {rounded(size[2])} mm in z; expected a plane z = const"
        )
    try:
        sheet = sheet_of(joined([line[:, :2] for line in lines], source), source)
    except InputError as error:
        raise InputError(f"{error}{hint}") from None
    if layer is None and len(set(names)) > 1:
        places = shapely.points([line[len(line) // 2, :2] for line in lines])
        is_rim = shapely.distance(sheet.exterior, places) < PLANE_TOLERANCE * size.max()
        rim = {name for name, is_on in zip(names, is_rim) if is_on}
        inside = sorted({name for name in names if not re.search("hole", name, re.I)} - rim)
        if inside:
            flaw = f"has lines of {', '.join(inside)} inside those of {', '.join(rim)}: holes, or a"
            flaw += " part in its drawing frame; expected `layer` with the layers that count"
            raise InputError(f"{source} {flaw}")
    return sheet, notes


def read_trim_line(path: Path | str) -> tuple[list[np.ndarray], list[str]]:
    """Lines in space (n, 3) [mm], or (n, 2) without z, that a file's trim line consists of, and
    what to say of it: a table of `read_outline` that may have a column z, or all that is visible of
    a drawing, without z if that is the same all over."""
    path, notes = Path(path), []
    source, allowed = f"trim line {path}", "a table of x, y and z (.csv, .txt), or a drawing (.dxf)"
    check_file(path, "trim line", allowed)
    if ending(path) in TABLES:
        lines = [np.vstack([ring, ring[:1]]) for ring in _table(path, source, ("x", "y", "z"))]
    elif ending(path) == ".dxf":
        lines, _, notes, _ = _drawing(path, source, None)
        size = np.ptp(np.concatenate(lines), axis=0)
        if size[2] <= PLANE_TOLERANCE * size.max():
            lines = [line[:, :2] for line in lines]
    else:
        raise InputError(f"{source} is of another format; expected {allowed}")
    if lines[0].shape[1] == 2:
        notes.append(f"{source} has no z and is projected along z")
    return lines, notes


def _table(path, source, names=("x", "y")):
    """The rings of a table, (n, 2) or with z, if it has that and it is asked for, (n, 3)."""
    try:
        lines = read_lines(path)
        table = table_of(lines, ("x", "y", "X", "Y").__contains__, names)
        table = table._replace(names=[name.lower() for name in table.names])
        units = dict.fromkeys(names, {None: 1.0} | factors("length")) | {"ring": {None: 1.0}}
        columns = columns_of(table, units, ("z", "ring"))
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    # a comment is no blank line
    blank = [not text.strip(" ,;\t") for text in lines]
    block = np.cumsum(blank)[np.array(table.rows) - 1]
    keys = np.column_stack([block, columns.get("ring", 0 * block)])
    _, first, of = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    points = np.column_stack([columns[name] for name in names if name in columns])
    return [points[of.ravel() == k] for k in np.argsort(first).argsort()]


def _drawing(path, source, layer):
    """Lines (n, 3) of a drawing [mm], the layer of each, sentences on its unit if that is not mm
    and on what is not read, and what to add to errors."""
    from ezdxf import readfile, recover
    from ezdxf.lldxf.const import DXFError
    from ezdxf.math import Matrix44

    try:
        if path.read_bytes().startswith(b"AutoCAD Binary DXF"):  # which `recover` does not know
            drawing = readfile(path)
            auditor = drawing.audit()
        else:
            drawing, auditor = recover.readfile(path)
    except (DXFError, OSError, ValueError) as error:
        raise InputError(f"{source} cannot be read ({error!r}); expected {ALLOWED}") from None
    states = {each.dxf.name.lower(): each for each in drawing.layers}
    drawn = [*_drawn(drawing.modelspace(), states, "0", Matrix44())]
    layers = sorted({layer for entity, layer, _ in drawn if _is_curve(entity)})
    if layer is not None:
        asked = [name.strip().lower() for name in layer.split(",")]
        if missing := [name for name in asked if name not in map(str.lower, layers)]:
            raise InputError(
                f"`layer` {', '.join(missing)} of {source} has no lines; expected {layers}"
            )
        drawn = [each for each in drawn if each[1].lower() in asked]
    beside = "TEXT MTEXT DIMENSION ARC_DIMENSION LEADER MULTILEADER POINT ATTDEF".split()
    others = Counter(entity.dxftype() for entity, *_ in drawn if not _is_curve(entity))
    unread = ", ".join(f"{n} {kind}" for kind, n in sorted(others.items()) if kind not in beside)
    factor, unit = _unit(drawing)
    lines, names = [], []
    for curve, name, place in (each for each in drawn if _is_curve(each[0])):
        stretch = np.linalg.norm(np.array([*place.rows()])[:3, :3], 2)
        for line in _flattened(curve, 0.01 / factor / stretch):  # chords within 0.01 mm
            lines.append(factor * np.array([tuple(x) for x in place.transform_vertices(line)]))
            names.append(name)
    if not lines:
        raise InputError(
            f"{source} has no lines, but {unread or 'nothing'}; expected {', '.join(CURVES)}"
        )
    sides = " x ".join(rounded(each, 4) for each in np.ptp(np.concatenate(lines), axis=0)[:2])
    notes = [f"{source} has {unread}, not read; expected {', '.join(CURVES)}"] if unread else []
    fixes = [each.message for each in auditor.fixes]
    notes += [f"{source} is damaged: {each}" for each in fixes if each.startswith("Removed")]
    notes += [f"{source} {unit}, so it is {sides} mm"] if unit else []
    hint = f"; it has {unread}, not read" if unread else ""
    if layer is None and len(layers) > 1:
        hint += f"; of its layers {', '.join(layers)} use `layer` to select some"
    return lines, names, notes, hint


def _flattened(curve, chord):
    """Lines of points on a curve, whose chords lie up to `chord` off it. ezdxf's paths alone are
    too coarse for arcs, and leave splines whose ends are not clamped."""
    from ezdxf import path as paths

    kind = curve.dxftype()
    if kind in ("ARC", "CIRCLE", "ELLIPSE"):
        return [[*curve.flattening(chord)]]
    if kind == "POLYLINE":  # R12 has vertices, by this flag, that steer a spline
        on_it = [vertex for vertex in curve.vertices if not vertex.dxf.flags & 16]
        curve.vertices[:] = on_it or curve.vertices
    if kind in ("LWPOLYLINE", "POLYLINE") and curve.has_arc:
        return [line for each in curve.virtual_entities() for line in _flattened(each, chord)]
    if kind != "SPLINE":
        line = [*paths.make_path(curve).flattening(chord)]
        return [line] if len(line) > 1 else []
    spline = curve.construction_tool()
    ends = np.unique(spline.knots()[spline.degree : spline.count + 1])
    for parts in 2 ** np.arange(2, 13):  # of each stretch between knots
        t = np.interp(np.arange(parts * (len(ends) - 1) + 1) / parts, np.arange(len(ends)), ends)
        x = np.array([tuple(point) for point in spline.points(t)])
        if np.linalg.norm(x[1::2] - (x[:-1:2] + x[2::2]) / 2, axis=1).max() < chord:
            break
    return [x]


def _is_curve(entity):
    kind = entity.dxftype()
    # flags of a POLYLINE that is a mesh
    return kind in CURVES and not (kind == "POLYLINE" and entity.dxf.flags & (16 | 64))


def _drawn(entities, states, above, place):
    """What is visible of entities of a block at a `place`, a matrix, on the layer `above`, and in
    the blocks that it inserts: each with its layer and place; `states`: the layers by name."""
    # by products of matrices, as ezdxf loses the shear of scales within scales
    for each in entities:
        layer = above if each.dxf.layer == "0" else each.dxf.layer
        state = states.get(layer.lower())
        if each.dxf.get("invisible") or (state and state.is_frozen()):
            continue
        if each.dxftype() == "INSERT" and (block := each.block()):
            for one in each.multi_insert():
                yield from _drawn(block, states, layer, one.matrix44() @ place)
        elif not (state and state.is_off()):
            yield each, layer, place


def _unit(drawing):
    """Factor from a drawing's unit to mm, and words on a unit that is another one or none."""
    from ezdxf import units

    # mm in units without a factor in ezdxf: microinches, mils, those of the US survey
    missing = {8: 2.54e-5, 9: 0.0254, 21: 1.2e6 / 3937, 22: 1e5 / 3937, 23: 3.6e6 / 3937}
    missing |= {24: 6.336e9 / 3937}
    unit, mm = drawing.header.get("$INSUNITS", 0), units.InsertUnits.Millimeters
    if unit not in range(1, 25):
        return 1.0, f"has no unit ($INSUNITS {unit}) and is read in mm"
    factor = missing.get(unit) or units.conversion_factor(units.InsertUnits(unit), mm)
    words = f"is in {units.unit_name(unit).lower()} ($INSUNITS {unit})"
    return float(f"{factor:.9g}"), "" if unit == mm else words


def _boundary(path):
    points, cells, _ = read_surface_mesh(path, "outline", ALLOWED)
    edges = []
    for kind, nodes in cells.items():
        corners = nodes[:, : {"triangle": 3, "quad": 4}.get(kind.rstrip("0123456789"))]
        edges += [*np.stack([corners, np.roll(corners, -1, 1)], 2).reshape(-1, 2)]
    ends, count = np.unique(np.sort(edges, 1), axis=0, return_counts=True)
    return [*points[ends[count == 1]]]


def joined(lines: Sequence[np.ndarray], source: str) -> list[np.ndarray]:
    """Closed rings (n, 2) of lines (k, 2) [mm] whose ends meet, in any order and sense, each once;
    source: what errors call them. Raises InputError, by the place, for lines that do not close."""
    # of the lines' extent, up to which their ends meet
    gap = 1e-4 * np.ptp(np.concatenate(lines), axis=0).max()
    ends = np.array([line[[0, -1]] for line in lines]).reshape(-1, 2)
    _, place = connected(len(ends), cKDTree(ends).query_pairs(gap, output_type="ndarray").T)
    _, first, group = np.unique(place, return_index=True, return_inverse=True)
    ends = ends[first[group]].reshape(-1, 2, 2)
    pieces = [
        shapely.LineString([start, *line[1:-1], end]) for line, (start, end) in zip(lines, ends)
    ]
    pieces = [each for each in pieces if each.length > gap]
    once = {shapely.normalize(each).wkb: each for each in pieces}
    merged = shapely.get_parts(shapely.line_merge(shapely.multilinestrings([*once.values()])))
    rings = [shapely.get_coordinates(each) for each in merged]
    if loose := [ring[[0, -1]] for ring in rings if (ring[0] != ring[-1]).any()]:
        place, *others = np.concatenate(loose)
        off = np.linalg.norm(others - place, axis=1)
        k = off.argmin()  # at 0 mm where more than two lines meet
        raise InputError(
            f"{source} is open at {coordinates(place)} mm: the nearest other end is "
            f"{rounded(off[k])} mm away, at {coordinates(others[k])}; expected closed rings, of "
            f"two lines at each place, whose ends are up to {rounded(gap, 1)} mm apart"
        )
    return rings


def sheet_of(rings: Sequence[np.ndarray], source: str) -> shapely.Polygon:
    """The sheet that rings (n, 2) [mm] bound: the largest is its outline, the others are holes.
    Raises InputError, by the place, for rings of a `source` that do not bound one sheet."""
    # rings of fewer points are too few for GEOS, not for its constructor
    areas = [shapely.Polygon(np.resize(ring, (max(3, len(ring)), 2))) for ring in rings]
    areas.sort(key=lambda area: -area.area)
    outline, *holes = [area.exterior for area in areas] or [None]
    sheet = shapely.Polygon(outline, holes)
    fault, _, place = shapely.is_valid_reason(sheet).partition("[")
    if place:  # as of Self-intersection[5 10]
        where = coordinates(map(float, place.rstrip("]").split()))
        raise InputError(
            f"{source} bounds no sheet: {fault.lower()} at {where} mm; expected one outline, and "
            "holes inside it that are apart from each other"
        )
    return sheet


def mirrored_half(
    sheet: shapely.Polygon, axis: int, source: str, at: float = 0.0
) -> shapely.Polygon:
    """The half of a sheet on the positive side of the plane x = `at` or y = `at` (`axis` 0 or 1)
    [mm], which mirrors it; a sheet that begins at the plane as it is. Raises InputError, by the
    size of what differs, for a sheet that is not its own mirror image, and for one in two parts."""
    low, high = np.reshape(sheet.bounds, (2, 2))[:, axis]
    if low - at > -MIRROR_TOLERANCE * (high - low):
        return sheet
    image = shapely.transform(sheet, lambda x: np.where(np.arange(2) == axis, 2 * at - x, x))
    apart = shapely.symmetric_difference(sheet, image)
    name, far = "xy"[axis], shapely.buffer(apart, -MIRROR_TOLERANCE * (high - low))
    if not far.is_empty:
        place = coordinates(far.representative_point().coords[0])
        raise InputError(
            f"{source} is not symmetric about {name} = {at:g}: {rounded(far.area, 3)} mm2 "
            f"differ, as at {place} mm; expected a symmetric outline, or its half"
        )
    reach = 2 * np.abs(sheet.bounds).max()
    start = [at if k == axis else -reach for k in (0, 1)]
    half = shapely.intersection(sheet, shapely.box(*start, reach, reach))
    if half.geom_type != "Polygon":
        raise InputError(
            f"{source} is cut into {shapely.get_num_geometries(half)} parts by the plane of "
            f"symmetry {name} = {at:g}; expected an outline that stays in one piece"
        )
    return half
