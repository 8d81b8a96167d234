"""The flat pattern of a trimmed part: a trim line on the formed ply, or a plane through it, as an
outline on the flat ply; files of it.

A point of the formed ply lies in one of its triangles and has its place in the same triangle of the
flat ply.
"""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyvista
import shapely
from scipy.spatial import cKDTree

from ..core.errors import InputError
from ..core.files import replace_file
from ..core.formatting import coordinates, rounded
from ..io.outlines import joined, sheet_of
from ..surfaces.tool import Frame
from .ply import SAME, Grid, Ply, areas, edge_sides, grid_of, in_frame, plan_area, ply_of, whole
from .states import save

MAX_BEYOND = 0.05  # of the distance that is allowed, by which a line may be beyond the ply's edge


class Plane(NamedTuple):
    """A plane by a `point` [mm] and its `normal`, which points to what is kept."""

    point: Sequence[float]
    normal: Sequence[float]


class FlatPattern(NamedTuple):
    """net: the outline on the flat ply with its holes, a polygon or several [mm]; part: the trimmed
    part, flat and formed, with the cells' fields; off: the largest distance of the trim line from
    the formed ply [mm]."""

    net: shapely.Polygon | shapely.MultiPolygon
    part: Ply
    off: float

    @property
    def formed_area(self) -> float:
        """Area of the formed part [mm2]."""
        return float(areas(self.part.formed[self.part.cells]).sum())


def placed(trim: Plane | Sequence[np.ndarray], frame: Frame) -> Plane | Sequence[np.ndarray]:
    """A plane or lines, as of `flat_pattern`, of these coordinates in those of the press. Raises
    InputError for lines without z along another direction."""
    if isinstance(trim, Plane):
        return Plane(
            frame.outside(np.array(trim.point)).tolist(), (frame.axes @ trim.normal).tolist()
        )
    if (plan := trim[0].shape[1]) == 2 and abs(frame.axes[2, 2]) < 1 - 1e-12:
        raise InputError("the trim line has no z, but the tool is tilted; use one with z")
    return [frame.outside(np.pad(x, ((0, 0), (0, 3 - plan))))[:, :plan] for x in trim]


def flat_pattern(grid: Grid, trim: Plane | Sequence[np.ndarray], reach: float) -> FlatPattern:
    """The flat pattern of the formed ply in `grid`, inside a trim line or on the side of a plane to
    which its normal points; of a quarter that of the whole ply.

    trim: lines (n, 3) in space, each point of which counts where the ply is nearest, or (n, 2),
    projected along z [mm]; of the closed rings that they form the largest is the outline, others
    are holes. reach: distance from the ply up to which a line counts [mm].
    """
    ply = whole(ply_of(grid))
    if isinstance(trim, Plane):
        part = _beside(ply, trim)
        return FlatPattern(_sheet(part), part, 0.0)
    edge = float(np.sqrt(2 * plan_area(ply.x, ply.cells).mean()))
    in_space = trim[0].shape[1] == 3
    # spacing of points on a trim line, over the mean edge of the ply's cells
    fine = shapely.segmentize([*map(shapely.LineString, trim)], 0.1 * edge)
    points, number = shapely.get_coordinates(fine, include_z=in_space, return_index=True)
    places, off = (_nearest if in_space else _below)(ply, points, reach)
    lines = shapely.linestrings(places, indices=number)
    # of that edge, distance from a line within which points are left out of it
    flat = [shapely.get_coordinates(line) for line in shapely.simplify(lines, 1e-4 * edge)]
    source = "the trim line, on the flat ply,"
    net = sheet_of(joined(flat, source), source).intersection(_sheet(ply))
    return FlatPattern(net, _inside(ply, net), off)


