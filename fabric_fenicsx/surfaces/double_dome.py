"""The generic double dome, whose dimensions are this project's own, not the benchmark's."""

import math
from collections import namedtuple
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from ..core.compiled import compiled
from ..core.errors import InputError
from ..core.fields import KnowsItsFields, check_fields, documented, quantity
from ..core.rules import FROM_ZERO, POSITIVE, Rule
from .implicit import ImplicitSurface
from .newton_kernel import MAX_ROUNDS, Search, advance
from .surfaces import Nearest

# Numbers that follow from the dimensions of a double dome [mm]: half the distance of the domes,
# radius and half width of the outline, curvature `bend` of its concave arcs [1/mm]; height, radii
# of rounding and fillet, their centres (d1, z1), (d2, z2) and the wall's normal (m, n) in the plane
# of the profile; share by which the saddle is lower, and half its length.
_Shape = namedtuple("_Shape", "half radius waist bend depth top entry d1 z1 d2 z2 m n drop reach")


@compiled
def _plan(dome: _Shape, x: float, y: float) -> tuple[float, float, float, float]:
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
def _height(dome: _Shape, x: float) -> tuple[float, float, float]:
    """H and its first and second derivative."""
    s = min(max(x / dome.reach, -1.0), 1.0)
    t, slope = 1 - s * s, 6 * dome.drop / dome.reach
    return 1 - dome.drop * t**3, slope * s * t * t, slope / dome.reach * t * (1 - 5 * s * s)


@compiled
def _profile(dome: _Shape, d: float, z: float) -> tuple[float, float, float, float]:
    """Signed distance to the profile, its gradient, and the curvature of its level lines: of those
    parts over which (d, z) lies the nearest one's."""
    m, n, along = dome.m, dome.n, dome.m * z - dome.n * d
    upper, lower = dome.m * dome.z1 - dome.n * dome.d1, dome.m * dome.z2 - dome.n * dome.d2
    nearest = (math.inf, math.nan, math.nan, math.nan)
    if d <= dome.d1:
        nearest = (z - dome.depth, 0.0, 1.0, 0.0)
    elif along > upper:
        p, q = d - dome.d1, z - dome.z1
        r = max(math.sqrt(p * p + q * q), 1e-9)
        nearest = (r - dome.top, p / r, q / r, 1 / r)
    if lower <= along <= upper and abs(m * d + n * z) < abs(nearest[0]):
        nearest = (m * d + n * z, m, n, 0.0)
    if d < dome.d2 and along < lower:
        p, q = dome.d2 - d, dome.z2 - z
        r = max(math.sqrt(p * p + q * q), 1e-9)
        if abs(dome.entry - r) < abs(nearest[0]):
            nearest = (dome.entry - r, p / r, q / r, -1 / r)
    if d >= dome.d2 and abs(z) < abs(nearest[0]):
        nearest = (z, 0.0, 1.0, 0.0)
    return nearest


