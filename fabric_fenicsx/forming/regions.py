"""Parts of a blank where a holder acts: masks of points, by limits of coordinates, and edges."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..material.files import Interval
from ..runtime.errors import InputError
from ..runtime.rules import FINITE, shown, unknown_key
from ..tools.values import checked_vector

Where = Callable[[np.ndarray], np.ndarray]  # function of points (3, n) [mm] to a mask (n,)
# edge of a rectangle around the blank -> axis, and which end of it
EDGES = {"low x": (0, 0), "high x": (0, 1), "low y": (1, 0), "high y": (1, 1)}


@dataclass(frozen=True)
class Region:
    """Function of points (3, n) [mm] to a mask (n,), True where they lie within all `limits`.

    limits: {name: (low, high)} of x, y [mm], and of r [mm] and angle (to x) [deg], polar
    coordinates about the point `at` (x, y), by default the blank's centroid when a holder is built.
    Raises InputError for others.
    """

    limits: Mapping[str, Sequence[float]]

    def __post_init__(self) -> None:
        if not isinstance(self.limits, Mapping) or not self.limits:
            raise InputError(f"`where` is {shown(self.limits)}; allowed is a table, as x = [0, 50]")
        for name, ends in self.limits.items():
            if name == "at":
                checked_vector("`where`.at", ends, size=2)
            elif name in ("x", "y", "r", "angle"):
                Interval(FINITE).check(f"`where`.{name}", ends)
            else:
                raise unknown_key(name, ("x", "y", "r", "angle", "at"), f"`where`.{name}")

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The mask (n,)."""
        rounding = 1e-6  # mm or deg, by which a node may lie beyond a limit
        arm = x[:2] - np.reshape(self.limits.get("at", (0.0, 0.0)), (2, 1))
        angle = np.degrees(np.arctan2(arm[1], arm[0]))
        values = {"x": x[0], "y": x[1], "r": np.hypot(*arm), "angle": angle}
        inside = np.ones(x.shape[1], dtype=bool)
        for name in values.keys() & self.limits.keys():
            low, high = self.limits[name]
            over = values[name] - low + rounding
            over = over % 360 if name == "angle" else over
            inside &= (over >= 0) & (over <= high - low + 2 * rounding)
        return inside

    def about(self, centre: np.ndarray) -> Region:
        """The region with `at` (2,) [mm] unless it has its own."""
        return Region({"at": centre.tolist()} | dict(self.limits))


def check_edges(names: object) -> None:
    """Raise InputError unless `names` is a list of some of `EDGES`."""
    if not isinstance(names, (list, tuple)) or any(each not in EDGES for each in names):
        raise InputError(f"`edges` is {shown(names)}; allowed is a list of some of {[*EDGES]}")
