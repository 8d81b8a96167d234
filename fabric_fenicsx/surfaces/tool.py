"""The rigid bodies that move: a surface on a path, or on a line by force."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError
from .surfaces import Nearest, Surface, checked_points, checked_vector

OfLoad = Callable[[float], ArrayLike]  # from the load factor to (3,)


class Frame(NamedTuple):
    """Coordinates in a scene: their origin `at` (3,) [mm], their axes as columns (3, 3)."""

    at: np.ndarray
    axes: np.ndarray

    def inside(self, points: ArrayLike) -> np.ndarray:
        """Points (n, 3) of the scene in these coordinates [mm]."""
        return np.subtract(points, self.at) @ self.axes

    def outside(self, points: ArrayLike) -> np.ndarray:
        """Points (n, 3) in these coordinates in those of the scene [mm]."""
        return points @ self.axes.T + self.at


class Tool:
    """A rigid body, bounded by a `surface`, that moves without rotation: along a path, or along a
    line by force. `name` is the tool's in summaries and errors.

    Raises InputError for a path or force that does not give three finite numbers, a force that
    turns, or a surface whose `radii` are no two numbers above 0.

    Parameters
    ----------
    path : (3,) or function of the load factor to (3,)
        Its displacement [mm]; three numbers are that at full load, to which it grows in proportion.
    force : (3,) or function of the load factor to (3,)
        If given, on the tool [N], always along one direction; the tool moves on that line by
        `travel` [mm], beyond the path, which its contact finds.

    Examples
    --------
    >>> punch = ff.Tool(ff.Sphere(10), path=(0, 0, 20), name="punch")
    >>> punch.at(0.5)
    >>> punch.displacement
    array([ 0.,  0., 10.])
    >>> punch.evaluate([[0, 0, 25]]).gap
    array([5.])
    """

    def __init__(
        self,
        surface: Surface,
        path: OfLoad | ArrayLike = (0.0, 0.0, 0.0),
        force: OfLoad | ArrayLike | None = None,
        name: str = "tool",
    ) -> None:
        if not isinstance(surface, Surface):
            raise InputError(
                f"surface of {name} is {surface!r}; expected a surface, as `Sphere(30)`"
            )
        self.name, self.surface = name, surface
        self.path = _growing(f"path of {name}", path)
        self.force = None if force is None else _growing(f"force of {name}", force)
        self.travel, self.push = 0.0, 0.0
        self.direction = np.zeros(3)
        # where its surface's origin is in the coordinates of its file, and axes of these
        self.home = Frame(np.zeros(3), np.eye(3))
        if self.force:
            full = f"force of {name} at full load"
            self.direction = checked_vector(full, self.force(1.0), unit=True)
        self.at(0.0)

    def at(self, load: float) -> None:
        """Move it along its path to where it is at this load, and set its force."""
        self._place = checked_vector(f"path of {self.name} at load {load:g}", self.path(load))
        if self.force:
            force = checked_vector(f"force of {self.name} at load {load:g}", self.force(load))
            self.push = float(force @ self.direction)
            turned = np.linalg.norm(force - self.push * self.direction) > 1e-9 * abs(force).max()
            if turned or self.push < 0:
                raise InputError(
                    f"force of {self.name} at load {load:g} is {force.tolist()}; expected one "
                    "along that at full load"
                )

    @property
    def displacement(self) -> np.ndarray:
        """Distance moved from the place of its surface, (3,) [mm]."""
        return self._place + self.travel * self.direction

    def frame(self) -> Frame:
        """The coordinates in which its file has it, where it is now."""
        return Frame(self.displacement - self.home.axes @ self.home.at, self.home.axes)

    def evaluate(self, points: ArrayLike, reach: float = math.inf) -> Nearest:
        """As `Surface.evaluate`, where the tool is now."""
        return self.surface.evaluate(checked_points(points) - self.displacement, reach)


def _growing(name: str, value: OfLoad | ArrayLike) -> OfLoad:
    if callable(value):
        return value
    full = checked_vector(name, value)
    return lambda load: load * full
