"""Rigid surfaces of tools: signed distance, normal and curvature at many points at once, and the tools that carry them.

A surface bounds a body; its normal points out of it, and the gap (signed distance) is positive outside.
"""

import math
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass, field, fields
from functools import cached_property
from numbers import Real
from pathlib import Path
from reprlib import repr as shown
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from .errors import InputError


class Nearest(NamedTuple):
    """Surface seen from n points: gap (n,) [mm], its gradient normal (n, 3) and Hessian curvature (n, 3, 3) [1/mm]."""

    gap: np.ndarray
    normal: np.ndarray
    curvature: np.ndarray


def _number(name, value, allowed="of either sign", low=-math.inf, high=math.inf, closed=False):
    """`value` as a float above `low` (or at it if `closed`) and below `high`; otherwise an InputError."""
    if isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value):
        if low < value < high or (closed and value == low):
            return float(value)
    raise InputError(f"{name} is {shown(value)}, but it must be a finite number, {allowed}")


def _vector(name, value, unit=False):
    """`value` as three floats, of length 1 if `unit`; otherwise an InputError."""
    try:
        vector = np.array(value, dtype=float)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or (unit and not vector.any()):
        raise InputError(f"{name} is {shown(value)}, but it must be three finite numbers{', not all 0' * unit}")
    # scaled first, so that its square neither overflows nor vanishes
    return vector / abs(vector).max() / np.linalg.norm(vector / abs(vector).max()) if unit else vector


def _points(points: ArrayLike) -> np.ndarray:
    """`points` as an array of shape (n, 3); otherwise an InputError."""
    try:
        x = np.asarray(points, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"points are {shown(points)}, but they must be numbers of shape (n, 3)") from None
    if x.ndim != 2 or x.shape[1] != 3:
        raise InputError(f"points have the shape {x.shape}, but it must be (n, 3)")
    return x


