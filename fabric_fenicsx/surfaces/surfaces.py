"""Base class of rigid surfaces, and surfaces that are moved, turned or seen from behind."""

from __future__ import annotations

import math
from copy import copy
from reprlib import repr as repr_short
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ..core.errors import InputError
from ..core.rules import FINITE, Rule
from ..core.timing import phase

Drawn = tuple[np.ndarray, np.ndarray, np.ndarray]  # points, normals and triangles
BLOCK = 4  # points of a grid along the sides of blocks that are looked at first


class Nearest(NamedTuple):
    """At n points the gap (n,) [mm] to a surface, positive outside the body, its gradient `normal`
    (n, 3), which points out of the body, and its Hessian `curvature` (n, 3, 3) [1/mm].

    Examples
    --------
    >>> near = ff.Sphere(10).evaluate([[0, 0, 12]])
    >>> near.gap, near.normal
    (array([2.]), array([[0., 0., 1.]]))
    """

    gap: np.ndarray
    normal: np.ndarray
    curvature: np.ndarray


def checked_vector(
    name: str, value: ArrayLike, unit: bool = False, size: str = "three"
) -> np.ndarray:
    """`value` as an array of a `size` in words, "two", "three" or "two or three" numbers, of length
    1 if `unit`; raises InputError for any other."""
    try:
        vector = np.array([FINITE.check("", each) for each in iter(value)])  # type: ignore
    except (TypeError, InputError):
        vector = np.empty(0)
    if {2: "two", 3: "three"}.get(len(vector), "none") not in size or (unit and not vector.any()):
        besides = ", not all 0" if unit else ""
        shown = repr_short(value.tolist() if isinstance(value, np.ndarray) else value)
        raise InputError(f"{name} is {shown}; expected {size} finite numbers{besides}")
    if not unit:
        return vector
    vector /= abs(vector).max()  # so that its square neither overflows nor vanishes
    return vector / np.linalg.norm(vector)


def checked_points(points: ArrayLike) -> np.ndarray:
    """`points` as an array of shape (n, 3); raises InputError for any other."""
    x = np.asarray(points, float)
    if x.ndim != 2 or x.shape[1] != 3:
        raise InputError(f"points have the shape {x.shape}; expected (n, 3)")
    return x


