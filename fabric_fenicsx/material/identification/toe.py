"""A toe: the beginning of a measured shear curve that lies above the fit, as friction makes it."""

import numpy as np

from ...runtime.words import percent, rounded
from ..curves import Curve, Response

LEAST = 3  # points at the beginning, all above the fit
ERRORS = 2.5  # standard errors by which their mean is above it, of the curve's own scatter
SHARE = 0.05  # share of the measured values below which a toe is not worth a word


def toe_warning(curve: Curve, response: Response, predicted: np.ndarray, sd: np.ndarray) -> str:
    """A sentence on the toe of a shear curve, empty if it has none; predicted, sd (n,): of the fit.

    Residuals that are scatter change their sign about every other point. So the first ones that
    share the sign + are a toe if there are `LEAST` or more and their mean is too large for the
    scatter of all. 12 points or fewer hardly show one, as three fitted parameters follow it.
    """
    if response.component != 2 or curve.abscissa != 2:
        return ""
    rising = np.argsort(curve.strains[:, 2])
    off, values = (response.values - predicted)[rising], response.values[rising]
    weighted = off / sd[rising]
    first = int(np.argmin(np.append(weighted > 0, False)))
    scatter = np.sqrt(np.mean(weighted**2))
    if first < LEAST or weighted[:first].sum() < ERRORS * scatter * np.sqrt(first):
        return ""
    share = off[:first].sum() / np.abs(values[:first]).sum()
    if share < SHARE:
        return ""
    low, high = np.degrees(curve.strains[rising, 2][[0, first - 1]])
    return (
        f"{curve.file}: the first {first} points, from {rounded(low)} to {rounded(high)} deg, all "
        f"lie above the fit, by {off[:first].mean():.2g} {response.unit} on average, "
        f"{percent(share)} of {response.column} there: a toe, as friction makes it where yarns "
        "begin to turn, which the law does not have; in a simulation the force at these angles "
        "will be too low"
    )
