"""Curved triangles that meet with a common tangent plane: their normals at the vertices and their control points.

A patch is a quartic over barycentric coordinates b with the rational inner points of Gregory. Along an edge the tangent plane
depends on that edge alone, so that two patches share it: D. J. Walton, D. S. Meek, A triangular G1 patch from boundary curves,
Computer-Aided Design 28 (1996) 113. Where all three corners have the facet's normal the patch is the facet.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import lsqr

NEXT, LAST = [1, 2, 0], [2, 0, 1]  # of corner 0, 1, 2; edge k lies opposite corner k, from NEXT[k] to LAST[k]
FLAT_MEET = math.radians(1.0)  # flat regions that meet at more than this have a sharp edge
KINK = math.radians(5.0)  # where the faces of a CAD model meet at more than this they have a sharp edge
DOMINANT = (
    8.0  # a flat region so many times larger than what it adjoins gives its normal to the vertices it has in common
)
PRIOR = 0.03  # weight of averaged normals beside the condition that edges are arcs


class Topology(NamedTuple):
    """Of m triangles: across edge k of triangle t lies edge `edge[t, k]` of triangle `triangle[t, k]` (m, 3), -1 where
    there is none or more than one; sharing (m, 3): how many triangles have the edge."""

    triangle: np.ndarray
    edge: np.ndarray
    sharing: np.ndarray


def topology(triangles: np.ndarray) -> Topology:
    """The `Topology` of triangles (m, 3) that are turned the same way round where they meet."""
    sides = np.sort(np.stack([triangles[:, NEXT], triangles[:, LAST]], 2).reshape(-1, 2), 1).astype(np.int64)
    _, name, count = np.unique(
        sides[:, 0] * (triangles.max() + 1) + sides[:, 1], return_inverse=True, return_counts=True
    )
    order = np.argsort(name, kind="stable")
    first = np.append(0, count.cumsum())[:-1]
    pair = first[count == 2]
    across = np.full(len(sides), -1)
    across[order[pair]], across[order[pair + 1]] = order[pair + 1], order[pair]
    inside = across >= 0
    shape = triangles.shape
    return Topology(
        np.where(inside, across // 3, -1).reshape(shape),
        np.where(inside, across % 3, -1).reshape(shape),
        count[name].reshape(shape),
    )


def facet_normals(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (m, 3) and areas (m,) of the facets."""
    p, q, r = points[triangles].swapaxes(0, 1)
    normal = np.cross(q - p, r - p)
    size = np.linalg.norm(normal, axis=1)
    return normal / size[:, None], size / 2


def vertex_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals (n, 3) at the points of triangles, those of the sphere at the vertices of a polyhedron in a sphere: N. Max,
    Weights for computing vertex normals from facet normals, J. Graphics Tools 4 (1999)."""
    corners = points[triangles]
    onwards, back = np.roll(corners, -1, 1) - corners, np.roll(corners, 1, 1) - corners
    total = np.zeros_like(points)
    weights = np.maximum((onwards**2).sum(2) * (back**2).sum(2), 1e-300)
    np.add.at(total, triangles, np.cross(onwards, back) / weights[..., None])
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]


def flat_regions(
    points: np.ndarray, triangles: np.ndarray, across: Topology, tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Region (m,) of each triangle, normal (m, 3) of its plane and area (m,): connected triangles whose vertices lie within
    `tolerance` [mm] of the plane of the region's largest one. Slivers take the normal of the plane that they lie in."""
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
    for _ in range(20):  # what bends out of its largest triangle's plane is tried again without that
        graph = sparse.coo_matrix((np.ones(len(t)), (t, other)), shape=(len(left),) * 2)
        number = connected_components(graph, directed=False)[1]
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
    total /= np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]
    return region, total[region], np.bincount(region, area, len(region))[region]