def edge_distance(grid: Grid, trim: Sequence[np.ndarray]) -> tuple[float, float]:
    """The largest distance between the edge of the formed ply in `grid`, of a quarter that of the
    whole ply, and a trim line, from each to the other, and the mean distance of the edge from the
    line [mm].

    trim: lines (n, 3) in space, or (n, 2), to which distances are along x and y [mm].
    """
    ply = whole(ply_of(grid))
    sides = ply.formed[edge_sides(ply.cells), : trim[0].shape[1]]
    longest = 0.02 * np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1).mean()
    edge, lengths = _pieces(sides, longest)
    line, _ = _pieces(np.vstack([np.stack([p[:-1], p[1:]], 1) for p in trim]), longest)
    (there, _), (back, _) = cKDTree(line).query(edge), cKDTree(edge).query(line)
    return float(max(there.max(), back.max())), float(np.average(there, weights=lengths))


def _pieces(sides, longest):
    """Middles (m, d), lengths (m,) of equal pieces of `sides` (n, 2, d), up to the `longest`."""
    start, along = sides[:, 0], sides[:, 1] - sides[:, 0]
    length = np.linalg.norm(along, axis=1)
    count = np.maximum(1, np.ceil(length / longest)).astype(int)
    of = np.repeat(np.arange(len(sides)), count)
    share = (np.arange(len(of)) - (np.cumsum(count) - count)[of] + 0.5) / count[of]
    return start[of] + share[:, None] * along[of], (length / count)[of]


def _sheet(ply):
    """The flat ply as a polygon, or several: what the edges of single triangles bound."""
    net = shapely.build_area(shapely.multilinestrings(ply.x[edge_sides(ply.cells), :2]))
    # points that the mesh alone has on straight edges
    return net.simplify(SAME)


def _beside(ply, plane):
    """The part of a ply on the side of a plane."""
    normal = np.asarray(plane.normal, float)
    height = (ply.formed - plane.point) @ (normal / np.linalg.norm(normal))
    if not height.min() < 0 < height.max():
        lies = f"which lies from {rounded(height.min())} to {rounded(height.max())} mm before it"
        flaw = f"the plane at {coordinates(plane.point)} mm does not cut the ply, {lies}"
        raise InputError(f"{flaw}; expected a plane through the ply")
    flat = grid_of(ply.x, ply.cells, ply.u)
    flat.cell_data.update(ply.fields)
    flat.point_data["height"] = height
    kept = flat.clip_scalar(scalars="height", invert=False, value=0.0).triangulate()
    triangles = kept.cells_dict[pyvista.CellType.TRIANGLE]
    fields = {name: np.asarray(kept.cell_data[name]) for name in ply.fields}
    u = np.asarray(kept.point_data["u"], dtype=float)
    return _cleaned(np.asarray(kept.points), u, triangles, fields)


def _nearest(ply, points, reach):
    """Places (n, 2) on the flat ply of what is nearest to `points` (n, 3) on the formed one, and
    the largest distance."""
    surface = pyvista.PolyData.from_regular_faces(ply.formed, ply.cells)
    cells, nearest = surface.find_closest_cell(points, return_closest_point=True)
    apart = np.linalg.norm(points - nearest, axis=1)
    allowed = f"up to {rounded(reach)} mm, on the formed ply"
    _refuse("the trim line is {} mm away from the ply", points, apart, apart > reach, allowed)
    corners = ply.formed[ply.cells[cells]]
    p, q, r = corners.swapaxes(0, 1)
    normal = np.cross(q - p, r - p)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # where nothing but the edge of the ply is nearest, the point is beside the triangle's plane
    beside = points - nearest
    beside -= (beside * normal).sum(1, keepdims=True) * normal
    shares = _shares(corners, nearest)[:, :, None]
    places = (shares * ply.x[ply.cells[cells], :2]).sum(1)
    beyond = np.linalg.norm(beside, axis=1)
    edge = _sheet(ply).boundary
    on_edge = shapely.distance(edge, shapely.points(places)) < 1e-6 * np.sqrt(edge.length)
    leaves = (beyond > MAX_BEYOND * reach) & on_edge
    _refuse("the trim line leaves the ply", points, beyond, leaves, "a line on the ply")
    return places, float(apart.max())


