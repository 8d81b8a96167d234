"""Sheets as arrays, in their place: rectangles, triangles in an outline with holes, and meshes in
files."""

import math
import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from ..core.errors import InputError
from ..core.files import ending
from ..core.formatting import coordinates, rounded
from ..core.rules import POSITIVE
from ..io.outlines import mirrored_half, read_outline, sheet_of
from ..io.read import READ, read_surface_mesh
from .mesh_checks import CELLS, MeshArrays
from .sheet import Layout, axes_of
from .specimen import blocks, meshed, own_model, specimen

FLAT_TOLERANCE = 1e-6  # of its size, up to which a sheet is flat
PATTERNS = "along", "unstructured"
MIN_DETAIL = 0.1  # of the cells' size: length of an edge or a hole below which it is left out
MIN_CLEARANCE = 1e-3  # of the cells' size: least distance of parts of the outline
MAX_CELLS = 1_000_000  # cells


def rectangle(
    layout: Layout,
    sides: Sequence[float],
    turned: float,
    centred: bool | Sequence[bool],
    planes: Mapping[int, float],
) -> MeshArrays:
    """A rectangle of these sides [mm], `turned` from x [rad], with a corner or, `centred`, its
    middle at the origin, moved to `planes` {axis: place}. Cells along the yarns follow those in the
    middle."""
    if layout.pattern == "along":
        _check_triangles(layout, "cells along the yarns")
    (length, width), middle = sides, np.array(sides) / 2
    squares = layout.pattern == "graded" and blocks(length, width) or length / width
    ny = layout.ny or max(1, round(layout.nx / squares))
    cell = "quadrilateral" if (layout.element or "P")[0] == "Q" else "triangle"
    count = (
        layout.nx * ny * (1 if cell[0] == "q" else {"left": 2, "right": 2}.get(layout.pattern, 4))
    )
    if count > MAX_CELLS:
        raise InputError(f"`nx` is {layout.nx}, `ny` {ny}: {_cost(count)}; at most {MAX_CELLS:,}")
    axes, shift = axes_of(turned), middle * np.asarray(centred)
    start = np.array([planes.get(axis, 0.0) for axis in (0, 1)])
    yarns = _yarns(layout, (middle - shift) @ axes + start)
    if layout.pattern == "along":
        size = min(max(length / layout.nx, width / ny), min(sides) / 2)
        yarns = yarns[0], sum(yarns)
        points, cells, kind, _ = outline_mesh(shapely.box(0, 0, *sides), size, "along", yarns)
    else:
        points, cells, kind = specimen(length, width, layout.nx, ny, layout.pattern, cell, *yarns)
    points[:, :2] = (points[:, :2] - shift) @ axes + start
    return MeshArrays(points, cells, kind, [])


def outline(
    layout: Layout,
    rim: Path | str | Sequence[ArrayLike],
    source: str,
    size: float | None,
    layer: str | None,
    turned: float,
    centred: bool,
    planes: Collection[int] | Mapping[int, float],
) -> MeshArrays:
    """The inside of a `rim`, as in `Blank.outline`, that messages call `source`. Warnings say what
    was left out."""
    _check_triangles(layout, "an outline")
    notes = list[str]()
    if isinstance(rim, str | os.PathLike):
        sheet, notes = read_outline(rim, layer)
    else:
        sheet = sheet_of([np.asarray(ring, float) for ring in rim], source)
    if centred:  # the middle of its extent is at the origin
        middle = np.reshape(sheet.bounds, (2, 2)).mean(0)
        sheet = shapely.transform(sheet, lambda x: x - middle)
    places = planes if isinstance(planes, Mapping) else dict.fromkeys(planes, 0.0)
    for axis, place in places.items():
        sheet = mirrored_half(sheet, axis, source, place)
    low, high = np.reshape(sheet.bounds, (2, 2))
    a, between = _yarns(layout, sheet.centroid.coords[0])
    size = (high - low)[0] / layout.nx if size is None else size
    yarns = a + turned, a + turned + between
    try:
        made = outline_mesh(sheet, size, layout.pattern, yarns, layout.slits)
        points, triangles, kind, left_out = made
    except InputError as error:
        raise InputError("; ".join([str(error), *notes])) from None
    return MeshArrays(points, triangles, kind, notes + left_out)


def _cost(cells):
    memory = rounded(12e-6 * cells)  # of P2 in a plane
    return f"{rounded(cells)} cells, which need about {memory} GB of memory"


def _check_triangles(layout, what):
    if (layout.element or "P")[0] != "P":
        raise InputError(f"`element` is {layout.element}; expected triangles (P) for {what}")


