"""The least value of a quantity, where a quantity is below a limit, and both on a finer mesh."""

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
APART = 0.05  # of a range, between places at which the answer is sought on a finer mesh
# of a range of two numbers, where the search begins: at three places side by side
FIRST = ((0.25, 0.25), (0.75, 0.35), (0.35, 0.75))
BEYOND = 1e30  # the least that a run beyond a limit counts: more than any quantity
Evaluate = Callable[[Sequence[Values]], list[Run]]
Limits = Sequence[tuple[str, float]]  # quantities and what they are to be below


class Finer(NamedTuple):
    """A finer mesh: how a reader would write it, and what has the runs of values done on it."""

    label: str
    evaluate: Evaluate


class _Enough(Exception):
    """All evaluations are used."""


class _Search:
    """Evaluations of `merit`, a function of runs, at shares of `ranges`, each known once."""

    def __init__(self, ranges, merit, evaluate, most):
        self.ranges, self.merit, self.evaluate, self.most = ranges, merit, evaluate, most
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
            self.found[key] = run, self.merit(run)

    def __call__(self, shares):
        """The merit at one place."""
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
    ranges: Sequence[Range],
    quantity: str,
    evaluate: Evaluate,
    evaluations: int | None = None,
    limits: Limits = (),
    finer: Finer | None = None,
) -> Optimum:
    """The least value of a quantity over one or two ranges, of runs that keep to the `limits`, by
    `evaluate`, which has the runs of values done, several of them side by side.

    One number: both ends, then bounded minimisation by Brent's method; two: Nelder and Mead's
    simplex in the bounds (both of scipy). Runs that are not believed count as infinitely bad, those
    beyond a limit as worse the further they are. On the `finer` mesh the best place and those about
    it are run again, until the least is among them. Raises SolverFailure if no run is believed, or
    none keeps to the limits.
    """
    from scipy import optimize  # takes long to import

    def merit(run):
        if not run.is_believed():
            return math.inf
        over = [(run.number(name) - limit) / (abs(limit) or 1.0) for name, limit in limits]
        worst = max(over, default=-1.0)
        return run.number(quantity) if worst < 0 else BEYOND * (1 + worst)

    most = evaluations or EVALUATIONS * len(ranges)
    search = _Search(ranges, merit, evaluate, most)
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
    found = list(search.found.values())
    best = _best(ranges, quantity, found, limits)
    if not finer:
        return best
    return _checked(best, _finer_runs(ranges, best.run, found, merit, finer), finer)


def _best(ranges, quantity, found, limits):
    """The `Optimum` of what was found, pairs of run and merit."""
    value = min(merit for _, merit in found)
    best = [run for run, merit in found if merit <= value + 1e-12 * abs(value)]
    run, *others = sorted(best, key=lambda run: float(run.values[ranges[0].key]))
    if not math.isfinite(value):
        raise SolverFailure(f"none of {len(found)} runs is believed; table.csv has their reasons")
    kept = " and ".join(f"{name} below {rounded(limit, 5)}" for name, limit in limits)
    if value >= BEYOND:
        raise SolverFailure(f"no run of {len(found)} has {kept}; the nearest is {run.label}")
    unbelieved = sum(not math.isfinite(merit) for _, merit in found)
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
    text += f" with {kept}" if kept else ""
    facts = {"quantity": quantity, "value": value, "values": dict(run.values), "notes": notes}
    return Optimum(run, "; ".join([text, *notes]), facts)


def _finer_runs(ranges, best, found, merit, finer):
    """Pairs of run and merit on the finer mesh: at the best place and at those next to it that are
    `APART`, on from there as long as the least is at another place, and, of one number, between
    the places next to the least."""

    def place(run):
        return np.array([each.share(float(run.values[each.key])) for each in ranges])

    runs = [best]
    others = [run for run, value in found if math.isfinite(value)]
    for run in sorted(others, key=lambda run: np.linalg.norm(place(run) - place(best))):
        if all(np.linalg.norm(place(run) - place(each)) >= APART for each in runs):
            runs.append(run)
    places = np.array([place(run) for run in runs])
    search, merits, least = _Search(ranges, merit, finer.evaluate, math.inf), dict[int, float](), 0
    while todo := sorted({least, *_next_to(places, least)} - merits.keys()):
        search.side_by_side(places[todo])
        merits |= {k: search(places[k]) for k in todo}
        least = min(merits, key=merits.__getitem__)
    if len(ranges) == 1:
        from scipy import optimize

        about = places[[least, *_next_to(places, least)], 0]
        ends, fine = (min(about), max(about)), {"xatol": APART}
        with np.errstate(invalid="ignore"):  # inf - inf
            optimize.minimize_scalar(search, bounds=ends, method="bounded", options=fine)
    return list(search.found.values())


