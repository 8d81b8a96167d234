"""The middle ply of a formed laminate: numbers, and pictures as the paper has them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.path import Path as Polygon
from matplotlib.tri import LinearTriInterpolator, Triangulation

from ..plot import forming_pictures, pictures
from ..tools.double_dome import DoubleDome
from ..tools.tool import Tool
from . import forming, measures
from .formed import ANGLES
from .ply import Grid, ply_of
from .result import OUTLIERS, Result

BETWEEN = "sheet_pressure", "sliding_size"
INWARDS = 1e-6  # mm, so that paths on planes of symmetry are within the metal


def middle_of(sheets: Sequence[Any]) -> str:
    """Name of the middle sheet, if it is of fabric, not the only one, and metal is on both sides of
    it; otherwise ""."""
    count = len(sheets)
    middle = sheets[count // 2]
    metals = [k for k, sheet in enumerate(sheets) if sheet.metal]
    between = count > 1 and metals and min(metals) < count // 2 < max(metals)
    return middle.name if middle.fabric and between else ""


def middle_quantities(result: Result, name: str) -> dict[str, float]:
    """Of ply `name`: the largest shear angle on the path at 45 deg, and the contrast of its shear
    angle (see `forming.contrast`) [deg]."""
    comm, found = result.scene.comm, {}
    if comm.rank == 0:
        grid = result.grids[name]
        path = forming.along_paths(grid, (45,))[45]
        found = {
            "shear_angle_on_45_deg_path_deg": float(abs(path.shear_angle).max()),
            "shear_contrast_deg": float(np.degrees(forming.contrast(grid, "shear_angle"))),
        }
    return comm.bcast(found)


def pressure_quantities(result: Result) -> dict[str, float]:
    """Of all sheets the largest mean pressure of a cell on the next sheet [MPa]; nothing of one."""
    if "sheet_pressure" not in result.fields:
        return {}
    pressure = np.nan_to_num(result.fields["sheet_pressure"])
    return {"sheet_pressure_largest_MPa": measures.extremes(result.scene.comm, pressure)[1]}


def marks(ply: Grid, metal: Grid, punch: Tool) -> dict[str, list[float]]:
    """Distances on the flat ply, one for each path of `ANGLES` [mm], at which the formed ply comes
    to the punch's upper rounding, to the end of its fillet and to the metal's edge; NaN where it
    does not, or the punch is no `DoubleDome`."""
    sheet, surface = ply_of(ply), punch.surface
    plan = Triangulation(*sheet.x[:, :2].T, sheet.triangles)
    (edge,) = forming.outline(metal)
    corners = edge.formed[:, :2]
    if ply_of(metal).planes:  # of a quarter the edge is open
        corners = np.vstack([corners, [0.0, 0.0]])
    found: dict[str, list[float]] = {"inner punch radius": [], "outer punch radius": []}
    found["edge of the metal"] = []
    for angle in np.radians(ANGLES):
        s = np.linspace(0, np.linalg.norm(sheet.x[:, :2], axis=1).max(), 2000)
        on_flat = np.outer(s, [np.cos(angle), np.sin(angle)]) * (1 - 1e-9)
        x, y = (LinearTriInterpolator(plan, v)(*on_flat.T) for v in sheet.formed[:, :2].T)
        known = ~np.ma.getmaskarray(x)
        s, places = s[known], np.column_stack([x[known], y[known]])
        found["edge of the metal"].append(
            _first(s, ~Polygon(corners).contains_points(places + INWARDS))
        )
        radii = surface.roundings if isinstance(surface, DoubleDome) else (np.inf, np.inf)
        away = surface.plan(*places.T)[0] if isinstance(surface, DoubleDome) else 0 * s
        for label, d in zip(found, radii):
            found[label].append(_first(s, away > d))
    return found


def _first(s, holds):
    """The first of `s` (n,) where that holds; the start, which may lie on an edge, not counted."""
    at = np.flatnonzero(holds[1:])
    return float(s[1 + at[0]]) if len(at) else np.nan


def draw(
    folder: Path, runs: Mapping[str, Mapping[str, Grid]], middle: str, metal: str, punch: Tool
) -> None:
    """The middle ply of runs {label: {name of a sheet: grid}}: strain states and shear angle with
    the metal's contour, and strains along the paths of `ANGLES`; pressure and sliding of all."""
    for label, grids in runs.items():
        end = f"_{label.replace(' ', '_')}" if label else ""
        edges = forming.outline(grids[metal])
        forming_pictures.state_map(
            folder / f"middle{end}.png", grids[middle], formed=True, edges=edges
        )
        between = {name: grid for name, grid in grids.items() if BETWEEN[0] in grid.cell_data}
        pictures.maps(folder / f"between{end}.png", between, BETWEEN, outliers=OUTLIERS)
    first = next(iter(runs.values()))
    paths = {label: forming.along_paths(grids[middle], ANGLES) for label, grids in runs.items()}
    at = marks(first[middle], first[metal], punch)
    forming_pictures.paths_picture(folder / "middle_paths.png", paths, at)
