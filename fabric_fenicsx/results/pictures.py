"""Maps of fields on sheets and diagrams, as PNG files (Matplotlib, from the written results)."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyvista
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from .ply import Grid
from .states import of_fabric

# field -> label, factor to the unit shown, colour map; no label has an index 1 or 2, which beside
# axes x and y looks like theirs
SHOWN = {
    "log_eps_11": ("log strain\nalong yarns a / %", 100.0, "viridis"),
    "log_eps_22": ("log strain\nalong yarns b / %", 100.0, "viridis"),
    "shear_angle": ("shear angle / deg", 180 / np.pi, "coolwarm"),
    "shortening_a": ("shortening\nof yarns a / %", 100.0, "magma_r"),
    "shortening_b": ("shortening\nof yarns b / %", 100.0, "magma_r"),
    "wrinkle_height": ("height of wrinkles / mm", 1.0, "coolwarm"),
    "thickness_under_pressure": ("thickness\nunder pressure / mm", 1.0, "viridis"),
    "error_log_eps_11": ("error of log strain\nalong yarns a / %", 100.0, "magma_r"),
    "error_log_eps_22": ("error of log strain\nalong yarns b / %", 100.0, "magma_r"),
    "error_shear_angle": ("error of\nshear angle / deg", 180 / np.pi, "magma_r"),
    "ellipticity_lost": ("ellipticity lost (1) or not", 1.0, "Greys"),
    "strain_state": ("strain state", 1.0, "Set2"),
}
MAPS = "log_eps_11", "log_eps_22", "shear_angle"  # what one looks at first
OUTLIERS = 0.005  # of the cells, as at corners, that are left out of a map's scale


@contextmanager
def figure(
    path: Path | str, size: tuple[float, float], rows: int = 1, columns: int = 1, **options: Any
) -> Iterator[tuple[Figure, np.ndarray]]:
    """A figure of `size` [inch] and its axes (rows, columns), written to `path` when it is done;
    options: `dpi` and `bbox_inches` of the file, others of `Figure.subplots`."""
    file = {"dpi": options.pop("dpi", 130), "bbox_inches": options.pop("bbox_inches", None)}
    drawn = Figure(figsize=size, layout="constrained")
    yield drawn, drawn.subplots(rows, columns, squeeze=False, **options)
    drawn.savefig(path, **file)


def shown(name: str, unit: str = "") -> tuple[str, float, str]:
    """Label, factor to the unit shown and colour map of a field; unit: of one not in `SHOWN`."""
    plain = " / ".join(filter(None, (name.replace("_", " "), unit)))
    return SHOWN.get(name, (plain, 1.0, "viridis"))


def colour_scale(colours: str, low: float, high: float) -> tuple[str, float, float]:
    """Colour map and limits for values from `low` to `high`, with 0 in the middle of `coolwarm`."""
    if colours == "coolwarm":
        low, high = -max(-low, high), max(-low, high)
    if high - low < 1e-6 * max(1.0, abs(high)):
        low, high = low - 0.5, high + 0.5
    return colours, low, high


def arrows(values: np.ndarray, low: float, high: float) -> str:
    """Ends of a colour bar beyond which `values` lie, as Matplotlib's `extend`."""
    little = 1e-6 * (high - low)
    below, above = values.min() < low - little, values.max() > high + little
    return ("neither", "min", "max", "both")[below + 2 * above]


def cells_range(values: np.ndarray) -> str:
    """The least and the largest of the `values` with their signs, as summary.json has them."""
    # rounding is no strain
    low, high = (round(float(v), 6) + 0.0 for v in (values.min(), values.max()))
    return f"cells: {low:.4g} to {high:.4g}"


def cell_polygons(grid: Grid) -> np.ndarray:
    """Deformed corner polygons (cells, k, 2) of a plane sheet."""
    # not cells_dict: before PyVista 0.45 it gives higher-order cells the nodes of linear ones
    kind, cells = grid.celltypes[0], grid.cells.reshape(grid.n_cells, -1)[:, 1:]
    corners = 3 if kind in (pyvista.CellType.TRIANGLE, pyvista.CellType.LAGRANGE_TRIANGLE) else 4
    x = np.asarray(grid.points) + grid.point_data["u"]
    return x[cells[:, :corners], :2]


def draw_cells(
    ax: Axes,
    polygons: np.ndarray,
    values: np.ndarray,
    colours: str | Colormap,
    limits: Sequence[float],
) -> PolyCollection:
    """Add cells (n, k, 2) [mm] in plan, coloured by `values` (n,) between `limits`."""
    cells = PolyCollection(polygons, array=values, cmap=colours, antialiased=False, clim=limits)
    ax.add_collection(cells)
    ax.autoscale_view()
    ax.set_aspect("equal")
    return cells