class Surface:
    """Base of all surfaces: they give `_nearest(points, reach)` for finite points (n, 3) [mm]."""

    radii: tuple[float, float] = (math.inf, math.inf)
    """Least radius of curvature [mm] as seen from inside the body and from outside: nearer than that to the surface the
    nearest point is unique, unless another part of the surface is as near. Infinite where unknown."""

    def evaluate(self, points: ArrayLike, reach: float = math.inf) -> Nearest:
        """Gap, normal and curvature at `points` (n, 3) [mm]; rows are NaN where a point is not finite.

        reach [mm]: where |gap| surely exceeds it, the gap need only do so too, with the right sign, and normal and
        curvature need only be finite; so far points cost little.
        Raises InputError for points of another shape and for a reach below 0.
        """
        x = _points(points)
        if not reach >= 0:
            raise InputError(f"reach is {reach}, but it must be at least 0")
        finite = np.isfinite(x).all(1)
        if finite.all():
            return self._nearest(x, reach)
        found = Nearest(*(np.full((len(x), *shape), np.nan) for shape in ((), (3,), (3, 3))))
        for whole, part in zip(found, self._nearest(x[finite], reach)):
            whole[finite] = part
        return found

    def mesh(self, low: ArrayLike, high: ArrayLike, size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (n, 3) [mm], unit normals (n, 3) and triangles (m, 3), anticlockwise as the normals see them, to draw
        what lies between the corners low and high (3,) [mm]; edges are about `size` [mm] long. A surface of triangles
        gives these, all of them."""
        return self._mesh(np.asarray(low, dtype=float), np.asarray(high, dtype=float), size)

    def _mesh(self, low, high, size):
        import pyvista

        cells = np.ceil((high - low) / size).astype(int)
        grid = pyvista.ImageData(dimensions=cells + 1, spacing=(high - low) / cells, origin=low)
        parts = np.array_split(np.asarray(grid.points, dtype=float), 1 + grid.n_points // 20000)  # fit the cache
        gap = np.concatenate([self.evaluate(part, 2 * size).gap for part in parts])
        contour = grid.contour([0.0], gap, compute_normals=False, method="flying_edges")
        points, triangles = np.array(contour.points, dtype=float), np.array(contour.faces).reshape(-1, 4)[:, 1:]
        for _ in range(2):  # on to the surface; the second finds what is left
            gap, normals, _ = self.evaluate(points, 2 * size)
            points = points - gap[:, None] * normals
        # where the gap jumps or there is no nearest point, there is no surface
        used, triangles = np.unique(triangles[(abs(gap) < 0.1 * size)[triangles].all(1)], return_inverse=True)
        points, normals, triangles = points[used], normals[used], triangles.reshape(-1, 3)
        p, q, r = points[triangles].swapaxes(0, 1)
        turned = (np.cross(q - p, r - p) * normals[triangles[:, 0]]).sum(1) < 0
        triangles[turned] = triangles[turned, ::-1]
        return points, normals, triangles

    def _nearest(self, points: np.ndarray, reach: float) -> Nearest:
        raise NotImplementedError


class Plane(Surface):
    """Plane through `point` [mm]; the body lies on the side from which `normal` (of any length) points away.

    Raises InputError unless both are three finite numbers, `normal` not all 0.
    """

    def __init__(self, point: ArrayLike, normal: ArrayLike) -> None:
        self.point, self.normal = _vector("point", point), _vector("normal", normal, unit=True)

    def _nearest(self, points, reach):
        return Nearest(
            (points - self.point) @ self.normal, np.tile(self.normal, (len(points), 1)), np.zeros((len(points), 3, 3))
        )


class _Round(Surface):
    """Sphere or cylinder: distance from its centre in the space that `_across` (3, 3) projects on."""

    _across: np.ndarray
    _any: np.ndarray

    def __init__(self, centre: np.ndarray, radius: float) -> None:
        self.centre, self.radius = centre, _number("radius", radius, "above 0", low=0)
        self.radii = (self.radius, math.inf)

    def _nearest(self, points, reach):
        arm = (points - self.centre) @ self._across
        distance = np.linalg.norm(arm, axis=1)
        least = 1e-12 * self.radius  # at the centre any normal will do
        arm[distance < least] = least * self._any
        arm_length = np.maximum(distance, least)
        normal = arm / np.linalg.norm(arm, axis=1)[:, None]
        curvature = (self._across - normal[:, :, None] * normal[:, None, :]) / arm_length[:, None, None]
        return Nearest(distance - self.radius, normal, curvature)


class Sphere(_Round):
    """Ball of `radius` [mm] about `centre` (3,) [mm]; InputError for a radius not above 0 or another centre."""

    _across, _any = np.eye(3), np.array([0.0, 0.0, 1.0])

    def __init__(self, centre: ArrayLike, radius: float) -> None:
        super().__init__(_vector("centre", centre), radius)


class Cylinder(_Round):
    """Endless round bar of `radius` [mm] along `axis` (3,), of any length, through `point` (3,) [mm].

    Raises InputError for a radius not above 0, an axis that is all 0, or what is not three finite numbers.
    """

    def __init__(self, point: ArrayLike, axis: ArrayLike, radius: float) -> None:
        super().__init__(_vector("point", point), radius)
        self.axis = _vector("axis", axis, unit=True)
        self._across = np.eye(3) - np.outer(self.axis, self.axis)
        self._any = self._across[abs(self.axis).argmin()]
        self._any = self._any / np.linalg.norm(self._any)


def _tangents(normal):
    """Two unit vectors (2, 3, n) that make a right-handed frame with unit normals (3, n)."""
    x, y, z = normal
    s = np.copysign(1.0, z)
    a = -1 / (s + z)
    b = x * y * a
    return np.array([[1 + s * x * x * a, s * b, -s * x], [b, s + y * y * a, -y]])


def _in_frame(tangents, matrix):
    """The entries 11, 22, 12 (3, n) of symmetric matrices (3, 3, n) in a frame of tangents (2, 3, n)."""
    along = np.einsum("ijn,ajn->ain", matrix, tangents)
    return np.array([(tangents[a] * along[b]).sum(0) for a, b in ((0, 0), (1, 1), (0, 1))])


def _hessian_of_gap(tangents, shape, gap):
    """K (I + gap K)^-1 as (n, 3, 3), of shape operators K given by their entries 11, 22, 12 (3, n) in the frame."""
    k11, k22, k12 = shape
    det = k11 * k22 - k12 * k12
    scale = 1 + gap * (k11 + k22) + gap * gap * det
    scale = np.where(abs(scale) < 1e-9, 1e-9, scale)  # a centre of curvature
    # Cayley-Hamilton: K adj(I + gap K) = K + gap det(K) I
    m11, m22, m12 = (k11 + gap * det) / scale, (k22 + gap * det) / scale, k12 / scale
    (s, t) = tangents
    half = np.einsum("in,jn->nij", m11 * s + m12 * t, s) + np.einsum("in,jn->nij", m12 * s + m22 * t, t)
    return (half + half.swapaxes(1, 2)) / 2


class ImplicitSurface(Surface):
    """Surface F(x) = 0 with F < 0 in the body; the nearest point by Newton's method on its Lagrangian.

    A subclass gives `implicit`, `bound` and, where F alone is cheaper, `value`. Gap, normal and curvature are exact at
    the point found, whose distance from the surface and from the foot of the normal is below 1e-11 mm. Rows are NaN
    where none is found, which can happen only further away than `radii`; there it can also be a point that is not the
    nearest of all.
    """

    def value(self, x: np.ndarray) -> np.ndarray:
        """F (n,) at x (3, n) [mm]."""
        return self.implicit(x)[0]

    def implicit(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F (n,), its gradient (3, n) and Hessian (3, 3, n) at x (3, n) [mm]."""
        raise NotImplementedError

    def bound(self, F: np.ndarray, x: np.ndarray) -> np.ndarray:
        """What the distance from x (3, n) [mm], where `value` is F (n,), surely is not below, (n,) [mm]."""
        raise NotImplementedError

    def _nearest(self, points, reach):
        x = np.ascontiguousarray(points.T)
        F = self.value(x)
        bound = self.bound(F, x)
        found = Nearest(
            np.copysign(bound, F), np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.zeros((len(points), 3, 3))
        )
        near = np.flatnonzero(bound <= reach)
        for part in np.array_split(near, max(1, len(near) // 4096)):  # blocks that stay in the cache
            self._project(x[:, part], part, found)
        return found

    def _project(self, x, rows, found):
        """Put what belongs to the nearest points of x (3, n) into `rows` of `found`."""
        for target in found:
            target[rows] = np.nan
        F, gradient, _ = self.implicit(x)
        base, step = x, -F * gradient / (gradient * gradient).sum(0)
        factor, merit = np.ones(len(rows)), np.full(len(rows), np.inf)
        tolerance = 1e-11 + 1e-14 * abs(x).max(0, initial=0)
        for iteration in range(100):
            if not len(rows):
                return
            trial = base + factor * step
            F, gradient, hessian = self.implicit(trial)
            size = np.sqrt((gradient * gradient).sum(0))
            normal = gradient / size
            tangents = _tangents(normal)
            arm = x - trial
            gap = (arm * normal).sum(0)
            aside = np.einsum("ajn,jn->an", tangents, arm)
            shape = _in_frame(tangents, hessian) / size
            new = (aside * aside).sum(0) + (F / size) ** 2
            done = new <= tolerance**2
            if done.any():
                at = rows[done]
                found.gap[at] = gap[done]
                found.normal[at] = normal[:, done].T
                found.curvature[at] = _hessian_of_gap(tangents[:, :, done], shape[:, done], gap[done])
            # Beyond a centre of curvature the distance has no minimum here, so the model is kept convex.
            a, b, c = 1 + gap * shape[0], 1 + gap * shape[1], gap * shape[2]
            lift = np.maximum(0, 0.1 - (a + b) / 2 + np.hypot((a - b) / 2, c))
            a, b = a + lift, b + lift
            s, t = np.array([b * aside[0] - c * aside[1], a * aside[1] - c * aside[0]]) / (a * b - c * c)
            newton = -F / size * normal + s * tangents[0] + t * tangents[1]
            # A step that does not help is halved; one of an eighth is taken all the same, to get over a seam. Shorter
            # steps later on end most of the cycles that there are far inside the body.
            taken = (new < merit) | (factor < 0.2)
            base, step = np.where(taken, trial, base), np.where(taken, newton, step)
            merit, factor = np.where(taken, new, merit), np.where(taken, 1.0 if iteration < 20 else 0.6, factor / 2)
            if done.any():
                on = ~done
                x, base, step, rows = x[:, on], base[:, on], step[:, on], rows[on]
                merit, factor, tolerance = merit[on], factor[on], tolerance[on]


def _dimension(default, allowed, text, low=0.0, high=math.inf, closed=False):
    limits = {"allowed": allowed, "low": low, "high": high, "closed": closed}
    return field(default=default, metadata={"limits": limits, "help": text})


@dataclass(frozen=True)
class DoubleDome(ImplicitSurface):
    """The project's generic double dome: two round domes joined by a lower, narrower saddle, on a flange z = 0.

    F(x, y, z) = P(d(x, y), z / H(x)): d is the signed distance in the plan to the outline, two circles about
    (+-dome_distance / 2, 0) joined by concave arcs tangent to both; P is the signed distance in the (d, z) plane to the
    profile of flat top, rounding, straight wall and fillet; H lowers the saddle. The outline is where wall and flange
    would meet without the fillet. The surface has continuous normals; its curvature jumps between these parts.
    The body is beneath, the normal points up; `Flipped` turns it upside down. Lengths in mm, wall_angle in deg from the
    vertical. The saddle also flattens fillet and rounding: see `radii` for the least radii.
    Raises InputError for a value out of its range, and for values that do not fit together.
    """

    dome_distance: float = _dimension(304.0, "above 0", "between the centres of the domes [mm]")
    dome_radius: float = _dimension(65.0, "above 0", "of a dome's outline [mm]")
    waist: float = _dimension(55.0, "above 0", "half width of the outline at the middle [mm]")
    depth: float = _dimension(60.0, "above 0", "height of the domes [mm]")
    wall_angle: float = _dimension(
        10.0, "at least 0 and below 90", "of the wall from the vertical [deg]", high=90, closed=True
    )
    top_radius: float = _dimension(40.0, "above 0", "of the rounding between top and wall [mm]")
    entry_radius: float = _dimension(15.0, "above 0", "of the fillet between wall and flange [mm]")
    saddle_depth: float = _dimension(15.0, "at least 0", "by which the middle lies lower [mm]", closed=True)
    saddle_length: float = _dimension(304.0, "above 0", "over which the top is lowered [mm]")
    # what follows from them; each dome has its own, ClassVar only says that they are no fields
    _waist_curvature: ClassVar[float]
    _wall: ClassVar[np.ndarray]
    _up: ClassVar[np.ndarray]
    _top_centre: ClassVar[np.ndarray]
    _entry_centre: ClassVar[np.ndarray]

    def __post_init__(self) -> None:
        for each in fields(self):
            object.__setattr__(self, each.name, _number(each.name, getattr(self, each.name), **each.metadata["limits"]))
        c, R, w, angle = self.dome_distance / 2, self.dome_radius, self.waist, math.radians(self.wall_angle)
        least = math.sqrt(max(0.0, R * R - c * c))  # half width at the middle where the circles overlap
        self._fits(
            "waist", least < w <= R, f"above {least:g} and at most dome_radius = {R:g}, with dome_distance {2 * c:g}"
        )
        self._fits("saddle_depth", self.saddle_depth < self.depth, f"below depth = {self.depth:g}")
        tangent = math.tan(math.pi / 4 - angle / 2)
        most = self.depth / (1 - math.sin(angle))
        self._fits(
            "top_radius + entry_radius",
            self.top_radius + self.entry_radius <= most,
            f"at most {most:g}, so that they fit between top and flange with depth {self.depth:g} and wall_angle "
            f"{self.wall_angle:g}",
        )
        slope = self.depth * math.tan(angle)
        most = math.degrees(math.atan(w / self.depth))
        self._fits(
            "wall_angle",
            slope < w,
            f"below {most:g}, as the walls of depth {self.depth:g} must not meet within waist {w:g}",
        )
        most = (w - slope) / tangent
        self._fits(
            "top_radius",
            self.top_radius < most,
            f"below {most:g}, so that it leaves a flat top within waist {w:g} at wall_angle {self.wall_angle:g}",
        )
        waist_curvature = 2 * (R - w) / (c * c + w * w - R * R)
        foot = self.entry_radius * tangent
        self._fits(
            "waist",
            waist_curvature * foot < 1,
            f"larger, as the fillet's foot, {foot:g} outside, must not reach the centre of the arc of radius "
            f"{1 / waist_curvature if waist_curvature else math.inf:g} there",
        )
        wall = np.array([math.cos(angle), math.sin(angle)])  # normal of the wall in the (d, z) plane
        derived = {
            "_waist_curvature": waist_curvature,
            "_wall": wall,
            "_up": np.array([-wall[1], wall[0]]),
            "_top_centre": np.array([-slope - self.top_radius * tangent, self.depth - self.top_radius]),
            "_entry_centre": np.array([foot, self.entry_radius]),
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    def _fits(self, names, fits, allowed):
        if not fits:
            value = sum(getattr(self, name) for name in names.split(" + "))
            raise InputError(f"{names} is {value:g}, but it must be {allowed}")

    def plan(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Signed distance (n,) [mm] to the outline, its gradient (2, n), curvature (n,) [1/mm] of its level lines."""
        c, w, k = self.dome_distance / 2, self.waist, self._waist_curvature
        u, v = abs(x), abs(y)
        arc = u * (1 + k * w) < c * (1 + k * (w - v))
        # Written with the arcs' curvature, which may be 0, and not with their radius.
        q = np.hypot(k * u, 1 - k * (v - w))
        q = np.where(arc, q, 1)
        r = np.maximum(np.hypot(u - c, v), 1e-9)
        d = np.where(arc, (2 * (v - w) - k * (u * u + (v - w) ** 2)) / (1 + q), r - self.dome_radius)
        dx = np.where(arc, -k * u / q, (u - c) / r)
        dy = np.where(arc, (1 - k * (v - w)) / q, v / r)
        return d, np.array([np.where(x < 0, -dx, dx), np.where(y < 0, -dy, dy)]), np.where(arc, -k / q, 1 / r)

    def height(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """H (n,) and its first and second derivative at x (n,) [mm]; H is 1 beyond the saddle."""
        half = self.saddle_length / 2
        s = np.clip(x / half, -1, 1)
        t, drop = 1 - s * s, self.saddle_depth / self.depth
        return 1 - drop * t**3, 6 * drop / half * s * t * t, 6 * drop / half**2 * t * (1 - 5 * s * s)

    def _profile(self, d, z):
        """Signed distance (n,) to the profile, its gradient (2, n) by d and z, curvature (n,) of its level lines."""
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
                np.where((along >= lower) & (along <= upper), d * self._wall[0] + z * self._wall[1], none),
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
        # |F| is at most the distance times the largest gradient between the point and the surface, at any x.
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
        """Arc lengths (4,) [mm] along the profile where rounding, wall, fillet and flange begin, from the outline
        inwards as in the plan on the flat top."""
        turn = math.pi / 2 - math.radians(self.wall_angle)
        wall = (self._top_centre - self._entry_centre) @ self._up
        return self._top_centre[0] + np.cumsum([0, self.top_radius * turn, wall, self.entry_radius * turn])

    def lift(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Points (n, 3) [mm] on the surface from their places x, y (n,) [mm] in the developed plan.

        There the arc length of the profile takes the place of the distance from the outline, so that walls are not seen
        edge-on; flat top and plan coincide.
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
            where, [self.depth, z1 + self.top_radius * np.cos(a), foot[:, 1], z2 - self.entry_radius * np.cos(b)], 0.0
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
        k11, k22, k12 = _in_frame(_tangents(gradient / size), hessian) / size
        spread = np.hypot((k11 - k22) / 2, k12)
        return 1 / float(((k11 + k22) / 2 + spread).max()), 1 / float((spread - (k11 + k22) / 2).max())


class TriangulatedSurface(Surface):
    """Triangles (m, 3) over points (n, 3) [mm], closed or open; normals point to the side from which the first triangle
    (of each connected part) turns anticlockwise, and the others are turned to agree with it.

    The gap is the distance to the closest point of the triangles, signed by the normal there, which is interpolated
    from averages at the vertices; the curvature is the gradient of that interpolation. With edges of length h on a
    smooth surface the errors are h^2 in the gap, h in the normal (h^2 on it) and, on a sphere, h in the curvature. At
    seams where the curvature jumps, as on the double dome, it is wrong by up to that jump, h^(1/2) r.m.s. The slope of
    the gap jumps between triangles, so that the normal is its gradient only up to an order of h. Normals are rounded
    over sharp edges, positions are not.
    The search is exact: candidates come from k-d trees of triangles of about one size each.
    Raises InputError if no triangle has an area, or for points or triangles of a wrong shape or not finite.
    """

    def __init__(self, points: ArrayLike, triangles: ArrayLike) -> None:
        x, cells = np.asarray(points, dtype=float), np.asarray(triangles)
        if x.ndim != 2 or x.shape[1] != 3 or not np.isfinite(x).all():
            raise InputError(f"points of the surface have the shape {x.shape}, but it must be (n, 3), all finite")
        if cells.ndim != 2 or cells.shape[1] != 3 or cells.dtype.kind not in "iu":
            raise InputError(f"triangles have the shape {cells.shape}, but it must be (m, 3), of integers")
        if cells.size and not 0 <= cells.min() <= cells.max() < len(x):
            raise InputError(f"triangles name points {cells.min()} to {cells.max()}, but there are {len(x)}")
        # STL repeats its points
        x, number = np.unique(x, axis=0, return_inverse=True)
        cells = number.reshape(-1)[cells]
        corners = x[cells]
        edges = np.roll(corners, -1, 1) - corners
        longest = (edges**2).sum(2).max(1, initial=0)
        flat = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) <= 1e-10 * longest
        if flat.all():
            raise InputError("the surface has no triangle with an area, but it must have one at least")
        used, number = np.unique(_agreeing(x, cells[~flat]), return_inverse=True)
        self.points: np.ndarray = x[used]
        self.triangles: np.ndarray = number.reshape(-1, 3)
        self._corners = corners = self.points[self.triangles]
        edges = np.roll(corners, -1, 1) - corners
        square = (edges**2).sum(2)
        area = np.cross(edges[:, 0], edges[:, 1])
        # gradients of the barycentric coordinates
        self._slopes = np.cross(area[:, None], np.roll(edges, -1, 1)) / (area**2).sum(1)[:, None, None]
        # Weights that give a polyhedron in a sphere the normals of the sphere: N. Max, J. Graphics Tools 4 (1999).
        weights = 1 / (square * np.roll(square, 1, 1))
        normals: np.ndarray = np.column_stack(
            [
                np.bincount(self.triangles.ravel(), (weights * area[:, k, None]).ravel(), len(self.points))
                for k in range(3)
            ]
        )
        self.normals = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
        self._turn = np.einsum("mci,mcj->ijm", self.normals[self.triangles], self._slopes)
        self._longest = math.sqrt(square.max())
        self._vertices = cKDTree(self.points)
        self._one_of = np.empty(len(self.points), dtype=np.int64)  # a triangle at each vertex
        self._one_of[self.triangles.ravel()] = np.repeat(np.arange(len(self.triangles)), 3)
        centre = corners.mean(1)
        radius = np.linalg.norm(corners - centre[:, None], axis=2).max(1)
        size = np.floor(np.log2(radius / radius.max()))
        self._by_size = []
        for each in np.unique(size)[::-1]:
            members = np.flatnonzero(size == each)
            self._by_size.append((cKDTree(centre[members]), members, radius[members].max() * (1 + 1e-9)))

    def _mesh(self, low, high, size):
        return self.points, self.normals, self.triangles

    @classmethod
    def read(cls, path: Path | str) -> Self:
        """The surface in a file [mm]: STL, VTP, MSH, or any other that meshio or PyVista reads; quadrilaterals are cut.

        Raises InputError if it cannot be read or has no triangle.
        """
        path = Path(path)
        if not path.is_file():
            raise InputError(f"surface file {path} does not exist or is not a file; allowed is STL, VTP, MSH")
        try:
            points, triangles = _read_triangles(path)
        except (Exception, SystemExit) as error:  # the readers raise whatever their parsing stumbles on, or exit
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"surface file {path} cannot be read ({reason}); allowed is STL, VTP, MSH") from None
        try:
            return cls(points, triangles)
        except InputError as error:
            raise InputError(f"surface file {path}: {error}") from None

    def _nearest(self, points, reach):
        distance, vertex = self._vertices.query(points)
        distance, vertex = np.atleast_1d(distance), np.atleast_1d(vertex)
        normal = self.normals[vertex]
        gap = np.copysign(np.maximum(distance - self._longest, 0), ((points - self.points[vertex]) * normal).sum(1))
        found = Nearest(gap, normal, np.zeros((len(points), 3, 3)))
        near = np.flatnonzero(distance - self._longest <= reach)
        triangle, weights = self._closest(points[near], distance[near], vertex[near])
        arm = points[near] - np.einsum("nc,nci->ni", weights, self._corners[triangle])
        normal = np.einsum("nc,nci->in", weights, self.normals[self.triangles[triangle]])
        size = np.maximum(np.linalg.norm(normal, axis=0), 1e-300)
        normal = normal / size
        gap = np.copysign(np.linalg.norm(arm, axis=1), (arm.T * normal).sum(0))
        turn = self._turn[:, :, triangle]
        tangents = _tangents(normal)
        shape = _in_frame(tangents, (turn + turn.swapaxes(0, 1)) / 2) / size
        found.gap[near], found.normal[near] = gap, normal.T
        found.curvature[near] = _hessian_of_gap(tangents, shape, gap)
        return found

    def _closest(self, points, distance, vertex):
        """Triangle and barycentric coordinates of the closest point, given the closest vertex and its distance."""
        distance, triangle = distance.copy(), self._one_of[vertex]
        weights = (self.triangles[triangle] == vertex[:, None]).astype(float)
        for tree, members, radius in self._by_size:
            rows, first, last = np.arange(len(points)), 0, 4
            while len(rows) and first < len(members):
                last = min(last, len(members))
                bound = distance[rows].max() + radius
                to_centre, near = tree.query(points[rows], range(first + 1, last + 1), distance_upper_bound=bound)
                # no point of a triangle is nearer than its centre less its radius
                maybe = to_centre < (distance[rows] + radius)[:, None]
                row, column = np.nonzero(maybe)
                candidates = members[near[row, column]]
                coordinates, square = self._on_triangle(points[rows[row]], candidates)
                squares = np.full(maybe.shape, np.inf)
                squares[row, column] = square
                place = np.zeros(maybe.shape, dtype=np.int64)
                place[row, column] = np.arange(len(row))
                best = squares.argmin(1)[:, None]
                square, place = (np.take_along_axis(a, best, 1)[:, 0] for a in (squares, place))
                closer = square < distance[rows] ** 2
                at, place = rows[closer], place[closer]
                distance[at], triangle[at], weights[at] = np.sqrt(square[closer]), candidates[place], coordinates[place]
                rows = rows[maybe[:, -1]]
                first, last = last, 4 * last
        return triangle, weights

    def _on_triangle(self, points, triangle):
        """Barycentric coordinates (n, 3) of the closest points on one triangle each, and the squared distances (n,)."""
        corners = self._corners[triangle]
        weights = np.einsum("nci,ni->nc", self._slopes[triangle], points - corners.mean(1)) + 1 / 3
        outside = np.flatnonzero(weights.min(1, initial=np.inf) < 0)
        if len(outside):
            p, c = points[outside], corners[outside]
            least = np.full(len(outside), np.inf)
            for i, j in ((0, 1), (1, 2), (2, 0)):
                edge, arm = c[:, j] - c[:, i], p - c[:, i]
                s = np.clip((arm * edge).sum(1) / (edge * edge).sum(1), 0, 1)
                square = ((arm - s[:, None] * edge) ** 2).sum(1)
                closer = np.flatnonzero(square < least)
                least[closer] = square[closer]
                at = outside[closer]
                weights[at], weights[at, i], weights[at, j] = 0, 1 - s[closer], s[closer]
        return weights, ((points - np.einsum("nc,nci->ni", weights, corners)) ** 2).sum(1)


def _agreeing(points, triangles):
    """The triangles, all turned the same way round as the first of their connected part."""
    sides = np.stack([triangles, np.roll(triangles, -1, 1)], 2).reshape(-1, 2)
    if len(np.unique(sides, axis=0)) == len(sides):
        return triangles  # no edge is passed twice in the same direction
    import pyvista

    mesh = pyvista.PolyData(points, np.column_stack([np.full(len(triangles), 3), triangles]).ravel())
    mesh = mesh.compute_normals(
        point_normals=False, consistent_normals=True, split_vertices=False, auto_orient_normals=False
    )
    return mesh.faces.reshape(-1, 4)[:, 1:]


def _read_triangles(path):
    """Points and triangles in a file; raises whatever its reader raises."""
    import meshio  # takes long to import

    if path.suffix.lower() in meshio.extension_to_filetypes:
        with redirect_stdout(None):  # its reader of .msh prints an empty line
            mesh = meshio.read(path)
        points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.points.shape[1])))
        parts = [np.empty((0, 3), dtype=np.int64)]
        for block in mesh.cells:
            if block.type.startswith("triangle"):
                parts.append(block.data[:, :3])
            elif block.type.startswith("quad"):
                parts += [block.data[:, :3], block.data[:, [0, 2, 3]]]
        return points, np.concatenate(parts).astype(np.int64)
    import pyvista

    mesh = pyvista.read(path)
    if isinstance(mesh, pyvista.MultiBlock):
        mesh = mesh.combine()
    mesh = (mesh if isinstance(mesh, pyvista.PolyData) else mesh.extract_geometry()).triangulate()
    return mesh.points, np.asarray(mesh.faces).reshape(-1, 4)[:, 1:]


class Offset(Surface):
    """`surface` moved along its normals by `distance` [mm], of either sign.

    Raises InputError if a radius of the surface would shrink to 0, where that is known.
    """

    def __init__(self, surface: Surface, distance: float) -> None:
        inside, outside = surface.radii
        allowed = f"above {-inside:g} and below {outside:g}, the radii of the surface"
        self.surface, self.distance = surface, _number("distance", distance, allowed, -inside, outside)
        self.radii = (inside + self.distance, outside - self.distance)

    def _nearest(self, points, reach):
        gap, normal, curvature = self.surface._nearest(points, reach + abs(self.distance))
        return Nearest(gap - self.distance, normal, curvature)

    def _mesh(self, low, high, size):
        room = abs(self.distance)
        points, normals, triangles = self.surface._mesh(low - room, high + room, size)
        return points + self.distance * normals, normals, triangles


class Reversed(Surface):
    """`surface` with the body on its other side: `Reversed(Offset(punch, clearance))` is the die of a punch."""

    def __init__(self, surface: Surface) -> None:
        self.surface, self.radii = surface, surface.radii[::-1]

    def _nearest(self, points, reach):
        return Nearest(*(-a for a in self.surface._nearest(points, reach)))

    def _mesh(self, low, high, size):
        points, normals, triangles = self.surface._mesh(low, high, size)
        return points, -normals, triangles[:, ::-1]


class Flipped(Surface):
    """`surface` upside down: mirrored in the plane z = 0, the normal still pointing out of the body."""

    def __init__(self, surface: Surface) -> None:
        self.surface, self.radii = surface, surface.radii

    def _nearest(self, points, reach):
        mirror = np.array([1.0, 1.0, -1.0])
        gap, normal, curvature = self.surface._nearest(points * mirror, reach)
        return Nearest(gap, normal * mirror, curvature * np.outer(mirror, mirror))

    def _mesh(self, low, high, size):
        mirror = np.array([1.0, 1.0, -1.0])
        low, high = low * mirror, high * mirror
        points, normals, triangles = self.surface._mesh(np.minimum(low, high), np.maximum(low, high), size)
        return points * mirror, normals * mirror, triangles[:, ::-1]


# (3,) at full load, to which it grows in proportion, or a function of the load factor
OfLoad = Callable[[float], ArrayLike]
Way = ArrayLike | OfLoad


class Tool:
    """A rigid body that moves without turning: along a path, or along a line by force.

    - name, surface: what to call it, and what bounds it
    - path: its displacement (3,) [mm] at full load, to which it grows in proportion, or a function of the load
    - force: if given, (3,) [N] at full load, or a function of the load to it, along one direction; the tool is moved on
      that line by `way` [mm], beyond the path, which its contact finds
    - displacement: (3,) [mm], where it is now; `at(load)` sets path and force

    Raises InputError for a path or force that does not give three finite numbers, or a force that turns.
    """

    def __init__(self, name: str, surface: Surface, path: Way = (0.0, 0.0, 0.0), force: Way | None = None) -> None:
        self.name, self.surface = name, surface
        self.path: OfLoad = _growing(f"path of {name}", path)
        self.force: OfLoad | Literal[False] = force is not None and _growing(f"force of {name}", force)
        self.way, self.push = 0.0, 0.0
        self.direction = _vector(f"force of {name} at full load", self.force(1.0), unit=True) if self.force else np.zeros(3)  # fmt: skip
        self.at(0.0)

    def at(self, load: float) -> None:
        """Move it along its path to where it is at this load, and set its force."""
        self._place = _vector(f"path of {self.name} at load {load:g}", self.path(load))
        if self.force:
            force = _vector(f"force of {self.name} at load {load:g}", self.force(load))
            self.push = float(force @ self.direction)
            if np.linalg.norm(force - self.push * self.direction) > 1e-9 * abs(force).max() or self.push < 0:
                raise InputError(
                    f"force of {self.name} at load {load:g} is {force.tolist()}, but it must be along that at full load"
                )

    @property
    def displacement(self) -> np.ndarray:
        """Where it is now, from where its surface was given, (3,) [mm]."""
        return self._place + self.way * self.direction

    def evaluate(self, points: ArrayLike, reach: float = math.inf) -> Nearest:
        """As `Surface.evaluate`, where the tool is now."""
        return self.surface.evaluate(_points(points) - self.displacement, reach)


def _growing(name: str, value: Way) -> OfLoad:
    """`value` itself if it is a function of the load, else one that grows to that vector."""
    if callable(value):
        return value
    full = _vector(name, value)
    return lambda load: load * full
