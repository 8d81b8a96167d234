"""Pictures that a person would look at first (matplotlib, from the written results)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pyvista
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap

# field -> label, factor to the unit shown, colour map; no label has an index 1 or 2, which beside
# axes x and y looks like theirs
SHOWN = {
    "log_eps_11": ("log strain\nalong yarns a / %", 100.0, "viridis"),
    "log_eps_22": ("log strain\nalong yarns b / %", 100.0, "viridis"),
    "shear_angle": ("shear angle / deg", 180 / np.pi, "coolwarm"),
    "shortening_a": ("shortening\nof yarns a / %", 100.0, "magma_r"),
    "shortening_b": ("shortening\nof yarns b / %", 100.0, "magma_r"),
    "thickness_under_pressure": ("thickness\nunder pressure / mm", 1.0, "viridis"),
    "error_log_eps_11": ("error of log strain\nalong yarns a / %", 100.0, "magma_r"),
    "error_log_eps_22": ("error of log strain\nalong yarns b / %", 100.0, "magma_r"),
    "error_shear_angle": ("error of\nshear angle / deg", 180 / np.pi, "magma_r"),
    "ellipticity_lost": ("ellipticity lost (1) or not", 1.0, "Greys"),
    "strain_state": ("strain state", 1.0, "Set2"),
}


def colour_scale(colours: str, low: float, high: float) -> tuple[str, float, float]:
    """Colour map and its limits for values from `low` to `high`: those of `coolwarm` are the same
    on both sides of 0."""
    if colours == "coolwarm":
        low, high = -max(-low, high), max(-low, high)
    if high - low < 1e-6 * max(1.0, abs(high)):
        low, high = low - 0.5, high + 0.5
    return colours, low, high


def arrows(values: np.ndarray, low: float, high: float) -> str:
    """At which ends of a colour bar from `low` to `high` arrows say that `values` lie beyond:
    Matplotlib's `extend`."""
    little = 1e-6 * (high - low)
    beyond = values.min() < low - little, values.max() > high + little
    return {(False, False): "neither", (True, False): "min", (False, True): "max"}.get(
        beyond, "both"
    )


def cells_range(values: np.ndarray) -> str:
    """Words for the least and the largest of the `values`, with their signs, as summary.json has
    them."""
    low, high = (
        round(float(v), 6) + 0.0 for v in (values.min(), values.max())
    )  # rounding is no strain
    return f"cells: {low:.4g} to {high:.4g}"


def cell_polygons(grid: pyvista.UnstructuredGrid) -> np.ndarray:
    """Deformed corner polygons (cells, k, 2) of a plane sheet."""
    # not cells_dict: before PyVista 0.45 it gives higher-order cells the nodes of linear ones
    kind, cells = grid.celltypes[0], grid.cells.reshape(grid.n_cells, -1)[:, 1:]
    corners = 3 if kind in (pyvista.CellType.TRIANGLE, pyvista.CellType.LAGRANGE_TRIANGLE) else 4
    x = np.asarray(grid.points) + grid.point_data["u"]
    return x[cells[:, :corners], :2]


