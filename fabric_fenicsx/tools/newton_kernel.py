"""Newton's method for the nearest points on F(x) = 0, a step of many points at once, compiled.

It is asked with F, its gradient and its Hessian at the places where the points are by now, whoever
gives them.
"""

import math
from typing import NamedTuple

import numpy as np

from ..runtime.compiled import compiled
from .surfaces import Nearest

EXACT = 1e-11, 1e-14  # mm, and per mm of the coordinates: by which a foot may be off


class Search(NamedTuple):
    """n points on their way: their `rows` (n,) in what is found, themselves x (n, 3), where each
    is by now (n, 3), where its last step began and that step in full (n, 3), the factor on it and
    the square of what it left (n,)."""

    rows: np.ndarray
    x: np.ndarray
    trial: np.ndarray
    base: np.ndarray
    step: np.ndarray
    factor: np.ndarray
    merit: np.ndarray


class Local(NamedTuple):
    """A surface seen from one point, at the place where it is by now: the distance along the normal
    there and beside it [mm], how far F = 0 is from the place [mm], the normal, two tangents, and
    the entries 11, 22, 12 of the shape operator between them [1/mm]."""

    gap: float
    beside: tuple[float, float]
    off: float
    normal: tuple[float, float, float]
    s: tuple[float, float, float]
    t: tuple[float, float, float]
    shape: tuple[float, float, float]


def search_from(x: np.ndarray, rows: np.ndarray) -> Search:
    """The search of points x (n, 3), of these `rows`, from where they are themselves."""
    n, zeros = len(rows), np.zeros_like(x)
    return Search(rows, x, x.copy(), x.copy(), zeros, np.ones(n), np.full(n, np.inf))


@compiled
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _along(matrix, a):
    return (_dot(matrix[0], a), _dot(matrix[1], a), _dot(matrix[2], a))


@compiled
def _local(x, trial, F, gradient, hessian):
    """The `Local` of a point x (3,) at its place `trial` (3,)."""
    size = math.sqrt(_dot(gradient, gradient))
    n0, n1, n2 = gradient[0] / size, gradient[1] / size, gradient[2] / size
    side = math.copysign(1.0, n2)
    a = -1 / (side + n2)
    b = n0 * n1 * a
    s = (1 + side * n0 * n0 * a, side * b, -side * n0)
    t = (b, side + n1 * n1 * a, -n1)
    arm = (x[0] - trial[0], x[1] - trial[1], x[2] - trial[2])
    along_s, along_t = _along(hessian, s), _along(hessian, t)
    shape = (_dot(s, along_s) / size, _dot(t, along_t) / size, _dot(s, along_t) / size)
    normal = (n0, n1, n2)
    return Local(_dot(arm, normal), (_dot(arm, s), _dot(arm, t)), F / size, normal, s, t, shape)


@compiled
def _newton(here):
    """The step (3,) to where the arm is normal and F is 0. Beyond a centre of curvature the
    distance has no minimum here, so the model is kept convex."""
    gap, (p, q), (k11, k22, k12), s, t = here.gap, here.beside, here.shape, here.s, here.t
    a, b, c = 1 + gap * k11, 1 + gap * k22, gap * k12
    lift = max(0.0, 0.1 - (a + b) / 2 + math.sqrt((a - b) ** 2 / 4 + c * c))
    a, b = a + lift, b + lift
    det = a * b - c * c
    u, v, w = (b * p - c * q) / det, (a * q - c * p) / det, -here.off
    n = here.normal
    return (
        w * n[0] + u * s[0] + v * t[0],
        w * n[1] + u * s[1] + v * t[1],
        w * n[2] + u * s[2] + v * t[2],
    )


@compiled
def _put(found, row, here):
    """The gap and its derivatives into a row of what is found: the curvature is K (I + gap K)^-1 of
    the shape operator K."""
    gap, (k11, k22, k12), s, t = here.gap + here.off, here.shape, here.s, here.t
    det = k11 * k22 - k12 * k12
    scale = 1 + gap * (k11 + k22) + gap * gap * det
    if abs(scale) < 1e-9:  # a centre of curvature
        scale = 1e-9
    # Cayley-Hamilton: K adj(I + gap K) = K + gap det(K) I
    m11, m22, m12 = (k11 + gap * det) / scale, (k22 + gap * det) / scale, k12 / scale
    found.gap[row] = gap
    for i in range(3):
        found.normal[row, i] = here.normal[i]
        for j in range(3):
            found.curvature[row, i, j] = (
                m11 * (s[i] * s[j]) + m22 * (t[i] * t[j]) + m12 * (s[i] * t[j] + s[j] * t[i])
            )


@compiled
def advance(
    search: Search,
    count: int,
    iteration: int,
    F: np.ndarray,
    gradient: np.ndarray,
    hessian: np.ndarray,
    found: Nearest,
) -> int:
    """Take the first `count` points of the search one step on, from F (count,), gradient (3, count)
    and Hessian (3, 3, count) at their places. Those that have arrived go to their rows of `found`,
    the others to the front; how many these are."""
    left = 0
    for i in range(count):
        row, x, trial = search.rows[i], search.x[i], search.trial[i]
        here = _local(x, trial, F[i], gradient[:, i], hessian[:, :, i])
        merit = here.beside[0] ** 2 + here.beside[1] ** 2 + here.off**2
        tolerance = EXACT[0] + EXACT[1] * max(abs(x[0]), abs(x[1]), abs(x[2]))
        if merit <= tolerance * tolerance:
            _put(found, row, here)
            continue
        # A step that does not help is halved; one of an eighth is taken all the same, to get over
        # a seam. Shorter steps later on end most of the cycles that there are far inside the body.
        taken = merit < search.merit[i] or search.factor[i] < 0.2
        step, factor = _newton(here), 1.0 if iteration <= 20 else 0.6
        search.rows[left] = row
        # from the point itself any step is taken
        search.merit[left] = (merit if iteration else math.inf) if taken else search.merit[i]
        search.factor[left] = factor = factor if taken else search.factor[i] / 2
        for k in range(3):
            base = trial[k] if taken else search.base[i, k]
            full = step[k] if taken else search.step[i, k]
            search.x[left, k], search.base[left, k], search.step[left, k] = x[k], base, full
            search.trial[left, k] = base + factor * full
        left += 1
    return left
