"""What the runs of a sweep tell: where a quantity is below a limit over one number, how it scatters
where several numbers do and which of these matter; their table, pictures and report."""

import csv
import math
import textwrap
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from ..core.errors import NOT_VALID, InputError, SolverFailure
from ..core.files import csv_text, replace_file
from ..core.formatting import percent, rounded, with_error
from ..results import report, states
from ..results.pictures import curves, figure, maps
from .folder import Range, Run, SweepFolder, Values, is_wide, label, number, short_names, spelled

BOUNDS = 0.05, 0.95  # quantiles
Limits = Sequence[tuple[str, float]]  # (quantity, what it is below)


def limit_of(word: str) -> tuple[str, float]:
    """Quantity and number of "QUANTITY=NUMBER"; InputError for another form."""
    quantity, _, text = word.partition("=")
    limit = number(text)
    if not quantity or limit is None or not math.isfinite(limit):
        raise InputError(f"--below {word} is not a quantity and a number; expected QUANTITY=NUMBER")
    return quantity, limit


def below(runs: Sequence[Run], quantity: str, limit: float) -> str:
    """Sentence on where `quantity` is below `limit`, over the one number that the runs vary, and
    what is known of the error of their cells. Between valid runs with a value it is linear, over
    the logarithm where numbers are far apart."""
    (key,) = runs[0].values
    name, points, others = short_names([key])[key], [], defaultdict(list)
    for run in sorted(runs, key=lambda run: float(run.values[key])):
        if math.isfinite(value := run.value(quantity)):
            points.append((float(run.values[key]), value))
        else:
            doubt = "doubtful, see the table" if run.doubts(quantity) else "without a value"
            others[doubt if run.is_valid() else "not valid"].append(run.values[key])
    notes = [f"left out ({why}): {name} = {', '.join(x)}" for why, x in others.items()]
    asked = f"{quantity} below {rounded(limit, 5)}"
    if not points:
        return "; ".join([f"{asked}: no valid run has a value", *notes])
    x, y = np.array(points).T
    slopes = np.sign(np.diff(y))
    if (slopes > 0).any() and (slopes < 0).any():
        notes.append("it is not monotonic: see trends.png")
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
    """A quantity over valid runs: how many they are, mean, standard deviation, quantiles
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
    """Sentences on a `spread`."""
    mean, low, high = (rounded(each, 4) for each in (spread["mean"], *spread["bounds"]))
    ends = f"90 % of {spread['runs']} runs between {low} and {high}"
    deviation = f"standard deviation {rounded(spread['deviation'], 3)}"
    lines = [f"{label}: mean {mean}, {deviation}, {ends}"]
    for each in spread["effects"]:
        change = with_error(f"{each['change']:+.3g}", each["change"], each["error"], 1)
        where = f"{each['name']} from {each['low']:g} to {each['high']:g}"
        lines.append(f"  {where}: {change}, {percent(each['share'], 2)} of the variance")
    return "\n".join([*lines, f"  not explained linearly: {percent(spread['left'], 2)}"])


def statistics(
    runs: Sequence[Run], ranges: Sequence[Range], labels: Mapping[str, str], limits: Limits = ()
) -> tuple[list[str], dict]:
    """Sentences on the spread of the quantities {name: label} over valid runs, with the number
    of runs below each limit, and the same for sweep.json. Raises SolverFailure for too few runs."""
    sound = [run for run in runs if run.is_valid()]
    if len(sound) < len(ranges) + 3:
        raise SolverFailure(f"{len(sound)} of {len(runs)} runs are valid, too few for statistics")
    known = set.intersection(*(set(run.numbers()) for run in sound))
    names = [n for n in labels if n in known and all(math.isfinite(r.value(n)) for r in sound)]
    spreads = {name: spread(sound, ranges, name) for name in names}
    sentences = [_words(labels[name], each) for name, each in spreads.items()]
    if left := ", ".join(labels[name] for name in labels if name in known.difference(names)):
        sentences.append(f"left out, because doubtful or without a value in some runs: {left}")
    for name, limit in limits:
        values = [y for run in sound if math.isfinite(y := run.value(name))]
        count = f"{sum(y < limit for y in values)} of {len(values)}"
        without = f", {n} have no value" if (n := len(sound) - len(values)) else ""
        sentences.append(f"{name} below {rounded(limit, 5)}: in {count} runs{without}")
    if lost := len(runs) - len(sound):
        sentences.append(f"{lost} of {len(runs)} runs are not valid and left out")
    return sentences, spreads


def write(sweep: SweepFolder, answers: Sequence[str] = (), pictures: bool = True) -> None:
    """Write table, pictures and report of the runs, `answers` on top of it."""
    captions = {
        "trends": "Headline quantities of runs at full load; crosses are invalid",
        "curves": "Force against displacement of all runs; dashed lines are invalid",
        "maps": "Shear angle, and shortening of both yarns",
    }
    runs = sorted(sweep.runs.values(), key=_place)
    rows = [
        {"run": run.folder.name, **run.values, "verdict": run.verdict()}
        | {"converged": run.is_valid(), "reason": run.reason or "; ".join(run.doubts())}
        | run.numbers()
        for run in runs
    ]
    replace_file(sweep.path / "table.csv", csv_text(rows))
    columns = headlines(runs, sweep.state.get("asked", ()))
    files = {name: sweep.path / f"{name}.png" for name in captions}
    if pictures:
        draw(files, [run for run in runs if run.summary()], columns, "scatter" in sweep.state)
    keys = short_names([*dict.fromkeys(key for run in runs for key in run.values)])
    page = report.rendered(
        Path(__file__).with_name("sweep.html.jinja"),
        title=f"Sweep: {sweep.title}",
        answers=answers,
        keys=list(keys.values()),
        columns=list(columns.values()),
        rows=[_row(run, keys, columns) for run in runs],
        valid=sum(run.is_valid() for run in runs),
        pictures=[(captions[name], report.encoded(f)) for name, f in files.items() if f.is_file()],
        press=sweep.state["press"]["text"],
    )
    replace_file(sweep.path / "report.html", page)


def _place(run):
    values = [(number(text), text) for text in run.values.values()]
    return [(value is None, value or 0.0, text) for value, text in values]


def force_name(runs: Iterable[Run]) -> str:
    """Name of the runs' force, if it is the same in all, else "force"."""
    names = {run.summary().get("reaction_is", "force") for run in runs if run.summary()}
    return names.pop() if len(names) == 1 else "force"


