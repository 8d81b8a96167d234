"""Places on a blank, in words of a file."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..runtime.errors import InputError
from ..runtime.rules import FINITE, shown, unknown_key

# of a rectangle around the blank -> axis, and end of it
EDGES = {"low x": (0, 0), "high x": (0, 1), "low y": (1, 0), "high y": (1, 1)}
# names of what is between two numbers -> function of points (3, n) to it
MEASURES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "x": lambda x: x[0],
    "y": lambda x: x[1],
    "r": lambda x: np.hypot(x[0], x[1]),
    "angle": lambda x: np.degrees(np.arctan2(x[1], x[0])),
}


def region(table: Any, label: str) -> Callable[[np.ndarray], np.ndarray]:
    """Function of points (3, n) [mm] to whether they lie between all that the table says (n,):
    x, y, r from the origin [mm] and angle to x [deg], {name: [low, high]}. Raises InputError for
    another table."""
    if not isinstance(table, Mapping) or not table:
        raise InputError(f"{label} is {shown(table)}; allowed is a table, as {{ x = [0, 50] }}")
    between = {}
    for name, ends in table.items():
        if name not in MEASURES:
            raise unknown_key(name, MEASURES, f"{label}.{name}")
        if not isinstance(ends, list) or len(ends) != 2:
            raise InputError(f"{label}.{name} is {shown(ends)}; allowed are two numbers")
        low, high = (FINITE.check(f"{label}.{name}", each) for each in ends)
        if low >= high:
            raise InputError(
                f"{label}.{name} is {shown(ends)}; allowed is the smaller number first"
            )
        between[name] = low, high

    def within(x):
        inside = np.ones(x.shape[1], dtype=bool)
        for name, (low, high) in between.items():
            value = MEASURES[name](x)
            if name == "angle":
                value = low + (value - low) % 360
            inside &= (value >= low) & (value <= high)
        return inside

    return within
