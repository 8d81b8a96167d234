"""How far fabric is sheared, and where its cells crumple: there the largest shear angle says
little."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..sheets.blank import Part
from . import measures
from .result import Result

CRUMPLED = 0.05  # shortening of yarns beyond which a cell crumples
FIELDS = "shear_angle", "eps_a", "eps_b"


def shear_quantities(result: Result, parts: Sequence[Part]) -> dict[str, Any]:
    """Of all cells of the `parts`, which are of fabric: the largest magnitude of the shear angle
    and the one that 99 % of the area stay below [deg]; `crumpled_share`, the share of the area in
    which yarns are shortened by more than `CRUMPLED`; `shortening_max`, how much they are at most
    (nominal strain, 0 if nowhere), and how much where the shear angle is largest.

    `..._at_mm` are places (x, y) of the flat sheet, of several parts `..._in` the name of theirs.
    """
    comm, blank = result.scene.comm, result.scene.blank
    cells = np.concatenate([part.cells for part in parts])
    part_of = np.repeat(np.arange(len(parts)), [len(part.cells) for part in parts])
    shear_angle, *strains = (result.fields[name][cells] for name in FIELDS)
    angle = np.degrees(np.abs(shear_angle))
    shortening = np.maximum(0.0, -np.minimum(*strains))
    areas = measures.areas(blank)[cells]
    # to few digits, so that of places that mirror each other the same is named on any ranks
    rows = np.column_stack([part_of, blank.midpoints()[:2, cells].T.round(6), shortening])
    found: dict[str, Any] = {}
    at_most: list[float] = []
    for name, unit, values in (("shear_angle", "_deg", angle), ("shortening", "", shortening)):
        largest, (k, x, y, at_most_here) = measures.where_largest(comm, values, rows)
        found |= {f"{name}_max{unit}": largest, f"{name}_max_at_mm": [x + 0.0, y + 0.0]}
        found |= {f"{name}_max_in": parts[int(k)].name} if len(parts) > 1 else {}
        at_most.append(at_most_here)
    crumples = (shortening > CRUMPLED) * 1.0
    return found | {
        "shear_angle_99_percent_deg": measures.quantiles(comm, angle, areas, (0.99,))[0],
        "shortening_at_shear_angle_max": at_most[0],
        "crumpled_share": measures.mean(comm, crumples, areas),
    }


def crumpling_warning(name: str, found: Mapping[str, Any]) -> str:
    """A sentence if the largest shear angle of the sheet of this name, whose `shear_quantities` are
    `found`, lies in a cell that crumples, else "": such an angle depends on mesh and contact."""
    shortening = found["shortening_at_shear_angle_max"]
    if shortening <= CRUMPLED:
        return ""
    x, y = found["shear_angle_max_at_mm"]
    return (
        f"the largest shear angle of {name}, {found['shear_angle_max_deg']:.3g} deg at "
        f"({x:.4g}, {y:.4g}) mm of the flat sheet, lies where yarns are shortened by "
        f"{100 * shortening:.2g} %: cells crumple there, and it depends on mesh and contact; 99 % "
        f"of the area stay below {found['shear_angle_99_percent_deg']:.3g} deg"
    )


def crumpling_warnings(result: Result) -> list[str]:
    """`crumpling_warning` of each part of fabric of a sheet in space, as a plane one can't
    fold."""
    blank, fields = result.scene.blank, result.fields
    if blank.mesh.geometry.dim == 2 or not set(FIELDS) <= set(fields):
        return []
    parts, found = list(blank.parts.values()) or [blank.whole], []
    for part in parts:
        unknown = int(np.isnan(fields["shear_angle"][part.cells]).sum())
        if not result.scene.comm.allreduce(unknown):
            quantities = shear_quantities(result, [part])
            found.append(crumpling_warning(part.name or blank.name, quantities))
    return list(filter(None, found))
