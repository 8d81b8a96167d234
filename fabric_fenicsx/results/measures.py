"""Measures of a state's cell fields that hold as the mesh is refined: means and quantiles by area,
values at a point."""

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike

from ..scene.scene import Scene
from ..sheet.blank import Blank, Part
from .ply import SAME
from .verdict import Numbers

PLANE_OF_SYMMETRY = "plane of symmetry"  # begins the names of supports of planes beside the origin


def covers(blank: Blank, point: ArrayLike) -> bool:
    """True if a cell of any rank has the `point` (2,) [mm] of a plane blank in it."""
    x = blank.corners()[:, :, :2]
    edge, offset = np.roll(x, -1, 1) - x, np.asarray(point, float) - x
    side = edge[:, :, 0] * offset[:, :, 1] - edge[:, :, 1] * offset[:, :, 0]
    near = 1e-9 * (edge**2).sum(2)  # a point on an edge is in both cells
    inside = (side >= -near).all(1) | (side <= near).all(1)
    return bool(blank.mesh.comm.allreduce(int(inside.sum())))


def mean(comm: MPI.Comm, values: np.ndarray, weights: np.ndarray) -> float | None:
    """Mean of `values` (n,) of all ranks by `weights` (n,); None where these are 0 in sum."""
    total, weight = comm.allreduce(np.array([values @ weights, weights.sum()], dtype=float))
    return float(total / weight) if weight else None


def quantiles(
    comm: MPI.Comm, values: np.ndarray, weights: np.ndarray, shares: Sequence[float]
) -> list[float]:
    """Values below which the `shares` (0 to 1) of the whole weight lie, of `values` and `weights`
    (n,) of all ranks, interpolated between values, each in the middle of its weight."""
    values, weights = np.hstack(comm.allgather(np.array([values, weights], float)))
    order = np.lexsort((weights, values))  # the same on any number of ranks
    values, weights = values[order], weights[order]
    below = np.cumsum(weights) - weights / 2
    return np.interp(np.asarray(shares) * weights.sum(), below, values).tolist()


def extremes(comm: MPI.Comm, values: np.ndarray) -> tuple[float, float]:
    """Smallest and largest of the arrays of all ranks."""
    low, high = values.min(initial=np.inf), values.max(initial=-np.inf)
    return float(comm.allreduce(low, MPI.MIN)), float(comm.allreduce(high, MPI.MAX))


def where_largest(
    comm: MPI.Comm, values: np.ndarray, rows: np.ndarray
) -> tuple[float, list[float]]:
    """Largest of the `values` (n,) of all ranks, and which of the `rows` (n, k) is there: of those
    whose values differ by rounding (1e-6) the first in their own order, which is the same on any
    number of ranks."""
    largest = extremes(comm, values)[1]
    mine = rows[values >= largest - 1e-6 * abs(largest)].tolist()
    return largest, min(row for each in comm.allgather(mine) for row in each)


def cells_of(parts: Sequence[Part]) -> np.ndarray:
    """Numbers of all cells of the `parts`, one part after the other."""
    return np.concatenate([part.cells for part in parts])


def largest_in(
    blank: Blank, parts: Sequence[Part], values: np.ndarray, also: np.ndarray
) -> tuple[float, Numbers, float]:
    """Largest of the `values` (n,) in all cells of the `parts`; the place `at_mm` where it
    is, (x, y) of a flat sheet and (x, y, z) of another, of one in space `formed_at_mm` (x, y, z)
    now, and, of several parts, the name of the one that it is `in`; and what `also` (n,) is there.
    """
    part_of = np.repeat(np.arange(len(parts)), [len(part.cells) for part in parts])
    u = blank.nodal_displacement()[blank.cell_nodes[:, : len(blank.around)]].mean(1)
    flat, dim = blank.places(), u.shape[1]
    # to few digits, so that of places that mirror each other the same is named on any ranks
    places = np.column_stack([flat, blank.centres()[:, :dim] + u])[cells_of(parts)].round(6) + 0.0
    rows = np.column_stack([part_of, places, also])
    largest, (k, *centre, there) = where_largest(blank.mesh.comm, values, rows)
    place: Numbers = {"at_mm": centre[: flat.shape[1]]}
    place |= {"formed_at_mm": centre[flat.shape[1] :]} if dim == 3 else {}
    return largest, place | ({"in": parts[int(k)].name} if len(parts) > 1 else {}), there


def near(comm: MPI.Comm, places: np.ndarray, point: ArrayLike, radius: float) -> np.ndarray:
    """Mask (n,) of `places` (2 or more, n) within `radius` [mm] of `point`, one at least."""
    distance = np.linalg.norm(places[:2] - np.asarray(point, float)[:, None], axis=0)
    return distance <= max(radius, extremes(comm, distance)[0])


def planes_of_symmetry(scene: Scene) -> dict[int, float]:
    """Axes x (0) and y (1) perpendicular to which a plane of symmetry bounds the scene's flat
    sheets, and where it cuts the axis [mm]: 0, or as a support is called `PLANE_OF_SYMMETRY`.
    Supports hold all nodes there, two at least, along the axis, and not all of them along another
    one, as a clamp does."""
    comm, held = scene.comm, scene.blank.whole.nodes
    x = scene.blank.coordinates()[: len(held)]
    fixed = np.zeros((len(held), scene.blank.mesh.geometry.dim), dtype=bool)
    fixed.flat[scene.fixed_dofs] = True
    planes, named = {}, [s.name for s in scene.supports if s.name.startswith(PLANE_OF_SYMMETRY)]
    for axis in (0, 1):
        low = extremes(comm, x[held, axis])[0]
        there = held & (x[:, axis] <= low + SAME)
        moves = comm.allreduce((~fixed[there]).sum(0)) > 0
        is_bound = abs(low) <= SAME or any(f" {'xy'[axis]} = " in name for name in named)
        is_bound &= comm.allreduce(there.sum()) > 1
        if is_bound and not moves[axis] and np.delete(moves, axis).all():
            planes[axis] = 0.0 if abs(low) <= SAME else low
    return planes