class Corners(NamedTuple):
    """Of m triangles: smooth vertex of each corner `name` (m, 3), normals of those (s, 3), which edges are sharp (m, 3), and
    a triangle that names the flat region of each (m,)."""

    name: np.ndarray
    normals: np.ndarray
    sharp: np.ndarray
    region: np.ndarray


def corner_normals(
    points: np.ndarray,
    triangles: np.ndarray,
    across: Topology,
    crease: float,
    tolerance: float,
    given: np.ndarray | None = None,
) -> Corners:
    """The `Corners` for edges that are sharp where facets turn by more than `crease` [rad]. Normals given (m, 3, 3), 0 where
    not known, are taken as they are, and edges are sharp where they say so."""
    m = len(triangles)
    region, plane, region_area = flat_regions(points, triangles, across, tolerance)
    _, area = facet_normals(points, triangles)
    size = np.bincount(region, minlength=m)[region]
    # a vertex inside a region: only a true plane has such
    low, high = np.full(len(points), m), np.full(len(points), -1)
    np.minimum.at(low, triangles.ravel(), np.repeat(region, 3))
    np.maximum.at(high, triangles.ravel(), np.repeat(region, 3))
    open_edge = across.triangle < 0
    rim = np.zeros(len(points), dtype=bool)
    for k in range(3):
        rim[triangles[open_edge[:, k]][:, [NEXT[k], LAST[k]]]] = True
    inner = (low == high) & ~rim
    sure = np.zeros(m, dtype=bool)
    sure[low[inner]] = True
    sure = sure[region]

    other = np.maximum(across.triangle, 0)
    turn = np.einsum("mi,mki->mk", plane, plane[other])
    sharp = open_edge | (turn < math.cos(crease))
    sharp |= sure[:, None] & sure[other] & (turn < math.cos(FLAT_MEET)) & (region[:, None] != region[other])
    if given is not None:  # a CAD model knows where it is sharp; where it has no normal, at poles, it is not
        sharp = open_edge.copy()
        for k in range(3):
            back = across.edge[:, k]
            for here, there in ((NEXT, LAST), (LAST, NEXT)):
                n, o = given[:, here[k]], given[other[:, k], np.array(there)[back]]
                sharp[:, k] |= n.any(1) & o.any(1) & ((n * o).sum(1) < math.cos(KINK))
    # corners that are joined across edges that are not sharp
    t, edge = np.nonzero(~sharp)
    nxt, last = np.array(NEXT), np.array(LAST)
    o, back = across.triangle[t, edge], across.edge[t, edge]
    rows = np.concatenate([3 * t + nxt[edge], 3 * t + last[edge]])
    cols = np.concatenate([3 * o + last[back], 3 * o + nxt[back]])
    graph = sparse.coo_matrix((np.ones(len(rows)), (rows, cols)), shape=(3 * m, 3 * m))
    count, name = connected_components(graph, directed=False)
    name = name.reshape(m, 3)

    def gathered(values):
        total = np.zeros((count, 3))
        for c in range(3):
            for i in range(3):
                total[:, i] += np.bincount(name[:, c], values[:, c, i], count)
        return total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]

    normals = gathered(np.repeat((plane * area[:, None])[:, None], 3, 1))
    if given is not None:
        known = gathered(given)
        return Corners(name, np.where(known.any(1)[:, None], known, normals), sharp, region)
    # vertices of planes
    score = np.where(sure, region_area.max(), 0.0) + np.where(size >= 2, region_area, 0.0)
    order = np.argsort(np.repeat(score, 3), kind="stable")
    # a triangle of the best plane there, and the area of the next
    best, second = np.empty(count, dtype=np.int64), np.zeros(count)
    best[name.ravel()[order]] = order // 3
    rest = np.where(region[best][name] == region[:, None], 0.0, region_area[:, None])
    np.maximum.at(second, name.ravel(), rest.ravel())
    fixed = sure[best] | ((size[best] >= 2) & (region_area[best] >= DOMINANT * second))
    normals[fixed] = plane[best[fixed]]
    return Corners(name, _arcs(points, triangles, name, normals, fixed), sharp, region)