def _yarns(layout, place):
    """Angle from the length to yarns a, and from there to yarns b, [rad] at a place (x, y)."""
    a = layout.fibre_angles(np.array([[*place, 0.0]]))[0]
    return math.radians(a), math.radians(layout.yarn_angle)


def read_mesh(path: Path | str) -> MeshArrays:
    """The mesh in a file, not checked yet; InputError as in `Blank.read`."""
    path, file = Path(path), f"mesh file {path}"
    kinds = dict.fromkeys((".geo", ".step", ".stp", ".iges", ".igs", ".brep"), "a geometry")
    kinds |= {".dxf": "an outline", ".csv": "an outline"}
    if other := kinds.get(ending(path)):
        how = f": gmsh makes one with `gmsh -2 {path.name} -o {path.stem}.msh`"
        how = how if other == "a geometry" else ", or the file as `outline`"
        raise InputError(f"{file} is {other} without a mesh; expected {READ}{how}")
    points, surface, others = read_surface_mesh(path, "mesh file")
    solid = sorted(kind for kind, dim in others.items() if dim == 3)
    if solid or len(surface) > 1 or not {*CELLS, "quad8"}.issuperset(surface):
        what = f"solid cells {solid}" if solid else f"cells {sorted(surface)}"
        raise InputError(f"{file} holds {what}; expected one kind out of {sorted(CELLS)}")
    ((kind, cells),) = surface.items()
    if kind == "quad8":
        # a node inside leaves the shape as it is
        numbers = len(points) + np.arange(len(cells))
        corners, middles = np.split(points[cells], [4], axis=1)
        points = np.vstack([points, middles.sum(1) / 2 - corners.sum(1) / 4])
        cells, kind = np.column_stack([cells, numbers]), "quad9"
    unused, total = len(points) - len(np.unique(cells)), len(points)
    doubt = (
        f"{file} has {unused} of {total} nodes outside all cells of a sheet: it may be truncated"
    )
    return MeshArrays(points, cells, kind, [doubt] if unused > 0.02 * total else [])


def moved_sheet(
    points: np.ndarray, source: str, centred: bool, height: float | None
) -> tuple[np.ndarray, list[str]]:
    """Points (n, 2 or 3) [mm] of a sheet, moved as in `Blank.read`, and a warning if z changes."""
    points, low, high = points.copy(), points.min(0), points.max(0)
    if centred:
        points[:, :2] -= (low + high)[:2] / 2
    if height is None or len(low) == 2:
        return points, []
    near, place = FLAT_TOLERANCE * (high - low).max(), f"z = {rounded(low[2], 4)}"
    if high[2] - low[2] > near:
        raise InputError(
            f"{source} reaches from {place} to {rounded(high[2], 4)} mm; expected a flat sheet, "
            "in a plane z = const"
        )
    points[:, 2] = height
    doubt = f"{source} lies in {place} mm and was moved to z = {height:g}, the plane of the blank"
    return points, [doubt] if abs(low[2] - height) > near else []


def outline_mesh(
    sheet: shapely.Polygon,
    size: float,
    pattern: str = "unstructured",
    yarns: Sequence[float] = (0.0, math.pi / 2),
    slits: Sequence[ArrayLike] = (),
) -> tuple[np.ndarray, np.ndarray, str, list[str]]:
    """Points (n, 3) [mm], triangles (m, 3), their kind, and what was left out, in words.

    size: of the cells' edges [mm], smaller where the outline is curved or narrow; its corners stay.
    pattern: `unstructured`, or `along`: squares along both yarns, each of four triangles, and other
    triangles between them and the outline. yarns: angles from x to yarns a and b [rad]; slits:
    lines (n, 2) [mm] along which edges run.
    """
    size = POSITIVE.check("`size`", size)
    if pattern not in PATTERNS:
        raise InputError(f"`pattern` is {pattern!r}; expected {PATTERNS} for an outline")
    low, high = np.reshape(sheet.bounds, (2, 2))
    cells = sheet.area / size**2 * (4 if pattern == "along" else 4 / math.sqrt(3))
    if size > (high - low).min() / 2 or cells > MAX_CELLS:
        sides = " x ".join(rounded(side, 4) for side in high - low)
        raise InputError(
            f"`size` is {size:g}, but the outline is {sides} mm, about {_cost(cells)}; expected "
            f"up to half of it, and {MAX_CELLS:,} cells"
        )
    # about its centre and without the last digits, as cells are not to depend on where it lies
    centre = ((low + high) / 2).round(6)
    sheet = shapely.transform(sheet, lambda x: (x - centre).round(9))
    sheet, notes = _simplified(sheet, size, centre)
    sheet, lines = _with_slits(sheet, [np.array(line) - centre for line in slits], size)
    places, sizes = _fine_places(sheet, size, notes, centre)
    if sheet.minimum_clearance < MIN_CLEARANCE * size:
        raise InputError(
            f"the outline comes within {rounded(sheet.minimum_clearance)} mm of itself; expected "
            f"more than {rounded(MIN_CLEARANCE * size)} mm for cells of this size"
        )

    def size_at(x, y):
        off = np.hypot(places[:, 0] - x, places[:, 1] - y)
        # of the cells' size over the distance from a small edge
        return float((sizes + 0.4 * off).min(initial=size))

    sheet = _divided(sheet, size, size_at)
    if pattern == "along":
        points, triangles = _along(sheet, size, size_at, yarns, lines)
    else:
        points, triangles = _filled([sheet], size_at, lines)
    points = np.pad(points + centre, ((0, 0), (0, 1)))
    return points, triangles, "triangle", notes


