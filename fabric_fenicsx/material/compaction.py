"""Loss of a ply's thickness under pressure."""

from dataclasses import dataclass

import numpy as np

from ..core.rules import FROM_ZERO, Rule, above_zero
from .material import Parameters, parameter, parameters


@parameters
@dataclass(frozen=True)
class Compaction(Parameters):
    """Pressure p against the thickness h of a ply: p = p_0 (e^y - 1 - y), y = n ln(h_0 / h).

    Well above p_0 the fibre volume fraction grows with the power 1/n of the pressure, and at first
    the pressure grows with the square of the compaction. h_0 is the thickness without pressure; if
    the area changes by a factor J, it changes by J^-m. Raises InputError
    for an exponent up to 1, pressures not above 0, and a thickening below 0.

    Examples
    --------
    >>> ply = ff.Compaction(16.0, onset=1e-3, pressure=1e-3)
    >>> ply.thickness(np.array([1e-3, 1.0])).round(3).tolist()  # over the fabric's
    [1.0, 0.697]
    """

    optional = ("thickening",)

    exponent: float = parameter(Rule("a number above 1", lambda v: v > 1), "n, above 1 [-]", 16.0)
    onset: float = parameter(above_zero("stress"), "p_0, onset of the power law [MPa]", 1e-3)
    pressure: float = parameter(above_zero("stress"), "pressure at the given thickness [MPa]", 1e-3)
    thickening: float = parameter(
        FROM_ZERO, "m; with 1 shear does not change the fibre volume fraction", 0.0
    )

    def thickness(self, p: float | np.ndarray) -> np.ndarray:
        """Thickness under pressures p from 0 [MPa], over the fabric's."""
        y = log_compaction(np.array([self.pressure, *np.atleast_1d(p).ravel()]) / self.onset)
        return np.exp((y[0] - y[1:]) / self.exponent).reshape(np.shape(p))


def log_compaction(q: np.ndarray) -> np.ndarray:
    """y (n,) from 0 of which e^y - 1 - y = q, for q (n,) from 0."""
    y = np.log1p(q + np.sqrt(2 * q))
    # of Newton's method three or four do; convex, so each comes nearer from above
    for _ in range(6):
        slope = np.expm1(y)
        y = y - np.divide(growth(y) - q, slope, out=np.zeros_like(y), where=slope > 0)
    return y


def growth(y: np.ndarray) -> np.ndarray:
    """e^y - 1 - y of y (n,) from 0, without cancellation: below 1e-3 as a series."""
    series = y * y / 2 * (1 + y / 3 * (1 + y / 4 * (1 + y / 5)))
    return np.where(y < 1e-3, series, np.expm1(y) - y)
