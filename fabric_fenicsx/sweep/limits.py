"""Where a quantity is below a limit, between the runs of a sweep."""

import math
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from ..core.errors import InputError
from ..core.formatting import rounded
from .folder import Run
from .varied import is_wide, number, short_names, spelled


def limit_of(word: str) -> tuple[str, float]:
    """Quantity and number of "QUANTITY=NUMBER"; InputError for another form."""
    quantity, _, text = word.partition("=")
    limit = number(text)
    if not quantity or limit is None or not math.isfinite(limit):
        raise InputError(f"--below {word} is no quantity with a number; allowed is QUANTITY=NUMBER")
    return quantity, limit


def below(runs: Sequence[Run], quantity: str, limit: float) -> str:
    """Sentence on where `quantity` is below `limit`, over the one number that the runs vary, and
    how far the cells may be off. Between believed runs with a value it is linear, over the
    logarithm where numbers are far apart."""
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
    errors = [run.summary().get("error", {}).get(quantity) for run in runs if run.is_believed()]
    off = "all on these cells: `-- --error` tells how far they may be off, finer ones show it"
    if sizes := [abs(error) for error in errors if error is not None]:
        off = f"the cells' estimated error is up to {rounded(max(sizes), 2)}"
    return "; ".join([f"{asked}: {_where(x, y, limit, name)}", *notes, off])


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
