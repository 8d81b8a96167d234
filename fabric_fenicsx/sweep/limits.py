"""Where a quantity is below a limit, on the cells of the press and on finer ones."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from .folder import Run
from .varied import Values, is_wide, number, short_names, spelled


class Finer(NamedTuple):
    """A finer mesh: how a reader would write it, and what has the runs of values done on it."""

    label: str
    evaluate: Callable[[Sequence[Values]], list[Run]]


def limit_of(word: str) -> tuple[str, float]:
    """Quantity and number of "QUANTITY=NUMBER"; InputError for another form."""
    quantity, _, text = word.partition("=")
    limit = number(text)
    if not quantity or limit is None or not math.isfinite(limit):
        raise InputError(f"--below {word} is no quantity with a number; allowed is QUANTITY=NUMBER")
    return quantity, limit


def below(runs: Sequence[Run], quantity: str, limit: float, finer: Finer | None = None) -> str:
    """Sentence on where `quantity` is below `limit`, over the one number that the runs vary.
    Between believed runs with a value it is linear, over the logarithm where numbers are far apart.
    On the `finer` mesh the runs beside each crossing are run again, and as long as a run is on the
    other side there those beside it."""
    (key,) = runs[0].values
    runs = sorted(runs, key=lambda run: float(run.values[key]))
    values = [run.value(quantity) for run in runs]
    valued = [run for run, value in zip(runs, values) if math.isfinite(value)]
    name, asked = short_names([key])[key], f"{quantity} below {rounded(limit, 5)}"
    notes = []
    for why in dict.fromkeys(_why(run, quantity) for run in runs if run not in valued):
        others = [r.values[key] for r in runs if r not in valued and _why(r, quantity) == why]
        notes.append(f"left out, as {why}: {name} = {', '.join(others)}")
    if not valued:
        return "; ".join([f"{asked}: no run is believed and has a value", *notes])
    x = np.array([float(run.values[key]) for run in valued])
    y = np.array([value for value in values if math.isfinite(value)])
    where, ends = _where(x, y, limit, name)
    slopes = np.sign(np.diff(y))
    if (slopes > 0).any() and (slopes < 0).any():
        notes.append("it neither falls nor rises throughout: look at trends.png")
    if not finer:
        return "; ".join([f"{asked}: {where}", *notes, _accuracy(valued, quantity)])
    fine = _again(valued, y, quantity, limit, finer)
    is_known = np.isfinite(fine)
    again, fine_ends = _where(x[is_known], fine[is_known], limit, name)
    notes.append(f"on finer cells ({finer.label}) {again}")
    if ends and len(ends) == len(fine_ends):
        apart = max(abs(a - b) for a, b in zip(ends, fine_ends))
        notes.append(f"a difference of {rounded(apart, 2)}, about the error that is left")
    elif ends or fine_ends:
        notes.append("so the cells decide: take finer ones")
    return "; ".join([f"{asked}: {where}", *notes])


def _why(run, quantity):
    """Why a run has no value that is believed."""
    doubted = "doubted, see the table" if run.doubts(quantity) else "without a value"
    return doubted if run.is_believed() else "not believed"


def _again(runs, y, quantity, limit, finer):
    """The quantity with the values of the finer mesh where it was run, nan if not believed."""
    under, fine, done = y < limit, y.copy(), set[int]()
    crossings = np.flatnonzero(np.diff(under))
    todo = {*crossings.tolist(), *(crossings + 1).tolist()} or {int(abs(y - limit).argmin())}
    while todo:
        places = sorted(todo)
        for k, run in zip(places, finer.evaluate([runs[k].values for k in places])):
            fine[k] = run.value(quantity)
        done |= todo
        moved = [k for k in places if math.isnan(fine[k]) or (fine[k] < limit) != under[k]]
        todo = {n for k in moved for n in (k - 1, k + 1) if 0 <= n < len(runs)} - done
    return fine


def _where(x, y, limit, name):
    """The first interval of x in which y is below the limit, in words, and its ends."""
    if not len(y):
        return "no run is believed and has a value", []
    under, wide = y < limit, len(x) > 1 and is_wide(list(x))
    if not under.any():
        least = int(y.argmin())
        return f"in no run; the least is {rounded(y[least], 4)} at {name} = {spelled(x[least])}", []

    def crossing(k):
        share, shown = (limit - y[k]) / (y[k + 1] - y[k]), np.log(x) if wide else x
        at = shown[k] + share * (shown[k + 1] - shown[k])
        return float(np.exp(at) if wide else at)

    first = int(under.argmax())
    after = np.flatnonzero(~under[first:])[:1]
    ends = [crossing(first - 1)] if first else []
    ends += [crossing(first + k - 1) for k in after]
    if not ends:
        return f"in all runs, from {name} = {x[0]:g} on", []
    words = [f"from {name} = {rounded(ends[0], 4)} on"] if first else []
    words += [f"up to {name} = {rounded(ends[-1], 4)}"] if len(after) else []
    return f"{' and '.join(words)} (between runs, interpolated)", ends


def _accuracy(runs, quantity):
    """Sentence on the error of the cells."""
    errors = [run.summary().get("error", {}).get(quantity) for run in runs]
    sizes = [abs(error) for error in errors if error is not None]
    if not sizes:
        return "all on these cells: `-- --error` tells how far they may be off, finer ones show it"
    return f"the cells' estimated error is up to {rounded(max(sizes), 2)}"
