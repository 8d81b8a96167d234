"""Pictures of formed plies in plan: paths, strain states, and all that a forming run draws of its
last state."""

import pathlib
from collections.abc import Mapping, Sequence
from itertools import chain, cycle

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch
from matplotlib.path import Path as Polygon

from ..core.errors import InputError
from ..core.status import MARKED, log
from ..surfaces.double_dome import DoubleDome
from ..surfaces.tool import Tool
from .pictures import OUTLIERS, SHOWN, cells_range, colour_scale, draw_cells, figure, maps
from .ply import Grid, plan_area, ply_of
from .shape import File, Outline, Path, along_paths, outline, write_paths
from .space import formed_picture
from .states import of_fabric, set_labels, states

STATES = {  # strain_state -> what it is, colour
    1: ("both in tension", "#3b6fb6"),
    2: ("a in tension, b in compression", "#f2b134"),
    3: ("a in compression, b in tension", "#5aa469"),
    4: ("both in compression", "#b83a3a"),
}
ANGLES = 0, 45, 90  # of the paths to x [deg]


def paths_picture(
    path: File, runs: Mapping[str, Mapping[float, Path]], marks: Mapping[str, Sequence[float]]
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
            ax.set_xlabel("x / mm")
        left.set_ylabel("y / mm")
        patches = [
            Patch(color=colour, label=f"{name}: {area[state == k].sum() / area.sum():.0%}")
            for k, (name, colour) in STATES.items()
        ]
        below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.15)}
        left.legend(handles=patches, ncol=2, frameon=False, **below)
        right.set_title(cells_range(shear), fontsize="small")
        page.colorbar(cells, ax=right, label=label, location="bottom", shrink=0.8, aspect=30)


def draw_plies(folder: pathlib.Path, grids: Mapping[str, Grid], tool: str = "") -> None:
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


def draw_compared(folder: pathlib.Path, grids: Mapping[str, Grid]) -> None:
    """Paths of plies {label: grid} side by side."""
    fabrics = of_fabric(grids).items()
    if runs := {label: paths for label, grid in fabrics if (paths := _paths(label, grid))}:
        paths_picture(folder / "paths.png", runs, {})


def draw_laminate(
    folder: pathlib.Path,
    runs: Mapping[str, Mapping[str, Grid]],
    middle: str,
    metal: str,
    punch: Tool,
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
    at = np.flatnonzero(holds[1:])
    return float(s[1 + at[0]]) if len(at) else np.nan
