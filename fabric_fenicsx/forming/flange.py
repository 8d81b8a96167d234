"""The share to which a place lies on the die's flange, where a blank holder presses."""

import itertools
import math
from collections.abc import Callable

import numpy as np

from ..tools.tool import Tool

RINGS = (
    2.0,
    4.0,
    6.0,
)  # mm about a place, at which the die must be flat for the place to count in full
# directions of the points on a ring
AROUND = [k * math.pi / 4 for k in range(8)]
# mm: edges of the squares whose places, or whose points on rings, are checked together, and the
# distance of the points at which they are checked
PLACES, POINTS = (4.0, 2.0), (1.0, 0.5)


class Flange:
    """Function of places (3, n) to the share (n,) to which each lies on the die's flange: 0 at the
    end of the flange, 1 from the largest of the `RINGS` inwards. thickness: of all that lies
    between die and holder [mm]; up: 1 for a die above the blank, -1 below it.

    The share says at how many points of the rings the die is flat. It depends only on x and y. The
    die's surface is evaluated only near the end of the flange. If it is flat everywhere, or
    nowhere, around a tile of the plane, the rings of all places in this tile are known. So are
    points of rings in smaller tiles that the end of the flange does not cross. Each tile is checked
    once, at points 2 mm, or 0.5 mm, apart: smaller parts of the flange may be missed.
    """

    def __init__(self, die: Tool, thickness: float, up: float = 1.0) -> None:
        self.die, self.thickness, self._up = die, thickness, up
        self._ring = np.array(
            [(r * math.cos(a), r * math.sin(a)) for r, a in itertools.product(RINGS, AROUND)]
        )
        self._begin_anew()

    def _begin_anew(self):
        self._seen = self.die.displacement
        # a step more than to the rings' ends, as the flange's end may be curved
        self._places = Tiles(self._flat, *PLACES, beyond=math.ceil(RINGS[-1] / PLACES[1]) + 1)
        self._points = Tiles(self._flat, *POINTS)
        # since the share of a state that is accepted was found before
        self._last = np.empty((3, 0)), np.empty(0)

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
        share = self._places(places)
        near = np.isnan(share)
        points = (places[near, None] + self._ring).reshape(-1, 2)
        flat = self._points(points)
        unknown = np.isnan(flat)
        flat[unknown] = self._flat(points[unknown])
        share[near] = np.clip(2 * flat.reshape(-1, len(self._ring)).mean(1) - 1, 0, 1)
        return np.where(finite, share, 0.0)

    def _flat(self, points):
        """1 where the die is flat at points (n, 2), 0 elsewhere, (n,)."""
        t, at = self.thickness, np.column_stack([points, np.zeros(len(points))])
        gap, normal, _ = self.die.evaluate(at, reach=t)
        return ((abs(gap - t / 2) < 1e-3 * t) & (self._up * normal[:, 2] < -0.999)).astype(float)


class Tiles:
    """Function of places (n, 2) to the value (n,) of `check` in and around the square tile that
    each place lies in: 0 or 1, NaN if it is not the same everywhere.

    check: function of points (k, 2) to 0 or 1, (k,); edge: of a tile; spacing: of a lattice of
    points, two or more to an edge; [mm]. Each tile is checked once, at the points of the lattice in
    it and up to `beyond` points beside it.
    """

    def __init__(
        self,
        check: Callable[[np.ndarray], np.ndarray],
        edge: float,
        spacing: float,
        beyond: int = 0,
    ) -> None:
        self._check, self._edge, self._spacing = check, edge, spacing
        self._tiles, self._lattice = Known(self._all_around), Known(self._at)
        self._count = round(edge / spacing)
        steps = np.arange(-beyond, self._count + beyond + 1)
        self._grid = np.add.outer(steps, 1j * steps).ravel()

    def __call__(self, places: np.ndarray) -> np.ndarray:
        """As the class says."""
        return self._tiles(np.floor(places / self._edge) @ [1, 1j])

    def _all_around(self, tiles):
        points = np.add.outer(self._count * tiles, self._grid)
        found = self._lattice(points.ravel()).reshape(points.shape).mean(1)
        return np.where((found == 0) | (found == 1), found, np.nan)

    def _at(self, points):
        return self._check(self._spacing * np.column_stack([points.real, points.imag]))


class Known:
    """Function of numbers (n,) to what `found`, a function of different ones, gives for each, (n,);
    it is asked once for a number."""

    def __init__(self, found: Callable[[np.ndarray], np.ndarray]) -> None:
        self._found = found
        self._numbers, self._values = np.array([complex(np.inf)]), np.array([np.nan])

    def __call__(self, numbers: np.ndarray) -> np.ndarray:
        """As the class says."""
        at = self._numbers.searchsorted(numbers)
        new = np.unique(numbers[self._numbers[at] != numbers])
        if len(new):
            place = self._numbers.searchsorted(new)
            self._values = np.insert(self._values, place, self._found(new))
            self._numbers = np.insert(self._numbers, place, new)
            at = self._numbers.searchsorted(numbers)
        return self._values[at]
