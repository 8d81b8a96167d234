"""Newton's method for the nearest point of a surface: its geometry at a place, the step from there,
and gap, normal and curvature at the end, compiled.

Surfaces of patches (`projection`) and surfaces F(x) = 0 (`implicit`) use the same step. Of the
latter it is taken for many points at once, from F, its gradient and its Hessian.
"""

import math
from typing import NamedTuple

import numpy as np

from ..core.compiled import compiled
from .surfaces import Nearest

Vector = tuple[float, float, float]
MAX_ROUNDS = 101  # after which a point has no nearest one
FOOT_TOLERANCE = 1e-11, 1e-14  # mm, and per mm of the coordinates: by which a foot may be off


class Search(NamedTuple):
    """n points on their way: their `rows` (n,) in the result, themselves x, where each is by now,
    where its last step began, that step in full (n, 3), its factor and squared remainder (n,)."""

    rows: np.ndarray
    x: np.ndarray
    trial: np.ndarray
    base: np.ndarray
    step: np.ndarray
    factor: np.ndarray
    merit: np.ndarray


class Local(NamedTuple):
    """A surface at a place, seen from x = place + (gap + off) normal + beside (s, t) [mm]: unit
    normal, tangents, entries 11, 12, 22 of their inverse metric, and of the shape operator."""

    gap: float
    beside: tuple[float, float]
    off: float
    normal: tuple[float, float, float]
    s: tuple[float, float, float]
    t: tuple[float, float, float]
    dual: tuple[float, float, float]
    shape: tuple[float, float, float, float]


def search_from(x: np.ndarray, rows: np.ndarray) -> Search:
    """The search of points x (n, 3), of these `rows`, from where they are themselves."""
    n, zeros = len(rows), np.zeros_like(x)
    return Search(rows, x, x.copy(), x.copy(), zeros, np.ones(n), np.full(n, np.inf))


@compiled
def dot(a: Vector, b: Vector) -> float:
    """Product of two vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def newton_step(here: Local) -> tuple[float, float]:
    """Step along s and t to where the arm is normal. Beyond a centre of curvature the distance has
    no minimum here, so the model is kept convex: its least eigenvalue, 1 on a plane, is 0.1 or
    more."""
    gap, (p, q), (k11, k12, k21, k22) = here.gap, here.beside, here.shape
    a, b, c, d = 1 + gap * k11, gap * k12, gap * k21, 1 + gap * k22
    lift = max(0.0, 0.1 - (a + d) / 2 + math.sqrt(max((a - d) ** 2 / 4 + b * c, 0.0)))
    a, d = a + lift, d + lift
    det = a * d - b * c
    return (d * p - b * q) / det, (a * q - c * p) / det


@compiled
def put(feet: Nearest, row: int, here: Local) -> None:
    """Put gap and derivatives into a row of what is found: the curvature is K (I + gap K)^-1 of the
    shape operator K."""
    gap, (k11, k12, k21, k22), (g11, g12, g22) = here.gap + here.off, here.shape, here.dual
    det = k11 * k22 - k12 * k21
    scale = 1 + gap * (k11 + k22) + gap * gap * det
    if abs(scale) < 1e-9:  # a centre of curvature
        scale = 1e-9
    # Cayley-Hamilton: K adj(I + gap K) = K + gap det(K) I
    m11, m22 = (k11 + gap * det) / scale, (k22 + gap * det) / scale
    m12, m21 = k12 / scale, k21 / scale
    ss, st, tt = m11 * g11 + m12 * g12, m11 * g12 + m12 * g22, m21 * g12 + m22 * g22
    s, t = here.s, here.t
    feet.gap[row] = gap
    for i in range(3):
        feet.normal[row, i] = here.normal[i]
        for j in range(3):
            feet.curvature[row, i, j] = (
                ss * (s[i] * s[j]) + tt * (t[i] * t[j]) + st * (s[i] * t[j] + s[j] * t[i])
            )


@compiled
def _times(matrix, a):
    return (dot(matrix[0], a), dot(matrix[1], a), dot(matrix[2], a))


@compiled
def _local(x, trial, F, gradient, hessian):
    """The `Local` of the surface F = 0 at a place `trial` (3,), seen from x (3,)."""
    size = math.sqrt(dot(gradient, gradient))
    n0, n1, n2 = gradient[0] / size, gradient[1] / size, gradient[2] / size
    side = math.copysign(1.0, n2)
    a = -1 / (side + n2)
    b = n0 * n1 * a
    s = (1 + side * n0 * n0 * a, side * b, -side * n0)
    t = (b, side + n1 * n1 * a, -n1)
    arm = (x[0] - trial[0], x[1] - trial[1], x[2] - trial[2])
    along_s, along_t = _times(hessian, s), _times(hessian, t)
    across = dot(s, along_t) / size
    shape = (dot(s, along_s) / size, across, across, dot(t, along_t) / size)
    normal, beside = (n0, n1, n2), (dot(arm, s), dot(arm, t))
    return Local(dot(arm, normal), beside, F / size, normal, s, t, (1.0, 0.0, 1.0), shape)


@compiled
def advance(
    search: Search,
    count: int,
    iteration: int,
    F: np.ndarray,
    gradient: np.ndarray,
    hessian: np.ndarray,
    feet: Nearest,
) -> int:
    """Take the first `count` points of the search one step on, from F, gradient and Hessian at
    their places. Those that arrive go to rows of `found`, the others, a number, to the front."""
    left = 0
    for i in range(count):
        row, x, trial = search.rows[i], search.x[i], search.trial[i]
        here = _local(x, trial, F[i], gradient[:, i], hessian[:, :, i])
        merit = here.beside[0] ** 2 + here.beside[1] ** 2 + here.off**2
        tolerance = FOOT_TOLERANCE[0] + FOOT_TOLERANCE[1] * max(abs(x[0]), abs(x[1]), abs(x[2]))
        if merit <= tolerance * tolerance:
            put(feet, row, here)
            continue
        # A step that does not help is halved; one of an eighth is taken all the same, to get over
        # a seam. Shorter steps later on end most of the cycles that there are far inside the body.
        is_nearer = merit < search.merit[i] or search.factor[i] < 0.2
        (u, v), factor = newton_step(here), 1.0 if iteration <= 20 else 0.6
        search.rows[left] = row
        # from the point itself any step is taken
        search.merit[left] = (merit if iteration else math.inf) if is_nearer else search.merit[i]
        search.factor[left] = factor = factor if is_nearer else search.factor[i] / 2
        for k in range(3):
            base = trial[k] if is_nearer else search.base[i, k]
            step = -here.off * here.normal[k] + u * here.s[k] + v * here.t[k]
            full = step if is_nearer else search.step[i, k]
            search.x[left, k], search.base[left, k], search.step[left, k] = x[k], base, full
            search.trial[left, k] = base + factor * full
        left += 1
    return left
