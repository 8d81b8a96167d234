"""The quantities of a formed blank, as functions of the built scene and the result."""

from typing import Any

import numpy as np

from ..job.job import Result
from ..mechanics.springs import Springs
from ..results import measures, quantities
from ..scene import output
from ..sheets.blank import Part
from .build import FormingScene

STRETCHING = (
    "strain",
    "metal",
    "plastic",
)  # energies with which that of the regularisation is compared


def all_of(made: FormingScene, result: Result) -> dict[str, Any]:
    """Forces, penetrations, shear, strains, draw-in, thickness, wrinkles; for metal thinning,
    plastic strain and stress; for a stack the pressure between sheets. Those of a stack are for all
    sheets together; `plies` has those of each sheet."""
    found = of_forces(made, result) | of_contact(made, result) | of_sheets(made, result)
    if "sheet_pressure" in result.fields:  # means of cells on the next sheet
        pressure = np.nan_to_num(result.fields["sheet_pressure"])
        found["sheet_pressure_largest_MPa"] = measures.extremes(made.comm, pressure)[1]
    return found


def of_forces(made: FormingScene, result: Result) -> dict[str, Any]:
    """Forces [N]: of the leading tool towards the blank, as `force_N` and under its name, on the
    modelled part and on the whole blank; the size of each contact force on the modelled part; the
    force of each tool along z on the whole blank."""
    share, force, leader = made.modelled_share(), result.rows[-1]["reaction_N"], made.leader().name
    return {
        "force_N": force,
        "force_of_whole_blank_N": force / share,
        f"{leader}_force_N": force,
        f"{leader}_force_of_whole_ply_N": force / share,
        "contact_forces_N": {
            term.tool.name: float(np.linalg.norm(term.force())) for term in made.pressing
        },
        "tool_forces_of_whole_blank_N": {
            term.tool.name: float(output.tool_force(made.scene, term.tool)[2]) / share
            for term in made.pressing
        },
    }


def of_contact(made: FormingScene, result: Result) -> dict[str, Any]:
    """Forces that are not in balance, penetration of tools, and what else checks the contact."""
    rows, scene, interface = result.rows, made.scene, made.data.interface
    total = sum((output.tool_force(scene, term.tool) for term in made.pressing), np.zeros(3))
    total += sum((term.force() for term in scene.terms if isinstance(term, Springs)), np.zeros(3))
    kept = sum(rows[-1].get(f"{kind}_energy_Nmm", 0.0) for kind in STRETCHING)
    return {
        "unbalanced_force_N": float(abs(total[2])),
        "penalty_N_per_mm3": interface.penalty,
        "penetration_mm": max(each.penetration() for each in made.contacts),
        "penetration_largest_mm": max(each.largest_penetration() for each in made.contacts),
        "penetration_of_thickness": output.deepest(scene)[0],
        "sticking_slip_mm": interface.slip if interface.friction else None,
        "viscous_of_strain_energy": rows[-1]["viscous_energy_Nmm"] / kept if kept else 0.0,
    }


def of_sheets(made: FormingScene, result: Result) -> dict[str, Any]:
    """Quantities of the one sheet, or of all sheets of a stack together and of each."""
    parts = made.blank.parts or {"": made.blank.whole}
    closed = result.rows[-1]["load"] == 1 and made.closed()
    tool = next(iter(closed.values())) if closed else made.leader()
    plies: dict[str, dict[str, Any]] = {}
    below = 0.0
    fabrics: list[Part] = []
    metals: list[Part] = []
    for sheet, (name, part) in zip(made.sheets, parts.items()):
        thickness = sheet.thickness_under(0.0)
        (metals if sheet.metal else fabrics).append(part)
        of_cells = quantities.metal_quantities if sheet.metal else quantities.fabric_quantities
        middle = below + thickness / 2
        plies[name] = of_cells(result, [part])
        plies[name] |= quantities.shape(result, part, tool, middle, bool(closed))
        below += thickness
    found = plies.get("")
    if not found:
        if name := quantities.middle_of(made.sheets):
            plies[name] |= quantities.middle_quantities(result, name)
        found = quantities.stack_quantities(result, plies, fabrics, metals) | {"plies": plies}
    return found | {"wrinkles": _wrinkles(made, result, fabrics, found)}


def _wrinkles(made, result, fabrics, found):
    """Mean shortening of yarns by compression over the area of fabric, the largest length that a
    yarn loses, and, between closed tools, the slopes to the tool."""
    if not fabrics:
        return None
    cells = np.concatenate([part.cells for part in fabrics])
    short, areas = quantities.shortening(result.fields)[cells], made.blank.areas()[cells]
    return (found.get("wrinkles") or {}) | {
        "shortening": measures.mean(made.comm, short, areas),
        "excess_length_mm": found.get("excess_length_mm"),
    }