@compiled
def _plans(dome: _Shape, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    rows = np.empty((4, len(x)))
    for i in range(len(x)):
        rows[0, i], rows[1, i], rows[2, i], rows[3, i] = _plan(dome, x[i], y[i])
    return rows


@compiled
def _value(dome: _Shape, x: np.ndarray) -> np.ndarray:
    F = np.empty(len(x))
    for i in range(len(x)):
        d = _plan(dome, x[i, 0], x[i, 1])[0]
        F[i] = _profile(dome, d, x[i, 2] / _height(dome, x[i, 0])[0])[0]
    return F


@compiled
def _implicit(dome: _Shape, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F (n,), its gradient (3, n) and Hessian (3, 3, n) at x (n, 3)."""
    count = len(x)
    F, gradient, hessian = np.empty(count), np.empty((3, count)), np.empty((3, 3, count))
    for i in range(count):
        d, dx, dy, turn = _plan(dome, x[i, 0], x[i, 1])
        H, H1, H2 = _height(dome, x[i, 0])
        z = x[i, 2] / H
        F[i], m, n, bend = _profile(dome, d, z)
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
def _bound(dome: _Shape, F: np.ndarray, z: np.ndarray) -> np.ndarray:
    bound, least = np.empty(len(F)), 1 - dome.drop
    steepest = 96 / (25 * math.sqrt(5)) * dome.drop / dome.reach
    for i in range(len(F)):
        # |F| is at most the distance times the largest gradient up to the surface, at any x
        zx = max(abs(z[i]), dome.depth) * steepest / least**2
        norm = 1 / least**2 + zx * zx
        largest = math.sqrt((1 + norm + math.sqrt((1 - norm) ** 2 + 4 * zx * zx)) / 2)
        bound[i] = max(abs(F[i]) / largest, z[i] - dome.depth, -z[i])
    return bound


@compiled
def _project(dome: _Shape, search: Search, feet: Nearest) -> None:
    count = len(search.rows)
    for iteration in range(MAX_ROUNDS):
        if not count:
            return
        F, gradient, hessian = _implicit(dome, search.trial[:count])
        count = advance(search, count, iteration, F, gradient, hessian, feet)


@documented
@dataclass(frozen=True)
class DoubleDome(KnowsItsFields, ImplicitSurface):
    """Two round domes joined by a lower, narrower saddle, on a flange z = 0.

    Seen from above, the outline, where wall and flange would meet without the fillet, is two
    circles about (+-dome_distance / 2, 0), joined by concave arcs tangent to both; it is narrowest
    in the middle, at the waist. A cut across it has, from within, a flat top, a rounding, a
    straight wall, a fillet and the flange. Between the domes the top sinks towards the middle.

    F(x, y, z) = P(d(x, y), z / H(x)): d is the signed distance in the plan to the outline; P that
    in the (d, z) plane to the profile of that cut; H lowers the saddle, which also flattens fillet
    and rounding: `radii` has the least radii. The normals are continuous; the curvature jumps
    between the parts. The body is beneath; `Flipped` turns it upside down. Raises InputError for
    names that are no dimension, values out of their range, and what does not fit together.

    Examples
    --------
    >>> dome = ff.DoubleDome(depth=50)
    >>> dome.evaluate([[152, 0, 52]]).gap
    array([2.])
    """

    dome_distance: float = quantity(304.0, POSITIVE, "distance of the centres of the domes [mm]")
    dome_radius: float = quantity(65.0, POSITIVE, "radius of a dome's outline [mm]")
    waist: float = quantity(55.0, POSITIVE, "half width of the outline at the middle [mm]")
    depth: float = quantity(60.0, POSITIVE, "height of the domes over the flange [mm]")
    wall_angle: float = quantity(
        10.0,
        Rule("an angle from 0, below 90 deg", lambda v: 0 <= v < 90),
        "angle of the wall from the vertical [deg]",
    )
    top_radius: float = quantity(40.0, POSITIVE, "radius between top and wall [mm]")
    entry_radius: float = quantity(15.0, POSITIVE, "radius between wall and flange [mm]")
    saddle_depth: float = quantity(15.0, FROM_ZERO, "depression of the top at the middle [mm]")
    saddle_length: float = quantity(304.0, POSITIVE, "length along x of this depression [mm]")
    # what follows from them; each dome has its own, ClassVar only says that they are no fields
    _shape: ClassVar[_Shape]

    def __post_init__(self) -> None:
        check_fields(self, "{}".format)
        c, R, w, depth = self.dome_distance / 2, self.dome_radius, self.waist, self.depth
        top, entry, angle = self.top_radius, self.entry_radius, math.radians(self.wall_angle)
        tangent, slope = math.tan(math.pi / 4 - angle / 2), depth * math.tan(angle)
        # half width at the middle where the circles overlap
        least, turn = math.sqrt(max(0.0, R * R - c * c)), c * c + w * w - R * R
        lowest, inwards = (top + entry) * (1 - math.sin(angle)), slope + top * tangent
        relations = [
            (
                least < w <= R and 2 * (R - w) * entry * tangent < turn,
                f"waist is {w:g}; expected above {least:g} and at most dome_radius = {R:g}, with "
                "dome_distance and entry_radius such that the fillet's foot does not reach the "
                "centre of the outline's concave arc",
            ),
            (
                self.saddle_depth < depth and lowest <= depth,
                f"depth is {depth:g}; expected above saddle_depth = {self.saddle_depth:g}, and "
                f"{lowest:g} or more, so that top_radius = {top:g} and entry_radius = {entry:g} "
                f"fit at wall_angle = {self.wall_angle:g}",
            ),
            (
                inwards < w,
                f"wall_angle is {self.wall_angle:g} and top_radius {top:g}; expected such that "
                f"wall and rounding, {inwards:g} mm, leave a flat top at the waist",
            ),
        ]
        for holds, flaw in relations:
            if not holds:
                raise InputError(flaw)
        outline = c, R, w, 2 * (R - w) / turn, depth, top, entry
        rounding, fillet = (-inwards, depth - top), (entry * tangent, entry)
        wall, saddle = (math.cos(angle), math.sin(angle)), self.saddle_depth / depth
        shape = _Shape(*outline, *rounding, *fillet, *wall, saddle, self.saddle_length / 2)
        object.__setattr__(self, "_shape", shape)

    @property
    def roundings(self) -> tuple[float, float]:
        """Distances from the outline [mm], as `plan` gives them, between which the surface is not
        flat: where the upper rounding begins, and where the fillet ends on the flange."""
        return self._shape.d1, self._shape.d2

    def plan(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Signed distance (n,) [mm] to the outline, gradient (2, n), curvature (n,) [1/mm]."""
        rows = _plans(self._shape, *(np.ascontiguousarray(each, dtype=float) for each in (x, y)))
        return rows[0], rows[1:3], rows[3]

    def value(self, x: np.ndarray) -> np.ndarray:
        return _value(self._shape, np.ascontiguousarray(x.T, dtype=float))

    def implicit(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return _implicit(self._shape, np.ascontiguousarray(x.T, dtype=float))

    def bound(self, F: np.ndarray, x: np.ndarray) -> np.ndarray:
        return _bound(self._shape, F, x[2])

    def _project(self, search, feet):
        _project(self._shape, search, feet)

    @cached_property
    def developed(self) -> np.ndarray:
        """Arc lengths (4,) [mm] along the profile where rounding, wall, fillet and flange begin,
        from the outline inwards as in the plan on the flat top."""
        turn = math.pi / 2 - math.radians(self.wall_angle)
        it = self._shape
        wall = it.m * (it.z1 - it.z2) - it.n * (it.d1 - it.d2)
        return it.d1 + np.cumsum([0, self.top_radius * turn, wall, self.entry_radius * turn])

    def lift(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Points (n, 3) [mm] on the surface from their places x, y (n,) [mm] in the developed plan.
        There the arc length of the profile takes the place of the distance from the outline, so
        that walls are not seen edge-on; flat top and plan coincide."""
        s, normal, _ = self.plan(x, y)
        rounding, wall, fillet, flange = self.developed
        a, b = (s - rounding) / self.top_radius, (flange - s) / self.entry_radius
        where = [s <= rounding, s <= wall, s <= fillet, s <= flange]
        it, down = self._shape, s - fillet
        on_wall = it.d2 - it.entry * it.m + it.n * down, it.z2 - it.entry * it.n - it.m * down
        ds = [s, it.d1 + it.top * np.sin(a), on_wall[0], it.d2 - it.entry * np.sin(b)]
        zs = [self.depth, it.z1 + it.top * np.cos(a), on_wall[1], it.z2 - it.entry * np.cos(b)]
        d, z = np.select(where, ds, s - flange + it.d2), np.select(where, zs, 0.0)
        x = x + (d - s) * normal[0]
        H = [_height(it, at)[0] for at in x.tolist()]
        return np.column_stack([x, y + (d - s) * normal[1], z * H])

    @cached_property
    def radii(self) -> tuple[float, float]:  # type: ignore[override]
        """As in `Surface`, from the curvature at 150 x 150 places of a quarter."""
        ends = (self.dome_distance / 2 + self.dome_radius, self.dome_radius)
        x, y = np.meshgrid(*(np.linspace(0, end + self.developed[-1], 150) for end in ends))
        bent = self.evaluate(self.lift(x.ravel(), y.ravel())).curvature
        # half the sum and half the difference of both curvatures, as the normal's is 0
        mean = np.trace(bent, axis1=1, axis2=2) / 2
        spread = np.sqrt(np.maximum((bent**2).sum((1, 2)) / 2 - mean**2, 0))
        return 1 / float((mean + spread).max()), 1 / float((spread - mean).max())
