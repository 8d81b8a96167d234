"""Measures of a state's cell fields that hold as the mesh is refined: area means, area quantiles, what is at a point."""

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike

from .. import dolfinx_compat as compat
from ..blank import Blank

TAIL = 0.01  # share of the area beyond each of the two values that `bulk` gives


def corners(blank: Blank) -> np.ndarray:
    """Undeformed corners of the owned cells along the frame's axes, in order around each, (cells, 3 or 4, gdim) [mm]."""
    nodes = compat.geometry_dofmap(blank.mesh)[: blank.mesh.topology.index_map(2).size_local]
    around = [0, 1, 2] if compat.cell_name(blank.mesh) == "triangle" else [0, 1, 3, 2]
    x = blank.mesh.geometry.x[nodes[:, around]]
    along = blank.along(x.reshape(-1, 3).T)  # of no cell on some ranks
    return np.moveaxis(along.reshape(len(along), *x.shape[:2]), 0, -1)


def areas(blank: Blank) -> np.ndarray:
    """Undeformed areas of the owned cells, of those with curved edges between their corners, (cells,) [mm2]."""
    x = corners(blank)
    arms = x[:, 1:] - x[:, :1]
    first, second = arms[:, :-1], arms[:, 1:]
    squares = (first**2).sum(2) * (second**2).sum(2) - (first * second).sum(2) ** 2
    return np.sqrt(np.maximum(squares, 0)).sum(1) / 2


def covers(blank: Blank, point: ArrayLike) -> bool:
    """Whether a cell of any rank has the `point` (2,) of a plane blank's frame [mm] in it, so that it is not in a hole."""
    x = corners(blank)[:, :, :2]
    edge, arm = np.roll(x, -1, 1) - x, np.asarray(point, float) - x
    side = edge[:, :, 0] * arm[:, :, 1] - edge[:, :, 1] * arm[:, :, 0]
    near = 1e-9 * (edge**2).sum(2)  # a point on an edge is in both cells
    inside = (side >= -near).all(1) | (side <= near).all(1)
    return bool(blank.mesh.comm.allreduce(int(inside.sum())))


def mean(comm: MPI.Comm, values: np.ndarray, weights: np.ndarray) -> float | None:
    """Mean of the `values` (n,) of all ranks by their `weights` (n,); None where these are 0 in sum."""
    total, weight = comm.allreduce(np.array([values @ weights, weights.sum()], dtype=float), MPI.SUM)
    return float(total / weight) if weight else None


def quantiles(comm: MPI.Comm, values: np.ndarray, weights: np.ndarray, shares: Sequence[float]) -> list[float]:
    """Values below which the `shares` (0 to 1) of the whole weight lie, of `values` and `weights` (n,) of all ranks.

    Between values, each in the middle of its weight, they are interpolated.
    """
    values, weights = (np.concatenate(comm.allgather(np.asarray(part, float))) for part in (values, weights))
    order = np.lexsort((weights, values))  # the same on any number of ranks
    values, weights = values[order], weights[order]
    below = np.cumsum(weights) - weights / 2
    return np.interp(np.asarray(shares) * weights.sum(), below, values).tolist()


def bulk(comm: MPI.Comm, values: np.ndarray, weights: np.ndarray) -> list[float]:
    """The two values between which all but the `TAIL` at either end lies, by `weights`.

    Extremes at singular points, such as a clamp's corners, grow with every refinement; these do not.
    """
    return quantiles(comm, values, weights, (TAIL, 1 - TAIL))
