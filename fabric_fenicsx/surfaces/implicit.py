"""Surfaces that are known by an equation."""

from __future__ import annotations

import math

import numpy as np

from .newton_kernel import advance, search_from
from .surfaces import Nearest, Surface


class ImplicitSurface(Surface):
    """Surface F(x) = 0 with F < 0 in the body; the nearest point by Newton's method.

    A subclass defines `implicit` and `radii`; `bound`, and `value` if F alone is cheaper, save
    time. Gap, normal and curvature are exact at the point found, whose distance from the surface
    and from the foot of the normal is below 1e-11 mm. None may be found further away than `radii`,
    where it can also be a point that is not the nearest of all. Rows are then NaN, unless F has one
    sign all around at twice the reach: the surface is beyond it.

    Examples
    --------
    >>> class Wave(ff.ImplicitSurface):
    ...     radii = (25.0, 25.0)
    ...
    ...     def implicit(self, x):
    ...         zero, curve = 0 * x[0], np.sin(x[0] / 5) / 25
    ...         gradient = np.array([-np.cos(x[0] / 5) / 5, zero, zero + 1])
    ...         hessian = np.array([[curve, zero, zero], [zero] * 3, [zero] * 3])
    ...         return x[2] - 25 * curve, gradient, hessian
    ...
    ...     def bound(self, F, x):
    ...         return abs(F) / 1.02  # by the gradient's largest length
    >>> Wave().evaluate([[2.5 * np.pi, 0, 3]]).gap
    array([2.])
    """

    def value(self, x: np.ndarray) -> np.ndarray:
        """F (n,) at x (3, n) [mm]."""
        return self.derivatives(x)[0]

    def implicit(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F (n,), its gradient (3, n) and Hessian (3, 3, n) at x (3, n) [mm]."""
        raise NotImplementedError

    def bound(self, F: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Lower bound of the distance (n,) [mm] from x (3, n) [mm], where `value` is F (n,). Points
        with a bound beyond the reach are not projected; 0 projects all."""
        return np.zeros_like(F)

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        x = np.ascontiguousarray(points.T)
        F = _fitting(self.value(x), x.shape[1:])
        bound = _fitting(self.bound(F, x), x.shape[1:])
        up, n = np.array([0.0, 0.0, 1.0]), len(points)
        feet = Nearest(np.copysign(bound, F), np.tile(up, (n, 1)), np.zeros((n, 3, 3)))
        near = np.flatnonzero(bound <= reach)
        # blocks that stay in the cache
        for part in np.array_split(near, max(1, len(near) // 4096)):
            self._project(points[part], part, feet)
        lost = near[np.isnan(feet.gap[near])]
        if len(lost) and 0 < reach < math.inf:  # where F has one sign around, the surface is far
            sides = np.stack(np.meshgrid(*3 * [[-1.0, 0.0, 1.0]]), -1).reshape(-1, 3)
            sides = sides[sides.any(1)]  # 26, one of which is less than 30 deg from any direction
            sides /= np.linalg.norm(sides, axis=1, keepdims=True)
            around = (x[:, lost, None] + 2 * reach * sides.T[:, None]).reshape(3, -1)
            signs = self.value(around).reshape(len(lost), -1) * F[lost, None]
            far = lost[(signs > 0).all(1)]
            feet.gap[far] = np.copysign(1.01 * reach, F[far])
            feet.normal[far], feet.curvature[far] = up, 0.0
        return feet

    def derivatives(self, x: np.ndarray) -> list[np.ndarray]:
        """Arrays that `implicit` gives at x (3, n)."""
        n = x.shape[1]
        return [*map(_fitting, self.implicit(x), ((n,), (3, n), (3, 3, n)))]

    def _project(self, x, rows, feet):
        """Put what belongs to the nearest points of x (n, 3) into `rows` of `found`."""
        for target in feet:
            target[rows] = np.nan
        search, count = search_from(x, rows), len(rows)
        for iteration in range(101):
            if not count:
                return
            F, gradient, hessian = self.derivatives(search.trial[:count].T)
            count = advance(search, count, iteration, F, gradient, hessian, feet)


def _fitting(values, shape):
    """An array of this shape, of values at each point or the same at all."""
    return np.ascontiguousarray(np.broadcast_to(np.asarray(values, float), shape))
