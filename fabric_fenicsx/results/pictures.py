"""Maps of fields on sheets, paths, strain states and diagrams, as PNG files (Matplotlib)."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain, cycle
from pathlib import Path
from typing import Any

import numpy as np
import pyvista
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Colormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.path import Path as Polygon
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.status import MARKED, log
from ..surfaces.double_dome import DoubleDome
from ..surfaces.tool import Tool
from .ply import Grid, plan_area, ply_of
from .shape import File, Outline, along_paths, outline, write_paths
from .shape import Path as PlyPath
from .space import SHOWN, formed_picture, shown
from .states import of_fabric, set_labels, states

MAPS = "log_eps_11", "log_eps_22", "shear_angle"  # what one looks at first
OUTLIERS = 0.005  # of the cells, as at corners, that are left out of a map's scale
STATES = {  # strain_state -> what it is, colour
    1: ("both in tension", "#3b6fb6"),
    2: ("a in tension, b in compression", "#f2b134"),
    3: ("a in compression, b in tension", "#5aa469"),
    4: ("both in compression", "#b83a3a"),
}
ANGLES = 0, 45, 90  # of the paths to x [deg]


@contextmanager
def figure(
    path: Path | str, size: tuple[float, float], rows: int = 1, columns: int = 1, **options: Any
) -> Iterator[tuple[Figure, np.ndarray]]:
    """A figure of `size` [inch] and its axes (rows, columns), written to `path` when it is done;
    options: `dpi` and `bbox_inches` of the file, others of `Figure.subplots`."""
    file = {"dpi": options.pop("dpi", 130), "bbox_inches": options.pop("bbox_inches", None)}
    drawn = Figure(figsize=size, layout="constrained")
    yield drawn, drawn.subplots(rows, columns, squeeze=False, **options)
    with rc_context({"axes.formatter.min_exponent": 5}):  # 0.1 and 100, not powers of 10
        drawn.savefig(path, **file)


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


# -- formed plies in plan


def paths_picture(
    path: File, runs: Mapping[str, Mapping[float, PlyPath]], marks: Mapping[str, Sequence[float]]
) -> None:
    """Strains and shear angle over the distance on the flat ply, a row a path, of runs {label:
    `along_paths`}. marks: {label: distances on the paths [mm]}, drawn as vertical lines where that
    is on the path; NaN for none."""
    angles = list(dict.fromkeys(angle for paths in runs.values() for angle in paths))
    factors = {"log_eps_11": 100, "log_eps_22": 100, "shear_angle": 1}  # to units shown
    size = 11, 2.6 * len(angles) + 0.6
    with figure(path, size, len(angles), 3, sharex="row", sharey="col") as (page, axes):
        for row, angle in enumerate(angles):
            here = {label: paths[angle] for label, paths in runs.items() if angle in paths}
            end = max(line.distance[-1] for line in here.values())
            for ax, (name, factor) in zip(axes[row], factors.items()):
                for label, line in here.items():
                    ax.plot(line.distance, factor * getattr(line, name), lw=1.4, label=label)
                for style, (label, at) in zip(cycle(("--", ":", "-.")), marks.items()):
                    if at[row] <= end:
                        ax.axvline(at[row], label=label, color="0.45", lw=0.9, ls=style)
                ax.axhline(0, color="k", lw=0.5)
                ax.grid(alpha=0.25)
                ax.set(ylabel=SHOWN[name][0], xlim=(0, end))
            along = {0.0: "along x", 90.0: "along y"}.get(angle, f"at {angle:g}°")
            axes[row, 1].set_title(f"path {along}", fontsize="medium")
        for ax in axes[-1]:
            ax.set_xlabel("distance on the flat ply / mm")
        handles = (zip(*ax.get_legend_handles_labels()[::-1]) for ax in axes[:, 0])
        legend = dict(chain.from_iterable(handles))
        if len(legend) > 1 or (legend and marks):
            page.get_layout_engine().set(rect=(0, 0, 1, 1 - 0.35 / page.get_figheight()))
            above = {"loc": "upper center", "ncol": len(legend), "frameon": False}
            page.legend(list(legend.values()), list(legend), **above)


def state_map(path: File, grid: Grid, formed: bool = False, edges: Sequence[Outline] = ()) -> None:
    """Plan maps of the strain states of eq. (13) and of the shear angle, on the flat or the formed
    ply. The legend gives each state's share of the flat ply's area. edges: of other sheets, drawn
    as they are formed."""
    ply = ply_of(grid)
    corners = (ply.formed if formed else ply.x)[ply.cells, :2]
    area, state = plan_area(ply.x, ply.cells), ply.fields["strain_state"]
    label, factor, colours = SHOWN["shear_angle"]
    shear = factor * ply.fields["shear_angle"]
    colours, *limits = colour_scale(colours, shear.min(), shear.max())
    kinds = ListedColormap([colour for _, colour in STATES.values()])
    with figure(path, (13, 5), 1, 2, sharex=True, sharey=True) as (page, ((left, right),)):
        draw_cells(left, corners, state, kinds, (0.5, 4.5))
        cells = draw_cells(right, corners, shear, colours, limits)
        for ax in (left, right):
            ax.margins(0.02)
            for edge in edges:
                ax.plot(*edge.formed[:, :2].T, color="k", lw=1.2)
        label_outer(np.array([[left, right]]))
        patches = [
            Patch(color=colour, label=f"{name}: {area[state == k].sum() / area.sum():.0%}")
            for k, (name, colour) in STATES.items()
        ]
        below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.15)}
        left.legend(handles=patches, ncol=2, frameon=False, **below)
        right.set_title(cells_range(shear), fontsize="small")
        page.colorbar(cells, ax=right, label=label, location="bottom", shrink=0.8, aspect=30)


def draw_plies(folder: Path, grids: Mapping[str, Grid], tool: str = "") -> None:
    """Paths and strain states of each ply {name: grid}; maps of all of fabric, thickness under
    pressure and shortening where there is some, and of metal; all plies formed over the `tool` of
    that name in the results `folder`."""
    fabrics = of_fabric(grids)
    labels = set_labels(fabrics)  # or the files of +45 and -45 would be one
    for name, grid in fabrics.items():
        end = f"_{labels[name]}" if name else ""
        if paths := _paths(name, grid):
            write_paths(folder / f"paths{end}.csv", paths)
        state_map(folder / f"states{end}.png", grid)
    thickness, short = "thickness_under_pressure", ("shortening_a", "shortening_b")
    named = {name or "ply": grid for name, grid in fabrics.items()}
    if pressed := {name: grid for name, grid in named.items() if thickness in grid.cell_data}:
        maps(folder / "thickness.png", pressed, [thickness], OUTLIERS)
    if any(grid[field].any() for grid in fabrics.values() for field in short):
        maps(folder / "shortening.png", named, short, OUTLIERS)
    if metals := {name: grid for name, grid in grids.items() if name not in fabrics}:
        fields = "equivalent_plastic_strain", "metal_thickness", "von_mises_top"
        maps(folder / "metal.png", metals, fields, OUTLIERS)
    surface = states(folder)[-1].tools()[tool] if tool else None
    formed_picture(folder / "formed.png", list(grids.values()), surface)


def _paths(name, grid):
    """The paths of a ply, none where its centroid is in a cut-out."""
    try:
        return along_paths(grid, ANGLES)
    except InputError as error:
        of = f" of {name}" if name else ""
        log.warning("there are no paths%s: %s", of, error, extra=MARKED)
        return {}


def draw_compared(folder: Path, grids: Mapping[str, Grid]) -> None:
    """Paths of plies {label: grid} side by side."""
    fabrics = of_fabric(grids).items()
    if runs := {label: paths for label, grid in fabrics if (paths := _paths(label, grid))}:
        paths_picture(folder / "paths.png", runs, {})


def draw_laminate(
    folder: Path, runs: Mapping[str, Mapping[str, Grid]], middle: str, metal: str, punch: Tool
) -> None:
    """The middle ply of runs {label: {name of a sheet: grid}}: strain states and shear angle with
    the metal's contour, and strains along the paths of `ANGLES`; pressure and sliding of all."""
    fields = "sheet_pressure", "sliding_size"
    for label, grids in runs.items():
        end = f"_{label.replace(' ', '_')}" if label else ""
        edges = outline(grids[metal])
        state_map(folder / f"middle{end}.png", grids[middle], formed=True, edges=edges)
        between = {name: grid for name, grid in grids.items() if fields[0] in grid.cell_data}
        maps(folder / f"between{end}.png", between, fields, OUTLIERS)
    first = next(iter(runs.values()))
    paths = {label: along_paths(grids[middle], ANGLES) for label, grids in runs.items()}
    marks = _laminate_marks(first[middle], first[metal], punch)
    paths_picture(folder / "middle_paths.png", paths, marks)


