"""Plane, ball, bar, torus, plate with an opening, and block, in closed form."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.errors import InputError
from ..runtime.rules import FROM_ZERO, POSITIVE, Rule
from .surfaces import Nearest, Surface
from .values import checked_vector


class Plane(Surface):
    """Plane through `point` [mm]; the body lies on the side from which `normal` (of any length)
    points away.

    Raises InputError unless both are three finite numbers, `normal` not all 0.
    """

    def __init__(self, point: ArrayLike, normal: ArrayLike) -> None:
        self.point, self.normal = (
            checked_vector("point", point),
            checked_vector("normal", normal, unit=True),
        )

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As in `Surface`."""
        return Nearest(
            (points - self.point) @ self.normal,
            np.tile(self.normal, (len(points), 1)),
            np.zeros((len(points), 3, 3)),
        )


class _Round(Surface):
    """Sphere or cylinder: distance from its centre in the space that `_across` (3, 3) projects
    on."""

    _across: np.ndarray
    _any: np.ndarray

    def __init__(self, centre: np.ndarray, radius: float) -> None:
        self.centre, self.radius = centre, POSITIVE.check("radius", radius)
        self.radii = (self.radius, math.inf)

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As in `Surface`."""
        arm = (points - self.centre) @ self._across
        distance = np.linalg.norm(arm, axis=1)
        least = 1e-12 * self.radius  # at the centre any normal will do
        arm[distance < least] = least * self._any
        arm_length = np.maximum(distance, least)
        normal = arm / np.linalg.norm(arm, axis=1)[:, None]
        curvature = (self._across - normal[:, :, None] * normal[:, None, :]) / arm_length[
            :, None, None
        ]
        return Nearest(distance - self.radius, normal, curvature)


class Sphere(_Round):
    """Ball of `radius` [mm] about `centre` (3,) [mm]; InputError for a radius not above 0 or
    another centre."""

    _across, _any = np.eye(3), np.array([0.0, 0.0, 1.0])

    def __init__(self, radius: float, centre: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        super().__init__(checked_vector("centre", centre), radius)


class Cylinder(_Round):
    """Endless round bar of `radius` [mm] along `axis` (3,), of any length, through `point` (3,)
    [mm].

    Raises InputError for a radius not above 0, an axis that is all 0, or what is not three finite
    numbers.
    """

    def __init__(self, point: ArrayLike, axis: ArrayLike, radius: float) -> None:
        super().__init__(checked_vector("point", point), radius)
        self.axis = checked_vector("axis", axis, unit=True)
        self._across = np.eye(3) - np.outer(self.axis, self.axis)
        self._any = self._across[abs(self.axis).argmin()]
        self._any = self._any / np.linalg.norm(self._any)


class Torus(Surface):
    """Ring of round cross-section: a tube of radius `tube` [mm] about the circle of radius `ring`
    [mm] around `axis` (3,), of any length, through `centre` (3,) [mm].

    Raises InputError for a tube not above 0 or a ring not larger than the tube, and for what is not
    three finite numbers.
    """

    def __init__(self, centre: ArrayLike, axis: ArrayLike, ring: float, tube: float) -> None:
        self.centre, self.axis = (
            checked_vector("centre", centre),
            checked_vector("axis", axis, unit=True),
        )
        self.tube = POSITIVE.check("tube", tube)
        self.ring = Rule(
            f"a number above the tube's radius {self.tube:g}", lambda v: v > self.tube
        ).check("ring", ring)
        self.radii = (self.tube, self.ring - self.tube)
        self._bar = Cylinder(self.centre, self.axis, self.ring)

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As in `Surface`."""
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
    """Thick plate with an opening through it, like a die: its face lies in the plane z = centre[2]
    with the normal up, and a rounding of `entry` [mm] leads into the opening's upright walls.

    length, width: of the opening along x and y [mm], without the rounding; width None: a round one
    of diameter `length`. corner: radius of the opening's corners in the plan [mm], 0: sharp ones; a
    round opening has none to give. centre: of the opening, in the plane of the face (3,) [mm].
    Raises InputError for values out of their range.
    """

    def __init__(
        self,
        length: float,
        width: float | None = None,
        corner: float | None = None,
        entry: float = 0.0,
        centre: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        if width is None and corner is not None:
            raise InputError(
                f"corner is {corner}, but a round opening has none; allowed is to give width, too"
            )
        self.length = POSITIVE.check("length", length)
        self.width = self.length if width is None else POSITIVE.check("width", width)
        half = min(self.length, self.width) / 2
        corner = half if width is None else 0.0 if corner is None else corner
        self.corner = Rule(
            f"a number from 0 to {half:g}, half the opening", lambda v: 0 <= v <= half * (1 + 1e-12)
        ).check("corner", corner)
        self.entry = FROM_ZERO.check("entry", entry)
        self.centre = checked_vector("centre", centre)
        self.radii = (self.entry or math.inf, self.corner or math.inf)

    def plan(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Signed distance (n,) [mm] to the opening's outline, positive on the plate, its gradient
        (2, n), and curvature (n,) [1/mm] of its level lines, at x, y (n,) [mm] from the centre."""
        return _from_rectangle(x, y, self.length, self.width, self.corner)

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As in `Surface`."""
        x, y, z = (points - self.centre).T
        d, slope, bend = self.plan(x, y)
        e, f = d - self.entry, z + self.entry
        edge = (e < 0) & (f > 0)
        r = np.where(edge, np.hypot(e, f), 1.0)
        face = np.where((e >= 0) & (f <= 0), z >= -d, e >= 0)
        gap = np.where(edge, r - self.entry, np.where(face, z, -d))
        m = np.where(edge, e / r, np.where(face, 0.0, -1.0))
        n = np.where(edge, f / r, np.where(face, 1.0, 0.0))
        return _of_profile(gap, slope, bend, m, n, np.where(edge, 1 / r, 0.0))


class Block(Surface):
    """Block with its top face in the plane z = centre[2] and all its edges rounded, like the punch
    of a box.

    length, width, height: along x, y and z over all [mm]. radius: of the edges around top and
    bottom [mm]. corner: radius of the upright edges in the plan [mm], at least `radius`; None: the
    same, so that the corners are parts of balls. centre: of the top face (3,) [mm]. Raises
    InputError for values out of their range.
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
        self.length, self.width, self.height = (
            POSITIVE.check(name, value)
            for name, value in (("length", length), ("width", width), ("height", height))
        )
        half = min(self.length, self.width) / 2
        most = min(half, self.height / 2)
        self.radius = Rule(
            f"a number above 0, up to {most:g}, half the block's least size",
            lambda v: 0 < v <= most * (1 + 1e-12),
        ).check("radius", radius)
        self.corner = Rule(
            f"a number from the radius {self.radius:g} to {half:g}, half the block in the plan",
            lambda v: self.radius <= v <= half * (1 + 1e-12),
        ).check("corner", self.radius if corner is None else corner)
        self.centre = checked_vector("centre", centre)
        self.radii = (self.radius, math.inf)

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As in `Surface`: the distance to a block with sharp edges within, less the radius."""
        x, y, z = (points - self.centre).T
        inner = self.length - 2 * self.radius, self.width - 2 * self.radius
        d, slope, bend = _from_rectangle(x, y, *inner, self.corner - self.radius)
        z = z + self.height / 2
        f = abs(z) - self.height / 2 + self.radius
        edge = (d > 0) & (f > 0)
        r = np.where(edge, np.hypot(d, f), 1.0)
        gap = np.where(edge, r, np.maximum(d, f)) - self.radius
        m = np.where(edge, d / r, d > f)
        n = np.copysign(np.where(edge, f / r, d <= f), z)
        return _of_profile(gap, slope, bend, m, n, np.where(edge, 1 / r, 0.0))


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


def _of_profile(gap, slope, bend, m, n, turn):
    """`Nearest` of a gap (n,) that depends on height and distance in the plan.

    slope (2, n), bend (n,): gradient and curvature of that distance; m, n: parts of the normal
    along it and up; turn: curvature of the profile's level lines (n,).
    """
    out = np.column_stack([*slope, np.zeros(len(gap))])
    along = np.column_stack([-slope[1], slope[0], np.zeros(len(gap))])
    up = np.array([0.0, 0.0, 1.0])
    normal = m[:, None] * out + n[:, None] * up
    cross = n[:, None] * out - m[:, None] * up
    curvature = turn[:, None, None] * _outer(cross, cross)
    curvature += (m * bend)[:, None, None] * _outer(along, along)
    return Nearest(gap, normal, curvature)


def _outer(a, b):
    return a[:, :, None] * b[:, None, :]
