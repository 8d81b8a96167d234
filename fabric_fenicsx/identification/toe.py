"""A toe: the beginning of a measured curve that lies off the fit: of a shear curve above it, as
friction makes it, of a tension curve below it, as crimp and slack make it."""

import numpy as np

from ..runtime.formatting import percent, rounded
from .curves import Curve, Response

LEAST = 3  # points at the beginning, all on one side of the fit
ERRORS = 2.5  # standard errors by which their mean is off it, of the curve's own scatter
SHARE = 0.05  # share of the measured values below which a toe is not worth a word


def toe_warning(curve: Curve, response: Response, predicted: np.ndarray, sd: np.ndarray) -> str:
    """A sentence on the toe of a curve of shear or of tension along its own yarns, empty if it has
    none; predicted, sd (n,): of the fit.

    Residuals that are scatter change their sign about every other point. So the first ones that
    share the sign of a toe are one if there are `LEAST` or more and their mean is too large for
    the scatter of all. 12 points or fewer hardly show one, as three fitted parameters follow it.
    """
    k = curve.abscissa
    is_shear = k == 2
    if response.component != k or not (is_shear or curve.test.startswith("uniaxial")):
        return ""
    rising = np.argsort(curve.strains[:, k])
    off, values = (response.values - predicted)[rising], response.values[rising]
    weighted = (1 if is_shear else -1) * off / sd[rising]
    first = int(np.argmin(np.append(weighted > 0, False)))
    scatter = np.sqrt(np.mean(weighted**2))
    if first < LEAST or weighted[:first].sum() < ERRORS * scatter * np.sqrt(first):
        return ""
    share = abs(off[:first].sum()) / np.abs(values[:first]).sum()
    if share < SHARE:
        return ""
    strains = curve.strains[rising, k]
    low, high = (np.degrees if is_shear else lambda v: 100 * v)(strains[[0, first - 1]])
    side, unit = ("above", "deg") if is_shear else ("below", "%")
    text = (
        f"{curve.file}: the first {first} points, from {rounded(low)} to {rounded(high)} {unit}, "
        f"all lie {side} the fit, by {abs(off[:first].mean()):.2g} {response.unit} on average, "
        f"{percent(share)} of {response.column} there: a toe, as "
    )
    if is_shear:
        return text + (
            "friction makes it where yarns begin to turn, which the law does not have; in a "
            "simulation the force at these angles will be too low"
        )
    fitted = values[0] - off[0]
    return text + (
        f"crimp or slack makes it where yarns straighten; the first point is {rounded(values[0])} "
        f"{response.unit}, and {rounded(fitted)} in the fit, so in a simulation the force at these "
        f"strains will be too high; if the strip was slack, {_slack(curve, strains, values, first)}"
    )


def _slack(curve, strains, values, first):
    """The remedy: the strain at which the line through the end of the toe meets zero stress (toe
    compensation, as in ASTM D638)."""
    i, j = max(first - 1, 0), min(first, len(strains) - 1)
    slope = (values[j] - values[i]) / (strains[j] - strains[i]) if j > i else np.inf
    end = max(strains[i] - values[i] / slope, 0.0)
    length = curve.keys.get("length")
    slack = f"{curve.slack + end * length:.2g} mm" if length else percent(curve.slack + end)
    return f"a line `# slack: {slack}` counts the strain from there"
