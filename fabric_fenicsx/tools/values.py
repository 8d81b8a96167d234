"""Numbers, vectors and points that tools are given, checked."""

import math
from numbers import Real
from reprlib import repr as shown

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError


def _number(name, value, allowed="of either sign", low=-math.inf, high=math.inf, closed=False):
    """`value` as a float above `low` (or at it if `closed`) and below `high`; otherwise an InputError."""
    if isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value):
        if low < value < high or (closed and value == low):
            return float(value)
    raise InputError(f"{name} is {shown(value)}, but it must be a finite number, {allowed}")


def _vector(name, value, unit=False):
    """`value` as three floats, of length 1 if `unit`; otherwise an InputError."""
    try:
        vector = np.array(value, dtype=float)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or (unit and not vector.any()):
        raise InputError(f"{name} is {shown(value)}, but it must be three finite numbers{', not all 0' * unit}")
    # scaled first, so that its square neither overflows nor vanishes
    return vector / abs(vector).max() / np.linalg.norm(vector / abs(vector).max()) if unit else vector


def _points(points: ArrayLike) -> np.ndarray:
    """`points` as an array of shape (n, 3); otherwise an InputError."""
    try:
        x = np.asarray(points, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"points are {shown(points)}, but they must be numbers of shape (n, 3)") from None
    if x.ndim != 2 or x.shape[1] != 3:
        raise InputError(f"points have the shape {x.shape}, but it must be (n, 3)")
    return x
