"""The equation of the double dome, compiled."""

import math
from typing import NamedTuple

import numpy as np

from ..runtime.compiled import compiled


class Shape(NamedTuple):
    """Numbers that follow from the dimensions of a double dome [mm].

    - half, radius, waist: half the distance of the domes, radius and half width of the outline;
      bend: curvature of its concave arcs [1/mm]
    - depth, top, entry: height, radii of rounding and fillet; (d1, z1), (d2, z2): their centres in
      the plane of the profile; (m, n): normal of the wall in it
    - drop, reach: share by which the saddle is lower, and half of its length
    """

    half: float
    radius: float
    waist: float
    bend: float
    depth: float
    top: float
    entry: float
    d1: float
    z1: float
    d2: float
    z2: float
    m: float
    n: float
    drop: float
    reach: float


@compiled
def plan(dome: Shape, x: float, y: float) -> tuple[float, float, float, float]:
    """Signed distance to the outline, its gradient, and the curvature of its level lines."""
    u, v, k = abs(x), abs(y) - dome.waist, dome.bend
    if u * (1 + k * dome.waist) < dome.half * (1 - k * v):
        # written with the arc's curvature, which may be 0, and not with its radius
        a, b = k * u, 1 - k * v
        q = math.sqrt(a * a + b * b)
        d, dx, dy = (2 * v - k * (u * u + v * v)) / (1 + q), -a / q, b / q
        turn = -k / q
    else:
        a, b = u - dome.half, abs(y)
        r = max(math.sqrt(a * a + b * b), 1e-9)
        d, dx, dy, turn = r - dome.radius, a / r, b / r, 1 / r
    return d, -dx if x < 0 else dx, -dy if y < 0 else dy, turn


@compiled
def height(dome: Shape, x: float) -> tuple[float, float, float]:
    """H and its first and second derivative."""
    s = min(max(x / dome.reach, -1.0), 1.0)
    t, slope = 1 - s * s, 6 * dome.drop / dome.reach
    return 1 - dome.drop * t**3, slope * s * t * t, slope / dome.reach * t * (1 - 5 * s * s)


@compiled
def profile(dome: Shape, d: float, z: float) -> tuple[float, float, float, float]:
    """Signed distance to the profile, its gradient, and the curvature of its level lines: of those
    parts over which (d, z) lies the nearest one's."""
    m, n, along = dome.m, dome.n, dome.m * z - dome.n * d
    upper, lower = dome.m * dome.z1 - dome.n * dome.d1, dome.m * dome.z2 - dome.n * dome.d2
    found = (math.inf, math.nan, math.nan, math.nan)
    if d <= dome.d1:
        found = (z - dome.depth, 0.0, 1.0, 0.0)
    elif along > upper:
        p, q = d - dome.d1, z - dome.z1
        r = max(math.sqrt(p * p + q * q), 1e-9)
        found = (r - dome.top, p / r, q / r, 1 / r)
    if lower <= along <= upper and abs(m * d + n * z) < abs(found[0]):
        found = (m * d + n * z, m, n, 0.0)
    if d < dome.d2 and along < lower:
        p, q = dome.d2 - d, dome.z2 - z
        r = max(math.sqrt(p * p + q * q), 1e-9)
        if abs(dome.entry - r) < abs(found[0]):
            found = (dome.entry - r, p / r, q / r, -1 / r)
    if d >= dome.d2 and abs(z) < abs(found[0]):
        found = (z, 0.0, 1.0, 0.0)
    return found


@compiled
def value(dome: Shape, x: np.ndarray) -> np.ndarray:
    """F (n,) at x (n, 3)."""
    F = np.empty(len(x))
    for i in range(len(x)):
        d = plan(dome, x[i, 0], x[i, 1])[0]
        F[i] = profile(dome, d, x[i, 2] / height(dome, x[i, 0])[0])[0]
    return F


@compiled
def implicit(dome: Shape, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F (n,), its gradient (3, n) and Hessian (3, 3, n) at x (n, 3)."""
    count = len(x)
    F, gradient, hessian = np.empty(count), np.empty((3, count)), np.empty((3, 3, count))
    for i in range(count):
        d, dx, dy, turn = plan(dome, x[i, 0], x[i, 1])
        H, H1, H2 = height(dome, x[i, 0])
        z = x[i, 2] / H
        F[i], m, n, bend = profile(dome, d, z)
        zx, zz, zxz = -z * H1 / H, 1 / H, -H1 / (H * H)
        zxx = z * (2 * (H1 / H) ** 2 - H2 / H)
        gradient[0, i], gradient[1, i], gradient[2, i] = m * dx + n * zx, m * dy, n * zz
        # along the level lines of P and of d, whose curvatures are `bend` and `turn`
        p, q, r, turn = m * zx - n * dx, -n * dy, m * zz, m * turn
        hessian[0, 0, i] = bend * p * p + turn * dy * dy + n * zxx
        hessian[1, 1, i] = bend * q * q + turn * dx * dx
        hessian[2, 2, i] = bend * r * r
        hessian[0, 1, i] = hessian[1, 0, i] = bend * p * q - turn * dx * dy
        hessian[0, 2, i] = hessian[2, 0, i] = bend * p * r + n * zxz
        hessian[1, 2, i] = hessian[2, 1, i] = bend * q * r
    return F, gradient, hessian


@compiled
def plans(dome: Shape, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """`plan` at x, y (n,), (4, n)."""
    found = np.empty((4, len(x)))
    for i in range(len(x)):
        found[0, i], found[1, i], found[2, i], found[3, i] = plan(dome, x[i], y[i])
    return found


@compiled
def heights(dome: Shape, x: np.ndarray) -> np.ndarray:
    """`height` at x (n,), (3, n)."""
    found = np.empty((3, len(x)))
    for i in range(len(x)):
        found[0, i], found[1, i], found[2, i] = height(dome, x[i])
    return found