def maps(
    path: Path,
    variants: Mapping[str, Any],
    names: Sequence[str],
    outliers: float = 0.0,
    units: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Maps of the fields `names` on the deformed sheets {title: grid} of `variants`, one colour
    scale a field.

    Values keep their signs; above each map stand the least and the largest of a cell. One variant's
    maps stand below each other; several variants make a row each. outliers: share of all cells, at
    each end of the scale, that may lie beyond it; units: of fields that are not in `SHOWN`.
    """
    one = len(variants) == 1
    rows, columns = (len(names), 1) if one else (len(variants), len(names))
    polygons = {title: cell_polygons(grid) for title, grid in variants.items()}
    length, width = max((np.ptp(p.reshape(-1, 2), axis=0) for p in polygons.values()), key=max)
    height = max(1.9, 0.72 * 7.0 * columns**-0.3 * width / length + (0.45 if one else 0.7))
    figure, axes = plt.subplots(
        rows,
        columns,
        figsize=(7.0 * columns**0.7, height * rows),
        squeeze=False,
        sharex=True,
        sharey=True,
        layout="constrained",
    )
    for name, mine in zip(names, axes if one else axes.T):
        plain = " / ".join(filter(None, (name.replace("_", " "), units.get(name, ""))))
        label, factor, colours = SHOWN.get(name, (plain, 1.0, "viridis"))
        values = {
            title: factor * np.asarray(grid.cell_data[name]) for title, grid in variants.items()
        }
        every = np.concatenate(list(values.values()))
        low, high = np.quantile(every, (outliers, 1 - outliers))
        colours, low, high = colour_scale(colours, low, high)
        for ax, title in zip(mine, variants):
            patches = PolyCollection(
                polygons[title], array=values[title], cmap=colours, antialiased=False
            )
            patches.set_clim(low, high)
            ax.add_collection(patches)
            ax.autoscale_view()
            ax.set_aspect("equal")
            shown = cells_range(values[title])
            ax.set_title(
                shown if one else f"{title}\n{shown}", fontsize="small" if one else "medium"
            )
        figure.colorbar(
            patches,
            ax=list(mine),
            label=label,
            extend=arrows(every, low, high),
            location="right" if one else "bottom",
            shrink=0.9,
            aspect=15 if one else 30,
        )
    for ax in axes[-1]:
        ax.set_xlabel("x / mm")
    for ax in axes[:, 0]:
        ax.set_ylabel("y / mm")
    figure.savefig(path, dpi=130, bbox_inches="tight")  # wide sheets push labels out
    plt.close(figure)


def curves(
    path: Path,
    series: Mapping[str, Sequence],
    xlabel: str,
    ylabel: str,
    scale: str = "linear",
    bands: Mapping[str, Sequence[float]] | None = None,
) -> None:
    """Curves of {label: (x, y)} or {label: (x, y, matplotlib format)} in one diagram; scale: of
    both axes; bands: half the height of a band around some of them, at each point."""
    figure, ax = plt.subplots(figsize=(6.0, 4.0), layout="constrained")
    ax.set(xscale=scale, yscale=scale)
    for label, (x, y, *style) in series.items():
        (line,) = ax.plot(x, y, *(style or ["o-"]), markersize=3, label=label)
        if bands and label in bands:
            low, high = np.asarray(y) - bands[label], np.asarray(y) + bands[label]
            ax.fill_between(x, low, high, color=line.get_color(), alpha=0.25, lw=0)
    ax.set_xlabel(xlabel)
    ax.set_ylabel(ylabel)
    ax.grid(alpha=0.3)
    if len(series) > 5:  # beside the curves, not over them
        figure.set_figwidth(8.0)
        ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize="small")
    elif len(series) > 1:
        ax.legend()
    figure.savefig(path, dpi=150)
    plt.close(figure)


def reactions(
    path: Path,
    results: Mapping[str, Any],
    xlabel: str = "displacement / mm",
    ylabel: str = "reaction / N",
    beside: Mapping[str, Sequence] = MappingProxyType({}),
) -> None:
    """Curves of force over displacement of runs {label: `job.Result`} in one diagram, with a band
    of their estimated errors; beside: others {label: (displacements, forces)}, as points."""
    series: dict[str, Sequence] = {
        label: ([r["displacement_mm"] for r in result.rows], [r["reaction_N"] for r in result.rows])
        for label, result in results.items()
    }
    series |= {label: (*curve, "s") for label, curve in beside.items()}
    bands = {
        label: [r["error_N"] for r in result.rows]
        for label, result in results.items()
        if all("error_N" in r for r in result.rows)
    }
    curves(path, series, xlabel, ylabel, bands=bands)


def bars(path: Path, values: Mapping[str, tuple[float, str, str]], xlabel: str) -> None:
    """Horizontal bars of {label: (value, text behind it, colour)}, the first on top."""
    figure, ax = plt.subplots(figsize=(8.0, 0.5 + 0.36 * len(values)), layout="constrained")
    numbers, texts, colours = zip(*values.values())
    drawn = ax.barh(list(values), numbers, color=colours)
    ax.bar_label(drawn, texts, padding=3, fontsize="small")
    ax.invert_yaxis()
    ax.margins(x=0.35)
    ax.set_xlabel(xlabel)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def panels(path: Path, series: Mapping[str, Mapping], labels: Mapping[str, tuple]) -> None:
    """Diagrams side by side, of {title: {(label, model): (x, closed form, kernel, elements)}} and
    {title: (x label, y label, x limits)}.

    Closed form is a line (the second model's dashed), the kernel a square, elements a dot.
    """
    figure, axes = plt.subplots(
        2, (len(series) + 1) // 2, figsize=(11, 8), squeeze=False, layout="constrained"
    )
    for ax, (title, curves) in zip(axes.flat, series.items()):
        colours: dict[str, str] = {}
        models: list[str] = []
        for (label, model), (x, closed, kernel, elements) in curves.items():
            colour = colours.setdefault(label, f"C{len(colours)}")
            models += [] if model in models else [model]
            second = models.index(model) > 0
            ax.plot(
                x,
                closed,
                "--" if second else "-",
                color=colour,
                lw=1,
                label=f"{label}" if not second else None,
            )
            ax.plot(x[::4], kernel[::4], "s", color=colour, ms=5, mfc="none", mew=0.6)
            ax.plot(x[2::4], elements[2::4], ".", color=colour, ms=4)
        ax.set_title(
            f"{title}: {', '.join(f'{m} {s}' for m, s in zip(models, ('(line)', '(dashed)')))}",
            fontsize="medium",
        )
        ax.set_xlabel(labels[title][0])
        ax.set_ylabel(labels[title][1])
        ax.set_xlim(labels[title][2])
        ax.grid(alpha=0.3)
        ax.legend(fontsize="small")
    figure.savefig(path, dpi=130)
    plt.close(figure)


def regions(
    path: Path, x: np.ndarray, panels: Mapping[tuple[str, str], tuple], xlabel: str, ylabel: str
) -> None:
    """Where two indicators are negative, over a square grid: {(row, column): (convexity,
    ellipticity)}, each (n, n) with x (n,) along its last axis."""
    rows, columns = (list(dict.fromkeys(key[k] for key in panels)) for k in (0, 1))
    kinds = {
        "stable": "#f2f2f2",
        "convexity lost": "#f4b942",
        "ellipticity lost": "#7fb2d9",
        "both lost": "#b0413e",
    }
    figure, axes = plt.subplots(
        len(rows),
        len(columns),
        figsize=(2.1 * len(columns) + 0.6, 2.4 * len(rows) + 1.2),
        squeeze=False,
        sharex=True,
        sharey=True,
        layout="constrained",
    )
    for (row, column), (convexity, ellipticity) in panels.items():
        ax = axes[rows.index(row), columns.index(column)]
        image = ax.pcolormesh(
            x,
            x,
            (convexity < 0) + 2 * (ellipticity < 0),
            cmap=ListedColormap(list(kinds.values())),
            vmin=-0.5,
            vmax=3.5,
            rasterized=True,
        )
        ax.axhline(0, color="k", lw=0.4)
        ax.axvline(0, color="k", lw=0.4)
        ax.set_aspect("equal")
        ax.set_title(f"{column}, {row}", fontsize="small")
    for ax in axes[-1]:
        ax.set_xlabel(xlabel)
    for ax in axes[:, 0]:
        ax.set_ylabel(ylabel)
    bar = figure.colorbar(
        image,
        ax=list(axes.flat),
        ticks=range(4),
        location="bottom",
        fraction=0.05,
        aspect=60,
        pad=0.02,
    )
    bar.ax.set_xticklabels(list(kinds))
    figure.savefig(path, dpi=130)
    plt.close(figure)
