"""Vectors and points that users give, checked."""

from reprlib import repr as repr_short

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.rules import FINITE


def checked_vector(
    name: str, value: ArrayLike, unit: bool = False, size: str = "three"
) -> np.ndarray:
    """`value` as an array of a `size` in words, "two", "three" or "two or three" numbers, of length
    1 if `unit`; raises InputError for any other."""
    try:
        vector = np.array([FINITE.check("", each) for each in iter(value)])  # type: ignore
    except (TypeError, InputError):
        vector = np.empty(0)
    if {2: "two", 3: "three"}.get(len(vector), "none") not in size or (unit and not vector.any()):
        besides = ", not all 0" if unit else ""
        raise InputError(
            f"{name} is {repr_short(value)}; allowed are {size} finite numbers{besides}"
        )
    if not unit:
        return vector
    vector /= abs(vector).max()  # so that its square neither overflows nor vanishes
    return vector / np.linalg.norm(vector)


def checked_points(points: ArrayLike) -> np.ndarray:
    """`points` as an array of shape (n, 3); raises InputError for any other."""
    x = np.asarray(points, float)
    if x.ndim != 2 or x.shape[1] != 3:
        raise InputError(f"points have the shape {x.shape}; allowed is (n, 3)")
    return x