def _with_slits(sheet, slits, size):
    """The sheet with corners where slits (n, 2) end near its edge, and these as lines that end on
    it, cut where they meet."""
    for x in slits:
        for k in (0, -1):
            line = shapely.shortest_line(sheet.boundary, shapely.Point(x[k]))
            if line.length < MIN_DETAIL * size:
                x[k] = shapely.get_coordinates(line)[0].round(9)
                sheet = shapely.snap(sheet, shapely.Point(x[k]), 1e-6 * size)
    return sheet, shapely.get_parts(shapely.node(shapely.MultiLineString(slits)))


def _simplified(sheet, size, centre):
    """The sheet without details below this size of cells, and words on holes left out."""
    notes, rings = [], []
    for ring in (sheet.exterior, *sheet.interiors):
        x = shapely.get_coordinates(ring)[:-1]
        if (extent := np.ptp(x, axis=0).max()) < MIN_DETAIL * size:
            hole = f"a hole of {rounded(extent)} mm at {coordinates(x[0] + centre)} mm"
            notes.append(f"{hole} is left out, because it is smaller than the cells")
            continue
        # where it begins it stays: at a corner
        rings.append(np.roll(x, -np.linalg.norm(x - x.mean(0), axis=1).round(6).argmax(), 0))
    # distance from a curve, over the cells' size, up to which an edge stands for it
    sheet = shapely.Polygon(rings[0], rings[1:]).simplify(0.02 * size)
    coarser = shapely.remove_repeated_points(sheet, MIN_DETAIL * size)
    return (coarser if coarser.is_valid else sheet), notes


def _fine_places(sheet, size, notes, centre):
    """Places (n, 2) where cells are to be smaller, and their sizes there (n,): at short edges and
    where the sheet is narrow, which gets two cells across."""
    edges, dense = [], []
    for k, ring in enumerate((sheet.exterior, *sheet.interiors)):
        x = shapely.get_coordinates(ring)
        edges.append([*(x[1:] + x[:-1]).T / 2, np.linalg.norm(np.diff(x, axis=0), axis=1)])
        x = shapely.get_coordinates(shapely.segmentize(ring, size / 5))
        way = np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))
        dense.append([*x[1:].T, way, 0 * way + ring.length, 0 * way + k])
    *places, sizes = np.concatenate(edges, 1)
    x, y, along, around, number = np.concatenate(dense, 1)
    x = np.column_stack([x, y])
    i, j = cKDTree(x).query_pairs(2 * size, output_type="ndarray").T
    width = np.linalg.norm(x[i] - x[j], axis=1)
    way = abs(along[i] - along[j])
    way = np.where(number[i] == number[j], np.minimum(way, around[i] - way), np.inf)
    middle = (x[i] + x[j]) / 2
    # way along a ring over the distance through the sheet, above which it is narrow
    faces = way > 6.0 * width
    faces[faces] = shapely.contains_xy(sheet, middle[faces])
    if faces.any() and (least := width[faces].min()) < MIN_DETAIL * size:
        where = coordinates(middle[faces][width[faces].argmin()] + centre)
        notes.append(f"the outline is {rounded(least)} mm wide at {where} mm, less than a cell")
    places = np.concatenate([np.transpose(places), middle[faces]])
    sizes = np.maximum(np.concatenate([sizes, width[faces] / 2]), MIN_DETAIL * size)
    return places[sizes < size], sizes[sizes < size]