def headlines(runs: Iterable[Run], asked: Sequence[str] = ()) -> dict[str, str]:
    """Headline quantities {name: label} that any of the runs has, those `asked` for first."""
    measured = {name for run in runs for name in run.numbers()}
    labels = report.HEADLINES | {
        "reaction_N": f"{force_name(runs)} [N]",
        "shortening_mean": "mean shortening of yarns [-]",
        "excess_length_mm": "length lost by a yarn [mm]",
    }
    names = dict.fromkeys([*asked, *labels])
    return {name: labels.get(name, name) for name in names if name in measured}


def _row(run, keys, names):
    reason = run.reason.removeprefix(NOT_VALID)
    texts = {n: "no value" if math.isnan(v) else rounded(v, 4) for n, v in run.numbers().items()}
    if (reached := run.summary().get("stroke_reached", 1.0)) < 1:
        reason = f"ended at load {rounded(reached)}: {reason}"
    page = run.results / "report.html"
    return {
        "values": [run.values.get(key, "") for key in keys],
        "numbers": [texts.get(name, "-") for name in names],
        **{"valid": run.is_valid(), "verdict": run.verdict() or "not run", "reason": reason},
        "doubts": run.doubts() if run.is_valid() else [],
        "report": str(page.relative_to(run.folder.parent)) if page.is_file() else "",
    }


