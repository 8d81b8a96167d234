"""The share to which a place lies on the die's flange, where a blank holder presses."""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from ..tools.tool import Tool

# mm about a place, at which the die must be flat for the place to count in full
RINGS = 2.0, 4.0, 6.0
SPACING = 2.0  # mm, of the lattice that tells where rings need no look
# points of it beyond a place's square: to the largest ring, and one more as the end may be curved
BEYOND = math.ceil(RINGS[-1] / SPACING) + 1


class Flange:
    """Function of places (3, n) to the share (n,) to which each lies on the die's flange: 0 at the
    end of the flange, 1 from the largest of the `RINGS` inwards; it depends only on x and y.

    The share says at how many points of the rings the die is flat. Where a lattice over the
    `extent` of the blank, two corners, is flat everywhere or nowhere about a place, so are the
    rings: smaller parts of the flange may be missed. thickness: of all that lies between die and
    holder [mm]; up: 1 for a die above the blank, -1 below it.
    """

    def __init__(self, die: Tool, thickness: float, up: float, extent: ArrayLike) -> None:
        self.die, self.thickness, self._up = die, thickness, up
        self._ring = np.array(
            [(r * np.cos(a), r * np.sin(a)) for r in RINGS for a in np.arange(8) * math.pi / 4]
        )
        low, high = np.asarray(extent)[:, :2]
        self._axes = [
            np.arange(math.floor(start / SPACING) - BEYOND, math.ceil(end / SPACING) + BEYOND + 1)
            for start, end in zip(low, high)
        ]
        self._begin_anew()

    def _begin_anew(self):
        self._seen, self._last = self.die.displacement, (np.empty((3, 0)), np.empty(0))
        lattice = np.stack(np.meshgrid(*self._axes, indexing="ij"), -1).astype(float)
        flat = self._flat(SPACING * lattice.reshape(-1, 2)).reshape(lattice.shape[:2])
        self._least, self._most = (
            find(flat, 2 * BEYOND + 2, origin=-1)
            for find in (ndimage.minimum_filter, ndimage.maximum_filter)
        )

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The share (n,) of places x (3, n) [mm]."""
        if not np.array_equal(self.die.displacement, self._seen):
            self._begin_anew()
        if not np.array_equal(x, self._last[0]):
            self._last = x.copy(), self._share(x)
        return self._last[1].copy()

    def _share(self, x):
        finite = np.isfinite(x[:2]).all(0)
        places = np.where(finite, x[:2], 0.0).T
        first, count = np.array([axis[[0, -1]] for axis in self._axes]).T
        square = np.floor(places / SPACING).clip(first, count) - first
        at = tuple(square.astype(int).T)
        inside = ((places / SPACING >= first) & (places / SPACING <= count)).all(1)
        share, near = self._least[at], ~inside | (self._least[at] != self._most[at])
        points = (places[near, None] + self._ring).reshape(-1, 2)
        flat = self._flat(points).reshape(-1, len(self._ring))
        share[near] = np.clip(2 * flat.mean(1) - 1, 0, 1)
        return np.where(finite, share, 0.0)

    def _flat(self, points):
        """1 where the die is flat at points (n, 2), 0 elsewhere, (n,)."""
        t, at = self.thickness, np.column_stack([points, np.zeros(len(points))])
        gap, normal, _ = self.die.evaluate(at, reach=t)
        return ((abs(gap - t / 2) < 1e-3 * t) & (self._up * normal[:, 2] < -0.999)).astype(float)
