"""Which share of a place lies beneath the die's flange, where a blank holder presses."""

import itertools
import math
from collections.abc import Callable

import numpy as np

from ..tools.tool import Tool

RINGS = 2.0, 4.0, 6.0  # mm about a place, in which the die must be flat for it to be held
# directions of the points on a ring
AROUND = [k * math.pi / 4 for k in range(8)]
# mm: edges of the squares whose places, or whose points on rings, are judged together, and how far
# apart the points that judge them are
PLACES, POINTS = (4.0, 2.0), (1.0, 0.5)


class Flange:
    """Function of places (3, n) to the share of each (n,) that lies beneath the die's flange: 0 at
    its end, 1 from the largest of the `RINGS` inwards. thickness: of all that lies between die and
    holder [mm]; up: 1 for a die above the blank, -1 below it.

    The share counts on how many points of the rings the die is flat. It depends on x and y alone,
    and only near the flange's end is the die asked. Where it is flat all over the surroundings of a
    tile of the plane, or nowhere, the rings of all places in it are known; and so are the points of
    rings that lie in smaller tiles which the flange's end does not cross. Each tile is judged once,
    by points 2 mm, or 0.5 mm, apart: parts of the flange that are smaller may be missed.
    """

    def __init__(self, die: Tool, thickness: float, up: float = 1.0) -> None:
        self.die, self.thickness, self._up = die, thickness, up
        self._ring = np.array(
            [(r * math.cos(a), r * math.sin(a)) for r, a in itertools.product(RINGS, AROUND)]
        )
        self._judge_anew()

    def _judge_anew(self):
        self._seen = self.die.displacement
        # a step more than to the rings' ends, as the flange's end may be curved
        self._places = Tiles(self._flat, *PLACES, beyond=math.ceil(RINGS[-1] / PLACES[1]) + 1)
        self._points = Tiles(self._flat, *POINTS)
        # as a state that is accepted was asked about before
        self._last = np.empty((3, 0)), np.empty(0)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The share (n,) of places x (3, n) [mm]."""
        if not np.array_equal(self.die.displacement, self._seen):
            self._judge_anew()
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
    """Function of places (n, 2) to what `judged`, a function of points (k, 2) to 0 or 1, (k,), is
    all around the square tile of this `edge` that each lies in, (n,): NaN where it is both.

    Each tile is judged once, by the points of a lattice, two or more to an edge, that lie in it or
    up to `beyond` of them beside it; spacing: of the lattice; [mm].
    """

    def __init__(
        self,
        judged: Callable[[np.ndarray], np.ndarray],
        edge: float,
        spacing: float,
        beyond: int = 0,
    ) -> None:
        self._judged, self._edge, self._spacing = judged, edge, spacing
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
        return self._judged(self._spacing * np.column_stack([points.real, points.imag]))


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
