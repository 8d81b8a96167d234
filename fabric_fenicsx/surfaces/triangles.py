"""Triangles as files and users give them: checked, doubles merged, turned the same way round."""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from ..core.errors import InputError
from ..core.graph import connected
from .facets import LAST, NEXT, facet_normals, topology
from .values import checked_points


def repaired(
    points: ArrayLike, triangles: ArrayLike, normals: ArrayLike | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Points (n, 3) [mm] and triangles (m, 3) without doubles and triangles without area, turned
    the same way round; normals (m, 3, 3) at their corners if given, 0 where there is none.
    Raises InputError if none has an area, and for points that are not finite."""
    x, cells = checked_points(points), np.asarray(triangles)
    for lost in x[~np.isfinite(x).all(1)][:1]:
        raise InputError(f"a point of the surface is {lost.tolist()}; allowed are finite ones")
    given = None if normals is None else np.asarray(normals, dtype=float)
    x, number = np.unique(x, axis=0, return_inverse=True)
    cells = number.ravel()[cells]
    # distance of points that are one, over the largest coordinate: files have singles
    scale = abs(x).max(initial=0)
    if not np.array_equal(x, x.astype(np.float32)):
        scale = min(scale, np.ptp(x, axis=0).max(initial=0))
    same = cKDTree(x).query_pairs(2e-7 * scale, output_type="ndarray")
    x, cells = _joined(x, cells, same)
    x, cells = _joined(x, cells, _cracks(x, cells))
    corners = x[cells]
    edges = np.roll(corners, -1, 1) - corners
    longest = (edges**2).sum(2).max(1, initial=0)
    unlike = np.zeros(len(cells), dtype=bool)  # the first of those with the same three points
    unlike[np.unique(np.sort(cells, 1), axis=0, return_index=True)[1]] = True
    area = unlike & (np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) > 1e-10 * longest)
    if not area.any():
        raise InputError("the surface has no triangle with an area; allowed is one at least")
    used, number = np.unique(cells[area], return_inverse=True)
    cells, turn = _agreeing(number.reshape(-1, 3))
    if given is not None:
        given = given[area]
        given[turn] = given[turn][:, [0, 2, 1]]
        given = np.where(turn[:, None, None], -given, given)
        facets = facet_normals(x[used], cells)[0][:, None]
        # at poles of a CAD model's faces there is none
        agrees = (given * facets).sum(2)[..., None] > math.cos(math.pi / 3)
        given = np.where(agrees, given, 0.0)
    return x[used], cells, given


def _cracks(x, cells):
    """Pairs (k, 2) of points at both sides of a crack, as CAD programs leave them between faces: up
    to 2e-3 median edges, and a tenth of the shortest edge at them, apart."""
    ends = np.sort(np.stack([cells, np.roll(cells, -1, 1)], -1).reshape(-1, 2), 1)
    ends = ends[ends[:, 0] != ends[:, 1]]
    ends, sharing = np.unique(ends, axis=0, return_counts=True)
    rim = np.unique(ends[sharing == 1])
    if not rim.size:
        return rim
    length = np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)
    near = np.full(len(x), 2e-3 * np.median(length))
    for end in ends.T:
        np.minimum.at(near, end, 0.1 * length)
    pairs = rim[cKDTree(x[rim]).query_pairs(near[rim].max(), output_type="ndarray")]
    apart = np.linalg.norm(x[pairs[:, 1]] - x[pairs[:, 0]], axis=1)
    return pairs[apart <= near[pairs].min(1)]


def _joined(x, cells, pairs):
    """Points without the later ones of pairs (k, 2) that are one, and cells of these."""
    if not len(pairs):
        return x, cells
    _, one = connected(len(x), pairs.T)
    _, first = np.unique(one, return_index=True)
    return x[first], one[cells]


def _agreeing(triangles):
    """The triangles, turned as the first of their connected part, and which were turned (m,)."""
    m = len(triangles)
    ends = np.stack([triangles[:, NEXT], triangles[:, LAST]], 2)
    across = topology(triangles)
    t, k = np.nonzero(across.triangle >= 0)
    o, back = across.triangle[t, k], across.edge[t, k]
    same = (ends[t, k, 0] == ends[o, back, 0]).astype(np.int64)
    # each triangle twice, as it is and turned, joined with what agrees with it
    joined = [np.append(t, t + m), np.append(o + same * m, o + (1 - same) * m)]
    label = connected(2 * m, joined)[1].reshape(2, m)
    _, first, part = np.unique(label.min(0), return_index=True, return_inverse=True)
    turn = label[0] != label[0][first][part]
    triangles = triangles.copy()
    triangles[turn] = triangles[turn][:, [0, 2, 1]]
    return triangles, turn
