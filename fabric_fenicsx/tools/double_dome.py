"""The project's generic double dome."""

import math
from dataclasses import dataclass, field, fields
from functools import cached_property, wraps
from typing import ClassVar

import numpy as np

from ..runtime.errors import InputError
from ..runtime.rules import FROM_ZERO, POSITIVE, Rule, did_you_mean
from .surfaces import ImplicitSurface, in_frame, tangent_vectors

WALL = Rule("an angle from 0, below 90 deg", lambda v: 0 <= v < 90)


def _dimension(default, rule, text):
    return field(default=default, metadata={"rule": rule, "help": text})


def _in_range(given):
    """The dimensions in {name: value} that are allowed each by itself, as floats, and sentences on
    the others."""
    right, wrong = {}, []
    for each in fields(DoubleDome):
        if each.name in given:
            try:
                right[each.name] = each.metadata["rule"].check(each.name, given[each.name])
            except InputError as error:
                wrong.append(str(error))
    return right, wrong


def _refusing_unknown(dome):
    """The class, whose names of dimensions are checked before Python does, one by one."""
    make = dome.__init__

    @wraps(make)  # so that the signature stays
    def checked(self, /, *values, **named):
        allowed = [each.name for each in fields(dome)]
        if unknown := [name for name in named if name not in allowed]:
            hints = ", ".join(name + did_you_mean(name, allowed) for name in unknown)
            raise InputError(
                f"{hints}: no dimension of the double dome has this name; allowed are "
                + "; ".join([", ".join(allowed), *_in_range(named)[1]])
            )
        make(self, *values, **named)

    dome.__init__ = checked
    return dome