def _below(ply, points, reach):
    """Places (n, 2) on the flat ply of what is at `points` (n, 2) in plan on the formed one, and a
    distance of 0."""
    corners = ply.formed[ply.cells]
    tree = shapely.STRtree(shapely.polygons(corners[:, :, :2]))
    places = shapely.points(points)
    point, cells = tree.query(places, predicate="dwithin", distance=MAX_BEYOND * reach)
    missing, beyond = ~np.isin(np.arange(len(points)), point), np.zeros(len(points))
    if missing.any():
        ply_in_plan = shapely.union_all(tree.geometries)
        beyond[missing] = shapely.distance(ply_in_plan, places[missing])
    _refuse("the trim line leaves the ply", points, beyond, missing, "a line on the ply")
    shares = _shares(corners[cells][:, :, :2], points[point])
    height = (shares * corners[cells][:, :, 2]).sum(1)
    low, high = np.full(len(points), np.inf), np.full(len(points), -np.inf)
    np.minimum.at(low, point, height)
    np.maximum.at(high, point, height)
    folded, flaw = high - low, "the ply overlaps itself, {} mm apart"
    _refuse(flaw, points, folded, folded > reach, "a trim line with z there")
    _, first = np.unique(point, return_index=True)
    return (shares[first, :, None] * ply.x[ply.cells[cells[first]], :2]).sum(1), 0.0


def _refuse(flaw, points, size, wrong, allowed):
    """Raise InputError if any of the points (n, d) are `wrong` (n,), which names the one where the
    `size` (n,) [mm] of the flaw is largest."""
    if wrong.any():
        worst = (size * wrong).argmax()
        words = f"{flaw.format(rounded(size[worst]))} at {coordinates(points[worst])} mm"
        raise InputError(f"{words}; expected {allowed}")


def _shares(corners, points):
    """Barycentric coordinates (n, 3) of `points` (n, d) in the planes of triangles (n, 3, d)."""
    p, q, r = corners.swapaxes(0, 1)
    a, b, c = q - p, r - p, points - p
    aa, ab, bb, ac, bc = ((s * t).sum(1) for s, t in ((a, a), (a, b), (b, b), (a, c), (b, c)))
    second, third = (bb * ac - ab * bc) / (aa * bb - ab**2), (aa * bc - ab * ac) / (aa * bb - ab**2)
    return np.column_stack([1 - second - third, second, third])


def _inside(ply, net):
    """The part of a ply inside its pattern; cells that the net cuts become triangles of pieces."""
    shapes = shapely.polygons(ply.x[ply.cells, :2])
    shapely.prepare(net)
    inner = shapely.covers(net, shapes)
    cut = np.flatnonzero(~inner & shapely.intersects(net, shapes))
    pieces = shapely.constrained_delaunay_triangles(shapely.intersection(shapes[cut], net))
    pieces, owner = shapely.get_parts(pieces, return_index=True)
    corners = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    owner = cut[owner]
    cells = ply.cells[np.repeat(owner, 3)]
    shares = _shares(ply.x[cells, :2], corners)[:, :, None]
    x, u = (np.vstack([v, (shares * v[cells]).sum(1)]) for v in (ply.x, ply.u))
    added = len(ply.x) + np.arange(len(corners)).reshape(-1, 3)
    parents = np.concatenate([np.flatnonzero(inner), owner])
    fields = {name: values[parents] for name, values in ply.fields.items()}
    return _cleaned(x, u, np.vstack([ply.cells[inner], added]), fields)


def _cleaned(x, u, triangles, fields):
    """The ply of these triangles but those with a side that is rounding."""
    sides = x[triangles] - x[np.roll(triangles, -1, 1)]
    real = np.linalg.norm(sides, axis=2).min(1) > 2 * SAME
    grid = grid_of(x, triangles[real], u)
    grid.cell_data.update({name: values[real] for name, values in fields.items()})
    return ply_of(grid)