def _arcs(points, triangles, name, normals, fixed):
    """Normals tilted so that edges between vertices of curved surfaces have the same angle to both ends' normals, as arcs
    have: by least squares, with averaged normals where that leaves them open."""
    ends = np.stack([name[:, NEXT], name[:, LAST]], 2).reshape(-1, 2)
    place = np.stack([triangles[:, NEXT], triangles[:, LAST]], 2).reshape(-1, 2)
    _, one = np.unique(np.sort(ends, 1) @ [len(normals), 1], return_index=True)
    ends, place = ends[one], place[one]
    free = ~fixed
    chord = points[place[:, 1]] - points[place[:, 0]]
    chord /= np.linalg.norm(chord, axis=1)[:, None]
    use = free[ends].any(1)
    ends, chord = ends[use], chord[use]
    if not len(ends):
        return normals
    helper = np.eye(3)[abs(normals).argmin(1)]
    x = np.cross(normals, helper)
    x /= np.linalg.norm(x, axis=1)[:, None]
    frame = np.stack([x, np.cross(normals, x)], 1)
    number = np.cumsum(free) - 1
    n = 2 * free.sum()
    rows, cols, values = [], [], []
    for e in (0, 1):
        on = np.flatnonzero(free[ends[:, e]])
        slope = np.einsum("nai,ni->na", frame[ends[on, e]], chord[on])
        for a in (0, 1):
            rows.append(on)
            cols.append(2 * number[ends[on, e]] + a)
            values.append(slope[:, a])
    J = sparse.csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), shape=(len(ends), n))
    miss = ((normals[ends[:, 0]] + normals[ends[:, 1]]) * chord).sum(1)
    tilt = lsqr(J, -miss, damp=math.sqrt(PRIOR), atol=1e-6, btol=1e-6, iter_lim=200)[0]
    new = normals.copy()
    new[free] += np.einsum("na,nai->ni", tilt.reshape(-1, 2), frame[free])
    return new / np.linalg.norm(new, axis=1)[:, None]


class Patches(NamedTuple):
    """Of m patches: places of corner 0 `origin` (m, 3), coefficients (m, 18, 3) of the functions of `basis` beside it, legs
    (m, 3, 2, 3) from each corner to the next control point on the edges to the next and to the last corner, and `bulge` (m,):
    the largest distance of a control point from the facet; lengths in mm."""

    origin: np.ndarray
    coefficients: np.ndarray
    legs: np.ndarray
    bulge: np.ndarray


