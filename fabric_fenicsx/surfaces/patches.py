"""Curved triangles that meet with a common tangent plane: their control points and places on them.

A patch is a quartic over barycentric coordinates b with the rational inner points of Gregory. Along
an edge the tangent plane depends on that edge alone, so that two patches share it: D. J. Walton, D.
S. Meek, A triangular G1 patch from boundary curves, Computer-Aided Design 28 (1996) 113. Where all
three corners have the facet's normal the patch is the facet.
"""

import math
from typing import NamedTuple

import numpy as np

from ..core.compiled import compiled
from .facets import LAST, NEXT, SmoothVertices, Topology, facet_normals, unit


class Patches(NamedTuple):
    """m curved patches: corner 0 `origin` (m, 3), coefficients (m, 18, 3) of `_fill_basis` beside
    it, legs (m, 3, 2, 3) from each corner to the control points towards the next and the last, and
    `bulge` (m,), the control points' largest distance from the facet; in mm."""

    origin: np.ndarray
    coefficients: np.ndarray
    legs: np.ndarray
    bulge: np.ndarray


def curved(
    points: np.ndarray, triangles: np.ndarray, across: Topology, corners: SmoothVertices
) -> Patches:
    """The `Patches` on triangles (m, 3) with these `SmoothVertices`."""
    P = points[triangles]
    N = corners.normals[corners.name]
    other = np.maximum(across.triangle, 0)
    legs = {}  # (from corner, to corner) -> from there to the next control point of the cubic
    for k in range(3):
        i, j = NEXT[k], LAST[k]
        back = across.edge[:, k]
        sharp = corners.sharp[:, k] & (across.triangle[:, k] >= 0)
        for a, b, there in ((i, j, LAST), (j, i, NEXT)):
            second = np.where(sharp[:, None], N[other[:, k], there[back]], N[:, a])
            legs[a, b] = _leg(P[:, b] - P[:, a], N[:, a], second)
    net = {}  # exponents of the corners -> control point
    # control points inside at corner i, from the edges to the next and to the last corner
    inner = np.empty((3, 2, len(P), 3))

    def name(*powers):
        return tuple(sum(power for corner, power in powers if corner == c) for c in range(3))

    for k in range(3):
        i, j = NEXT[k], LAST[k]
        c0, c1, c2, c3 = P[:, i], P[:, i] + legs[i, j], P[:, j] + legs[j, i], P[:, j]
        net[name((i, 4))] = c0
        net[name((i, 3), (j, 1))] = c0 + 0.75 * legs[i, j]
        net[name((i, 2), (j, 2))] = (c1 + c2) / 2
        net[name((i, 1), (j, 3))] = c3 + 0.75 * legs[j, i]
        e0, e1, e2 = 3 * (c1 - c0), 3 * (c2 - c1), 3 * (c3 - c2)
        # the derivative across the edge lies in the plane of the edge's own and of r, linear from
        # end to end
        r0, r1 = (unit(np.cross(N[:, a], e)) for a, e in ((i, e0), (j, e2)))
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
    bulge = abs(np.einsum("mci,mi->mc", places, normal)).max(1)
    bulge += np.linalg.norm(halves, axis=2).max(1) / 12
    coefficients = np.concatenate([np.einsum("wc,mci->mwi", _MONOMIALS, places), halves], 1)
    return Patches(P[:, 0].copy(), coefficients, ends, bulge)


def _in(d, e, r):
    """Coefficients (n, 1) of d in e and r, by least squares."""
    ee, er, rr = ((a * b).sum(1, keepdims=True) for a, b in ((e, e), (e, r), (r, r)))
    de, dr = (d * e).sum(1, keepdims=True), (d * r).sum(1, keepdims=True)
    det = np.maximum(ee * rr - er * er, 1e-300)
    return (de * rr - dr * er) / det, (dr * ee - de * er) / det


def _leg(chord, normal, second):
    """Arms from an end of edges to the next control points of their cubics: along the chord in the
    tangent plane, or where two planes meet along their intersection; of the length that makes an
    arc of an arc."""
    length = np.linalg.norm(chord, axis=1, keepdims=True)
    chord = chord / length
    along = unit(chord - (chord * normal).sum(1, keepdims=True) * normal)
    line = np.cross(normal, second)
    sine = np.linalg.norm(line, axis=1, keepdims=True)
    line = unit(line) * np.sign((line * chord).sum(1, keepdims=True))
    along = np.where(sine > 0.05, line, along)
    cosine = (along * chord).sum(1, keepdims=True)
    lost = cosine < 0.5
    return length * np.where(lost, chord / 3, 2 * along / (3 * (1 + np.maximum(cosine, 0.5))))


