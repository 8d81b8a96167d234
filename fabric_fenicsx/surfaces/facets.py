"""Flat triangles: their neighbours, normals, flat regions and sharp edges, and the normals at their
corners."""

import math
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import lsqr

from ..core.graph import connected

# the corners after and before corner k; edge k lies opposite it, from NEXT[k] to LAST[k]
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def unit(v: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) with the length 1, or 0 as they are."""
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300)


class Topology(NamedTuple):
    """Across edge k of triangle t lies edge `edge[t, k]` of triangle `triangle[t, k]` (m, 3), -1
    where there is none or more than one; sharing (m, 3): how many triangles have the edge."""

    triangle: np.ndarray
    edge: np.ndarray
    sharing: np.ndarray


def topology(triangles: np.ndarray) -> Topology:
    """The `Topology` of triangles (m, 3) that are turned the same way round where they meet."""
    sides = np.sort(np.stack([triangles[:, NEXT], triangles[:, LAST]], 2).reshape(-1, 2), 1)
    keys = sides.astype(np.int64) @ [triangles.max() + 1, 1]
    _, name, count = np.unique(keys, return_inverse=True, return_counts=True)
    order = np.argsort(name, kind="stable")
    first = np.append(0, count.cumsum())[:-1]
    pair = first[count == 2]
    across = np.full(len(sides), -1)
    across[order[pair]], across[order[pair + 1]] = order[pair + 1], order[pair]
    inside = across >= 0
    columns = np.where(inside, across // 3, -1), np.where(inside, across % 3, -1), count[name]
    return Topology(*(each.reshape(triangles.shape) for each in columns))


def facet_normals(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (m, 3) and areas (m,) of the facets."""
    p, q, r = points[triangles].swapaxes(0, 1)
    normal = np.cross(q - p, r - p)
    size = np.linalg.norm(normal, axis=1)
    return normal / size[:, None], size / 2


def vertex_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals (n, 3) at the points of triangles, exact on a sphere: N. Max, Weights for
    computing vertex normals from facet normals, J. Graphics Tools 4 (1999)."""
    corners = points[triangles]
    onwards, back = np.roll(corners, -1, 1) - corners, np.roll(corners, 1, 1) - corners
    total = np.zeros_like(points)
    weights = np.maximum((onwards**2).sum(2) * (back**2).sum(2), 1e-300)
    np.add.at(total, triangles, np.cross(onwards, back) / weights[..., None])
    return unit(total)


def flat_regions(
    points: np.ndarray, triangles: np.ndarray, across: Topology, tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Region (m,) of each triangle, normal (m, 3) of its plane and area (m,): connected triangles
    whose vertices lie within `tolerance` [mm] of the plane of the region's largest one."""
    normal, area = facet_normals(points, triangles)
    t, k = np.nonzero(across.triangle >= 0)
    other = across.triangle[t, k]
    large, small = np.where(area[t] >= area[other], [t, other], [other, t])

    def within(plane, triangle):
        arm = points[triangles[triangle]] - points[triangles[plane, 0]][:, None]
        return abs(np.einsum("nci,ni->nc", arm, normal[plane])).max(1, initial=0) <= tolerance

    agree = (normal[large] * normal[small]).sum(1) > 0
    flat = within(large, small) & agree
    t, other = t[flat], other[flat]
    left = np.ones(len(triangles), dtype=bool)
    region = np.arange(len(triangles))
    order = np.argsort(area, kind="stable")
    # what bends out of its largest triangle's plane is tried again without that
    for _ in range(20):
        _, number = connected(len(left), [t, other])
        seed = np.empty(number.max() + 1, dtype=np.int64)
        seed[number[order]] = order  # the last is the largest
        seed = seed[number]
        keep = left & (within(seed, np.arange(len(left))) | (seed == np.arange(len(left))))
        region[keep] = seed[keep]
        left &= ~keep
        on = left[t] & left[other]
        t, other = t[on], other[on]
        if not left.any():
            break
    total = np.zeros_like(normal)
    np.add.at(total, region, normal * area[:, None])
    return region, unit(total)[region], np.bincount(region, area, len(region))[region]


class Corners(NamedTuple):
    """Corners of m triangles: smooth vertex `name` of each (m, 3), normals of these (s, 3), and
    which edges are sharp (m, 3)."""

    name: np.ndarray
    normals: np.ndarray
    sharp: np.ndarray


