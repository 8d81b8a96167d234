"""Base classes of rigid surfaces: signed distance, normal and curvature at many points at once;
surfaces moved or turned.

A surface bounds a body; its normal points out of it, and the gap (signed distance) is positive
outside.
"""

from __future__ import annotations

import math
from copy import copy
from reprlib import repr as shown
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.errors import InputError
from ..runtime.rules import Rule
from .values import checked_points

# unit vectors (26, 3), one of which is less than 30 deg from any direction
AROUND = np.stack(np.meshgrid(*3 * [[-1.0, 0.0, 1.0]]), -1).reshape(-1, 3)
AROUND = AROUND[AROUND.any(1)] / np.linalg.norm(AROUND[AROUND.any(1)], axis=1, keepdims=True)


class Nearest(NamedTuple):
    """Surface seen from n points: gap (n,) [mm], its gradient normal (n, 3) and Hessian curvature
    (n, 3, 3) [1/mm]."""

    gap: np.ndarray
    normal: np.ndarray
    curvature: np.ndarray


class Surface:
    """Base of all surfaces. An own one gives `nearest(points, reach)`, and `radii` where it is
    curved:

        class Floor(Surface):
            def nearest(self, points, reach):
                normal = np.tile([0.0, 0.0, 1.0], (len(points), 1))
                return Nearest(points[:, 2].copy(), normal, np.zeros((len(points), 3, 3)))

    One that is known by an equation F(x) = 0 is less work as an `ImplicitSurface`. The gap must be
    the distance, the normal its gradient and the curvature its Hessian: forces and stiffness of
    contact are made of them. `Reversed`, `Offset`, `Flipped` and `Tool` take any surface.
    """

    radii: tuple[float, float] = (math.inf, math.inf)
    """Least radius of curvature [mm] as seen from inside the body and from outside: nearer than
    that to the surface the nearest point is unique, unless another part of the surface is as near.
    Infinite where unknown."""

    def evaluate(self, points: ArrayLike, reach: float = math.inf) -> Nearest:
        """Gap, normal and curvature at `points` (n, 3) [mm]; rows are NaN where a point is not
        finite.

        reach [mm]: where |gap| surely exceeds it, the gap need only do so too, with the right sign,
        and normal and curvature need only be finite; so far points cost little. Raises InputError
        for points of another shape and for a reach below 0.
        """
        x = checked_points(points)
        if not reach >= 0:
            raise InputError(f"reach is {reach}; allowed is at least 0")
        finite = np.isfinite(x).all(1)
        if finite.all():
            return self.nearest(x, reach)
        found = Nearest(*(np.full((len(x), *shape), np.nan) for shape in ((), (3,), (3, 3))))
        for whole, part in zip(found, self.nearest(x[finite], reach)):
            whole[finite] = part
        return found

    def mesh(
        self, low: ArrayLike, high: ArrayLike, size: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (n, 3) [mm], unit normals (n, 3) and triangles (m, 3), anticlockwise as the
        normals see them, to draw what lies between the corners low and high (3,) [mm]; edges are
        about `size` [mm] long. A surface of triangles gives these, all of them."""
        import pyvista

        low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)

        cells = np.ceil((high - low) / size).astype(int)
        grid = pyvista.ImageData(dimensions=cells + 1, spacing=(high - low) / cells, origin=low)
        # fit the cache
        parts = np.array_split(np.asarray(grid.points, dtype=float), 1 + grid.n_points // 20000)
        gap = np.concatenate([self.evaluate(part, 2 * size).gap for part in parts])
        contour = grid.contour([0.0], gap, compute_normals=False, method="flying_edges")
        points, triangles = (
            np.array(contour.points, dtype=float),
            np.array(contour.faces).reshape(-1, 4)[:, 1:],
        )
        for _ in range(2):  # on to the surface; the second finds what is left
            gap, normals, _ = self.evaluate(points, 2 * size)
            points = points - gap[:, None] * normals
        # where the gap jumps or there is no nearest point, there is no surface
        used, triangles = np.unique(
            triangles[(abs(gap) < 0.1 * size)[triangles].all(1)], return_inverse=True
        )
        points, normals, triangles = points[used], normals[used], triangles.reshape(-1, 3)
        p, q, r = points[triangles].swapaxes(0, 1)
        turned = (np.cross(q - p, r - p) * normals[triangles[:, 0]]).sum(1) < 0
        triangles[turned] = triangles[turned, ::-1]
        return points, normals, triangles

    def from_behind(self) -> Surface:
        """Itself as `Reversed` wants it: an open surface is open from both sides."""
        return self

    def given(self) -> dict[str, Any]:
        """What tells it from another of its kind, by name: a checkpoint must agree in it."""
        return {name: value for name, value in vars(self).items() if not name.startswith("_")}

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As `evaluate`, at points (n, 3) [mm] that are finite; every surface gives it."""
        raise InputError(
            f"surface {type(self).__name__} has no `nearest`; allowed is one that gives it, or an "
            "`ImplicitSurface`"
        )


def radii_of(surface: Surface) -> tuple[float, float]:
    """`radii` of a surface; InputError if they are no two numbers above 0."""
    try:
        inside, outside = (float(radius) for radius in surface.radii)
    except (TypeError, ValueError):
        inside = outside = math.nan
    if not (inside > 0 and outside > 0):
        raise InputError(
            f"`radii` of surface {type(surface).__name__} are {shown(surface.radii)}; allowed are "
            "two numbers above 0, the least radii from inside and from outside [mm]"
        )
    return inside, outside


def tangent_vectors(normal: np.ndarray) -> np.ndarray:
    """Two unit vectors (2, 3, n) that make a right-handed frame with unit normals (3, n)."""
    x, y, z = normal
    s = np.copysign(1.0, z)
    a = -1 / (s + z)
    b = x * y * a
    return np.array([[1 + s * x * x * a, s * b, -s * x], [b, s + y * y * a, -y]])


def in_frame(tangents: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """The entries 11, 22, 12 (3, n) of symmetric matrices (3, 3, n) in a frame of tangents (2, 3,
    n)."""
    along = np.einsum("ijn,ajn->ain", matrix, tangents)
    return np.array([(tangents[a] * along[b]).sum(0) for a, b in ((0, 0), (1, 1), (0, 1))])


def _hessian_of_gap(tangents, shape, gap):
    """K (I + gap K)^-1 as (n, 3, 3), of shape operators K given by their entries 11, 22, 12 (3, n)
    in the frame."""
    k11, k22, k12 = shape
    det = k11 * k22 - k12 * k12
    scale = 1 + gap * (k11 + k22) + gap * gap * det
    scale = np.where(abs(scale) < 1e-9, 1e-9, scale)  # a centre of curvature
    # Cayley-Hamilton: K adj(I + gap K) = K + gap det(K) I
    m11, m22, m12 = (k11 + gap * det) / scale, (k22 + gap * det) / scale, k12 / scale
    (s, t) = tangents
    half = np.einsum("in,jn->nij", m11 * s + m12 * t, s) + np.einsum(
        "in,jn->nij", m12 * s + m22 * t, t
    )
    return (half + half.swapaxes(1, 2)) / 2


class ImplicitSurface(Surface):
    """Surface F(x) = 0 with F < 0 in the body; the nearest point by Newton's method on its
    Lagrangian.

    An own one gives `implicit` and `radii`; `bound`, and `value` where F alone is cheaper, save
    time:

        class Wave(ImplicitSurface):
            radii = (25.0, 25.0)

            def implicit(self, x):
                zero, curve = 0 * x[0], np.sin(x[0] / 5) / 25
                gradient = np.array([-np.cos(x[0] / 5) / 5, zero, zero + 1])
                hessian = np.array([[curve, zero, zero], [zero] * 3, [zero] * 3])
                return x[2] - 25 * curve, gradient, hessian

            def bound(self, F, x):
                return abs(F) / 1.02  # by the gradient's largest length

    Gap, normal and curvature are exact at the point found, whose distance from the surface and from
    the foot of the normal is below 1e-11 mm. None may be found further away than `radii`, where it
    can also be a point that is not the nearest of all. Rows are then NaN, unless F has one sign all
    around at twice the reach: the surface is beyond it.
    """

    def value(self, x: np.ndarray) -> np.ndarray:
        """F (n,) at x (3, n) [mm]."""
        return self.derivatives(x)[0]

    def implicit(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F (n,), its gradient (3, n) and Hessian (3, 3, n) at x (3, n) [mm]."""
        raise InputError(
            f"surface {type(self).__name__} has no `implicit`; allowed is one that gives F, its "
            "gradient and its Hessian at points (3, n)"
        )

    def bound(self, F: np.ndarray, x: np.ndarray) -> np.ndarray:
        """What the distance from x (3, n) [mm], where `value` is F (n,), surely is not below, (n,)
        [mm]. Points beyond the reach are then not projected; 0 projects all."""
        return np.zeros_like(F)

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As in `Surface`."""
        x = np.ascontiguousarray(points.T)
        F = self._fitting("`value`", self.value(x), x.shape[1:])
        bound = self._fitting("`bound`", self.bound(F, x), x.shape[1:])
        found = Nearest(
            np.copysign(bound, F),
            np.tile([0.0, 0.0, 1.0], (len(points), 1)),
            np.zeros((len(points), 3, 3)),
        )
        near = np.flatnonzero(bound <= reach)
        # blocks that stay in the cache
        for part in np.array_split(near, max(1, len(near) // 4096)):
            self._project(x[:, part], part, found)
        lost = near[np.isnan(found.gap[near])]
        if len(lost) and 0 < reach < math.inf:
            self._tell_far(x[:, lost], F[lost], lost, reach, found)
        return found

    def _tell_far(self, x, F, rows, reach, found):
        """Put a gap beyond the reach into those `rows` of `found`, of points x (3, n) where no
        nearest point was found, around which F does not change its sign."""
        around = (x[:, :, None] + 2 * reach * AROUND.T[:, None]).reshape(3, -1)
        far = (self.value(around).reshape(len(rows), -1) * F[:, None] > 0).all(1)
        at = rows[far]
        found.gap[at] = np.copysign(1.01 * reach, F[far])
        found.normal[at], found.curvature[at] = (0.0, 0.0, 1.0), 0.0

    def derivatives(self, x: np.ndarray) -> list[np.ndarray]:
        """What `implicit` gives at x (3, n); InputError if it is not what it must be."""
        given, n = self.implicit(x), x.shape[1]
        if not (isinstance(given, (tuple, list)) and len(given) == 3):
            found = f"{len(given)} arrays" if isinstance(given, (tuple, list)) else "no tuple"
            raise InputError(
                f"`implicit` of surface {type(self).__name__} gives {found}; allowed are three: F, "
                "its gradient and its Hessian"
            )
        shapes = {"F": (n,), "gradient": (3, n), "Hessian": (3, 3, n)}
        return [self._fitting(name, each, shapes[name]) for name, each in zip(shapes, given)]

    def _fitting(self, name, given, shape):
        """`given` as an array of this shape; InputError, which calls it `name`, if it is none."""
        try:
            array = np.asarray(given, float)
        except (TypeError, ValueError):
            array = None
        # what is the same at all points may be given once
        if array is not None and array.shape in (shape, (*shape[:-1], 1)):
            return np.broadcast_to(array, shape)
        found = "no array of numbers" if array is None else f"of shape {array.shape}"
        allowed = "(n,)" if len(shape) == 1 else f"({', '.join(map(str, shape[:-1]))}, n)"
        raise InputError(
            f"{name} of surface {type(self).__name__} is {found} at n = {shape[-1]} points; "
            f"allowed is {allowed}"
        )

    def _project(self, x, rows, found):
        """Put what belongs to the nearest points of x (3, n) into `rows` of `found`."""
        for target in found:
            target[rows] = np.nan
        F, gradient, _ = self.derivatives(x)
        base, step = x, -F * gradient / (gradient * gradient).sum(0)
        factor, merit = np.ones(len(rows)), np.full(len(rows), np.inf)
        tolerance = 1e-11 + 1e-14 * abs(x).max(0, initial=0)
        for iteration in range(100):
            if not len(rows):
                return
            trial = base + factor * step
            F, gradient, hessian = self.derivatives(trial)
            size = np.sqrt((gradient * gradient).sum(0))
            normal = gradient / size
            tangents = tangent_vectors(normal)
            arm = x - trial
            gap = (arm * normal).sum(0)
            aside = np.einsum("ajn,jn->an", tangents, arm)
            shape = in_frame(tangents, hessian) / size
            new = (aside * aside).sum(0) + (F / size) ** 2
            done = new <= tolerance**2
            if done.any():
                at = rows[done]
                found.gap[at] = gap[done]
                found.normal[at] = normal[:, done].T
                found.curvature[at] = _hessian_of_gap(
                    tangents[:, :, done], shape[:, done], gap[done]
                )
            # Beyond a centre of curvature the distance has no minimum here, so the model is kept
            # convex.
            a, b, c = 1 + gap * shape[0], 1 + gap * shape[1], gap * shape[2]
            lift = np.maximum(0, 0.1 - (a + b) / 2 + np.hypot((a - b) / 2, c))
            a, b = a + lift, b + lift
            s, t = np.array([b * aside[0] - c * aside[1], a * aside[1] - c * aside[0]]) / (
                a * b - c * c
            )
            newton = -F / size * normal + s * tangents[0] + t * tangents[1]
            # A step that does not help is halved; one of an eighth is taken all the same, to get
            # over a seam. Shorter steps later on end most of the cycles that there are far inside
            # the body.
            taken = (new < merit) | (factor < 0.2)
            base, step = np.where(taken, trial, base), np.where(taken, newton, step)
            merit, factor = (
                np.where(taken, new, merit),
                np.where(taken, 1.0 if iteration < 20 else 0.6, factor / 2),
            )
            if done.any():
                on = ~done
                x, base, step, rows = x[:, on], base[:, on], step[:, on], rows[on]
                merit, factor, tolerance = merit[on], factor[on], tolerance[on]


class Offset(Surface):
    """`surface` moved along its normals by `distance` [mm], of either sign.

    Raises InputError if a radius of the surface would shrink to 0, where that is known.
    """

    def __init__(self, surface: Surface, distance: float) -> None:
        inside, outside = radii_of(surface)
        allowed = f"a number above {-inside:g} and below {outside:g}, the radii of the surface"
        name = f"distance of the offset of surface {type(surface).__name__}"
        self.surface = surface
        self.distance = Rule(allowed, lambda v: -inside < v < outside).check(name, distance)
        self.radii = (inside + self.distance, outside - self.distance)

    def from_behind(self) -> Surface:
        """As in `Surface`."""
        seen = copy(self)
        seen.surface = self.surface.from_behind()
        return seen

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As in `Surface`."""
        gap, normal, curvature = self.surface.nearest(points, reach + abs(self.distance))
        return Nearest(gap - self.distance, normal, curvature)

    def mesh(
        self, low: ArrayLike, high: ArrayLike, size: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As in `Surface`."""
        room = abs(self.distance)
        low, high = np.subtract(low, room), np.add(high, room)
        points, normals, triangles = self.surface.mesh(low, high, size)
        return points + self.distance * normals, normals, triangles


class Reversed(Surface):
    """`surface` with the body on its other side: `Reversed(Offset(punch, clearance))` is the die of
    a punch."""

    def __init__(self, surface: Surface) -> None:
        self.surface, self.radii = surface.from_behind(), radii_of(surface)[::-1]

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As in `Surface`."""
        return Nearest(*(-a for a in self.surface.nearest(points, reach)))

    def mesh(
        self, low: ArrayLike, high: ArrayLike, size: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As in `Surface`."""
        points, normals, triangles = self.surface.mesh(low, high, size)
        return points, -normals, triangles[:, ::-1]


class Flipped(Surface):
    """`surface` upside down: mirrored in the plane z = 0, the normal still pointing out of the
    body."""

    def __init__(self, surface: Surface) -> None:
        self.surface, self.radii = surface, radii_of(surface)

    def from_behind(self) -> Surface:
        """As in `Surface`."""
        seen = copy(self)
        seen.surface = self.surface.from_behind()
        return seen

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As in `Surface`."""
        mirror = np.array([1.0, 1.0, -1.0])
        gap, normal, curvature = self.surface.nearest(points * mirror, reach)
        return Nearest(gap, normal * mirror, curvature * np.outer(mirror, mirror))

    def mesh(
        self, low: ArrayLike, high: ArrayLike, size: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As in `Surface`."""
        mirror = np.array([1.0, 1.0, -1.0])
        ends = np.array([low, high]) * mirror
        points, normals, triangles = self.surface.mesh(ends.min(0), ends.max(0), size)
        return points * mirror, normals * mirror, triangles[:, ::-1]
