"""What a sweep's folder shows of its runs: table.csv, pictures and report.html.

Numbers are read from the runs' files. Maps read their fields, which needs DOLFINx.
"""

import base64
import csv
import io
import textwrap
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import jinja2

from ..runtime.errors import NOT_BELIEVED
from ..runtime.files import replace_file
from ..runtime.formatting import rounded
from .folder import Run, SweepFolder
from .varied import is_wide, label, number, short_names

# what a person looks at first, where a run has it
HEADLINES = {
    "reaction_N": "force [N]",
    "shear_angle_max_deg": "largest shear angle [deg]",
    "wrinkles.shortening": "mean shortening of yarns [-]",
    "shortening_max": "largest shortening of yarns [-]",
    "excess_length_mm": "length lost by a yarn [mm]",
    "draw_in.largest_mm": "largest draw-in [mm]",
    "wrinkles.slope_largest_deg": "largest slope of wrinkles [deg]",
    "shear_angle_99_percent_deg": "shear angle, 99 % of the area below [deg]",
}
PANELS = 6
CAPTIONS = {
    "trends": "Headline quantities over what is varied; of runs at full load; a cross is one "
    "that is not believed",
    "curves": "Force over displacement of all runs; dashed is one that is not believed",
    "maps": "Magnitude of the shear angle, and shortening of yarns (the larger of both), seen from "
    "above [mm], on one scale",
}
COLUMNS = 6  # of maps side by side


def write(
    sweep: SweepFolder, title: str, answers: Sequence[str] = (), pictures: bool = True
) -> None:
    """Write table, pictures and report of the runs of a sweep that have any result; answers:
    sentences on top of the report, on quantities {name} that are headlines then, too."""
    runs = ordered([run for run in sweep.runs.values() if run.summary()])
    write_table(sweep.path / "table.csv", list(sweep.runs.values()))
    if pictures and runs:
        draw(sweep.path, runs, list(sweep.facts.get("asked", ())))
    replace_file(sweep.path / "report.html", page(sweep, title, answers))


def ordered(runs: Sequence[Run]) -> list[Run]:
    """The runs by their values: numbers by size, before texts."""

    def place(run):
        found = [(number(text), text) for text in run.values.values()]
        return [(value is None, value or 0.0, text) for value, text in found]

    return sorted(runs, key=place)


def write_table(path: Path, runs: Sequence[Run]) -> None:
    """table.csv: a row a run with its folder, values, whether it is believed or why not, and all
    of its numbers."""
    rows = []
    for run in ordered(runs):
        facts = {"run": run.folder.name, **run.values, "converged": run.is_believed()}
        rows.append(facts | {"reason": run.reason} | run.numbers())
    text = io.StringIO(newline="")
    columns = dict.fromkeys(key for row in rows for key in row)
    writer = csv.DictWriter(text, columns, restval="")
    writer.writeheader()
    writer.writerows(rows)
    replace_file(path, text.getvalue())


def headlines(runs: Sequence[Run], asked: Sequence[str] = ()) -> dict[str, str]:
    """Headline quantities {name: label} that any of the runs has, those `asked` for first."""
    known = {name for run in runs for name in run.numbers()}
    names = dict.fromkeys(asked) | HEADLINES
    told = HEADLINES | {"reaction_N": f"{_force_name(runs)} [N]"}
    return {name: told.get(name) or name for name in names if name in known}


def _force_name(runs):
    """What the force is of, if it is the same in all runs."""
    names = {run.summary().get("reaction_is", "force") for run in runs if run.summary()}
    return names.pop() if len(names) == 1 else "force"


def draw(folder: Path, runs: Sequence[Run], asked: Sequence[str] = ()) -> None:
    """curves.png, trends.png and maps.png of runs with results, each where there is something to
    draw."""
    for name in CAPTIONS:
        (folder / f"{name}.png").unlink(missing_ok=True)
    _draw_curves(folder / "curves.png", runs)
    _draw_trends(folder / "trends.png", runs, headlines(runs, asked))
    _draw_maps(folder / "maps.png", runs)


