"""Plane, ball, bar, torus, plate with an opening, and block, in closed form."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ..core.rules import FROM_ZERO, POSITIVE, Rule
from .surfaces import Nearest, Surface, checked_vector

ROUNDING = 1 + 1e-12


class Plane(Surface):
    """Plane with the body behind it, defined by a `point` (3,) [mm] and its `normal` (3,) out of
    the body, of any length. Raises InputError for other values.

    Examples
    --------
    >>> ff.Plane((0, 0, 5), (0, 0, 1)).evaluate([[10, 20, 6]]).gap
    array([1.])
    """

    def __init__(self, point: ArrayLike, normal: ArrayLike) -> None:
        self.point = checked_vector("point", point)
        self.normal = checked_vector("normal", normal, unit=True)

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        normal = np.tile(self.normal, (len(points), 1))
        return Nearest((points - self.point) @ self.normal, normal, np.zeros((len(points), 3, 3)))


class _Round(Surface):
    """Sphere or cylinder, by the distance from its centre that `_across` (3, 3) projects on."""

    _across: np.ndarray
    _any: np.ndarray

    def __init__(self, centre: np.ndarray, radius: float) -> None:
        self.centre, self.radius = centre, POSITIVE.check("radius", radius)
        self.radii = (self.radius, math.inf)

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        arm = (points - self.centre) @ self._across
        distance = np.linalg.norm(arm, axis=1)
        least = 1e-12 * self.radius  # at the centre any normal will do
        arm[distance < least] = least * self._any
        normal = arm / np.linalg.norm(arm, axis=1)[:, None]
        bend = self._across - _outer(normal, normal)
        curvature = bend / np.maximum(distance, least)[:, None, None]
        return Nearest(distance - self.radius, normal, curvature)


class Sphere(_Round):
    """Ball of a `radius` above 0 about a `centre` (3,) [mm]. Raises InputError for other values.

    Examples
    --------
    >>> near = ff.Sphere(10).evaluate([[0, 0, 12]])
    >>> near.gap, near.normal
    (array([2.]), array([[0., 0., 1.]]))
    """

    _across, _any = np.eye(3), np.array([0.0, 0.0, 1.0])

    def __init__(self, radius: float, centre: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        super().__init__(checked_vector("centre", centre), radius)


class Cylinder(_Round):
    """Endless round bar, by a `point` (3,) on its axis [mm], the direction `axis` (3,), of any
    length, and its `radius` above 0 [mm]. Raises InputError for other values.

    Examples
    --------
    >>> ff.Cylinder((0, 0, 0), (1, 0, 0), 10).evaluate([[50, 0, 11]]).gap
    array([1.])
    """

    def __init__(self, point: ArrayLike, axis: ArrayLike, radius: float) -> None:
        super().__init__(checked_vector("point", point), radius)
        self.axis = checked_vector("axis", axis, unit=True)
        self._across = np.eye(3) - np.outer(self.axis, self.axis)
        beside = self._across[abs(self.axis).argmin()]
        self._any = beside / np.linalg.norm(beside)


class Torus(Surface):
    """Ring of round cross-section, about a `centre` (3,) [mm] and around an `axis` (3,), of any
    length: `ring` is the radius of the circle in the middle of the tube, above that of the `tube`
    itself, above 0 [mm]. Raises InputError for other values.

    Examples
    --------
    >>> ff.Torus((0, 0, 0), (0, 0, 1), ring=50, tube=5).evaluate([[50, 0, 7]]).gap
    array([2.])
    """

    def __init__(self, centre: ArrayLike, axis: ArrayLike, ring: float, tube: float) -> None:
        self.centre = checked_vector("centre", centre)
        self.axis = checked_vector("axis", axis, unit=True)
        self.tube = POSITIVE.check("tube", tube)
        wide = Rule(f"a number above the tube's radius {self.tube:g}", lambda v: v > self.tube)
        self.ring = wide.check("ring", ring)
        self.radii = (self.tube, self.ring - self.tube)
        self._bar = Cylinder(self.centre, self.axis, self.ring)

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        height = (points - self.centre) @ self.axis
        out, radial, turn = self._bar.nearest(points, reach)
        up = np.broadcast_to(self.axis, points.shape)
        distance = np.maximum(np.hypot(out, height), 1e-12 * self.tube)
        cross = (height * radial.T - out * up.T).T / distance[:, None]
        normal = (out * radial.T + height * up.T).T
        normal[~normal.any(1)] = self.axis  # in the middle of the tube any will do
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        curvature = _outer(cross, cross) / distance[:, None, None]
        curvature += (out / distance)[:, None, None] * turn
        return Nearest(distance - self.tube, normal, curvature)


class Plate(Surface):
    """Thick plate with an opening through it, like a die, its face up.

    length, width: of the opening along x and y, without the rounding; without `width` it is round,
    of diameter `length`. corner: radius of its corners in the plan, 0 by default: sharp. entry:
    radius of the rounding between the face and the upright walls. centre (3,): of the opening, in
    the plane of the face; all in mm. Raises InputError for values out of their range.

    Examples
    --------
    >>> ff.Plate(100, entry=5).evaluate([[70, 0, 2], [49, 0, -20]]).gap
    array([2., 1.])
    """

    def __init__(
        self,
        length: float,
        width: float | None = None,
        corner: float | None = None,
        entry: float = 0.0,
        centre: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        self.length = POSITIVE.check("length", length)
        self.width = self.length if width is None else POSITIVE.check("width", width)
        half = min(self.length, self.width) / 2
        least = half if width is None else 0.0
        allowed = f"a number from {least:g} to {half:g}, half the opening (round without `width`)"
        fits = Rule(allowed, lambda v: least <= v <= half * ROUNDING)
        self.corner = fits.check("corner", least if corner is None else corner)
        self.entry = FROM_ZERO.check("entry", entry)
        self.centre = checked_vector("centre", centre)
        self.radii = (self.entry or math.inf, self.corner or math.inf)

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        x, y, z = (points - self.centre).T
        d, slope, bend = _from_rectangle(x, y, self.length, self.width, self.corner)
        return _of_profile(self.entry - d, -slope, -bend, z + self.entry, 1.0, self.entry)


class Block(Surface):
    """Block with rounded edges, such as the punch of a box.

    length, width, height: along x, y and z, over all. radius: of the edges around top and bottom;
    corner: of the upright edges in the plan, from `radius`, which it is by default. centre (3,): of
    the top face; all in mm. Raises InputError for values out of their range.

    Examples
    --------
    >>> ff.Block(100, 60, 40, radius=5).evaluate([[0, 0, 3], [51, 0, -20]]).gap
    array([3., 1.])
    """

    def __init__(
        self,
        length: float,
        width: float,
        height: float,
        radius: float,
        corner: float | None = None,
        centre: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        self.length, self.width = POSITIVE.check("length", length), POSITIVE.check("width", width)
        self.height = POSITIVE.check("height", height)
        half = min(self.length, self.width) / 2
        most = min(half, self.height / 2)
        allowed = f"a number above 0, up to {most:g}, half the block's least size"
        self.radius = Rule(allowed, lambda v: 0 < v <= most * ROUNDING).check("radius", radius)
        corner = self.radius if corner is None else corner
        text = f"a number from the radius {self.radius:g} to {half:g}, half the block in the plan"
        fits = Rule(text, lambda v: self.radius <= v <= half * ROUNDING)
        self.corner = fits.check("corner", corner)
        self.centre = checked_vector("centre", centre)
        self.radii = (self.radius, math.inf)

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """Distance to a block with sharp edges within, less the radius."""
        x, y, z = (points - self.centre).T
        inner = self.length - 2 * self.radius, self.width - 2 * self.radius
        d, slope, bend = _from_rectangle(x, y, *inner, self.corner - self.radius)
        z = z + self.height / 2
        f = abs(z) - self.height / 2 + self.radius
        return _of_profile(d, slope, bend, f, np.copysign(1.0, z), self.radius)


def _from_rectangle(x, y, length, width, corner):
    """Signed distance (n,) to a rectangle about the origin with rounded corners, positive outside,
    its gradient (2, n), and curvature (n,) of its level lines, at x, y (n,)."""
    u = abs(x) - length / 2 + corner
    v = abs(y) - width / 2 + corner
    round_ = (u > 0) & (v > 0)
    r = np.where(round_, np.hypot(u, v), 1.0)
    distance = np.where(round_, r, np.maximum(u, v)) - corner
    dx = np.where(round_, u / r, u >= v)
    dy = np.where(round_, v / r, u < v)
    return distance, np.array([np.copysign(dx, x), np.copysign(dy, y)]), np.where(round_, 1 / r, 0)


def _of_profile(d, slope, bend, f, side, radius):
    """`Nearest` of a body between a wall and a face with a rounded edge. d, f (n,): distance beyond
    the rounding's centre across the wall and across the face, which looks up or down by `side`;
    slope (2, n), bend (n,): gradient and curvature of d in the plan."""
    edge = (d > 0) & (f > 0)
    r = np.where(edge, np.hypot(d, f), 1.0)
    m, n = np.where(edge, d / r, d > f), side * np.where(edge, f / r, d <= f)
    out = np.column_stack([*slope, 0 * d])
    along = np.column_stack([-slope[1], slope[0], 0 * d])
    up = np.array([0.0, 0.0, 1.0])
    normal = m[:, None] * out + n[:, None] * up
    cross = n[:, None] * out - m[:, None] * up
    curvature = np.where(edge, 1 / r, 0.0)[:, None, None] * _outer(cross, cross)
    curvature += (m * bend)[:, None, None] * _outer(along, along)
    return Nearest(np.where(edge, r, np.maximum(d, f)) - radius, normal, curvature)


def _outer(a, b):
    return a[:, :, None] * b[:, None, :]
