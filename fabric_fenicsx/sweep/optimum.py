"""The least value of a quantity over one or two numbers, and where a quantity is below a limit."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

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

    def together(self, places):
        """Have several places evaluated side by side."""
        values = {str(self.values(place)): self.values(place) for place in places}
        new = {key: each for key, each in values.items() if key not in self.found}
        if len(self.found) + len(new) > self.most:
            raise _Enough
        for key, run in zip(new, self.evaluate(list(new.values()))):
            value = run.number(self.quantity) if run.is_believed() else math.inf
            self.found[key] = run, value

    def __call__(self, shares):
        """The quantity at one place, inf where the run is not believed."""
        shares = np.atleast_1d(shares)
        self.together([shares])
        return self.found[str(self.values(shares))][1]


class Optimum(NamedTuple):
    """The run in which `quantity` is least, of several that with the lowest first number; notes:
    words on numbers at an end of their range, and on the others; of the `evaluations` `unbelieved`
    are not believed."""

    quantity: str
    run: Run
    value: float
    notes: list[str]
    evaluations: int
    unbelieved: int

    def words(self) -> str:
        """What a person is told."""
        text = f"least {self.quantity}: {rounded(self.value, 5)} at {self.run.label}, of "
        text += f"{self.evaluations} runs"
        if self.unbelieved:
            text += f" ({self.unbelieved} not believed, left out)"
        return "; ".join([text, *self.notes])

    def facts(self) -> dict[str, Any]:
        """What sweep.json keeps."""
        return {
            "quantity": self.quantity,
            "value": self.value,
            "values": dict(self.run.values),
            "notes": self.notes,
        }


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
                search.together([(0.0,), (1.0,)])
                fine = {"xatol": FINE, "maxiter": 10 * most}
                optimize.minimize_scalar(search, bounds=(0, 1), method="bounded", options=fine)
            else:
                search.together(FIRST)
                simplex = {"initial_simplex": FIRST, "xatol": FINE, "fatol": math.inf}
                bounds = [(0.0, 1.0)] * 2
                optimize.minimize(
                    search, FIRST[0], method="Nelder-Mead", bounds=bounds, options=simplex
                )
    except _Enough:
        pass
    found = list(search.found.values())
    value = min(each for _, each in found)
    key = ranges[0].key
    best = [run for run, each in found if each <= value + 1e-12 * abs(value)]
    run, *flat = sorted(best, key=lambda run: float(run.values[key]))
    if not math.isfinite(value):
        raise SolverFailure(f"none of {len(found)} runs is believed; table.csv has their reasons")
    unbelieved = sum(not math.isfinite(each) for _, each in found)
    notes = [text for each in ranges if (text := _end(each, float(run.values[each.key])))]
    if flat:
        notes.append(f"as little in {len(flat)} more, up to {flat[-1].label}")
    return Optimum(quantity, run, value, notes, len(found), unbelieved)


def _end(range_, value):
    """Words if `value` lies at an end of its range."""
    for end, name in ((range_.low, "lower"), (range_.high, "upper")):
        if math.isclose(value, end, rel_tol=1e-9):
            return (
                f"{range_.key} = {spelled(value)} is the {name} end of its range: the least may "
                "lie beyond"
            )
    return ""


def below(runs: Sequence[Run], quantity: str, limit: float) -> str:
    """Where `quantity` is below `limit`, in words, over the one number that the runs vary: between
    runs at full load it is linear, over the logarithm where numbers are far apart. Runs that are
    not believed, as where yarns shorten too much, count with a note.

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
    shown = np.log(x) if len(x) > 1 and is_wide(list(x)) else x
    notes = []
    if doubted := ", ".join(run.values[key] for run in whole if not run.is_believed()):
        notes.append(f"not believed: {name} = {doubted}")
    if lost := ", ".join(run.values[key] for run in ordered if run not in whole):
        notes.append(f"left out, as not at full load: {name} = {lost}")
    slopes = np.sign(np.diff(y))
    if (slopes > 0).any() and (slopes < 0).any():
        notes.append("it neither falls nor rises throughout: look at trends.png")
    notes.append(_how_good(whole, quantity))
    under = y < limit
    if not under.any():
        least = int(y.argmin())
        where = f"in no run; the least is {rounded(y[least], 4)} at {name} = {spelled(x[least])}"
        return "; ".join([f"{asked}: {where}", *notes])

    def crossing(k):
        share = (limit - y[k]) / (y[k + 1] - y[k])
        at = shown[k] + share * (shown[k + 1] - shown[k])
        return rounded(float(np.exp(at) if shown is not x else at), 4)

    first = int(under.argmax())
    begin = f"from {name} = {crossing(first - 1)} on" if first else ""
    after = np.flatnonzero(~under[first:])
    end = f"up to {name} = {crossing(first + after[0] - 1)}" if len(after) else ""
    where = " and ".join(filter(None, (begin, end))) or f"in all runs, from {name} = {x[0]:g} on"
    interpolated = " (between runs, interpolated)" if begin or end else ""
    return "; ".join([f"{asked}: {where}{interpolated}", *notes])


def _how_good(runs, quantity):
    """How far the cells may be off, in words."""
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
