"""Table and report of a sweep, from the files of its runs."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from ..core.errors import NOT_BELIEVED
from ..core.files import csv_text, replace_file
from ..core.formatting import rounded
from ..results import report
from .folder import Run, SweepFolder, force_name
from .pictures import draw
from .varied import number, short_names


def write(sweep: SweepFolder, answers: Sequence[str] = (), pictures: bool = True) -> None:
    """Write table, pictures and report of the runs, `answers` on top of it."""
    captions = {
        "trends": "Headline quantities of runs at full load; a cross is one that is not believed",
        "curves": "Force over displacement of all runs; dashed is one that is not believed",
        "maps": "Shear angle, and shortening of both yarns",
    }
    runs = sorted(sweep.runs.values(), key=_place)
    replace_file(sweep.path / "table.csv", _table(runs))
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


def _table(runs):
    """table.csv: a row a run, with values, verdict, doubts and all of its numbers."""
    rows = []
    for run in runs:
        facts = {"run": run.folder.name, **run.values, "verdict": run.verdict()}
        facts |= {"converged": run.is_believed(), "reason": run.reason or "; ".join(run.doubts())}
        rows.append(facts | run.numbers())
    return csv_text(rows)


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
        "believed": run.is_believed(),
        "verdict": run.verdict() or "not run",
        "reason": reason,
        "doubts": run.doubts() if run.is_believed() else [],
        "report": str(page.relative_to(run.folder.parent)) if page.is_file() else "",
    }
