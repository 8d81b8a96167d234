"""The least value of a quantity over one or two numbers, and where a quantity is below a limit."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..runtime.errors import InputError, SolverFailure
from ..runtime.formatting import rounded
from .folder import Run
from .varied import Range, Values, is_wide, number, short_names, spelled

EVALUATIONS = 12  # for each number
FINE = 0.005  # of a range, below which the place of the least value is found
# of a range of two numbers, where the search begins: at three places side by side
FIRST = ((0.25, 0.25), (0.75, 0.35), (0.35, 0.75))
Evaluate = Callable[[Sequence[Values]], list[Run]]


class _Enough(Exception):
    """All evaluations are used."""


class _Search:
    """Evaluations of `quantity` at shares of `ranges`, each known once."""

    def __init__(self, ranges, quantity, evaluate, most):
        self.ranges, self.quantity, self.evaluate, self.most = ranges, quantity, evaluate, most
        self.found: dict[str, tuple[Run, float]] = {}

    def values(self, shares):
        return {each.key: spelled(each.at(share)) for each, share in zip(self.ranges, shares)}

    def side_by_side(self, places):
        """Evaluate several places at a time."""
        values = {str(found): found for found in map(self.values, places)}
        new = {key: each for key, each in values.items() if key not in self.found}
        if len(self.found) + len(new) > self.most:
            raise _Enough
        for key, run in zip(new, self.evaluate(list(new.values()))):
            value = run.number(self.quantity) if run.is_believed() else math.inf
            self.found[key] = run, value

    def __call__(self, shares):
        """The quantity at one place, inf where the run is not believed."""
        shares = np.atleast_1d(shares)
        self.side_by_side([shares])
        return self.found[str(self.values(shares))][1]


class Optimum(NamedTuple):
    """The `run` in which a quantity is least, with the lowest first number of several such; text:
    what a person is told; facts: what sweep.json keeps."""

    run: Run
    text: str
    facts: dict[str, object]


def minimise(
    ranges: Sequence[Range], quantity: str, evaluate: Evaluate, evaluations: int | None = None
) -> Optimum:
    """The least value of a quantity over one or two ranges, by `evaluate`, which has the runs of
    values done, several of them side by side.

    One number: both ends, then bounded minimisation by Brent's method; two: Nelder and Mead's
    simplex in the bounds (both of scipy). Runs that are not believed count as infinitely bad.
    Raises InputError for a quantity that runs do not have, SolverFailure if none is believed.
    """
    from scipy import optimize  # takes long to import

    most = evaluations or EVALUATIONS * len(ranges)
    search = _Search(ranges, quantity, evaluate, most)
    try:
        with np.errstate(invalid="ignore"):  # inf - inf
            if len(ranges) == 1:
                search.side_by_side([(0.0,), (1.0,)])
                fine = {"xatol": FINE, "maxiter": 10 * most}
                optimize.minimize_scalar(search, bounds=(0, 1), method="bounded", options=fine)
            else:
                search.side_by_side(FIRST)
                simplex = {"initial_simplex": FIRST, "xatol": FINE, "fatol": math.inf}
                how = {"method": "Nelder-Mead", "bounds": [(0.0, 1.0)] * 2, "options": simplex}
                optimize.minimize(search, FIRST[0], **how)
    except _Enough:
        pass
    return _best(ranges, quantity, list(search.found.values()))


def _best(ranges, quantity, found):
    """The `Optimum` of what was found, pairs of run and value."""
    value = min(each for _, each in found)
    if not math.isfinite(value):
        raise SolverFailure(f"none of {len(found)} runs is believed; table.csv has their reasons")
    best = [run for run, each in found if each <= value + 1e-12 * abs(value)]
    run, *others = sorted(best, key=lambda run: float(run.values[ranges[0].key]))
    unbelieved = sum(not math.isfinite(each) for _, each in found)
    notes = [
        f"{key} = {spelled(end)} is the {name} end of its range: the least may lie beyond"
        for key, *ends in ranges
        for end, name in zip(ends, ("lower", "upper"))
        if math.isclose(float(run.values[key]), end, rel_tol=1e-9)
    ]
    if others:
        notes.append(f"as little in {len(others)} more, up to {others[-1].label}")
    text = f"least {quantity}: {rounded(value, 5)} at {run.label}, of {len(found)} runs"
    text += f" ({unbelieved} not believed, left out)" if unbelieved else ""
    facts = {"quantity": quantity, "value": value, "values": dict(run.values), "notes": notes}
    return Optimum(run, "; ".join([text, *notes]), facts)


def below(runs: Sequence[Run], quantity: str, limit: float) -> str:
    """Sentence on where `quantity` is below `limit`, over the one number that the runs vary.

    Between runs at full load it is linear, over the logarithm where numbers are far apart. Runs
    that are not believed, as where yarns shorten too much, count with a note.

    Raises InputError for a quantity that a run does not have.
    """
    (key,) = runs[0].values
    ordered = sorted(runs, key=lambda run: float(run.values[key]))
    whole = [run for run in ordered if run.is_at_full_load()]
    name, asked = short_names([key])[key], f"{quantity} below {rounded(limit, 5)}"
    if not whole:
        return f"{asked}: no run came to full load"
    x = np.array([float(run.values[key]) for run in whole])
    y = np.array([run.number(quantity) for run in whole])
    notes = []
    if doubted := ", ".join(run.values[key] for run in whole if not run.is_believed()):
        notes.append(f"not believed: {name} = {doubted}")
    if lost := ", ".join(run.values[key] for run in ordered if run not in whole):
        notes.append(f"left out, as not at full load: {name} = {lost}")
    slopes = np.sign(np.diff(y))
    if (slopes > 0).any() and (slopes < 0).any():
        notes.append("it neither falls nor rises throughout: look at trends.png")
    return "; ".join([f"{asked}: {_where(x, y, limit, name)}", *notes, _accuracy(whole, quantity)])


def _where(x, y, limit, name):
    """The first interval of x in which y is below the limit, in words."""
    under, wide = y < limit, len(x) > 1 and is_wide(list(x))
    if not under.any():
        least = int(y.argmin())
        return f"in no run; the least is {rounded(y[least], 4)} at {name} = {spelled(x[least])}"

    def crossing(k):
        share, shown = (limit - y[k]) / (y[k + 1] - y[k]), np.log(x) if wide else x
        at = shown[k] + share * (shown[k + 1] - shown[k])
        return rounded(float(np.exp(at) if wide else at), 4)

    first = int(under.argmax())
    after = np.flatnonzero(~under[first:])
    ends = [f"from {name} = {crossing(first - 1)} on"] if first else []
    ends += [f"up to {name} = {crossing(first + after[0] - 1)}"] if len(after) else []
    if not ends:
        return f"in all runs, from {name} = {x[0]:g} on"
    return f"{' and '.join(ends)} (between runs, interpolated)"


def _accuracy(runs, quantity):
    """Sentence on the error of the cells."""
    errors = [run.summary().get("error", {}).get(quantity) for run in runs]
    known = [abs(error) for error in errors if error is not None]
    if not known:
        return "all on these cells: `-- --error` tells how far they may be off, finer ones show it"
    return f"the cells' estimated error is up to {rounded(max(known), 2)}"


def limit_of(word: str) -> tuple[str, float]:
    """Quantity and number of "QUANTITY=NUMBER"; InputError for another form."""
    quantity, _, text = word.partition("=")
    limit = number(text)
    if not quantity or limit is None or not math.isfinite(limit):
        raise InputError(f"--below {word} is no quantity with a number; allowed is QUANTITY=NUMBER")
    return quantity, limit
