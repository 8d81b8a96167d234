"""The rigid bodies that move: a surface on a path, or on a line by force."""

import math
from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from .surfaces import Nearest, Surface
from .values import _points, _vector

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