def _history(run):
    """Displacements and forces of a run."""
    try:
        with open(run.folder / "history.csv", newline="") as file:
            rows = [
                (float(r["displacement_mm"]), float(r["reaction_N"])) for r in csv.DictReader(file)
            ]
    except (OSError, KeyError, ValueError):
        rows = []
    return tuple(zip(*rows)) or ((), ())


def _draw_curves(path, runs):
    from ..plot.pictures import curves

    styles = {True: "-", False: "--"}
    series = {run.label: (*_history(run), styles[run.is_believed()]) for run in runs}
    series = {name: curve for name, curve in series.items() if curve[0]}
    if series:
        curves(path, series, "displacement / mm", f"{_force_name(runs)} / N")


def _draw_trends(path, runs, names):
    keys = list(runs[0].values)
    if len(keys) > 2 or any(number(run.values[key]) is None for run in runs for key in keys[:1]):
        return
    from ..plot.pictures import plt

    names = dict(list(names.items())[:PANELS])
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    size = 4.2 * columns, 3.0 * rows + 0.4
    figure, axes = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    for ax, (name, title) in zip(axes.flat, names.items()):
        _draw_trend(ax, runs, name)
        ax.set(ylabel=textwrap.fill(title, 26), xlabel=keys[0])
        ax.grid(alpha=0.3)
    for ax in axes.flat[len(names) :]:
        ax.remove()
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _draw_trend(ax, runs, name):
    """A quantity at full load over the first key, with a line for each value of the second one."""
    first, *second = runs[0].values
    groups: dict[str, list[Run]] = {}
    for run in runs:
        if run.is_at_full_load() and name in run.numbers():
            groups.setdefault(label({k: run.values[k] for k in second}), []).append(run)
    for group, mine in groups.items():
        points = [(float(run.values[first]), run.numbers()[name]) for run in mine]
        marks = [run.is_believed() for run in mine]
        (line,) = ax.plot(*zip(*points), "-", lw=1.2, label=group)
        for mark, believed in (("o", True), ("x", False)):
            some = [point for point, each in zip(points, marks) if each == believed]
            ax.plot(*(zip(*some) if some else ((), ())), mark, ms=5, color=line.get_color())
    places = sorted({float(run.values[first]) for run in runs})
    if is_wide(places):
        ax.set_xscale("log")
        ax.minorticks_off()
    if len(places) <= 6:
        ax.set_xticks(places, [f"{place:g}" for place in places])
    if second and 1 < len(groups) <= 8:
        ax.legend(fontsize="x-small")


def _sheets(runs):
    """{folder: polygons and fields {label: values} of the run's last state}, the uppermost last."""
    import numpy as np

    from ..plot.pictures import cell_polygons
    from ..postprocess.states import read_last

    found = {}
    for run in runs:
        if not (run.folder / "fields.pvd").is_file():
            continue
        grid = read_last(run.folder)
        cells = grid.cells.reshape(grid.n_cells, -1)[:, 1:]
        heights = (grid.points[:, 2] + grid.point_data["u"][:, 2])[cells].mean(1)
        order = np.argsort(heights, kind="stable")
        unknown = np.full(grid.n_cells, np.nan)  # as of metal
        shear, a, b = (
            np.asarray(grid.cell_data[name]) if name in grid.cell_data else unknown
            for name in ("shear_angle", "shortening_a", "shortening_b")
        )
        values = {
            "shear angle / deg": abs(np.degrees(shear))[order],
            "shortening of yarns / %": 100 * np.maximum(a, b)[order],
        }
        found[run.folder.name] = cell_polygons(grid)[order], values
    return found


