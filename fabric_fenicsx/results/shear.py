"""How far fabric is sheared, and where its cells crumple: there the largest shear angle says
little."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..runtime.formatting import of_sheet, percent, rounded
from ..sheets.blank import Part
from . import measures
from .result import Result
from .shortening import shortening, shortening_quantities, shortening_warning

CRUMPLED = 0.05  # shortening of yarns beyond which a cell crumples
FIELDS = "shear_angle", "shortening_a", "shortening_b"  # of fabric


def shear_quantities(result: Result, parts: Sequence[Part]) -> dict[str, Any]:
    """Of all cells of the `parts`, which are of fabric: the largest magnitude of the shear angle,
    its place (x, y) of the flat sheet [mm], of several parts with the name of that part, and how
    much yarns are shortened there; the angle that 99 % of the area stay below [deg]."""
    comm, blank = result.scene.comm, result.scene.blank
    cells = np.concatenate([part.cells for part in parts])
    angle, areas = np.degrees(np.abs(result.fields["shear_angle"][cells])), measures.areas(blank)
    also = shortening(result.fields)[cells]
    largest, place, there = measures.largest_in(blank, parts, angle, also)
    return {
        "shear_angle_max_deg": largest,
        **{f"shear_angle_max_{key}": value for key, value in place.items()},
        "shear_angle_99_percent_deg": measures.quantiles(comm, angle, areas[cells], (0.99,))[0],
        "shortening_at_shear_angle_max": there,
    }


def crumpling_warning(name: str, found: Mapping[str, Any]) -> str:
    """A sentence if the largest shear angle of the sheet of this name, whose `shear_quantities` are
    `found`, lies in a cell that crumples, else "": such an angle depends on mesh and contact."""
    there = found["shortening_at_shear_angle_max"]
    if there <= CRUMPLED:
        return ""
    return (
        f"the largest shear angle of {name}, {rounded(found['shear_angle_max_deg'])} deg at "
        f"{of_sheet(found['shear_angle_max_at_mm'])}, lies where yarns are shortened by "
        f"{percent(there)}: cells crumple there, and it depends on mesh and contact; 99 % "
        f"of the area stay below {rounded(found['shear_angle_99_percent_deg'])} deg"
    )


def fabric_warnings(result: Result) -> list[str]:
    """`crumpling_warning` and `shortening_warning` of each part of fabric of a sheet in space, as a
    plane one can't fold."""
    blank, fields = result.scene.blank, result.fields
    if blank.mesh.geometry.dim == 2 or not set(FIELDS) <= set(fields):
        return []
    found = []
    for part in list(blank.parts.values()) or [blank.whole]:
        unknown = int(np.isnan(fields["shear_angle"][part.cells]).sum())
        if not result.scene.comm.allreduce(unknown):
            name = part.name or blank.name
            found.append(crumpling_warning(name, shear_quantities(result, [part])))
            found.append(shortening_warning(name, shortening_quantities(result, [part])))
    return list(filter(None, found))