class Surface:
    """Base of all surfaces; a subclass defines `nearest(points, reach)`, and `radii` if curved.

    For an equation F(x) = 0, `ImplicitSurface` is simpler. The gap must be the distance, the normal
    its gradient and the curvature its Hessian: forces and stiffness of contact are computed from
    them. `Reversed`, `Offset`, `Flipped`, `Turned` and `Tool` accept any surface.

    Examples
    --------
    >>> class Floor(ff.Surface):
    ...     def nearest(self, points, reach):
    ...         normal = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    ...         return ff.Nearest(points[:, 2].copy(), normal, np.zeros((len(points), 3, 3)))
    >>> ff.Reversed(Floor()).evaluate([[0, 0, 3]]).gap
    array([-3.])
    """

    radii: tuple[float, float] = (math.inf, math.inf)
    """Least radius of curvature [mm] as seen from inside the body and from outside: nearer than
    that to the surface the nearest point is unique, unless another part of the surface is as near.
    Infinite where unknown."""

    def evaluate(self, points: ArrayLike, reach: float = math.inf) -> Nearest:
        """Gap, normal and curvature at points (n, 3) [mm]; rows are NaN where one is not finite.
        Where |gap| surely exceeds the reach [mm], the gap need only do so too, with the right sign,
        and normal and curvature need only be finite; so far points cost little."""
        x = checked_points(points)
        finite = np.isfinite(x).all(1)
        near = self.nearest(x if finite.all() else x[finite], reach)
        if finite.all():
            return near
        feet = Nearest(*(np.full((len(x), *part.shape[1:]), np.nan) for part in near))
        for whole, part in zip(feet, near):
            whole[finite] = part
        return feet

    def mesh(self, low: ArrayLike, high: ArrayLike, size: float) -> Drawn:
        """Points (n, 3) [mm], unit normals (n, 3) and triangles (m, 3), anticlockwise as the
        normals see them, to draw what lies between the corners low and high (3,) [mm]; edges are
        about `size` [mm] long. A surface of triangles gives these, all of them."""
        with phase("imports"):
            import pyvista

        low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        cells = np.ceil((high - low) / size).astype(int)
        grid = pyvista.ImageData(dimensions=cells + 1, spacing=(high - low) / cells, origin=low)
        gap = self._gaps_on(np.asarray(grid.points, dtype=float), cells + 1, 2 * size)
        contour = grid.contour([0.0], gap, compute_normals=False, method="flying_edges")
        points = np.array(contour.points, dtype=float)
        triangles = np.array(contour.faces).reshape(-1, 4)[:, 1:]
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

    def _gaps_on(self, points, counts, reach):
        """Gaps at points of a grid, `counts` along its axes, exact within the reach."""
        # a gap changes by no more than the way: far blocks have that of their middle
        blocks = np.indices(counts) // BLOCK
        number = np.ravel_multi_index(tuple(blocks), tuple(-(-counts // BLOCK))).ravel("F")
        size = np.bincount(number)
        middles = np.column_stack([np.bincount(number, x) / size for x in points.T])
        farthest = reach + np.sqrt(((points - middles[number]) ** 2).sum(1).max())
        gap = self.evaluate(middles, farthest).gap[number]
        near = np.flatnonzero(~(abs(gap) > farthest))
        for part in np.array_split(near, 1 + len(near) // 20000):  # which fit the cache
            gap[part] = self.evaluate(points[part], reach).gap
        return gap

    def from_behind(self) -> Surface:
        """Itself as `Reversed` wants it: an open surface is open from both sides."""
        return self

    def fingerprint(self) -> dict[str, ArrayLike]:
        """Public attributes, in which a checkpoint must agree."""
        return {name: value for name, value in vars(self).items() if not name.startswith("_")}

    def __eq__(self, other: object) -> bool:
        """Equality of kind and numbers."""
        if type(self) is not type(other):
            return NotImplemented
        mine, others = self.fingerprint(), other.fingerprint()
        same = (np.array_equal(mine[name], others[name]) for name in mine.keys() & others.keys())
        return mine.keys() == others.keys() and all(same)

    def __hash__(self) -> int:
        return hash(type(self))

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As `evaluate`, at points (n, 3) [mm] that are finite; every surface gives it."""
        raise NotImplementedError


class _Changed(Surface):
    """Base of what is made of another `surface`."""

    surface: Surface

    def from_behind(self) -> Surface:
        seen = copy(self)
        seen.surface = self.surface.from_behind()
        return seen


def innermost(surface: Surface) -> Surface:
    """The surface that others are made of."""
    while isinstance(surface, _Changed):
        surface = surface.surface
    return surface


class Offset(_Changed):
    """A `surface` moved along its normals by a `distance` out of the body, or into it if negative
    [mm]. Raises InputError if a radius of it would shrink to 0, where that is known.

    Examples
    --------
    >>> ff.Offset(ff.Sphere(10), 2).evaluate([[0, 0, 15]]).gap
    array([3.])
    """

    def __init__(self, surface: Surface, distance: float) -> None:
        inside, outside = surface.radii
        allowed = f"a number above {-inside:g} and below {outside:g}, the radii of the surface"
        name = f"distance of the offset of surface {type(surface).__name__}"
        self.surface = surface
        self.distance = Rule(allowed, lambda v: -inside < v < outside).check(name, distance)
        self.radii = (inside + self.distance, outside - self.distance)

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        gap, normal, curvature = self.surface.nearest(points, reach + abs(self.distance))
        return Nearest(gap - self.distance, normal, curvature)

    def mesh(self, low: ArrayLike, high: ArrayLike, size: float) -> Drawn:
        room = abs(self.distance)
        low, high = np.subtract(low, room), np.add(high, room)
        points, normals, triangles = self.surface.mesh(low, high, size)
        return points + self.distance * normals, normals, triangles


class Reversed(_Changed):
    """A `surface` with the body on its other side.

    Examples
    --------
    The die of a punch, 1 mm from it:

    >>> die = ff.Reversed(ff.Offset(ff.Sphere(10), 1))
    >>> die.evaluate([[0, 0, 10]]).gap
    array([1.])
    """

    def __init__(self, surface: Surface) -> None:
        self.surface, self.radii = surface.from_behind(), surface.radii[::-1]

    def from_behind(self) -> Surface:
        return self

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        return Nearest(*(-a for a in self.surface.nearest(points, reach)))

    def mesh(self, low: ArrayLike, high: ArrayLike, size: float) -> Drawn:
        points, normals, triangles = self.surface.mesh(low, high, size)
        return points, -normals, triangles[:, ::-1]


class _Rigid(_Changed):
    """A surface turned or mirrored about the origin, by the matrix `_turn` (3, 3)."""

    _turn: np.ndarray

    def __init__(self, surface: Surface) -> None:
        self.surface, self.radii = surface, surface.radii

    def back(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) [mm] where they lie beside the surface that this one is made of."""
        return points @ self._turn

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        gap, normal, curvature = self.surface.nearest(self.back(points), reach)
        curvature = self._turn @ curvature @ self._turn.T
        curvature = (curvature + curvature.swapaxes(1, 2)) / 2  # of rounding
        return Nearest(gap, normal @ self._turn.T, curvature)

    def mesh(self, low: ArrayLike, high: ArrayLike, size: float) -> Drawn:
        ends = np.array([low, high], dtype=float).T
        corners = self.back(np.stack(np.meshgrid(*ends), -1).reshape(-1, 3))
        points, normals, triangles = self.surface.mesh(corners.min(0), corners.max(0), size)
        triangles = triangles if np.linalg.det(self._turn) > 0 else triangles[:, ::-1]
        return points @ self._turn.T, normals @ self._turn.T, triangles


class Flipped(_Rigid):
    """A `surface` upside down: mirrored in the plane z = 0, the normal still out of the body.

    Examples
    --------
    >>> ff.Flipped(ff.Sphere(10, (0, 0, 30))).evaluate([[0, 0, -18]]).gap
    array([2.])
    """

    _turn = np.diag([1.0, 1.0, -1.0])


class Turned(_Rigid):
    """A `surface` turned about the origin by `angles` (3,) [deg]: first about the axis x, then
    about y, then about z, the axes standing still; anticlockwise as seen from the axis' end. Raises
    InputError unless these are three finite numbers.

    Examples
    --------
    >>> floor = ff.Plane((0, 0, 0), (0, 0, 1))
    >>> ff.Turned(floor, (0, 90, 0)).evaluate([[3, 0, 0]]).gap
    array([3.])
    """

    def __init__(self, surface: Surface, angles: ArrayLike) -> None:
        super().__init__(surface)
        self.angles = checked_vector("angles of the turn [deg]", angles)
        # of a column of coordinates
        self._turn = Rotation.from_euler("xyz", self.angles, degrees=True).as_matrix()