# u^p v^q of a quartic, and what their derivatives by u, v, uu, uv, vv are: (factor, which one)
_POWERS = [(p, q) for p in range(5) for q in range(5 - p)]
_EXPONENTS, _UV = np.array(_POWERS), ((-1.0, -1.0), (1.0, 0.0), (0.0, 1.0))
_NAMES = [(4 - p - q, p, q) for p, q in _POWERS]


_ORDERS = (0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)
_FACTORS = np.array([[math.perm(p, u) * math.perm(q, v) for p, q in _POWERS] for u, v in _ORDERS])
_WHICH = np.array(
    [[_POWERS.index((max(p - u, 0), max(q - v, 0))) for p, q in _POWERS] for u, v in _ORDERS]
)
# monomials from control points: 4! / (i! j! k!) (1 - u - v)^i u^j v^k
_MONOMIALS = np.zeros((15, 15))
for _c, (_i, _j, _k) in enumerate(_NAMES):
    for _p in range(_i + 1):
        for _q in range(_i + 1 - _p):
            _several = math.comb(_i, _p) * math.comb(_i - _p, _q) * (-1) ** (_p + _q)
            _several *= math.comb(4, _i) * math.comb(4 - _i, _j)
            _MONOMIALS[_POWERS.index((_j + _p, _k + _q)), _c] += _several


@compiled
def _fill_basis(b, w):
    """Put into w (6, 18) the functions of which patches are made, as they are, by u and v, and by
    uu, uv, vv, at barycentric coordinates b (3,), where u = b[1] and v = b[2]: the 15 monomials of
    a quartic, and for each corner i with the next j and the last k
    b_i^2 b_j b_k (b_j - b_k) / (b_j + b_k)."""
    u, v = b[1], b[2]
    up, vp = (1.0, u, u * u, u**3, u**4), (1.0, v, v * v, v**3, v**4)
    for d in range(6):
        for k in range(15):
            p, q = _EXPONENTS[_WHICH[d, k]]
            w[d, k] = _FACTORS[d, k] * up[p] * vp[q]
    for c in range(3):
        x, y, z = b[c], b[(c + 1) % 3], b[(c + 2) % 3]
        s = y + z
        p = y / max(s, 1e-60)
        q = 1 - p
        pq, apart, xx = p * q, p - q, x * x
        # h = y z (y - z) / (y + z) and its derivatives
        h, hy, hz = s * s * pq * apart, s * q * (apart + 2 * pq), s * p * (apart - 2 * pq)
        hyy, hzz, hyz = 4 * q * q * q, -4 * p * p * p, apart * (1 + 2 * pq)
        # directions of u and v in x, y, z
        (ux, vx), (uy, vy), (uz, vz) = _UV[c], _UV[(c + 1) % 3], _UV[(c + 2) % 3]
        hu, hv = uy * hy + uz * hz, vy * hy + vz * hz
        huu = uy * uy * hyy + 2 * uy * uz * hyz + uz * uz * hzz
        huv = uy * vy * hyy + (uy * vz + uz * vy) * hyz + uz * vz * hzz
        hvv = vy * vy * hyy + 2 * vy * vz * hyz + vz * vz * hzz
        k = 15 + c
        w[0, k], w[1, k], w[2, k] = xx * h, 2 * x * ux * h + xx * hu, 2 * x * vx * h + xx * hv
        w[3, k] = 2 * ux * ux * h + 4 * x * ux * hu + xx * huu
        w[4, k] = 2 * ux * vx * h + 2 * x * (ux * hv + vx * hu) + xx * huv
        w[5, k] = 2 * vx * vx * h + 4 * x * vx * hv + xx * hvv


@compiled
def place(patches: Patches, triangle: int, b: np.ndarray, w: np.ndarray, at: np.ndarray) -> None:
    """Put into `at` (6, 3) [mm] the place and its derivatives by u and v, and by uu, uv, vv, on
    patch `triangle` at barycentric coordinates b (3,), where u = b[1] and v = b[2]; w (6, 18) is
    written over."""
    _fill_basis(b, w)
    for d in range(6):
        for i in range(3):
            at[d, i] = patches.origin[triangle, i] if d == 0 else 0.0
            for k in range(18):
                at[d, i] += w[d, k] * patches.coefficients[triangle, k, i]
