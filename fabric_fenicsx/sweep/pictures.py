"""Pictures of a sweep: curves, trends and maps. Maps read fields of runs, which needs DOLFINx."""

import csv
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..plot.pictures import cell_polygons, colour_scale, curves, draw_cells, figure
from .folder import Run, force_name
from .scatter import BOUNDS
from .varied import is_wide, label, number

MAX_PANELS = 6  # trends, and maps side by side


def draw(
    files: Mapping[str, Path], runs: Sequence[Run], names: Mapping[str, str], scatter: bool = False
) -> None:
    """Draw curves, trends and maps of runs with results into `files`, each where there is something
    to draw; names: labels of the quantities whose trends are drawn {quantity: label}; scatter: True
    of runs of a design, whose trends are points over each key."""
    for file in files.values():
        file.unlink(missing_ok=True)
    if not runs:
        return
    _draw_curves(files["curves"], runs, scatter)
    if scatter:
        _draw_points(files["trends"], runs, dict(list(names.items())[: MAX_PANELS // 2]))
    else:
        _draw_trends(files["trends"], runs, dict(list(names.items())[:MAX_PANELS]))
        _draw_maps(files["maps"], runs)


def _draw_curves(path, runs, scatter):
    series: dict[str, Any] = {}
    for run in runs:
        try:
            with open(run.results / "history.csv", newline="") as file:
                rows = [*csv.DictReader(file)]
            x, y = ([float(row[k]) for row in rows] for k in ("displacement_mm", "reaction_N"))
        except (OSError, KeyError, ValueError):
            continue
        if rows and (run.is_believed() or not scatter):
            series[run.label] = x, y, "-" if run.is_believed() else "--"
    if series and scatter:
        x = next(iter(series.values()))[0]
        forces = np.array([np.interp(x, at, force) for at, force, _ in series.values()])
        series = {"mean": (x, forces.mean(0), "-")}
        for share, bound in zip(BOUNDS, np.quantile(forces, BOUNDS, axis=0)):
            series[f"{100 * share:g} % of runs below"] = x, bound, "--"
    if series:
        curves(path, series, "displacement / mm", f"{force_name(runs)} / N")


def _draw_trends(path, runs, names):
    keys = list(runs[0].values)
    if len(keys) > 2 or any(number(run.values[keys[0]]) is None for run in runs):
        return
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    with figure(path, (4.2 * columns, 3.0 * rows + 0.4), rows, columns) as (_, axes):
        for ax, (name, title) in zip(axes.flat, names.items()):
            _draw_trend(ax, runs, name)
            ax.set(ylabel=textwrap.fill(title, 26), xlabel=keys[0])
            ax.grid(alpha=0.3)
        for ax in axes.flat[len(names) :]:
            ax.remove()


def _draw_points(path, runs, names):
    """A row of panels a quantity, with a panel for each key; of believed runs."""
    known, keys = [run for run in runs if run.is_believed()], list(runs[0].values)
    size, shared = (2.6 * len(keys) + 1.0, 2.4 * len(names)), {"sharex": "col", "sharey": "row"}
    with figure(path, size, len(names), len(keys), **shared) as (_, axes):
        for row, (name, title) in zip(axes, names.items()):
            having = [run for run in known if name in run.numbers()]
            for ax, key in zip(row, keys):
                x = [float(run.values[key]) for run in having]
                ax.plot(x, [run.number(name) for run in having], "o", ms=4)
                ax.grid(alpha=0.3)
            row[0].set_ylabel(textwrap.fill(title, 22))
        for ax, key in zip(axes[-1], keys):
            ax.set_xlabel(key)


def _draw_trend(ax, runs, name):
    """A quantity at full load over the first key, with a line for each value of the second one."""
    first = next(iter(runs[0].values))
    groups: dict[str, list[Run]] = {}
    for run in runs:
        if run.is_at_full_load() and name in run.numbers():
            others = {key: value for key, value in run.values.items() if key != first}
            groups.setdefault(label(others), []).append(run)
    for group, mine in groups.items():
        x = np.array([float(run.values[first]) for run in mine])
        y = np.array([run.numbers()[name] for run in mine])
        believed = np.array([run.is_believed() for run in mine])
        (line,) = ax.plot(x, y, "-", lw=1.2, label=group)
        ax.plot(x[believed], y[believed], "o", ms=5, color=line.get_color())
        ax.plot(x[~believed], y[~believed], "x", ms=5, color=line.get_color())
    places = sorted({float(run.values[first]) for run in runs})
    if is_wide(places):
        ax.set_xscale("log")
        ax.minorticks_off()
    if len(places) <= 6:
        ax.set_xticks(places, [f"{place:g}" for place in places])
    if 1 < len(groups) <= 8:
        ax.legend(fontsize="x-small")


def _sheet(folder):
    """Polygons and fields {label: values} of the cells of the last state, the uppermost last."""
    from ..postprocess.states import read_state

    grid = read_state(folder)
    cells = grid.cells.reshape(grid.n_cells, -1)[:, 1:]
    heights = (grid.points[:, 2] + grid.point_data["u"][:, 2])[cells].mean(1)
    order = np.argsort(heights, kind="stable")
    unknown = np.full(grid.n_cells, np.nan)  # as of metal
    names = "shear_angle", "shortening_a", "shortening_b"
    shear, a, b = (np.asarray(grid.cell_data.get(name, unknown)) for name in names)
    values = {
        "shear angle / deg": abs(np.degrees(shear))[order],
        "shortening of yarns / %": 100 * np.maximum(a, b)[order],
    }
    return cell_polygons(grid)[order], values


def _draw_maps(path, runs):
    drawn = [run for run in runs if (run.results / "fields.pvd").is_file()]
    if not drawn:
        return
    sheets = [_sheet(run.results) for run in drawn]
    fields = {name: [values[name] for _, values in sheets] for name in sheets[0][1]}
    fields = {name: f for name, f in fields.items() if np.isfinite(np.concatenate(f)).any()}
    # all values of the last key in a row where two keys make a full table, else what fits
    counts = [len({run.values[key] for run in drawn}) for key in drawn[0].values]
    is_full = len(counts) == 2 and counts[0] * counts[1] == len(drawn) == len(runs)
    columns = min(MAX_PANELS, len(drawn))
    if is_full and counts[1] <= 2 * MAX_PANELS:
        columns = counts[1]
    rows = -(-len(drawn) // columns)
    sides = [np.ptp(polygons.reshape(-1, 2), axis=0) for polygons, _ in sheets]
    length, width = np.max(sides, axis=0)
    size = 2.6 * columns + 1.0, (2.5 * width / length + 0.45) * rows * len(fields) + 0.5
    shared = {"sharex": True, "sharey": True, "dpi": 120}
    with figure(path, size, rows * len(fields), columns, **shared) as (page, axes):
        for k, (name, values) in enumerate(fields.items()):
            mine = axes[k * rows : (k + 1) * rows]
            colours = "viridis" if name.startswith("shear") else "magma_r"
            _, *limits = colour_scale(colours, 0.0, float(np.nanmax(np.concatenate(values))))
            for ax, run, (polygons, _), each in zip(mine.flat, drawn, sheets, values):
                cells = draw_cells(ax, polygons, each, colours, limits)
                words = run.verdict() * (not run.is_believed())
                ax.set_title(run.label + (f" ({words})" if words else ""), fontsize="x-small")
            for ax in mine.flat[len(drawn) :]:
                ax.set_axis_off()
            page.colorbar(cells, ax=list(mine.flat), label=name, shrink=0.9)