def curved(points: np.ndarray, triangles: np.ndarray, across: Topology, corners: Corners) -> Patches:
    """The `Patches` on triangles (m, 3) with these `Corners`."""
    P = points[triangles]
    N = corners.normals[corners.name]
    other = np.maximum(across.triangle, 0)
    nxt, last = np.array(NEXT), np.array(LAST)
    legs = {}  # (from corner, to corner) -> from there to the next control point of the cubic
    for k in range(3):
        i, j = NEXT[k], LAST[k]
        back = across.edge[:, k]
        sharp = corners.sharp[:, k] & (across.triangle[:, k] >= 0)
        for a, b, there in ((i, j, last), (j, i, nxt)):
            second = np.where(sharp[:, None], N[other[:, k], there[back]], N[:, a])
            legs[a, b] = _leg(P[:, b] - P[:, a], N[:, a], second)
    net = {}  # exponents of the corners -> control point
    inner = np.empty((3, 2, len(P), 3))  # of corner i, from the edges to the next and to the last corner

    def name(*powers):
        return tuple(sum(power for corner, power in powers if corner == c) for c in range(3))

    for k in range(3):
        i, j = NEXT[k], LAST[k]
        c0, c1, c2, c3 = P[:, i], P[:, i] + legs[i, j], P[:, j] + legs[j, i], P[:, j]
        net[name((i, 4))] = c0
        net[name((i, 3), (j, 1))] = c0 + 0.75 * legs[i, j]
        net[name((i, 2), (j, 2))] = (c1 + c2) / 2
        net[name((i, 1), (j, 3))] = c3 + 0.75 * legs[j, i]
    for k in range(3):
        i, j = NEXT[k], LAST[k]
        c0, c1, c2, c3 = P[:, i], P[:, i] + legs[i, j], P[:, j] + legs[j, i], P[:, j]
        e0, e1, e2 = 3 * (c1 - c0), 3 * (c2 - c1), 3 * (c3 - c2)
        # the derivative across the edge lies in the plane of the edge's own and of r, linear from end to end
        r0, r1 = (_unit(np.cross(N[:, a], e)) for a, e in ((i, e0), (j, e2)))
        d0, d3 = 3 * legs[i, k], 3 * (legs[j, k] - legs[j, i])
        (a0, b0), (a1, b1) = _in(d0, e0, r0), _in(d3, e2, r1)
        d1 = (2 * a0 * e1 + a1 * e0 + b0 * r0 + b0 * r1 + b1 * r0) / 3
        d2 = (a0 * e2 + 2 * a1 * e1 + b0 * r1 + b1 * r0 + b1 * r1) / 3
        inner[i, 0] = net[name((i, 3), (j, 1))] + d1 / 4
        inner[j, 1] = net[name((i, 2), (j, 2))] + d2 / 4
    for i in range(3):
        net[name((i, 2), (NEXT[i], 1), (LAST[i], 1))] = inner[i].mean(0)
    places = np.stack([net[each] for each in _NAMES], 1) - P[:, :1]
    halves = 6 * (inner[:, 0] - inner[:, 1]).swapaxes(0, 1)
    normal = facet_normals(points, triangles)[0]
    ends = np.stack([np.stack([legs[i, NEXT[i]], legs[i, LAST[i]]], 1) for i in range(3)], 1)
    reach = abs(np.einsum("mci,mi->mc", places, normal)).max(1) + np.linalg.norm(halves, axis=2).max(1) / 12
    return Patches(P[:, 0], np.concatenate([np.einsum("wc,mci->mwi", _MONOMIALS, places), halves], 1), ends, reach)


def _unit(v):
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300)


def _in(d, e, r):
    """Coefficients (n, 1) of d in e and r, by least squares."""
    ee, er, rr = ((a * b).sum(1, keepdims=True) for a, b in ((e, e), (e, r), (r, r)))
    de, dr = (d * e).sum(1, keepdims=True), (d * r).sum(1, keepdims=True)
    det = np.maximum(ee * rr - er * er, 1e-300)
    return (de * rr - dr * er) / det, (dr * ee - de * er) / det


def _leg(chord, normal, second):
    """From an end of an edge to the next control point of its cubic: along the chord in the tangent plane, or where two
    planes meet along their intersection; of the length that makes an arc of an arc."""
    length = np.linalg.norm(chord, axis=1, keepdims=True)
    chord = chord / length
    along = _unit(chord - (chord * normal).sum(1, keepdims=True) * normal)
    line = np.cross(normal, second)
    sine = np.linalg.norm(line, axis=1, keepdims=True)
    line = _unit(line) * np.sign((line * chord).sum(1, keepdims=True))
    along = np.where(sine > 0.05, line, along)
    cosine = (along * chord).sum(1, keepdims=True)
    lost = cosine < 0.5
    return length * np.where(lost, chord / 3, 2 * along / (3 * (1 + np.maximum(cosine, 0.5))))


# u^p v^q of a quartic, and what their derivatives by u, v, uu, uv, vv are: (factor, which one)
_POWERS = [(p, q) for p in range(5) for q in range(5 - p)]
_NAMES = [(4 - p - q, p, q) for p, q in _POWERS]


