"""Table, pictures and report of a sweep, from the files of its runs."""

import csv
import math
import textwrap
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ..core.errors import NOT_BELIEVED
from ..core.files import csv_text, replace_file
from ..core.formatting import rounded
from ..results import report, states
from ..results.pictures import curves, figure, maps
from .answers import BOUNDS
from .folder import Run, SweepFolder, force_name
from .varied import is_wide, label, number, short_names


def write(sweep: SweepFolder, answers: Sequence[str] = (), pictures: bool = True) -> None:
    """Write table, pictures and report of the runs, `answers` on top of it."""
    captions = {
        "trends": "Headline quantities of runs at full load; a cross is one that is not believed",
        "curves": "Force over displacement of all runs; dashed is one that is not believed",
        "maps": "Shear angle, and shortening of both yarns",
    }
    runs = sorted(sweep.runs.values(), key=_place)
    rows = [
        {"run": run.folder.name, **run.values, "verdict": run.verdict()}
        | {"converged": run.is_believed(), "reason": run.reason or "; ".join(run.doubts())}
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
        believed=sum(run.is_believed() for run in runs),
        pictures=[(captions[name], report.encoded(f)) for name, f in files.items() if f.is_file()],
        press=sweep.state["press"]["text"],
    )
    replace_file(sweep.path / "report.html", page)


def _place(run):
    values = [(number(text), text) for text in run.values.values()]
    return [(value is None, value or 0.0, text) for value, text in values]


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
    reason = run.reason.removeprefix(NOT_BELIEVED)
    texts = {n: "no value" if math.isnan(v) else rounded(v, 4) for n, v in run.numbers().items()}
    if (reached := run.summary().get("stroke_reached", 1.0)) < 1:
        reason = f"ended at load {rounded(reached)}: {reason}"
    page = run.results / "report.html"
    return {
        "values": [run.values.get(key, "") for key in keys],
        "numbers": [texts.get(name, "-") for name in names],
        **{"believed": run.is_believed(), "verdict": run.verdict() or "not run", "reason": reason},
        "doubts": run.doubts() if run.is_believed() else [],
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
    """Force over displacement of each run, or of believed ones of a design mean and bounds."""
    series = {}
    for run in (run for run in runs if (run.results / "history.csv").is_file()):
        rows = [*csv.DictReader((run.results / "history.csv").read_text().splitlines())]
        x, y = ([float(row[k]) for row in rows] for k in ("displacement_mm", "reaction_N"))
        if rows and (run.is_believed() or not scatter):
            series[run.label] = x, y, "-" if run.is_believed() else "--"
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
    a cross is a run that is not believed."""
    groups = defaultdict(list)
    for run in runs:
        groups[label({k: v for k, v in run.values.items() if k != key})].append(run)
    for k, (group, mine) in enumerate(groups.items()):
        colour = f"C{k if len(groups) <= most else 0}"
        x = [float(run.values[key]) for run in mine]
        y = [run.number(name) for run in mine]
        ax.plot(x, y, "-", lw=1.2, label=group, color=colour)
        for run, *point in zip(mine, x, y):
            ax.plot(*point, "o" if run.is_believed() else "x", ms=5, color=colour)
    if runs and is_wide([float(run.values[key]) for run in runs]):
        ax.set_xscale("log")
    if 1 < len(groups) <= most:
        ax.legend(fontsize="x-small")
    ax.grid(alpha=0.3)


def _draw_maps(path, runs, most=24):
    """A row of maps for each ply of each run, up to so many."""
    grids = {}
    for run in (run for run in runs if (run.results / "fields.pvd").is_file()):
        words = run.label + ("" if run.is_believed() else f" ({run.verdict()})")
        for ply, grid in states.of_fabric(states.read_grids(run.results)).items():
            grids[", ".join(filter(None, (words, ply)))] = grid
    if 0 < len(grids) <= most:
        maps(path, grids, ("shear_angle", "shortening_a", "shortening_b"))
