"""Balance of a force on a tool with the resistance of the sheet."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

ITERATIONS = 100
MISSING = 1e-12  # of the force, that may be


class Resistance(NamedTuple):
    """Resistance to a tool: force along its direction [N], growth of it as the tool travels [N/mm],
    and distance to the nearest point, 0 in contact [mm]."""

    force: float
    stiffness: float
    free: float


def find_balance(
    force: float, look: Callable[[float], Resistance], start: float, reach: float, soft: float
) -> bool:
    """Seek the travel at which `look(travel)` resists with `force` [N], by Newton's method between
    bounds; true if found. `look` was then called last there.

    start: travel to begin with; reach: what the tool may pass a point by, or go back, in one step;
    soft: step where it touches nothing and none is ahead [mm].
    """
    travel, back = start, reach
    low: float | None = None
    high: float | None = None
    for _ in range(ITERATIONS):
        found = look(travel)
        missing = force - found.force
        if abs(missing) <= MISSING * force:
            return True
        low, high = (travel, high) if missing > 0 else (low, travel)
        # without contact as far as no point is passed
        step = missing / found.stiffness if found.stiffness > 0 else found.free + soft
        new = travel + float(np.clip(step, -back, found.free + reach))
        back = back if high is None or low is not None else 2 * back
        if low is not None and high is not None and not low < new < high:
            new = 0.5 * (low + high)
            if new in (low, high):
                return True
        travel = new
    return False