def _divided(sheet, size, size_at):
    """The sheet with points on its edges as far apart as cells are to be there."""
    rings = []
    for ring in (sheet.exterior, *sheet.interiors):
        corners, points = shapely.get_coordinates(ring), []
        for p, q in zip(corners, corners[1:]):
            length = math.dist(p, q)
            steps = math.ceil(5 * length / size)
            middles = p + (q - p) * (np.arange(steps)[:, None] + 0.5) / steps
            cells = np.cumsum([0.0, *(length / steps / size_at(*x) for x in middles)])
            count = max(1, math.ceil(cells[-1] - 0.2))
            at = np.interp(
                np.arange(count) * cells[-1] / count, cells, np.linspace(0, 1, steps + 1)
            )
            points.append(p + (q - p) * at[:, None])
        rings.append(np.concatenate(points))
    return shapely.Polygon(rings[0], rings[1:])


def _filled(faces, size_at, slits):
    """Points (n, 2) and triangles (m, 3) of sizes size_at(x, y) in polygons, whose edges stay, and
    along slits, lines in them."""
    import gmsh

    options = {"MeshSizeMin": 0.0, "MeshSizeMax": 1e22, "Algorithm": 6.0}
    sources = "FromPoints", "FromCurvature", "ExtendFromBoundary"
    options |= {f"MeshSize{source}": 0.0 for source in sources}
    with own_model(gmsh, **options):
        geo = gmsh.model.geo
        numbers: dict[tuple[float, ...], int] = {}

        def curves(line):
            ends = [*map(tuple, shapely.get_coordinates(line))]
            for end in ends:
                numbers[end] = numbers.get(end) or geo.addPoint(*end, 0)
            return [geo.addLine(numbers[p], numbers[q]) for p, q in zip(ends, ends[1:])]

        surfaces = []
        for face in map(shapely.geometry.polygon.orient, faces):
            rings = [curves(ring) for ring in (face.exterior, *face.interiors)]
            for edge in sum(rings, []):
                geo.mesh.setTransfiniteCurve(edge, 2)
            surfaces.append(geo.addPlaneSurface([*map(geo.addCurveLoop, rings)]))
        shares = [shapely.length(shapely.intersection(faces, line)) for line in slits]
        cuts = [(curves(line), share.argmax()) for line, share in zip(slits, shares)]
        geo.synchronize()
        for lines, face in cuts:
            gmsh.model.mesh.embed(1, lines, 2, surfaces[face])
        try:
            points, triangles = meshed(gmsh, size_at=size_at)
        except Exception as error:  # it raises no other kind
            raise InputError(
                f"gmsh cannot mesh the outline ({error}); expected one without spikes and gaps"
            ) from None
    return points[:, :2], triangles


def _along(sheet, size, size_at, yarns, slits):
    """Points (n, 2) and triangles (m, 3): parallelograms along both yarns inside, each of four
    triangles, and others around them."""
    axes = size * np.array([[math.cos(yarn), math.sin(yarn)] for yarn in yarns])
    corners = np.reshape(shapely.get_coordinates(shapely.box(*sheet.bounds)), (-1, 2))
    steps = corners @ np.linalg.inv(axes)
    low, high = np.floor(steps.min(0)).astype(int), np.ceil(steps.max(0)).astype(int)
    i, j = np.indices(high - low + 1)
    grid = np.stack([i + low[0], j + low[1]], -1) @ axes
    square = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], 2)
    # least distance of squares along yarns from the outline, over their size
    inner = sheet.buffer(-0.5 * size).difference(shapely.union_all(slits).buffer(0.5 * size))
    shapely.prepare(inner)
    inside = shapely.contains(inner, shapely.polygons(square))
    # where two squares touch in a corner alone, both go
    while True:
        a, b, c, d = inside[:-1, :-1], inside[1:, 1:], inside[1:, :-1], inside[:-1, 1:]
        pinched = (a & b & ~c & ~d) | (c & d & ~a & ~b)
        if not pinched.any():
            break
        for part in (a, b, c, d):
            part &= ~pinched
    square = square[inside]
    if not len(square):
        return _filled([sheet], size_at, slits)
    rim = shapely.get_parts(sheet.difference(shapely.union_all(shapely.polygons(square))))
    points, cells = _filled(rim, size_at, slits)
    number = len(points) + np.arange(5 * len(square)).reshape(-1, 5)
    points = np.concatenate([points, *np.concatenate([square, square.mean(1)[:, None]], 1)])
    cells = [cells, *(number[:, [k, (k + 1) % 4, 4]] for k in range(4))]
    _, first, of = np.unique(
        np.round(points / (1e-6 * size)), axis=0, return_index=True, return_inverse=True
    )
    return points[first], of.ravel()[np.concatenate(cells)]