def corner_normals(
    points: np.ndarray,
    triangles: np.ndarray,
    across: Topology,
    crease: float,
    tolerance: float,
    given: np.ndarray | None = None,
) -> Corners:
    """The `Corners` for edges that are sharp where facets turn by more than `crease` [rad], or
    where normals `given` (m, 3, 3), 0 where not known, say so."""
    region, plane, region_area = flat_regions(points, triangles, across, tolerance)
    _, area = facet_normals(points, triangles)
    sure = _true_planes(points, triangles, across, region)
    if given is None:
        other = np.maximum(across.triangle, 0)
        turn = np.einsum("mi,mki->mk", plane, plane[other])
        planes = sure[:, None] & sure[other] & (region[:, None] != region[other])
        limit = np.where(planes, min(crease, math.radians(1.0)), crease)
        sharp = (across.triangle < 0) | (turn < np.cos(limit))
    else:
        sharp = _model_edges(across, given)
    # number of smooth vertices, and which each corner (m, 3) is, joined across smooth edges
    t, edge = np.nonzero(~sharp)
    o, back = across.triangle[t, edge], across.edge[t, edge]
    one = np.concatenate([3 * t + NEXT[edge], 3 * t + LAST[edge]])
    same = np.concatenate([3 * o + LAST[back], 3 * o + NEXT[back]])
    count, name = connected(sharp.size, [one, same])
    name = name.reshape(sharp.shape)

    def gathered(values):
        total = np.zeros((count, 3))
        np.add.at(total, name, values)
        return unit(total)

    normals = gathered((plane * area[:, None])[:, None])
    if given is not None:
        own = gathered(given)
        return Corners(name, np.where(own.any(1)[:, None], own, normals), sharp)
    best, fixed = _planes_at_vertices(name, count, region, region_area, sure)
    normals[fixed] = plane[best[fixed]]
    return Corners(name, _arcs(points, triangles, name, normals, fixed), sharp)


def _true_planes(points, triangles, across, region):
    """Mask of triangles in flat regions with a vertex inside, which only true planes have."""
    low, high = np.full(len(points), len(triangles)), np.full(len(points), -1)
    np.minimum.at(low, triangles.ravel(), np.repeat(region, 3))
    np.maximum.at(high, triangles.ravel(), np.repeat(region, 3))
    rim, (t, k) = np.zeros(len(points), dtype=bool), np.nonzero(across.triangle < 0)
    rim[triangles[t, NEXT[k]]] = rim[triangles[t, LAST[k]]] = True
    inner = (low == high) & ~rim
    sure = np.zeros(len(triangles), dtype=bool)
    sure[low[inner]] = True
    return sure[region]


def _model_edges(across, given):
    """Sharp edges (m, 3) by the normals of a CAD model, which knows where it is sharp; where it has
    no normal, at poles, it is not."""
    sharp, other = across.triangle < 0, np.maximum(across.triangle, 0)
    for k in range(3):
        back = across.edge[:, k]
        for here, there in ((NEXT, LAST), (LAST, NEXT)):
            n, o = given[:, here[k]], given[other[:, k], there[back]]
            # where the faces of a CAD model meet at more than this they have a sharp edge
            sharp[:, k] |= n.any(1) & o.any(1) & ((n * o).sum(1) < math.cos(math.radians(5.0)))
    return sharp


def _planes_at_vertices(name, count, region, region_area, sure):
    """A triangle of the best plane at each smooth vertex; whether it has that plane's normal."""
    size = np.bincount(region, minlength=len(region))[region]
    score = np.where(sure, region_area.max(), 0.0) + np.where(size >= 2, region_area, 0.0)
    order = np.argsort(np.repeat(score, 3), kind="stable")
    best, second = np.empty(count, dtype=np.int64), np.zeros(count)
    best[name.ravel()[order]] = order // 3
    rest = np.where(region[best][name] == region[:, None], 0.0, region_area[:, None])
    np.maximum.at(second, name.ravel(), rest.ravel())  # the area of the next plane
    # a flat region so many times larger than what it adjoins gives its normal to common vertices
    return best, sure[best] | ((size[best] >= 2) & (region_area[best] >= 8.0 * second))


def _arcs(points, triangles, name, normals, fixed):
    """Normals tilted so that edges have the same angle to both ends' normals, as arcs have: by
    least squares, with averaged normals where that leaves them open."""
    ends = np.stack([name[:, NEXT], name[:, LAST]], 2).reshape(-1, 2)
    place = np.stack([triangles[:, NEXT], triangles[:, LAST]], 2).reshape(-1, 2)
    _, one = np.unique(np.sort(ends, 1) @ [len(normals), 1], return_index=True)
    ends, place = ends[one], place[one]
    free = ~fixed
    chord = unit(points[place[:, 1]] - points[place[:, 0]])
    use = free[ends].any(1)
    ends, chord = ends[use], chord[use]
    if not len(ends):
        return normals
    x = unit(np.cross(normals, np.eye(3)[abs(normals).argmin(1)]))
    frame = np.stack([x, np.cross(normals, x)], 1)
    slope = np.einsum("neai,ni->nea", frame[ends], chord)  # of both ends, along both tangents
    row, end = np.nonzero(free[ends])
    unknown = 2 * (np.cumsum(free) - 1)[ends[row, end]]
    at = np.repeat(row, 2), (unknown[:, None] + [0, 1]).ravel()
    J = csr_matrix((slope[row, end].ravel(), at), shape=(len(ends), 2 * free.sum()))
    miss = ((normals[ends[:, 0]] + normals[ends[:, 1]]) * chord).sum(1)
    # weight of averaged normals beside the condition that edges are arcs
    tilt = lsqr(J, -miss, damp=math.sqrt(0.03), atol=1e-6, btol=1e-6, iter_lim=200)[0]
    new = normals.copy()
    new[free] += np.einsum("na,nai->ni", tilt.reshape(-1, 2), frame[free])
    return unit(new)
