"""Flat triangles: repaired, their neighbours, flat regions, sharp edges and corner normals."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import lsqr
from scipy.spatial import cKDTree

from ..core.errors import InputError
from ..core.graph import connected
from .surfaces import checked_points

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


class SmoothVertices(NamedTuple):
    """Corners of m triangles: smooth vertex `name` of each (m, 3), normals of these (s, 3), those
    averaged over their facets (s, 3), which ones are in true planes (s,), and which edges are sharp
    (m, 3)."""

    name: np.ndarray
    normals: np.ndarray
    averaged: np.ndarray
    planar: np.ndarray
    sharp: np.ndarray


def corner_normals(
    points: np.ndarray,
    triangles: np.ndarray,
    across: Topology,
    crease: float,
    tolerance: float,
    given: np.ndarray | None = None,
) -> SmoothVertices:
    """The `SmoothVertices` for edges that are sharp where facets turn by more than `crease` [rad],
    or where normals `given` (m, 3, 3), 0 where not known, say so."""
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
        normals = np.where(own.any(1)[:, None], own, normals)
        return SmoothVertices(name, normals, normals, np.zeros(count, bool), sharp)
    best, fixed = _planes_at_vertices(name, count, region, region_area, sure)
    normals[fixed] = plane[best[fixed]]
    arcs = _arcs(points, triangles, name, normals, fixed)
    return SmoothVertices(name, arcs, normals, sure[best], sharp)


def divided_at_planes(
    points: np.ndarray, triangles: np.ndarray, across: Topology, corners: SmoothVertices
) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles, divided where true planes end within them, as patches would bend from
    the plane's last vertices on. An arc tangent to the plane begins z / tan(t / 2) before a vertex
    at height z whose normal is tilted by t; the tilt is that of arcs between vertices off the
    planes."""
    name, planar = corners.name, corners.planar
    off = ~planar[name].any(1)
    normals = _arcs(points, triangles[off], name[off], corners.averaged, planar)
    t, k = np.nonzero(~corners.sharp | (across.sharing == 1))
    i, j = np.where(planar[name[t, NEXT[k]]], [NEXT[k], LAST[k]], [LAST[k], NEXT[k]])
    ends = planar[name[t, i]] & ~planar[name[t, j]]
    t, k, i, j = (each[ends] for each in (t, k, i, j))
    a, b = triangles[t, i], triangles[t, j]
    arm, plane, normal = points[b] - points[a], normals[name[t, i]], normals[name[t, j]]
    z, cosine = (arm * plane).sum(1), (normal * plane).sum(1)
    aside = normal - cosine[:, None] * plane
    # |sin| of the tilt over 1 - cos is 1 / tan(t / 2)
    sine = np.linalg.norm(aside, axis=1)
    along = -np.sign(z) * (arm * aside).sum(1) / np.maximum(sine, 1e-300)
    curved = abs(z) * sine / np.maximum(1 - cosine, 1e-300)
    # what ends within 5 % of an edge from a vertex ends there, so that no slivers are made
    least = 0.05 * np.linalg.norm(arm, axis=1)
    points, ended, beyond = points.copy(), np.zeros(len(points), dtype=bool), along > 0
    ends, begins = beyond & (along - curved < least), beyond & (curved < least)
    ended[a[ends]] = ended[b[begins]] = True
    foot = points[b] - z[:, None] * plane
    points[b[begins]] = foot[begins]
    new = points[a] + (1 - curved / np.where(beyond, along, 1.0))[:, None] * (foot - points[a])
    key, within = np.sort([a, b], 0).T @ [len(points), 1], beyond & ~ended[a] & ~ended[b]
    t, k, new, key = (each[within] for each in (t, k, new, key))
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    split = np.full(triangles.shape, -1)
    split[t, k] = len(points) + number.ravel()
    points = np.concatenate([points, new[first]])
    return points, _divided(points, triangles, split)


def _divided(points, triangles, split):
    """Triangles with points on one or two of their edges, `split` (m, 3), -1 for none."""
    many = (split >= 0).sum(1)
    # first the corner opposite to the one edge that is unlike the other two
    first = np.where(many == 2, split.argmin(1), split.argmax(1))[:, None]
    turned = (first + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles, turned, 1).T
    p, q, r = np.take_along_axis(split, turned, 1).T  # across from a, b and c
    length = lambda i, j: np.linalg.norm(points[i] - points[j], axis=1)  # noqa: E731
    to_c = length(r, c) <= length(b, q)
    quads = (a, r, q), (r, b, np.where(to_c, c, q)), (np.where(to_c, r, b), c, q)
    parts = [(0, (a, b, c)), (1, (a, b, p)), (1, (a, p, c)), *((2, each) for each in quads)]
    return np.concatenate([np.stack(each, 1)[many == count] for count, each in parts])


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


def repaired(
    points: ArrayLike, triangles: ArrayLike, normals: ArrayLike | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Points (n, 3) [mm] and triangles (m, 3) without doubles and triangles without area, turned
    the same way round; normals (m, 3, 3) at their corners if given, 0 where there is none.
    Raises InputError if none has an area, and for points that are not finite."""
    x, cells = checked_points(points), np.asarray(triangles)
    for lost in x[~np.isfinite(x).all(1)][:1]:
        raise InputError(f"a point of the surface is {lost.tolist()}; expected finite numbers")
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
        raise InputError("the surface has no triangle with a positive area")
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
