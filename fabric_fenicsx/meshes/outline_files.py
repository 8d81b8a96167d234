"""Outlines of sheets in files: polygons in CSV, drawings in DXF, boundaries of meshes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely

from ..readers.read import read_surface_mesh
from ..readers.text_tables import Problems, is_comment, read_lines, table_of, values_of
from ..readers.units import factors
from ..runtime.errors import InputError
from ..runtime.files import check_file
from ..runtime.formatting import rounded
from .rings import joined, sheet_of

READ = "a drawing (.dxf), a table of x and y (.csv, .txt), or a mesh"
TABLES = (".csv", ".txt", ".xy")
CURVES = "LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE"  # of DXF
BLOCK = "INSERT"
CHORD = 0.01  # largest distance of a chord from its curve [mm]
PLANE = 1e-6  # extent in z over the others, below which lines lie in a plane
Lines = Sequence[np.ndarray]


def read_outline(path: Path | str, layer: str | None = None) -> tuple[shapely.Polygon, list[str]]:
    """The sheet that a file's rings bound [mm], and what to say of it, a sentence each.

    The largest ring is the outline, those in it are holes. A table (.csv) has columns x and y, and
    blank lines or a column `ring` between rings, which close by themselves; a header is needed for
    other columns and units alone. Of a drawing (.dxf) all lines of its `layer` count, or of several
    with commas between them, by default of all that are visible, in the unit that it names. Of any
    other file, a mesh, the boundary counts. Raises InputError for a file that cannot be read, and
    as `joined` and `sheet_of` do.
    """
    path = Path(path)
    source, ending = f"outline {path}", path.suffix.lower()
    check_file(path, "outline", READ)
    if layer is not None and ending != ".dxf":
        raise InputError(f"`layer` is allowed only for a .dxf, not for {source}")
    notes: list[str] = []
    if ending in TABLES:
        rings = _table(path, source)
    elif ending == ".dxf":
        lines, notes, hint = _drawing(path, source, layer)
        try:
            rings = joined(lines, source)
            return sheet_of(rings, source), notes
        except InputError as error:
            raise InputError(f"{error}{hint}") from None
    else:
        rings = joined(_boundary(path, source), source)
    return sheet_of(rings, source), notes


def read_trim_line(path: Path | str) -> tuple[list[np.ndarray], list[str]]:
    """Lines in space (n, 3) [mm], or (n, 2) without z, that a file's trim line consists of, and
    what to say of it, a sentence each. They close to rings where their ends meet.

    A table (.csv) is one of `read_outline` that may have a column z. Of a drawing (.dxf) all that
    is visible counts; one in a plane z = const has no z. Raises InputError for a file that cannot
    be read.
    """
    path = Path(path)
    source, ending, notes = f"trim line {path}", path.suffix.lower(), []
    allowed = "a table of x, y and z (.csv, .txt), or a drawing (.dxf)"
    check_file(path, "trim line", allowed)
    if ending in TABLES:
        lines = [np.vstack([ring, ring[:1]]) for ring in _table(path, source, ("x", "y", "z"))]
    elif ending == ".dxf":
        lines, unit, _ = _curves(path, source, None)
        size = np.ptp(np.concatenate(lines), axis=0)
        notes = [f"{unit}, so it is {rounded(size[0], 4)} mm long in x"] if unit else []
        if size[2] <= PLANE * size.max():
            lines = [line[:, :2] for line in lines]
    else:
        raise InputError(f"{source} has the ending {ending or 'none'}; allowed is {allowed}")
    if lines[0].shape[1] == 2:
        notes.append(f"{source} has no z and is projected along z")
    return lines, notes


# -- tables


def _table(path, source, names=("x", "y")):
    """The rings of a table, (n, 2) or, where it has a column z and that is one of the `names`, (n,
    3)."""
    problems = Problems()
    try:
        lines = [each for each in enumerate(read_lines(path), 1) if not is_comment(each[1])]
        filled = [bool(text.strip(" ,;\t")) for _, text in lines]
        table = table_of(
            [each for each, is_filled in zip(lines, filled) if is_filled],
            lambda name: name.lower() in ("x", "y"),
            ("x", "y"),
        )
        if len(names) > len(table.names) and {len(cells) for cells in table.cells} == {3}:
            table = table._replace(names=[*names], units=[*table.units, None])  # without a header
        wanted = _columns(table, names)
        columns = values_of(table, wanted, problems)
        problems.stop()
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    number = dict(zip((row for row, _ in lines), np.cumsum(np.logical_not(filled))))
    block = np.array([number[row] for row in table.rows])
    keys = np.column_stack([block, columns.get("ring", 0 * block)])
    _, first, of = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    points = np.column_stack([columns[name] for name in names if name in columns])
    return [points[of.ravel() == k] for k in np.argsort(first).argsort()]


def _columns(table, wanted):
    """The columns of a table, {number: (name, factor)}; of those `wanted` z may be missing."""
    names = [name.lower() for name in table.names]
    lengths, found = factors("length"), {}
    for name in (*wanted, "ring"):
        if names.count(name) != 1 and (name not in ("z", "ring") or name in names):
            raise InputError(
                f"row {table.top}: there are {names.count(name)} columns {name}; allowed is one"
            )
        if name in names:
            unit = table.units[names.index(name)]
            if name != "ring" and unit not in (None, *lengths):
                raise InputError(
                    f"row {table.top}: unit of {name} is {unit}; allowed is {', '.join(lengths)}"
                )
            factor = 1.0 if name == "ring" or unit is None else lengths[unit]
            found[names.index(name)] = name, factor
    return found


# -- drawings


def _drawing(path, source, layer):
    """Lines of a flat drawing, what to say of it, and what to add to errors."""
    lines, unit, hint = _curves(path, source, layer)
    size = np.ptp(np.concatenate(lines), axis=0)
    if size[2] > PLANE * size.max():
        raise InputError(
            f"{source} reaches over {rounded(size[2])} mm in z; allowed is a drawing in x and y"
        )
    sides = " x ".join(rounded(side, 4) for side in size[:2])
    notes = [f"{unit}, so it is {sides} mm"] if unit else []
    return [line[:, :2] for line in lines], notes, hint


def _curves(path, source, layer):
    """Lines (n, 3) of a drawing [mm], words on its unit if that is not mm, and what to add to
    errors: its layers if there are several."""
    from ezdxf import path as paths
    from ezdxf import recover
    from ezdxf.disassemble import recursive_decompose
    from ezdxf.lldxf.const import DXFError

    try:
        drawing, _ = recover.readfile(path)
    except (DXFError, OSError, ValueError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{source} cannot be read ({reason}); allowed is {READ}") from None
    hidden = {each.dxf.name.lower() for each in drawing.layers if each.is_off() or each.is_frozen()}
    space = [each for each in drawing.modelspace() if each.dxftype() in (*CURVES, BLOCK)]
    curves = [each for each in recursive_decompose(space) if each.dxftype() in CURVES]
    curves = [each for each in curves if each.dxf.layer.lower() not in hidden]
    layers = sorted({each.dxf.layer for each in curves})
    if layer is not None:
        asked = [name.strip().lower() for name in layer.split(",")]
        known = [name.lower() for name in layers]
        if missing := [name for name in asked if name not in known]:
            raise InputError(
                f"`layer` {', '.join(missing)} of {source} has no lines; allowed is one of "
                f"{', '.join(layers) or 'none, as no layer has any'}"
            )
        curves = [each for each in curves if each.dxf.layer.lower() in asked]
    if not curves:
        raise InputError(f"{source} has no lines; allowed are {', '.join(CURVES)}, visible")
    factor, unit = _unit(drawing, source)
    flat = [[*paths.make_path(each).flattening(CHORD / factor)] for each in curves]
    lines = [factor * np.array([tuple(point) for point in line]) for line in flat if len(line) > 1]
    several = layer is None and len(layers) > 1
    hint = f"; of its layers {', '.join(layers)} some may be left out by `layer`" if several else ""
    return lines, unit, hint


def _unit(drawing, source):
    """Factor from a drawing's unit to mm, and words on a unit that is another one or none."""
    from ezdxf import units
    from ezdxf.lldxf.const import DXFValueError

    unit, mm = drawing.header.get("$INSUNITS", 0), units.InsertUnits.Millimeters
    if unit == mm:
        return 1.0, ""
    try:
        factor = float(f"{units.conversion_factor(units.InsertUnits(unit), mm):.9g}")
        return factor, f"{source} is in {units.unit_name(unit).lower()} ($INSUNITS {unit})"
    except (DXFValueError, TypeError, ValueError):
        return 1.0, f"{source} names no unit ($INSUNITS {unit}) and is taken in mm"


# -- meshes


def _boundary(path, source):
    """The edges of one cell of a mesh, as lines."""
    points, cells, _ = read_surface_mesh(path, "outline", READ)
    if np.ptp(points[:, 2]) > PLANE * np.ptp(points, axis=0).max():
        raise InputError(
            f"{source} is not plane in z; allowed is a mesh in a plane z = const, or a drawing"
        )
    edges = []
    for kind, nodes in cells.items():
        if not kind.startswith(("triangle", "quad")):
            raise InputError(f"{source} holds cells {kind}; allowed are triangles and quads")
        corners = nodes[:, : 3 if kind.startswith("triangle") else 4]
        edges.append(np.stack([corners, np.roll(corners, -1, 1)], 2).reshape(-1, 2))
    edges, count = np.unique(np.sort(np.concatenate(edges), 1), axis=0, return_counts=True)
    return [*points[edges[count == 1], :2]]
