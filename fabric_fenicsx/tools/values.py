"""Vectors and points that tools are given, checked."""

from reprlib import repr as shown

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.errors import InputError


def checked_vector(name: str, value: ArrayLike, unit: bool = False) -> np.ndarray:
    """`value` as an array (3,), of length 1 if `unit`; raises InputError for any other."""
    try:
        vector = np.array(value, dtype=float)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or (unit and not vector.any()):
        besides = ", not all 0" if unit else ""
        raise InputError(f"{name} is {shown(value)}; allowed are three finite numbers{besides}")
    # scaled first, so that its square neither overflows nor vanishes
    return (
        vector / abs(vector).max() / np.linalg.norm(vector / abs(vector).max()) if unit else vector
    )


def checked_points(points: ArrayLike) -> np.ndarray:
    """`points` as an array of shape (n, 3); raises InputError for any other."""
    try:
        x = np.asarray(points, dtype=float)
    except (TypeError, ValueError):
        raise InputError(
            f"points are {shown(points)}; allowed are numbers of shape (n, 3)"
        ) from None
    if x.ndim != 2 or x.shape[1] != 3:
        raise InputError(f"points have the shape {x.shape}; allowed is (n, 3)")
    return x
