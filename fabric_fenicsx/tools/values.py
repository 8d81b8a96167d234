"""Vectors and points that users give, checked."""

from reprlib import repr as shown

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.errors import InputError
from ..runtime.rules import FINITE


def checked_vector(
    name: str, value: ArrayLike, unit: bool = False, size: int = 3, hint: str = ""
) -> np.ndarray:
    """`value` as an array (size,), of length 1 if `unit`; raises InputError for any other, with a
    `hint` at its end."""
    try:
        vector = np.array([FINITE.check("", each) for each in iter(value)])  # type: ignore
    except (TypeError, InputError):
        vector = np.empty(0)
    if vector.shape != (size,) or (unit and not vector.any()):
        count, besides = "two" if size == 2 else "three", ", not all 0" if unit else ""
        raise InputError(
            f"{name} is {shown(value)}; allowed are {count} finite numbers{besides}{hint}"
        )
    if not unit:
        return vector
    vector /= abs(vector).max()  # so that its square neither overflows nor vanishes
    return vector / np.linalg.norm(vector)


def length_of(value: object) -> int:
    """Length of a vector that is not checked yet; 0 if it is none."""
    try:
        return len(value)  # type: ignore[arg-type]
    except TypeError:
        return 0


def checked_points(points: ArrayLike, name: str = "points") -> np.ndarray:
    """`points` as an array of shape (n, 3); raises InputError for any other, by `name`."""
    x = np.asarray(points, float)
    if x.ndim != 2 or x.shape[1] != 3:
        raise InputError(f"{name} have the shape {x.shape}; allowed is (n, 3)")
    return x
