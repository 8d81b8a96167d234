"""Loops over points, compiled by numba and kept in the cache beside the forms."""

import os
from collections.abc import Callable
from typing import TypeVar

import numba

from .cache_folders import cache

F = TypeVar("F", bound=Callable)

if not os.getenv("NUMBA_CACHE_DIR"):
    vars(numba.config)["CACHE_DIR"] = str(cache() / "fabric_fenicsx")


def compiled(function: F) -> F:
    """The function as machine code, made at its first call and kept for later processes. Division
    by 0 gives inf or NaN, as in NumPy."""
    return numba.njit(cache=True, error_model="numpy")(function)  # type: ignore[return-value]
