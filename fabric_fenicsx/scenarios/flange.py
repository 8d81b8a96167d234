"""Which share of a place lies beneath the die's flange, where a blank holder presses."""

import itertools
import math

import numpy as np

from ..tools.tool import Tool

RINGS = 2.0, 4.0, 6.0  # mm about a place, in which the die must be flat for it to be held
# directions of the points on a ring
AROUND = [k * math.pi / 4 for k in range(8)]
TILE = 4.0  # mm, edge of the squares of the plane whose places are judged together
ROOM = 0.5  # mm by which the points that judge them reach beyond the rings
SIDE = 9  # points along each side of the square around a tile


class Flange:
    """Function of places (3, n) to the share of each (n,) that lies beneath the die's flange: 0 at
    its end, 1 from the largest of the `RINGS` inwards. thickness: of all that lies between die and
    holder [mm].

    The share counts on how many points of the rings the die is flat. It depends on x and y alone,
    and only near the flange's end are the rings looked at: the plane is cut into tiles, and where
    a grid of points around a tile, every 2 mm out to the rings of all of its places, is flat all
    over or nowhere, so are the rings. Each tile is judged once, when a place lies in it, and anew
    if the die has moved.
    """

    def __init__(self, die: Tool, thickness: float) -> None:
        self.die, self.thickness = die, thickness
        self._tiles: dict[complex, float] = {}  # share in a tile, NaN if its places differ
        self._seen = die.displacement
        self._ring = np.array(
            [(r * math.cos(a), r * math.sin(a)) for r, a in itertools.product(RINGS, AROUND)]
        )
        side = np.linspace(-1, 1, SIDE) * (TILE / 2 + RINGS[-1] + ROOM)
        self._grid = np.array(list(itertools.product(side, side)))

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The share (n,) of places x (3, n) [mm]."""
        if not np.array_equal(self.die.displacement, self._seen):
            self._tiles, self._seen = {}, self.die.displacement
        finite = np.isfinite(x[:2]).all(0)
        places = np.where(finite, x[:2], 0.0).T
        tiles = (np.floor(places / TILE) @ [1, 1j]).tolist()
        new = np.array([*{*tiles} - self._tiles.keys()], complex)
        middles = TILE * (np.column_stack([new.real, new.imag]) + 0.5)
        flat = self._flat(middles, self._grid).mean(1)
        self._tiles |= zip(new.tolist(), np.where((flat == 0) | (flat == 1), flat, np.nan))
        share = np.array([self._tiles[each] for each in tiles])
        near = np.isnan(share)
        share[near] = np.clip(2 * self._flat(places[near], self._ring).mean(1) - 1, 0, 1)
        return np.where(finite, share, 0.0)

    def _flat(self, places, around):
        """Whether the die is flat at the points `around` (k, 2) each of the places (n, 2),
        (n, k)."""
        at = np.zeros((len(places), len(around), 3))
        at[:, :, :2] = places[:, None] + around
        gap, normal, _ = self.die.evaluate(at.reshape(-1, 3), reach=self.thickness)
        t = self.thickness
        flat = (abs(gap - t / 2) < 1e-3 * t) & (normal[:, 2] < -0.999)
        return flat.reshape(at.shape[:2])
