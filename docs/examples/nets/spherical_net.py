r"""A ply whose yarns do not stretch and turn freely where they cross, on a sphere.

Yarns a and b are the lines of a net x(u, v), with u and v measured along them (Chebyshev 1878). The
angle omega between them and the Gaussian curvature K of the surface then obey

    d^2 omega / du dv = -K sin(omega),

as omega changes along a yarn by its geodesic curvature. The two yarns through the pole are great
circles, by symmetry, and so omega is pi/2 all along them. On a sphere of radius R, K = 1/R^2. With
s = u v / R^2 equation and boundary values depend on s alone:

    s omega'' + omega' + sin(omega) = 0, omega(0) = pi/2, omega'(0) = -1.

u and v are also the places on the flat ply, so the shear angle pi/2 - omega is known there.
"""

import math
from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

LOCKED = 4.0  # s beyond which omega has passed 0, where both yarns are one line
ACCURACY = 1e-13  # of the solver of the equation, absolute and relative
START = 1e-3  # s up to which the series at s = 0, where the equation is singular, is exact


@cache
def _angle_between():
    """omega over s, by steps of eighth order with their interpolation.

    The series: omega = pi/2 - s + s^3 / 18 + O(s^5), from cos(s) = 1 - s^2 / 2 in the equation.
    """
    s = START
    start = [math.pi / 2 - s + s**3 / 18, -1 + s**2 / 6]
    found = solve_ivp(
        lambda s, y: (y[1], -(y[1] + math.sin(y[0])) / s),
        (s, LOCKED),
        start,
        method="DOP853",
        rtol=ACCURACY,
        atol=ACCURACY,
        dense_output=True,
    )
    return found.sol


def shear_angle(u: ArrayLike, v: ArrayLike, radius: float) -> np.ndarray:
    """Shear angle [rad] of the net at the places u, v of the flat ply, from the pole along yarns a
    and b [mm]; positive where yarns come closer, nan beyond the place where both are one line."""
    s = np.abs(np.asarray(u, float) * np.asarray(v, float)) / radius**2
    angle = np.where(
        s < START, s - s**3 / 18, np.pi / 2 - _angle_between()(np.maximum(s, START))[0]
    )
    return np.where(s > locking_product(), np.nan, angle)


@cache
def locking_product() -> float:
    """u v / R^2 where the yarns become one line, omega = 0: 1.8616"""
    return float(brentq(lambda s: _angle_between()(s)[0], 1.0, LOCKED, xtol=1e-12))


def diagonal(polar_angle: float) -> tuple[float, float]:
    """On the circle that halves the angle between the great circles, at a polar angle [rad]: u / R
    = v / R there, and the shear angle [rad].

    The circle is x(t, t), of speed |x_u + x_v| = 2 cos(omega / 2).
    """

    def angle(t):
        return math.pi / 2 - float(shear_angle(t, t, 1.0))

    end = math.sqrt(locking_product())
    found = solve_ivp(
        lambda t, y: [2 * math.cos(angle(t) / 2)],
        (0.0, end),
        [0.0],
        method="DOP853",
        rtol=ACCURACY,
        atol=ACCURACY,
        dense_output=True,
    )
    t = brentq(lambda t: found.sol(t)[0] - polar_angle, 0.0, end, xtol=1e-13)
    return float(t), float(shear_angle(t, t, 1.0))
