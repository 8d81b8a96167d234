"""What a forming run tells of its plies: numbers, tables and pictures."""

import logging
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyvista
from scipy.optimize import brentq

from ..material.strains import SHORTENED
from ..plot import forming_pictures, pictures
from ..runtime.errors import InputError
from ..sheets.blank import Part
from ..tools.double_dome import DoubleDome
from ..tools.tool import Tool
from ..tools.triangulated import TriangulatedSurface
from . import forming, measures
from .output import MARKED
from .result import OUTLIERS, Result, of_fabric
from .shear import shear_quantities
from .shortening import shortening_quantities
from .structural import set_labels

log = logging.getLogger("fabric_fenicsx")
ANGLES = 0, 45, 90  # of the paths to x [deg]
# of the shapes of plies, what of several ones the largest has a meaning
LARGEST = {"draw_in": ("largest_mm",), "wrinkles": ("slope_largest_deg",)}
SHORTENING = "shortening_a", "shortening_b"
METAL = "equivalent_plastic_strain", "metal_thickness", "von_mises_top"  # that is drawn


def fabric_quantities(result: Result, parts: Sequence[Part]) -> dict[str, Any]:
    """Shear, shortening, strains and thickness of all cells of the `parts`, one ply or several of
    fabric. The largest fibre volume fraction is None without a fibre density."""
    comm, cells = result.scene.comm, _cells(parts)
    fields = {name: values[cells] for name, values in result.fields.items()}
    ellipticity, states = fields["stability_ellipticity"], fields["strain_state"]
    extremes, areas = partial(measures.extremes, comm), measures.areas(result.scene.blank)[cells]
    return {
        "shear_angle_deg": extremes(np.degrees(fields["shear_angle"])),
        **shear_quantities(result, parts),
        **shortening_quantities(result, parts),
        "log_eps_11": extremes(fields["log_eps_11"]),
        "log_eps_22": extremes(fields["log_eps_22"]),
        "stability_ellipticity_min": extremes(ellipticity)[0],
        "cells_that_lost_ellipticity": comm.allreduce(int((ellipticity < 0).sum())),
        "share_of_state_1_to_4": [
            measures.mean(comm, (states == k) * 1.0, areas) for k in (1, 2, 3, 4)
        ],
        "thickness_min_mm": _known(np.fmin, comm, fields.get("thickness_under_pressure")),
        "fibre_volume_fraction_max": _known(np.fmax, comm, fields.get("fibre_volume_fraction")),
    }


def _known(extreme, comm, values):
    """The least (`np.fmin`) or largest number of all ranks in a field (cells,), None if it has no
    number or is not told."""
    mine = np.nan if values is None else extreme.reduce(values, initial=np.nan)
    found = extreme.reduce(comm.allgather(float(mine)))
    return None if np.isnan(found) else float(found)


def metal_quantities(result: Result, parts: Sequence[Part]) -> dict[str, Any]:
    """Plastic strain, thickness and von Mises' stress of all cells of the `parts`, one ply or
    several of metal."""
    cells, fields = _cells(parts), result.fields
    extremes = partial(measures.extremes, result.scene.comm)
    thickness = fields["metal_thickness"][cells]
    before = np.repeat([part.thickness or 1.0 for part in parts], [len(p.cells) for p in parts])
    stress = np.fmax(*(fields[f"von_mises_{face}"][cells] for face in ("top", "bottom")))
    return {
        "plastic_strain_max": extremes(fields["equivalent_plastic_strain"][cells])[1],
        "thinning_max": extremes(1 - thickness / before)[1],
        "thickness_mm": extremes(thickness),
        "von_mises_max_MPa": extremes(stress)[1],
    }


def _cells(parts):
    return np.concatenate([part.cells for part in parts])


def shape(result: Result, part: Part, tool: Tool, middle: float, closed: bool) -> dict[str, Any]:
    """Draw-in, and slopes of wrinkles over the tool, of one ply, which is all of a sheet or a part
    of a stack. Their height is left out: closed tools leave it no more than their play. middle:
    height of its mid-surface over the tool that it lies on [mm]; closed: whether the tools are,
    as otherwise the ply does not follow them and wrinkles are None."""
    comm, wrinkles = result.scene.comm, None
    if closed and comm.rank == 0:
        found = forming.wrinkles(result.grids[part.name], tool, 2 * middle)
        wrinkles = {name: value for name, value in found.items() if name.startswith("slope")}
    return {"draw_in": result.draw_in(part.name), "wrinkles": comm.bcast(wrinkles)}