def write_pattern(
    stem: Path | str,
    pattern: FlatPattern,
    units: dict[str, str] | None = None,
    name: str = "",
    frame: Frame | None = None,
) -> list[Path]:
    """Write STEM.dxf with layers OUTLINE and HOLES, and beside these the ply's `name` as TEXT, an
    arrow along YARNS a, and DIMENSIONS; STEM.csv of x, y and `ring`; and STEM.vtu, the formed part
    in coordinates `frame` with fields, `u` and places `flat` on the flat ply; returns their paths.
    """
    stem = Path(stem)
    files = [stem.with_name(stem.name + ending) for ending in (".dxf", ".csv", ".vtu")]
    rings = []
    for part in shapely.get_parts(pattern.net):
        # without the first point again
        outline, *holes = (shapely.get_coordinates(x)[:-1] for x in shapely.get_rings(part))
        rings += [("OUTLINE", outline), *(("HOLES", hole) for hole in holes)]
    replace_file(files[0], _drawing(rings, name or "ply", _yarn(pattern)))
    rows = [f"{x:.6f},{y:.6f},{k}\n" for k, (_, ring) in enumerate(rings) for x, y in ring]
    replace_file(files[1], "".join(["x [mm],y [mm],ring\n", *rows]))
    ply = in_frame(pattern.part, frame)
    part = grid_of(ply.formed, ply.cells, ply.u)
    part.cell_data.update(ply.fields)
    part.point_data["flat"] = pattern.part.x
    save(files[2], part, {"u": "mm", "flat": "mm"} | (units or {}))
    return files


def _yarn(pattern):
    """A place (2,) of a pattern, and the direction (2,) of yarns a there on the flat ply; None of
    metal."""
    if "a" not in pattern.part.fields:
        return None
    ply, middle = pattern.part, pattern.net.representative_point().coords[0]
    k = np.linalg.norm(ply.x[ply.cells, :2].mean(1) - middle, axis=1).argmin()
    flat, formed = (np.diff(x[ply.cells[k]], axis=0) for x in (ply.x[:, :2], ply.formed))
    along = np.linalg.lstsq(formed.T, ply.fields["a"][k], rcond=None)[0] @ flat
    return np.array(middle), along / np.linalg.norm(along)


def _drawing(rings, name, yarn):
    import ezdxf

    drawing = ezdxf.new(units=ezdxf.units.MM)
    for colour, layer in enumerate(("HOLES", "YARNS", "TEXT", "DIMENSIONS", "OUTLINE"), 1):
        drawing.layers.add(layer, color=colour)
    space = drawing.modelspace()
    for layer, points in rings:
        space.add_lwpolyline(points, close=True, dxfattribs={"layer": layer})
    points = np.vstack([points for _, points in rings])
    low, high = points.min(0), points.max(0)
    h = 0.02 * float((high - low).max())  # of letters
    sizes = {"dimtxt": h, "dimasz": h, "dimexe": h / 2, "dimexo": h / 2}
    for end, angle in (((high[0], low[1]), 0), ((low[0], high[1]), 90)):
        size = space.add_linear_dim(low - 4 * h, low, end, angle=angle, override=sizes)
        size.dimension.dxf.layer = "DIMENSIONS"
        size.render()
    text = space.add_text(name, height=h, dxfattribs={"layer": "TEXT"})
    text.set_placement((low[0], high[1] + h))
    if yarn:  # its tip first
        ends = [yarn[0] + 5 * h * yarn[1], yarn[0] - 5 * h * yarn[1]]
        space.add_leader(ends, override=sizes, dxfattribs={"layer": "YARNS"})
    written = io.StringIO()
    drawing.write(written)
    return written.getvalue()
