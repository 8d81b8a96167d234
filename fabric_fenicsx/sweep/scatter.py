"""Scatter of quantities over runs in which several numbers scatter, and which of these matter."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import qmc

from ..core.errors import SolverFailure
from ..core.formatting import percent, rounded, with_error
from .folder import Run
from .varied import Range, Values, short_names, spelled

BOUNDS = 0.05, 0.95  # quantiles
Limits = Sequence[tuple[str, float]]  # (quantity, what it is below)


def design(ranges: Sequence[Range], count: int) -> list[Values]:
    """Values of a power of two of runs that fill the ranges evenly: Sobol's sequence, scrambled in
    the same way in each call, of which a larger design has the smaller one as its beginning."""
    points = qmc.Sobol(len(ranges), seed=1).random_base2(count.bit_length() - 1)
    return [{r.key: spelled(r.at(share)) for r, share in zip(ranges, p)} for p in points]


def spread(runs: Sequence[Run], ranges: Sequence[Range], quantity: str) -> dict:
    """A quantity over believed runs: how many they are, mean, standard deviation, quantiles
    `BOUNDS`; and of the regression that is linear in all numbers at once the effects, the largest
    first, and the share of the variance that these leave.

    An effect is the change from the low to the high end of a number's interval, with its standard
    error and the number's share of the variance. Few runs determine nothing more: ranks, or Sobol'
    indices of a fitted surface, would hide where straight lines do not do.
    """
    y = np.array([run.number(quantity) for run in runs])
    X = np.array([[r.share(float(run.values[r.key])) for r in ranges] for run in runs]) - 0.5
    A = np.column_stack([np.ones(len(y)), X])
    slopes = np.linalg.lstsq(A, y, rcond=None)[0]
    rest = ((y - A @ slopes) ** 2).sum() / (len(y) - A.shape[1])
    errors = np.sqrt(rest * np.diag(np.linalg.inv(A.T @ A)))
    parts = slopes[1:] ** 2 / 12  # variance of a straight line over evenly spread numbers
    whole = parts.sum() + rest or 1.0
    names = short_names([r.key for r in ranges]).values()
    rows = np.column_stack([slopes[1:], errors[1:], parts / whole]).tolist()
    effects = [
        {"name": name, "low": r.low, "high": r.high, "change": b, "error": e, "share": share}
        for name, r, (b, e, share) in zip(names, ranges, rows)
    ]
    return {
        "runs": len(y),
        "mean": float(y.mean()),
        "deviation": float(y.std(ddof=1)),
        "bounds": np.quantile(y, BOUNDS).tolist(),
        "effects": sorted(effects, key=lambda each: -each["share"]),
        "left": float(rest / whole),
    }


def _words(label, spread):
    """What a person is told of a `spread`."""
    mean, low, high = (rounded(each, 4) for each in (spread["mean"], *spread["bounds"]))
    ends = f"90 % of {spread['runs']} runs between {low} and {high}"
    deviation = f"standard deviation {rounded(spread['deviation'], 3)}"
    lines = [f"{label}: mean {mean}, {deviation}, {ends}"]
    for each in spread["effects"]:
        change = with_error(f"{each['change']:+.3g}", each["change"], each["error"], 1)
        where = f"{each['name']} from {each['low']:g} to {each['high']:g}"
        lines.append(f"  {where}: {change}, {percent(each['share'], 2)} of the variance")
    return "\n".join([*lines, f"  not by straight lines: {percent(spread['left'], 2)}"])


def told(
    runs: Sequence[Run], ranges: Sequence[Range], labels: Mapping[str, str], limits: Limits = ()
) -> tuple[list[str], dict]:
    """Sentences on the spread of the quantities {name: label} over believed runs, with the number
    of runs below each limit, and the same for sweep.json. Raises SolverFailure for too few runs."""
    sound = [run for run in runs if run.is_believed()]
    if len(sound) < len(ranges) + 3:
        raise SolverFailure(f"{len(sound)} of {len(runs)} runs are believed, too few to tell more")
    known = set.intersection(*(set(run.numbers()) for run in sound))
    names = [n for n in labels if n in known and all(math.isfinite(r.value(n)) for r in sound)]
    spreads = {name: spread(sound, ranges, name) for name in names}
    sentences = [_words(labels[name], each) for name, each in spreads.items()]
    for name, limit in limits:
        values = [y for run in sound if math.isfinite(y := run.value(name))]
        count = f"{sum(y < limit for y in values)} of {len(values)}"
        without = f", {n} have no value" if (n := len(sound) - len(values)) else ""
        sentences.append(f"{name} below {rounded(limit, 5)}: in {count} runs{without}")
    if lost := len(runs) - len(sound):
        sentences.append(f"{lost} of {len(runs)} runs are not believed and left out")
    return sentences, spreads
