"""Measurements of a formed ply: paths, outline and draw-in, wrinkles.

Every function takes the grid of a state, as `states.read_state` gives it: undeformed places of a
flat ply, `u` at the points, fields on the cells. Edges on planes of symmetry are not free.
"""

import pathlib
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy import spatial

from ..core.errors import InputError
from ..core.formatting import coordinates
from .ply import SAME, Grid, check_field, edge_sides, plan_area, ply_of

File: TypeAlias = pathlib.Path | str


class Path(NamedTuple):
    """Values at the k points of a path, (k,) each: `distance` along it on the flat and `formed` on
    the formed ply [mm], logarithmic fibre strains [-] and shear angle [deg]; formed `places` (k, 3)
    [mm]."""

    distance: np.ndarray
    formed: np.ndarray
    log_eps_11: np.ndarray
    log_eps_22: np.ndarray
    shear_angle: np.ndarray
    places: np.ndarray


def along_paths(
    grid: Grid, angles_deg: Sequence[float] = (0, 45, 90), spacing: float = 5.0
) -> dict[float, Path]:
    """{angle: `Path`} from the whole ply's centroid to its edge, straight on the flat ply, at
    `angles_deg` to x; a point each `spacing` [mm] and one at the edge. A value is linear between
    nodes, and there the mean over the cells around by their areas (as in Fig. 16 of the paper).
    Raises InputError if the centroid is not on the ply."""
    from matplotlib.tri import LinearTriInterpolator  # takes long to import

    ply, fine = ply_of(grid), 20  # points of the line on the formed ply for each point of the path
    middles, paths = ply.x[ply.cells, :2].mean(1), {}
    centre = np.average(middles, axis=0, weights=plan_area(ply.x, ply.cells))
    centre[[*ply.planes]] = [*ply.planes.values()]
    centre = centre.round(9)
    plan, cell_at, _ = _found(ply, centre, "the centroid")
    factors = {"log_eps_11": 1.0, "log_eps_22": 1.0, "shear_angle": 180 / np.pi}
    at_nodes = [factor * ply.at_nodes(ply.fields[name]) for name, factor in factors.items()]
    of = [LinearTriInterpolator(plan, v, cell_at) for v in (*ply.formed.T, *at_nodes)]
    most = np.linalg.norm(ply.x[:, :2] - centre, axis=1).max()
    for angle in angles_deg:
        direction = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        direction *= 1 - 1e-9  # the edge is not outside, by rounding
        s = np.arange(0, most + spacing, spacing / fine)
        first = (cell_at(*(centre[:, None] + np.outer(direction, s))) < 0).argmax()  # beside it
        low, high = s[first - 1 : first + 1]
        while high - low > SAME / 10:
            middle = (low + high) / 2
            outside = cell_at(*(centre + middle * direction)) < 0
            low, high = (low, middle) if outside else (middle, high)
        s = np.append(s[:first], low)
        places = centre[:, None] + np.outer(direction, s)
        line = np.column_stack([x(*places) for x in of[:3]])
        length = np.append(0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
        k = np.arange(0, len(s) - 1, fine)
        # no point just before the one at the edge
        k = np.append(k[s[-1] - s[k] > SAME * spacing], len(s) - 1)
        values = {name: v(*places[:, k]).data for name, v in zip(factors, of[3:])}
        paths[angle] = Path(s[k], length[k], **values, places=line[k])
    return paths


def _found(ply, place, name):
    """The flat ply as Matplotlib's triangulation, its function from places to cells, and the cell
    at a place."""
    from matplotlib.tri import Triangulation

    plan = Triangulation(*ply.x[:, :2].T, ply.cells)
    cell_at = plan.get_trifinder()
    if (cell := int(cell_at(*place))) < 0:
        flaw = f"{name}, {coordinates(place)} mm, is not on the flat sheet"
        raise InputError(f"{flaw}; expected a place on it")
    return plan, cell_at, cell


def value_at(grid: Grid, place: ArrayLike, name: str) -> float:
    """Field `name`, of one number a cell, of the cell at `place` (x, y) [mm] of the flat ply.
    Raises InputError for a place beside it and for a field that it does not have."""
    ply = ply_of(grid)
    check_field(name, ply.fields)
    return float(ply.fields[name][_found(ply, np.asarray(place, float), "the place")[2]])


def write_paths(file: File, paths: Mapping[float, Path]) -> None:
    """Write `along_paths` to a CSV file, a row a point."""
    names = "path_deg,distance_mm,formed_distance_mm,log_eps_11,log_eps_22,shear_angle_deg"
    rows = [[angle, *row] for angle, path in paths.items() for row in zip(*path[:-1])]
    np.savetxt(file, rows, "%.8g", ",", "\r\n", header=names, comments="")


class Outline(NamedTuple):
    """A free edge of the ply, anticlockwise: undeformed and formed places (n, 3) [mm] and the way
    `inwards` (n,) [mm] that it went in plan, along the undeformed edge's normal (at corners the
    mean of both). A closed one ends where it starts."""

    undeformed: np.ndarray
    formed: np.ndarray
    inwards: np.ndarray


def outline(grid: Grid) -> list[Outline]:
    """The free edges of the ply [list of `Outline`], without those on planes of symmetry."""
    ply = ply_of(grid)
    sides = edge_sides(ply.cells)
    for axis, at in ply.planes.items():
        sides = sides[(ply.x[sides, axis] != at).any(1)]
    after = dict(sides.tolist())
    starts = sorted(after.keys() - after.values())
    edges = []
    while after:
        edge = [starts.pop() if starts else next(iter(after))]
        while edge[-1] in after:
            edge.append(after.pop(edge[-1]))
        x, u = ply.x[edge], ply.u[edge]
        along = np.diff(x[:, :2], axis=0)
        outwards = np.column_stack([along[:, 1], -along[:, 0]])
        outwards /= np.linalg.norm(along, axis=1)[:, None]
        ends = (outwards[-1], outwards[0]) if edge[0] == edge[-1] else (outwards[0], outwards[-1])
        normal = np.vstack([ends[0], outwards]) + np.vstack([outwards, ends[1]])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        edges.append(Outline(x, x + u, -(u[:, :2] * normal).sum(1)))
    return edges


def draw_in(grid: Grid) -> dict[str, float | list[float]]:
    """Ways of the edge inwards in plan [mm], as in `Outline`: {name: value} at the middle of the
    long and of the short side of the rectangle around the ply and at its corner, as means, at the
    middle of each side of a whole ply, and the largest, with its place (x, y) on the flat ply."""
    edges, cut = outline(grid), ply_of(grid).planes
    # without the last point of a closed one, which is its first
    ends = [None if (edge.formed[0] != edge.formed[-1]).any() else -1 for edge in edges]
    place = np.concatenate([edge.undeformed[:end, :2] for edge, end in zip(edges, ends)])
    inwards = np.concatenate([edge.inwards[:end] for edge, end in zip(edges, ends)])
    centre = (place.min(0) + place.max(0)) / 2
    centre[[*cut]] = [*cut.values()]
    sides = place - centre
    half = abs(sides).max(0)
    # of a square sheet x is the long side, whatever rounding says
    is_along_x = half[0] > half[1] - SAME
    long, short = half * np.eye(2)[[1, 0]] if is_along_x else half * np.eye(2)
    spots = {"middle_of_long_side": long, "middle_of_short_side": short, "corner": half}
    asked = [(name, abs(sides), at) for name, at in spots.items()]
    for axis, side in enumerate(half * np.eye(2)):
        if axis not in cut:
            asked += [
                (f"middle_at_{end}_{'xy'[axis]}", sides, at)
                for end, at in (("low", -side), ("high", side))
            ]
    ways = dict[str, float | list[float]]()
    for name, places, at in asked:
        distance = np.linalg.norm(places - at, axis=1)
        ways[f"{name}_mm"] = float(inwards[distance < distance.min() + SAME].mean())
    largest = float(inwards.max())
    there = (place.round(6) + 0.0)[inwards >= largest - 1e-6 * abs(largest)].tolist()
    return ways | {"largest_mm": largest, "largest_at_mm": min(there)}


def asymmetry(grid: Grid, axis: int) -> tuple[float, float, np.ndarray] | None:
    """The largest displacement in plan, by how much the formed sheet is at most off its mirror
    image across an axis (0: in x = 0) [mm], and the place (2,) of that. None if this is less than
    a tenth of it, and for a mesh that is not its own image."""
    x, mirror = np.asarray(grid.points), 1.0 - 2.0 * np.eye(3)[axis]
    away, image = spatial.KDTree(x).query(x * mirror)
    u = np.asarray(grid.point_data["u"])
    moved, off = (np.linalg.norm(v[:, :2], axis=1) for v in (u, u - u[image] * mirror))
    is_alike = away.max() > SAME or off.max() <= 0.1 * moved.max()
    return None if is_alike else (moved.max(), off.max(), x[off.argmax(), :2])


def contrast(grid: Grid, name: str) -> float:
    """Root mean square of how far the cells' field `name` is from the mean about them: what bands
    one or two cells wide have and smooth fields do not, in the field's unit."""
    ply = ply_of(grid)
    values = ply.fields[name]
    return float(np.sqrt(np.mean((values - ply.at_nodes(values)[ply.cells].mean(1)) ** 2)))