def _laminate_marks(ply, metal, punch):
    """Distances on the flat ply, one for each path of `ANGLES` [mm], at which the formed ply comes
    to the punch's upper rounding, to the end of its fillet and to the metal's edge; NaN where it
    does not, and of a punch that is no `DoubleDome`."""
    names = "inner punch radius", "outer punch radius", "edge of the metal"
    corners, rows = outline(metal)[0].formed[:, :2], []
    if ply_of(metal).planes:  # of a quarter the edge is open
        corners = np.vstack([corners, [0.0, 0.0]])
    for path in along_paths(ply, ANGLES, spacing=0.2).values():
        places, never = path.places[:, :2], np.zeros(len(path.places), bool)
        # mm, so that paths on planes of symmetry are within the metal
        beyond = [never, never, ~Polygon(corners).contains_points(places + 1e-6)]
        if isinstance(surface := punch.surface, DoubleDome):
            beyond[:2] = (surface.plan(*places.T)[0] > radius for radius in surface.roundings)
        rows.append([_first(path.distance, holds) for holds in beyond])
    return dict(zip(names, zip(*rows)))


def _first(s, holds):
    """The first of `s` (n,) where that holds; the start, which may lie on an edge, not counted."""
    return min(s[1:][holds[1:] > 0], default=np.nan)
