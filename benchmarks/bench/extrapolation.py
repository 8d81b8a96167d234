"""A value and its error bar from meshes that are halved each time: Richardson's extrapolation."""

import math
from collections.abc import Sequence
from typing import NamedTuple

ORDERS = 0.5, 4.0  # least and greatest order of convergence that is believed


class Estimate(NamedTuple):
    """A value, its error bar, and the order of convergence (None: the finest value is taken)."""

    value: float
    error: float
    order: float | None


def estimate(series: Sequence[float], checks: Sequence[float]) -> Estimate:
    """The `Estimate` from a series on meshes halved each time, the finest last.

    Extrapolated by Richardson with the order observed on the last three, if they are monotone and
    the order is one of ORDERS. The bar reaches to the finest value (else to the two before) and to
    all `checks`.
    """
    value, order, others = series[-1], None, series[-3:]
    if len(series) > 2 and series[-1] != series[-2]:
        ratio = (series[-2] - series[-3]) / (series[-1] - series[-2])
        if 2 ** ORDERS[0] <= ratio <= 2 ** ORDERS[1]:
            order, others = math.log2(ratio), series[-1:]
            value += (series[-1] - series[-2]) / (ratio - 1)
    return Estimate(value, max(abs(value - other) for other in (*others, *checks)), order)
