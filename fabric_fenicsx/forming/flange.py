"""The share to which a place lies on the die's flange, where a blank holder presses."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from ..runtime.formatting import rounded
from ..tools.tool import Tool

SPACING = 2.0  # mm, of the lattice that tells where the die need not be asked
BEYOND = 2  # points of it beyond a place's square, as the end may be curved
# height over the thickness, and 1 less the normal's part along z: up to the first a face is flat,
# from the second on it is not
FLAT, NOT_FLAT = 1e-3, 1e-2


class Flange:
    """Function of places (3, n) to the share (n,) to which each lies on the die's flange: 1 where
    the die is flat, 0 beyond, and less than 1 where its radius begins; it depends only on x and y.

    Where a lattice over the `extent` of the blank, two corners, is flat everywhere or nowhere about
    a place, so is the place: smaller parts of the flange may be missed. thickness: of all that lies
    between die and holder [mm]; up: 1 for a die above the blank, -1 below it.
    """

    def __init__(self, die: Tool, thickness: float, up: float, extent: ArrayLike) -> None:
        self.die, self.thickness, self.up = die, thickness, up
        low, high = np.asarray(extent)[:, :2]
        self._axes = [
            np.arange(math.floor(start / SPACING) - BEYOND, math.ceil(end / SPACING) + BEYOND + 1)
            for start, end in zip(low, high)
        ]
        self._begin_anew()

    def _begin_anew(self):
        self._seen = self.die.displacement
        lattice = np.stack(np.meshgrid(*self._axes, indexing="ij"), -1).astype(float)
        flat = self._flat(SPACING * lattice.reshape(-1, 2)).reshape(lattice.shape[:2])
        self._least, self._most = (
            find(flat, 2 * BEYOND + 2, origin=-1)
            for find in (ndimage.minimum_filter, ndimage.maximum_filter)
        )
        # how many squares before each have share 0 everywhere, and 1
        self._counts = [
            np.pad(each.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
            for each in (self._most == 0, self._least == 1)
        ]

    def _follow_die(self):
        if not np.array_equal(self.die.displacement, self._seen):
            self._begin_anew()

    def over(self, x: np.ndarray) -> np.ndarray:
        """The share (n,) of each triangle with corners x (n, 3, 3) [mm] that is 0 or 1 all over it;
        nan where it may differ, and has to be asked for at places."""
        self._follow_die()
        first, last = np.array([axis[[0, -1]] for axis in self._axes]).T
        low, high = (np.floor(ends / SPACING) for ends in (x.min(1)[:, :2], x.max(1)[:, :2]))
        known = ((low >= first) & (high <= last)).all(1)
        (a, b), (c, d) = (
            (np.where(known[:, None], end - first, 0).astype(int) + n).T
            for n, end in enumerate((low, high))
        )
        squares, share = (c - a) * (d - b), np.full(len(x), np.nan)
        for value, sums in enumerate(self._counts):
            share[known & (sums[c, d] - sums[a, d] - sums[c, b] + sums[a, b] == squares)] = value
        return share

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The share (n,) of places x (3, n) [mm]."""
        self._follow_die()
        finite = np.isfinite(x[:2]).all(0)
        places = np.where(finite, x[:2], 0.0).T
        first, count = np.array([axis[[0, -1]] for axis in self._axes]).T
        square = np.floor(places / SPACING).clip(first, count) - first
        at = tuple(square.astype(int).T)
        inside = ((places / SPACING >= first) & (places / SPACING <= count)).all(1)
        share, near = self._least[at], ~inside | (self._least[at] != self._most[at])
        share[near] = self._flat(places[near])
        return np.where(finite, share, 0.0)

    def loose_ends(
        self, extents: Sequence[ArrayLike], centre: np.ndarray, planes: Sequence[int]
    ) -> list[str]:
        """A sentence on each end of the smallest sheet, on the axes through its centre (2,), that
        lies over the die's opening, where no blank holder presses it. extents: two corners of each
        sheet [mm]; planes: axes to which planes of symmetry are perpendicular."""
        low, high = (np.array(end) for end in zip(*extents))
        ends = [(axis, 1, high[:, axis].min()) for axis in (0, 1)]
        ends += [(axis, -1, low[:, axis].max()) for axis in (0, 1) if axis not in planes]
        doubts, reach = list[str](), np.arange(200)  # mm, within which the flange is looked for
        for axis, way, end in ends:
            x = np.append(centre, 0.0)[:, None] + np.zeros(len(reach))
            x[axis] = end + way * reach
            pressed = np.flatnonzero(self(x))
            if len(pressed) and not pressed[0]:
                continue
            away = f"{pressed[0]} mm" if len(pressed) else f"more than {len(reach)} mm"
            doubts.append(
                f"the smallest sheet ends over the die's opening at {'xy'[axis]} = "
                f"{rounded(end, 4)} mm, {away} from the flange: the blank holder does not press it "
                "there"
            )
        return doubts

    def _flat(self, points):
        """The share (n,) of points (n, 2)."""
        t, at = self.thickness, np.column_stack([points, np.zeros(len(points))])
        gap, normal, _ = self.die.evaluate(at, reach=t)
        off = np.fmax(abs(gap - t / 2) / t, 1 + self.up * normal[:, 2])
        return np.clip((NOT_FLAT - off) / (NOT_FLAT - FLAT), 0, 1)