def stack_quantities(
    result: Result,
    plies: Mapping[str, Mapping[str, Any]],
    fabrics: Sequence[Part],
    metals: Sequence[Part],
) -> dict[str, Any]:
    """Quantities of a stack: those of cells over all cells of its plies of fabric and of metal, and
    of the shapes of its `plies` {name: quantities} the largest ones. What is of one ply's edge or
    area alone is left out: each ply has it."""
    found = fabric_quantities(result, fabrics) if fabrics else {}
    found |= metal_quantities(result, metals) if metals else {}
    for name, keys in LARGEST.items():
        shapes = [ply[name] for ply in plies.values()]
        known = None not in shapes
        found[name] = {key: max(each[key] for each in shapes) for key in keys} if known else None
    return found


def tool_mesh(tool: Tool, low: np.ndarray, high: np.ndarray) -> pyvista.PolyData:
    """A tool, where it is now, as a PyVista surface between the corners low and high (3,) of where
    its surface was given [mm]."""
    from ..meshes.double_dome import double_dome

    surface = tool.surface
    if isinstance(surface, TriangulatedSurface):
        points, triangles = surface.points, surface.triangles
    elif isinstance(surface, DoubleDome):
        points, triangles = double_dome(surface, size=8.0)
    else:
        points, _, triangles = surface.mesh(low, high, 8.0)
    return pyvista.PolyData.from_regular_faces(points + tool.displacement, triangles)


def draw_plies(
    folder: Path,
    grids: Mapping[str, pyvista.UnstructuredGrid],
    angles: Sequence[Sequence[float]],
    tool: pyvista.PolyData,
) -> None:
    """Paths and strain states of each ply, shortening if there is some, and all of them formed over
    the tool; angles: of each one's yarns [deg]."""
    fabrics = of_fabric(grids)
    labels = set_labels(fabrics)  # or the files of +45 and -45 would be one
    for name, grid in fabrics.items():
        end = f"_{labels[name]}" if name else ""
        for paths in _paths(name, grid):
            forming.write_paths(folder / f"paths{end}.csv", paths)
        forming_pictures.state_map(folder / f"states{end}.png", grid)
    if any(grid[field].max() > SHORTENED for grid in fabrics.values() for field in SHORTENING):
        named = {name or "shortening": grid for name, grid in fabrics.items()}
        pictures.maps(folder / "shortening.png", named, SHORTENING, outliers=OUTLIERS)
    if metals := {name: grid for name, grid in grids.items() if name not in of_fabric(grids)}:
        pictures.maps(folder / "metal.png", metals, METAL, outliers=OUTLIERS)
    try:
        plies = list(zip(grids.values(), angles))
        forming_pictures.formed_picture(folder / "formed.png", plies, tool)
    except InputError as error:  # nothing to draw with, which is no reason to lose a run
        log.warning("formed.png was not drawn: %s", error, extra=MARKED)


def _paths(name, grid):
    """The paths of a ply, once or, where the origin is in a cut-out, not at all."""
    try:
        return [forming.along_paths(grid, ANGLES)]
    except InputError as error:
        words = "there are no paths%s: %s"
        log.warning(words, f" of {name}" if name else "", error, extra=MARKED)
        return []


def draw_compared(folder: Path, grids: Mapping[str, pyvista.UnstructuredGrid], punch: Tool) -> None:
    """Outlines and paths of plies {label: grid} side by side."""
    forming_pictures.outline_picture(folder / "outline.png", grids)
    fabrics = of_fabric(grids)
    paths = {label: each for label, grid in fabrics.items() for each in _paths(label, grid)}
    if not paths:
        return
    surface, marks = punch.surface, {}
    if isinstance(surface, DoubleDome):
        rays = [np.array([[math.cos(k)], [math.sin(k)]]) for k in np.radians(ANGLES)]
        at = [brentq(lambda r, ray=ray: surface.plan(*(r * ray))[0][0], 0, 1e3) for ray in rays]
        marks = {"outline of the punch": at}
    forming_pictures.paths_picture(folder / "paths.png", paths, marks)
