"""Where a tool moved by force stands: its travel at which it is resisted with that force."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Resistance(NamedTuple):
    """Force along a tool's direction [N], its growth [N/mm], and the distance to touch [mm]."""

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
    travel, back, low, high = start, reach, -np.inf, np.inf
    for _ in range(100):
        resistance = look(travel)
        missing = force - resistance.force
        if abs(missing) <= 1e-12 * force:
            return True
        low, high = (travel, high) if missing > 0 else (low, travel)
        is_stiff = resistance.stiffness > 0  # without contact as far as no point is passed
        step = missing / resistance.stiffness if is_stiff else resistance.free + soft
        new = travel + float(np.clip(step, -back, resistance.free + reach))
        back = 2 * back if np.isfinite(high) and np.isinf(low) else back
        if np.isfinite(low + high) and not low < new < high:
            new = 0.5 * (low + high)
            if new in (low, high):
                return True
        travel = new
    return False