def _next_to(places, k):
    """Numbers of the places next to place k: one on each side, of two numbers the three nearest."""
    away = places - places[k]
    order = np.linalg.norm(away, axis=1).argsort(kind="stable")[1:]
    if places.shape[1] == 2:
        return order[:3].tolist()
    sides = ([n for n in order if sign * away[n, 0] > 0] for sign in (-1, 1))
    return [int(side[0]) for side in sides if side]


def _checked(best, again, finer):
    """The `Optimum` with what the finer mesh says of it."""
    quantity, coarse = best.facts["quantity"], best.facts["value"]
    run, value = min(again, key=lambda pair: pair[1])
    if value >= BEYOND:
        why = "keeps to the limits" if math.isfinite(value) else "is believed"
        said, facts = f"none of {len(again)} runs {why}", {}
    else:
        said = f"{rounded(value, 5)} at {run.label}, of {len(again)} runs: a difference of "
        said += f"{rounded(abs(value - coarse), 2)}, about the error that is left"
        facts = {"value": value, "values": dict(run.values)}
    text = f"{best.text}; on finer cells ({finer.label}) {quantity} is {said}"
    return best._replace(text=text, facts=best.facts | {"finer": facts})


def below(runs: Sequence[Run], quantity: str, limit: float, finer: Finer | None = None) -> str:
    """Sentence on where `quantity` is below `limit`, over the one number that the runs vary.
    Between runs that are believed it is linear, over the logarithm where numbers are far apart. On
    the `finer` mesh the runs beside each crossing are run again, and as long as a run is on the
    other side there those beside it."""
    (key,) = runs[0].values
    ordered = sorted(runs, key=lambda run: float(run.values[key]))
    known = [run for run in ordered if run.is_believed()]
    name, asked = short_names([key])[key], f"{quantity} below {rounded(limit, 5)}"
    if not known:
        return f"{asked}: no run is believed"
    x = np.array([float(run.values[key]) for run in known])
    y = np.array([run.number(quantity) for run in known])
    where, ends = _where(x, y, limit, name)
    notes = []
    if lost := ", ".join(run.values[key] for run in ordered if run not in known):
        notes.append(f"left out, as not believed: {name} = {lost}")
    slopes = np.sign(np.diff(y))
    if (slopes > 0).any() and (slopes < 0).any():
        notes.append("it neither falls nor rises throughout: look at trends.png")
    if not finer:
        return "; ".join([f"{asked}: {where}", *notes, _accuracy(known, quantity)])
    fine = y.copy()
    for k, value in _again(known, quantity, limit, finer).items():
        fine[k] = value
    is_known = np.isfinite(fine)
    again, fine_ends = _where(x[is_known], fine[is_known], limit, name)
    notes.append(f"on finer cells ({finer.label}) {again}")
    if ends and len(ends) == len(fine_ends):
        apart = max(abs(a - b) for a, b in zip(ends, fine_ends))
        notes.append(f"a difference of {rounded(apart, 2)}, about the error that is left")
    elif ends or fine_ends:
        notes.append("so the cells decide: take finer ones")
    return "; ".join([f"{asked}: {where}", *notes])


def _again(runs, quantity, limit, finer):
    """The quantity on the finer mesh {number of the run: value, nan if not believed}."""
    y = np.array([run.number(quantity) for run in runs])
    under, found = y < limit, dict[int, float]()
    crossings = np.flatnonzero(np.diff(under))
    todo = {*crossings.tolist(), *(crossings + 1).tolist()} or {int(abs(y - limit).argmin())}
    while todo:
        places = sorted(todo)
        for k, run in zip(places, finer.evaluate([runs[k].values for k in places])):
            found[k] = run.number(quantity) if run.is_believed() else math.nan
        kept = [math.isfinite(found[k]) and (found[k] < limit) == under[k] for k in places]
        moved = [k for k, same in zip(places, kept) if not same]
        todo = {n for k in moved for n in (k - 1, k + 1) if 0 <= n < len(runs)} - found.keys()
    return found


def _where(x, y, limit, name):
    """The first interval of x in which y is below the limit, in words, and its ends."""
    under, wide = y < limit, len(x) > 1 and is_wide(list(x))
    if not under.any():
        if not len(y):
            return "no run is believed", []
        least = int(y.argmin())
        return f"in no run; the least is {rounded(y[least], 4)} at {name} = {spelled(x[least])}", []

    def crossing(k):
        share, shown = (limit - y[k]) / (y[k + 1] - y[k]), np.log(x) if wide else x
        at = shown[k] + share * (shown[k + 1] - shown[k])
        return float(np.exp(at) if wide else at)

    first = int(under.argmax())
    after = np.flatnonzero(~under[first:])
    ends = [crossing(first - 1)] if first else []
    words = [f"from {name} = {rounded(ends[0], 4)} on"] if first else []
    if len(after):
        ends.append(crossing(first + after[0] - 1))
        words.append(f"up to {name} = {rounded(ends[-1], 4)}")
    if not ends:
        return f"in all runs, from {name} = {x[0]:g} on", []
    return f"{' and '.join(words)} (between runs, interpolated)", ends


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