def _derivative(by_u, by_v):
    factor, which = np.zeros(15), np.zeros(15, dtype=np.int64)
    for n, (p, q) in enumerate(_POWERS):
        if p >= by_u and q >= by_v:
            factor[n], which[n] = math.perm(p, by_u) * math.perm(q, by_v), _POWERS.index((p - by_u, q - by_v))
    return factor, which


_FACTORS, _WHICH = (
    np.array(a) for a in zip(*(_derivative(*d) for d in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))))
)
# monomials from control points: 4! / (i! j! k!) (1 - u - v)^i u^j v^k
_MONOMIALS = np.zeros((15, 15))
for _c, (_i, _j, _k) in enumerate(_NAMES):
    for _p in range(_i + 1):
        for _q in range(_i + 1 - _p):
            _several = math.comb(_i, _p) * math.comb(_i - _p, _q) * (-1) ** (_p + _q)
            _several *= math.comb(4, _i) * math.comb(4 - _i, _j)
            _MONOMIALS[_POWERS.index((_j + _p, _k + _q)), _c] += _several
# directions of u = b[1] and v = b[2] in b; of each corner's own coordinate, the next and the last
_U, _V = (np.array(d, dtype=float)[[[0, 1, 2], NEXT, LAST], None] for d in ([-1, 1, 0], [-1, 0, 1]))


def basis(b: np.ndarray) -> np.ndarray:
    """Functions (n, 6, 18) of which patches are made, as they are, by u and v, and by uu, uv, vv, at barycentric coordinates
    b (3, n), where u = b[1] and v = b[2]: the 15 monomials of a quartic, and for each corner i with the next j and the last k
    b_i^2 b_j b_k (b_j - b_k) / (b_j + b_k)."""
    n = b.shape[1]
    u, v = b[1], b[2]
    power = np.ones((2, 5, n))
    for p in range(1, 5):
        power[0, p], power[1, p] = power[0, p - 1] * u, power[1, p - 1] * v
    monomials = power[0, [p for p, _ in _POWERS]] * power[1, [q for _, q in _POWERS]]
    w = np.empty((6, 18, n))
    w[:, :15] = monomials[_WHICH] * _FACTORS[:, :, None]
    x, y, z = b, b[NEXT], b[LAST]
    s = y + z
    p = y / np.maximum(s, 1e-60)
    q = 1 - p
    pq, apart, xx = p * q, p - q, x * x
    # h = y z (y - z) / (y + z) and its derivatives
    h, hy, hz = s * s * pq * apart, s * q * (apart + 2 * pq), s * p * (apart - 2 * pq)
    hyy, hzz, hyz = 4 * q * q * q, -4 * p * p * p, apart * (1 + 2 * pq)
    (ux, uy, uz), (vx, vy, vz) = _U, _V
    hu, hv = uy * hy + uz * hz, vy * hy + vz * hz
    w[0, 15:] = xx * h
    w[1, 15:] = 2 * x * ux * h + xx * hu
    w[2, 15:] = 2 * x * vx * h + xx * hv
    w[3, 15:] = 2 * ux * ux * h + 4 * x * ux * hu + xx * (uy * uy * hyy + 2 * uy * uz * hyz + uz * uz * hzz)
    w[4, 15:] = 2 * ux * vx * h + 2 * x * (ux * hv + vx * hu)
    w[4, 15:] += xx * (uy * vy * hyy + (uy * vz + uz * vy) * hyz + uz * vz * hzz)
    w[5, 15:] = 2 * vx * vx * h + 4 * x * vx * hv + xx * (vy * vy * hyy + 2 * vy * vz * hyz + vz * vz * hzz)
    return w.transpose(2, 0, 1)


def evaluate(patches: Patches, triangle: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Place, and derivatives as in `basis`, (n, 6, 3) [mm], on patches `triangle` (n,) at b (3, n)."""
    at = basis(b) @ patches.coefficients[triangle]
    at[:, 0] += patches.origin[triangle]
    return at