@_refusing_unknown
@dataclass(frozen=True)
class DoubleDome(ImplicitSurface):
    """The project's generic double dome: two round domes joined by a lower, narrower saddle, on a
    flange z = 0.

    Seen from above, the outline is two circles, one a dome, joined by concave arcs tangent to both;
    in the middle between the domes it is narrowest, at the waist. It is where wall and flange
    would meet without the fillet. In a cut across the outline follow, from within, the flat top, a
    rounding, the straight wall, a fillet and the flange; the fillet's foot is where the flange
    begins. The saddle is the top between the domes, which sinks towards the middle.

    - dome_distance: between the centres of the domes [mm]
    - dome_radius: of a dome's outline [mm]
    - waist: half width of the outline at the middle [mm]
    - depth: height of the domes over the flange [mm]
    - wall_angle: of the wall from the vertical [deg]
    - top_radius: of the rounding between top and wall [mm]
    - entry_radius: of the fillet between wall and flange [mm]
    - saddle_depth: by which the top is lower at the middle [mm]
    - saddle_length: along x, over which the top is lowered [mm]

    F(x, y, z) = P(d(x, y), z / H(x)): d is the signed distance in the plan to the outline, with
    circles about (+-dome_distance / 2, 0); P is the signed distance in the (d, z) plane to the
    profile of that cut; H lowers the saddle. The surface has continuous normals; its curvature
    jumps between these parts. The body is beneath, the normal points up; `Flipped` turns it upside
    down. The saddle also flattens fillet and rounding: see `radii` for the least radii. Raises
    InputError, which lists all that is wrong: names that are no dimension, values out of their
    range, and values that do not fit together.
    """

    dome_distance: float = _dimension(304.0, POSITIVE, "between the centres of the domes [mm]")
    dome_radius: float = _dimension(65.0, POSITIVE, "of a dome's outline [mm]")
    waist: float = _dimension(55.0, POSITIVE, "half width of the outline at the middle [mm]")
    depth: float = _dimension(60.0, POSITIVE, "height of the domes over the flange [mm]")
    wall_angle: float = _dimension(10.0, WALL, "of the wall from the vertical [deg]")
    top_radius: float = _dimension(40.0, POSITIVE, "of the rounding between top and wall [mm]")
    entry_radius: float = _dimension(15.0, POSITIVE, "of the fillet between wall and flange [mm]")
    saddle_depth: float = _dimension(
        15.0, FROM_ZERO, "by which the top is lower at the middle [mm]"
    )
    saddle_length: float = _dimension(
        304.0, POSITIVE, "along x, over which the top is lowered [mm]"
    )
    # what follows from them; each dome has its own, ClassVar only says that they are no fields
    _waist_curvature: ClassVar[float]
    _wall: ClassVar[np.ndarray]
    _up: ClassVar[np.ndarray]
    _top_centre: ClassVar[np.ndarray]
    _entry_centre: ClassVar[np.ndarray]

    def __post_init__(self) -> None:
        right, wrong = _in_range(vars(self))
        if wrong := [*wrong, *self._misfits(dict.fromkeys(vars(self), math.nan) | right)]:
            raise InputError("; ".join(wrong))
        c, R, w = right["dome_distance"] / 2, right["dome_radius"], right["waist"]
        angle = math.radians(right["wall_angle"])
        tangent = math.tan(math.pi / 4 - angle / 2)
        # normal of the wall in the (d, z) plane
        wall = np.array([math.cos(angle), math.sin(angle)])
        top, entry = right["top_radius"], right["entry_radius"]
        derived = {
            "_waist_curvature": 2 * (R - w) / (c * c + w * w - R * R),
            "_wall": wall,
            "_up": np.array([-wall[1], wall[0]]),
            "_top_centre": np.array(
                [-right["depth"] * math.tan(angle) - top * tangent, right["depth"] - top]
            ),
            "_entry_centre": np.array([entry * tangent, entry]),
        }
        for name, value in (right | derived).items():
            object.__setattr__(self, name, value)

    @staticmethod
    def _misfits(given):
        """A sentence on each of `given` dimensions that does not fit the others; one that is nan
        is judged in none."""
        c, R, w, depth = (
            given[name] for name in ("dome_distance", "dome_radius", "waist", "depth")
        )
        c /= 2
        angle, top, entry = (given[name] for name in ("wall_angle", "top_radius", "entry_radius"))
        radians = math.radians(angle)
        tangent, slope = math.tan(math.pi / 4 - radians / 2), depth * math.tan(radians)
        # half width at the middle where the circles overlap
        least = math.sqrt(max(0.0, R * R - c * c))
        if w <= least or w > R:
            yield (
                f"waist is {w:g}; allowed is above {least:g} and at most dome_radius = {R:g}, with "
                f"dome_distance {2 * c:g}"
            )
        elif 2 * (R - w) * entry * tangent >= (turn := c * c + w * w - R * R):
            yield (
                f"waist is {w:g}; allowed is larger, as the fillet's foot, {entry * tangent:g} "
                "outside the outline, must not reach the centre of the outline's concave arc of "
                f"radius {turn / (2 * (R - w)):g} there"
            )
        if given["saddle_depth"] >= depth:
            yield f"saddle_depth is {given['saddle_depth']:g}; allowed is below depth = {depth:g}"
        room = 1 - math.sin(radians)
        if (top + entry) * room > depth:
            yield (
                f"top_radius + entry_radius is {top + entry:g}; allowed is at most "
                f"{depth / room:g}, so that they fit between top and flange with depth {depth:g} "
                f"and wall_angle {angle:g}"
            )
        if slope >= w:
            yield (
                f"wall_angle is {angle:g}; allowed is below {math.degrees(math.atan(w / depth)):g},"
                f" as the walls of depth {depth:g} must not meet within waist {w:g}"
            )
        elif top * tangent >= w - slope:
            yield (
                f"top_radius is {top:g}; allowed is below {(w - slope) / tangent:g}, so that it "
                f"leaves a flat top within waist {w:g} at wall_angle {angle:g}"
            )

    @property
    def roundings(self) -> tuple[float, float]:
        """Distances from the outline [mm], as `plan` gives them, between which the surface is not
        flat: where the upper rounding begins, and where the fillet ends on the flange."""
        return float(self._top_centre[0]), float(self._entry_centre[0])

    def plan(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Signed distance (n,) [mm] to the outline, its gradient (2, n), curvature (n,) [1/mm] of
        its level lines."""
        c, w, k = self.dome_distance / 2, self.waist, self._waist_curvature
        u, v = abs(x), abs(y)
        arc = u * (1 + k * w) < c * (1 + k * (w - v))
        # Written with the arcs' curvature, which may be 0, and not with their radius.
        q = np.hypot(k * u, 1 - k * (v - w))
        q = np.where(arc, q, 1)
        r = np.maximum(np.hypot(u - c, v), 1e-9)
        d = np.where(
            arc, (2 * (v - w) - k * (u * u + (v - w) ** 2)) / (1 + q), r - self.dome_radius
        )
        dx = np.where(arc, -k * u / q, (u - c) / r)
        dy = np.where(arc, (1 - k * (v - w)) / q, v / r)
        return (
            d,
            np.array([np.where(x < 0, -dx, dx), np.where(y < 0, -dy, dy)]),
            np.where(arc, -k / q, 1 / r),
        )

    def height(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """H (n,) and its first and second derivative at x (n,) [mm]; H is 1 beyond the saddle."""
        half = self.saddle_length / 2
        s = np.clip(x / half, -1, 1)
        t, drop = 1 - s * s, self.saddle_depth / self.depth
        return (
            1 - drop * t**3,
            6 * drop / half * s * t * t,
            6 * drop / half**2 * t * (1 - 5 * s * s),
        )

    def _profile(self, d, z):
        """Signed distance (n,) to the profile, its gradient (2, n) by d and z, curvature (n,) of
        its level lines."""
        (d1, z1), (d2, z2) = self._top_centre, self._entry_centre
        along = d * self._up[0] + z * self._up[1]
        upper, lower = self._top_centre @ self._up, self._entry_centre @ self._up
        r1, r2 = np.hypot(d - d1, z - z1), np.hypot(d - d2, z - z2)
        r1, r2 = np.maximum(r1, 1e-9), np.maximum(r2, 1e-9)
        none = np.inf
        parts = np.array(
            [
                np.where(d <= d1, z - self.depth, none),
                np.where((d > d1) & (along > upper), r1 - self.top_radius, none),
                np.where(
                    (along >= lower) & (along <= upper), d * self._wall[0] + z * self._wall[1], none
                ),
                np.where((d < d2) & (along < lower), self.entry_radius - r2, none),
                np.where(d >= d2, z, none),
            ]
        )
        part = abs(parts).argmin(0)
        value = np.take_along_axis(parts, part[None], 0)[0]
        m = np.choose(part, [0.0, (d - d1) / r1, self._wall[0], (d2 - d) / r2, 0.0])
        n = np.choose(part, [1.0, (z - z1) / r1, self._wall[1], (z2 - z) / r2, 1.0])
        return value, np.array([m, n]), np.choose(part, [0.0, 1 / r1, 0.0, -1 / r2, 0.0])

    def value(self, x: np.ndarray) -> np.ndarray:
        """F (n,) [mm] at x (3, n) [mm]."""
        return self._profile(self.plan(x[0], x[1])[0], x[2] / self.height(x[0])[0])[0]

    def implicit(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F (n,) [mm], its gradient (3, n) and Hessian (3, 3, n) [1/mm] at x (3, n) [mm]."""
        d, plan, turn = self.plan(x[0], x[1])
        H, H1, H2 = self.height(x[0])
        z = x[2] / H
        F, (m, n), bend = self._profile(d, z)
        zx, zz, zxz = -z * H1 / H, 1 / H, -H1 / H**2
        zxx = z * (2 * (H1 / H) ** 2 - H2 / H)
        gradient = np.array([m * plan[0] + n * zx, m * plan[1], n * zz])
        # along the level lines of P and of d, whose curvatures are `bend` and `turn`
        p = np.array([-n * plan[0] + m * zx, -n * plan[1], m * zz])
        t, turn = np.array([-plan[1], plan[0]]), m * turn
        hessian = (bend * p)[:, None] * p
        hessian[:2, :2] += (turn * t)[:, None] * t
        hessian[0, 0] += n * zxx
        hessian[0, 2] += n * zxz
        hessian[2, 0] += n * zxz
        return F, gradient, hessian

    def bound(self, F: np.ndarray, x: np.ndarray) -> np.ndarray:
        """As in `ImplicitSurface`."""
        # |F| is at most the distance times the largest gradient between the point and the surface,
        # at any x.
        least = 1 - self.saddle_depth / self.depth
        steepest = 96 / (25 * math.sqrt(5)) * (1 - least) / self.saddle_length * 2
        zx = np.maximum(abs(x[2]), self.depth) * steepest / least**2
        norm = 1 / least**2 + zx * zx
        largest = np.sqrt((1 + norm + np.sqrt((1 - norm) ** 2 + 4 * zx * zx)) / 2)
        return np.maximum(abs(F) / largest, np.maximum(x[2] - self.depth, -x[2]))

    @property
    def foot(self) -> float:
        """Distance [mm] from the outline at which the flange begins."""
        return float(self._entry_centre[0])

    @cached_property
    def developed(self) -> np.ndarray:
        """Arc lengths (4,) [mm] along the profile where rounding, wall, fillet and flange begin,
        from the outline inwards as in the plan on the flat top."""
        turn = math.pi / 2 - math.radians(self.wall_angle)
        wall = (self._top_centre - self._entry_centre) @ self._up
        return self._top_centre[0] + np.cumsum(
            [0, self.top_radius * turn, wall, self.entry_radius * turn]
        )

    def lift(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Points (n, 3) [mm] on the surface from their places x, y (n,) [mm] in the developed plan.

        There the arc length of the profile takes the place of the distance from the outline, so
        that walls are not seen edge-on; flat top and plan coincide.
        """
        s, normal, _ = self.plan(x, y)
        rounding, wall, fillet, flange = self.developed
        (d1, z1), (d2, z2) = self._top_centre, self._entry_centre
        a, b = (s - rounding) / self.top_radius, (flange - s) / self.entry_radius
        where = [s <= rounding, s <= wall, s <= fillet, s <= flange]
        foot = [d2, z2] - self.entry_radius * self._wall - self._up * (s - fillet)[:, None]
        d = np.select(
            where,
            [s, d1 + self.top_radius * np.sin(a), foot[:, 0], d2 - self.entry_radius * np.sin(b)],
            s - flange + d2,
        )
        z = np.select(
            where,
            [
                self.depth,
                z1 + self.top_radius * np.cos(a),
                foot[:, 1],
                z2 - self.entry_radius * np.cos(b),
            ],
            0.0,
        )
        x = x + (d - s) * normal[0]
        return np.column_stack([x, y + (d - s) * normal[1], z * self.height(x)[0]])

    @cached_property
    def radii(self) -> tuple[float, float]:  # type: ignore[override]
        """As in `Surface`, from the curvature at 150 x 150 places of a quarter."""
        ends = (self.dome_distance / 2 + self.dome_radius, self.dome_radius)
        x, y = np.meshgrid(*(np.linspace(0, end + self.developed[-1], 150) for end in ends))
        _, gradient, hessian = self.implicit(self.lift(x.ravel(), y.ravel()).T)
        size = np.linalg.norm(gradient, axis=0)
        k11, k22, k12 = in_frame(tangent_vectors(gradient / size), hessian) / size
        spread = np.hypot((k11 - k22) / 2, k12)
        return 1 / float(((k11 + k22) / 2 + spread).max()), 1 / float(
            (spread - (k11 + k22) / 2).max()
        )
