"""What the runs of a sweep tell: where a quantity is below a limit over one number, and how it
scatters where several numbers do, and which of these matter."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import qmc

from ..core.errors import InputError, SolverFailure
from ..core.formatting import percent, rounded, with_error
from .folder import Run
from .varied import Range, Values, is_wide, number, short_names, spelled

BOUNDS = 0.05, 0.95  # quantiles
Limits = Sequence[tuple[str, float]]  # (quantity, what it is below)


def limit_of(word: str) -> tuple[str, float]:
    """Quantity and number of "QUANTITY=NUMBER"; InputError for another form."""
    quantity, _, text = word.partition("=")
    limit = number(text)
    if not quantity or limit is None or not math.isfinite(limit):
        raise InputError(f"--below {word} is no quantity with a number; allowed is QUANTITY=NUMBER")
    return quantity, limit


def below(runs: Sequence[Run], quantity: str, limit: float) -> str:
    """Sentence on where `quantity` is below `limit`, over the one number that the runs vary, and
    what is known of the error of their cells. Between believed runs with a value it is linear, over
    the logarithm where numbers are far apart."""
    (key,) = runs[0].values
    name, points, others = short_names([key])[key], [], defaultdict(list)
    for run in sorted(runs, key=lambda run: float(run.values[key])):
        if math.isfinite(value := run.value(quantity)):
            points.append((float(run.values[key]), value))
        else:
            doubt = "doubted, see the table" if run.doubts(quantity) else "without a value"
            why = doubt if run.is_believed() else "not believed"
            others[why].append(run.values[key])
    notes = [f"left out, as {why}: {name} = {', '.join(x)}" for why, x in others.items()]
    asked = f"{quantity} below {rounded(limit, 5)}"
    if not points:
        return "; ".join([f"{asked}: no run is believed and has a value", *notes])
    x, y = np.array(points).T
    slopes = np.sign(np.diff(y))
    if (slopes > 0).any() and (slopes < 0).any():
        notes.append("it neither falls nor rises throughout: look at trends.png")
    used = [run for run in runs if math.isfinite(run.value(quantity))]
    errors = [run.summary().get("error", {}).get(quantity) for run in used]
    sizes = [abs(error) for error in errors if error is not None]
    off = [f"estimated as up to {rounded(max(sizes), 2)}"] if sizes else []
    off += [f"not known in {n} of {len(used)} runs"] if (n := len(used) - len(sizes)) else []
    notes.append(f"only {name} was varied; the error of the cells is {', '.join(off)}")
    return "; ".join([f"{asked}: {_where(x, y, limit, name)}", *notes])


def _where(x, y, limit, name):
    """Where over x (n,) y (n,) is below the limit, in words."""
    under, wide = y < limit, len(x) > 1 and is_wide(list(x))
    if not under.any():
        least = int(y.argmin())
        return f"in no run; the least is {rounded(y[least], 4)} at {name} = {spelled(x[least])}"
    if under.all():
        return f"in all runs, from {name} = {x[0]:g} on"
    scale, ends = np.log(x) if wide else x, []
    for k in np.flatnonzero(np.diff(under)):
        at = scale[k] + (limit - y[k]) / (y[k + 1] - y[k]) * (scale[k + 1] - scale[k])
        place = f"{name} = {rounded(float(np.exp(at) if wide else at), 4)}"
        ends.append(f"from {place} on" if under[k + 1] else f"up to {place}")
    return f"{' and '.join(ends)} (between runs, interpolated)"


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
    error and the number's share of the variance.
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
    if left := ", ".join(labels[name] for name in labels if name in known.difference(names)):
        sentences.append(f"left out, as doubted or without a value in some runs: {left}")
    for name, limit in limits:
        values = [y for run in sound if math.isfinite(y := run.value(name))]
        count = f"{sum(y < limit for y in values)} of {len(values)}"
        without = f", {n} have no value" if (n := len(sound) - len(values)) else ""
        sentences.append(f"{name} below {rounded(limit, 5)}: in {count} runs{without}")
    if lost := len(runs) - len(sound):
        sentences.append(f"{lost} of {len(runs)} runs are not believed and left out")
    return sentences, spreads