def _draw_maps(path, runs):
    sheets = _sheets(runs)
    if not sheets:
        return
    import numpy as np
    from matplotlib.collections import PolyCollection

    from ..plot.pictures import colour_scale, plt

    titles = {run.folder.name: run for run in runs}
    names = [
        name
        for name in next(iter(sheets.values()))[1]
        if any(np.isfinite(values[name]).any() for _, values in sheets.values())
    ]
    columns = _columns(runs) if len(sheets) == len(runs) else min(COLUMNS, len(sheets))
    rows = -(-len(sheets) // columns)
    points = [polygons.reshape(-1, 2) for polygons, _ in sheets.values()]
    length, width = np.max([np.ptp(each, axis=0) for each in points], axis=0)
    size = 2.6 * columns + 1.0, (2.5 * width / length + 0.45) * rows * len(names) + 0.5
    how = {"squeeze": False, "sharex": True, "sharey": True, "layout": "constrained"}
    figure, axes = plt.subplots(rows * len(names), columns, figsize=size, **how)
    for k, name in enumerate(names):
        mine = axes[k * rows : (k + 1) * rows]
        every = np.concatenate([values[name] for _, values in sheets.values()])
        colours = "viridis" if name.startswith("shear") else "magma_r"
        _, *limits = colour_scale(colours, 0.0, float(np.nanmax(every)))
        for ax, (folder, (polygons, values)) in zip(mine.flat, sheets.items()):
            cells = PolyCollection(polygons, array=values[name], cmap=colours, antialiased=False)
            cells.set_clim(*limits)
            ax.add_collection(cells)
            ax.autoscale_view()
            ax.set_aspect("equal")
            ax.set_title(titles[folder].label + _doubt(titles[folder]), fontsize="x-small")
        for ax in mine.flat[len(sheets) :]:
            ax.set_axis_off()
        figure.colorbar(cells, ax=list(mine.flat), label=name, shrink=0.9)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _doubt(run):
    """Words behind the name of a run that is not believed."""
    if run.is_believed():
        return ""
    reached = run.summary().get("stroke_reached", 1.0)
    return " (not believed)" if reached >= 1 else f" (ended at load {rounded(reached)})"


def _columns(runs):
    """Maps in a row: all values of the last key where two keys make a full table, else what
    fits."""
    counts = [len({run.values[key] for run in runs}) for key in runs[0].values]
    full = len(counts) == 2 and counts[0] * counts[1] == len(runs)
    return counts[1] if full and counts[1] <= 2 * COLUMNS else min(COLUMNS, len(runs))


def page(sweep: SweepFolder, title: str, answers: Sequence[str] = ()) -> str:
    """report.html, with its pictures in it and links to the runs' own reports."""
    runs = ordered(list(sweep.runs.values()))
    environment = jinja2.Environment(loader=jinja2.PackageLoader(__package__, "."), autoescape=True)
    environment.trim_blocks = environment.lstrip_blocks = True
    shown = headlines(runs, list(sweep.facts.get("asked", ())))
    rows = [_row(run, list(shown)) for run in runs]
    files = {caption: sweep.path / f"{name}.png" for name, caption in CAPTIONS.items()}
    return environment.get_template("sweep.html.jinja").render(
        title=title,
        answers=answers,
        keys=list(short_names(sweep.keys).values()),
        columns=list(shown.values()),
        rows=rows,
        ended=sum(bool(run.summary()) for run in runs),
        believed=sum(run.is_believed() for run in runs),
        pictures=[
            (caption, base64.b64encode(file.read_bytes()).decode())
            for caption, file in files.items()
            if file.is_file()
        ],
        press=sweep.press["text"],
        now=f"{datetime.now():%Y-%m-%d %H:%M}",
    )


def _row(run: Run, names: Sequence[str]) -> Mapping[str, Any]:
    """What the report's table has of a run."""
    numbers = run.numbers()
    doubt = _doubt(run).strip(" ()")
    reason = run.reason.removeprefix(NOT_BELIEVED)
    report = f"{run.folder.name}/report.html"
    return {
        "values": list(run.values.values()),
        "numbers": [rounded(numbers[name], 4) if name in numbers else "-" for name in names],
        "believed": run.is_believed(),
        "reason": ": ".join(filter(None, (doubt, reason)))
        if run.summary()
        else reason or "not run",
        "report": report if (run.folder / "report.html").is_file() else "",
    }