def label_outer(axes: np.ndarray, xlabel: str = "x / mm", ylabel: str = "y / mm") -> None:
    """Label the axes (rows, columns) at the left and the lower edge of a figure."""
    for ax in axes[-1]:
        ax.set_xlabel(xlabel)
    for ax in axes[:, 0]:
        ax.set_ylabel(ylabel)


def maps(
    path: Path,
    variants: Mapping[str, Grid],
    names: Sequence[str],
    outliers: float = 0.0,
    units: Mapping[str, str] | None = None,
) -> None:
    """Maps of the fields `names` on the deformed sheets {title: grid} of `variants`, one colour
    scale a field, with the least and the largest of a cell above. Several variants make a row each.
    outliers: share of all cells, at each end of the scale, that may lie beyond it; units: of fields
    that are not in `SHOWN`."""
    one = len(variants) == 1
    rows, columns = (len(names), 1) if one else (len(variants), len(names))
    polygons = {title: cell_polygons(grid) for title, grid in variants.items()}
    length, width = max((np.ptp(p.reshape(-1, 2), axis=0) for p in polygons.values()), key=max)
    height = max(1.9, 0.72 * 7.0 * columns**-0.3 * width / length + (0.45 if one else 0.7))
    size, shared = (7.0 * columns**0.7, height * rows), {"sharex": True, "sharey": True}
    # tight, as wide sheets push labels out
    with figure(path, size, rows, columns, bbox_inches="tight", **shared) as (page, axes):
        for name, column in zip(names, axes if one else axes.T):
            is_nodal = any(name not in grid.cell_data for grid in variants.values())
            title = f"{name}, mean over each cell" if is_nodal else name
            label, factor, colours = shown(title, (units or {}).get(name, ""))
            of_cells = [g.point_data_to_cell_data() if is_nodal else g for g in variants.values()]
            values = [factor * np.asarray(grid.cell_data[name]) for grid in of_cells]
            every = np.concatenate(values)
            low, high = np.quantile(every, (outliers, 1 - outliers))
            colours, *limits = colour_scale(colours, low, high)
            for ax, (title, shape), value in zip(column, polygons.items(), values):
                cells = draw_cells(ax, shape, value, colours, limits)
                text = cells_range(value)
                ax.set_title(text if one else f"{title}\n{text}", size="small" if one else "medium")
            place = {"location": "right", "aspect": 15} if one else {"location": "bottom"}
            bar = {"aspect": 30, "shrink": 0.9, "extend": arrows(every, *limits)} | place
            page.colorbar(cells, ax=list(column), label=label, **bar)
        label_outer(axes)


def draw_state(name: str, result: Any, force_name: str) -> None:
    """What one looks at first of the `Result` of the run `name`: maps.png, error.png with estimated
    errors and, at last, curve.png, whose force is called `force_name`."""
    plies, folder = of_fabric(result.grids), Path(result.folder or ".")
    grids = {part or name.replace("_", " "): grid for part, grid in plies.items()}
    for file, fields in (("maps", MAPS), ("error", [f"error_{field}" for field in MAPS])):
        if grids and all(set(fields) <= set(grid.cell_data) for grid in grids.values()):
            maps(folder / f"{file}.png", grids, fields, OUTLIERS)
    reactions(folder / "curve.png", {"": result}, ylabel=f"{force_name} / N")


def curves(
    path: Path,
    series: Mapping[str, Sequence],
    xlabel: str,
    ylabel: str,
    scale: str = "linear",
    bands: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Curves of {label: (x, y)} or {label: (x, y, matplotlib format)} in one diagram; scale: of
    both axes; bands: half the height of a band around some of them, at each point."""
    is_wide = len(series) > 5  # the legend is beside the curves, not over them
    with figure(path, (8.0 if is_wide else 6.0, 4.0), dpi=150) as (_, ((ax,),)):
        ax.set(xscale=scale, yscale=scale, xlabel=xlabel, ylabel=ylabel)
        for label, (x, y, *style) in series.items():
            (line,) = ax.plot(x, y, *(style or ["o-"]), markersize=3, label=label)
            if bands and label in bands:
                low, high = np.subtract(y, bands[label]), np.add(y, bands[label])
                ax.fill_between(x, low, high, color=line.get_color(), alpha=0.25, lw=0)
        ax.grid(alpha=0.3)
        beside = {"loc": "upper left", "bbox_to_anchor": (1.01, 1), "fontsize": "small"}
        if len(series) > 1:
            ax.legend(**beside if is_wide else {})


def reactions(
    path: Path,
    results: Mapping[str, Any],
    xlabel: str = "displacement / mm",
    ylabel: str = "reaction / N",
) -> None:
    """Curves of force over displacement of runs {label: `Result`} in one diagram, with a band of
    their estimated errors."""
    series, bands = {}, {}
    for label, run in results.items():
        names = "displacement_mm", "reaction_N", "error_N"
        *series[label], error = ([row.get(name) for row in run.rows] for name in names)
        if None not in error:
            bands[label] = error
    curves(path, series, xlabel, ylabel, bands=bands)