def draw(
    files: Mapping[str, Path], runs: Sequence[Run], names: Mapping[str, str], scatter: bool = False
) -> None:
    """Draw curves, trends {quantity: label} and maps of runs with results into `files`, each where
    there is something to draw; scatter: True of runs of a design, of which no maps are drawn."""
    for file in files.values():
        file.unlink(missing_ok=True)
    _draw_curves(files["curves"], runs, scatter)
    _draw_trends(files["trends"], runs, dict(list(names.items())[:6]))  # as many as fit a page
    if not scatter:
        _draw_maps(files["maps"], runs)


def _draw_curves(path, runs, scatter):
    """Force over displacement of each run, or of valid ones of a design mean and bounds."""
    series = {}
    for run in (run for run in runs if (run.results / "history.csv").is_file()):
        rows = [*csv.DictReader((run.results / "history.csv").read_text().splitlines())]
        x, y = ([float(row[k]) for row in rows] for k in ("displacement_mm", "reaction_N"))
        if rows and (run.is_valid() or not scatter):
            series[run.label] = x, y, "-" if run.is_valid() else "--"
    if series and scatter:
        x, *_ = next(iter(series.values()))
        forces = np.array([np.interp(x, at, force) for at, force, _ in series.values()])
        series = {"mean": (x, forces.mean(0), "-")}
        for share, bound in zip(BOUNDS, np.quantile(forces, BOUNDS, axis=0)):
            series[f"{100 * share:g} % of runs below"] = x, bound, "--"
    if series:
        curves(path, series, "displacement / mm", f"{force_name(runs)} / N")


def _draw_trends(path, runs, names):
    """A row of panels a quantity, with one for each key whose values are numbers."""
    runs = [run for run in runs if run.is_at_full_load()]
    keys = list(runs[0].values) if runs else []
    keys = [key for key in keys if None not in [number(run.values[key]) for run in runs]]
    if not (keys and names):
        return
    size, shared = (2.6 * len(keys) + 1.6, 2.4 * len(names)), {"sharex": "col", "sharey": "row"}
    with figure(path, size, len(names), len(keys), **shared) as (_, axes):
        for row, (name, title) in zip(axes, names.items()):
            for ax, key in zip(row, keys):
                _draw_trend(ax, [run for run in runs if name in run.numbers()], key, name)
            row[0].set_ylabel(textwrap.fill(title, 22))
        for ax, key in zip(axes[-1], keys):
            ax.set_xlabel(key)


def _draw_trend(ax, runs, key, name, most=8):
    """A quantity over a key, with a line for each values of the others, in a legend up to `most`;
    a cross is a run that is not valid."""
    groups = defaultdict(list)
    for run in runs:
        groups[label({k: v for k, v in run.values.items() if k != key})].append(run)
    for k, (group, mine) in enumerate(groups.items()):
        colour = f"C{k if len(groups) <= most else 0}"
        x = [float(run.values[key]) for run in mine]
        y = [run.number(name) for run in mine]
        ax.plot(x, y, "-", lw=1.2, label=group, color=colour)
        for run, *point in zip(mine, x, y):
            ax.plot(*point, "o" if run.is_valid() else "x", ms=5, color=colour)
    if runs and is_wide([float(run.values[key]) for run in runs]):
        ax.set_xscale("log")
    if 1 < len(groups) <= most:
        ax.legend(fontsize="small")
    ax.grid(alpha=0.3)


def _draw_maps(path, runs, most=24):
    """A row of maps for each ply of each run, up to so many."""
    grids = {}
    for run in (run for run in runs if (run.results / "fields.pvd").is_file()):
        words = run.label + ("" if run.is_valid() else f" ({run.verdict()})")
        for ply, grid in states.of_fabric(states.read_grids(run.results)).items():
            grids[", ".join(filter(None, (words, ply)))] = grid
    if 0 < len(grids) <= most:
        maps(path, grids, ("shear_angle", "shortening_a", "shortening_b"))
