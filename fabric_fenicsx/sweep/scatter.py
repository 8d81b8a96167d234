"""Scatter of quantities over runs in which several numbers scatter, and which of these matter."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..runtime.errors import SolverFailure
from ..runtime.formatting import percent, rounded
from .folder import Run
from .varied import Range, Values, short_names, spelled

SEED = 1  # so that a design is the same in each call, and a larger one goes on with it
BOUNDS = 0.05, 0.95  # quantiles


class Effect(NamedTuple):
    """How much a quantity changes from the `low` to the `high` end of a number's interval, with its
    standard error, and the number's share of the quantity's variance."""

    name: str
    low: float
    high: float
    change: float
    error: float
    share: float


class Spread(NamedTuple):
    """A quantity over some `runs`: mean, standard deviation, quantiles `BOUNDS`, effects
    of the numbers, the largest first, and the share of the variance that these leave."""

    runs: int
    mean: float
    deviation: float
    bounds: tuple[float, float]
    effects: list[Effect]
    left: float

    def words(self, label: str) -> str:
        """What a person is told of it."""
        low, high = (rounded(each, 4) for each in self.bounds)
        head = f"{label}: mean {rounded(self.mean, 4)}, standard deviation "
        head += f"{rounded(self.deviation, 3)}, 90 % of {self.runs} runs between {low} and {high}"
        lines = [
            f"  {each.name} from {each.low:g} to {each.high:g}: {each.change:+.3g} "
            f"+- {rounded(each.error, 1)}, {percent(each.share, 2)} of the variance"
            for each in self.effects
        ]
        return "\n".join([head, *lines, f"  not by straight lines: {percent(self.left, 2)}"])


def design(ranges: Sequence[Range], count: int) -> list[Values]:
    """Values of a power of two of runs that fill the ranges evenly: Sobol's sequence, scrambled, of
    which a larger design has the smaller one as its beginning."""
    from scipy.stats import qmc  # takes long to import

    points = qmc.Sobol(len(ranges), seed=SEED).random_base2(count.bit_length() - 1)
    return [{r.key: spelled(r.at(share)) for r, share in zip(ranges, p)} for p in points]


def spread(runs: Sequence[Run], ranges: Sequence[Range], quantity: str) -> Spread:
    """The `Spread` of a quantity over believed runs. Effects are of the regression that is linear
    in all numbers at once, which few runs determine. What it leaves is told, so that a reader sees
    whether straight lines do; ranks, or Sobol' indices of a fitted surface, would hide that."""
    y = np.array([run.number(quantity) for run in runs])
    X = np.array([[r.share(float(run.values[r.key])) for r in ranges] for run in runs]) - 0.5
    A = np.column_stack([np.ones(len(y)), X])
    slopes = np.linalg.lstsq(A, y, rcond=None)[0]
    rest = ((y - A @ slopes) ** 2).sum() / (len(y) - A.shape[1])
    errors = np.sqrt(rest * np.diag(np.linalg.inv(A.T @ A)))
    parts = slopes[1:] ** 2 / 12  # variance of a straight line over evenly spread numbers
    whole = parts.sum() + rest or 1.0
    names = short_names([r.key for r in ranges]).values()
    effects = [
        Effect(name, r.low, r.high, float(b), float(e), float(share))
        for name, r, b, e, share in zip(names, ranges, slopes[1:], errors[1:], parts / whole)
    ]
    ordered = sorted(effects, key=lambda each: -each.share)
    mean, deviation, bounds = float(y.mean()), float(y.std(ddof=1)), np.quantile(y, BOUNDS)
    return Spread(len(y), mean, deviation, tuple(bounds.tolist()), ordered, rest / whole)


def told(
    runs: Sequence[Run],
    ranges: Sequence[Range],
    labels: Mapping[str, str],
    limits: Sequence[tuple[str, float]] = (),
) -> tuple[list[str], dict[str, Any]]:
    """Sentences on the spread of the quantities {name: label} over believed runs, with the number
    of runs below each limit, and the same for sweep.json. Raises SolverFailure for too few runs."""
    known = [run for run in runs if run.is_believed()]
    if len(known) < len(ranges) + 3:
        raise SolverFailure(f"{len(known)} of {len(runs)} runs are believed, too few to tell more")
    names = [name for name in labels if all(name in run.numbers() for run in known)]
    found = {name: spread(known, ranges, name) for name in names}
    sentences = [each.words(labels[name]) for name, each in found.items()]
    for name, limit in limits:
        count = sum(run.number(name) < limit for run in known)
        sentences.append(f"{name} below {rounded(limit, 5)}: in {count} of {len(known)} runs")
    if lost := len(runs) - len(known):
        left_out = f"{lost} of {len(runs)} runs are not believed and left out"
        sentences.append(f"{left_out}: what is told is of the others, of one side perhaps")
    facts = {
        name: s._asdict() | {"effects": [e._asdict() for e in s.effects]}
        for name, s in found.items()
    }
    return sentences, facts
