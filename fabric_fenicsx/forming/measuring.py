"""What a forming run tells: its numbers, and its pictures."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..job.job import Result
from ..mechanics.contact import output as contact_output
from ..mechanics.springs import Springs
from ..scene import output as reports
from ..sheets.blank import Part
from ..tools.tool import Tool

STRETCHING = "strain", "metal", "plastic"  # energies that regularisation is measured by


def quantities(forming: Any, result: Result) -> dict[str, Any]:
    """Forces, penetrations, shear, strains, draw-in and, once the tools are closed, wrinkles; of
    metal thinning, plastic strain and stress. Those of a stack are over all its plies, and each
    one's are in `plies`."""
    force = result.rows[-1]["reaction_N"]
    found = {
        "punch_force_N": force,
        "punch_force_of_whole_ply_N": force / forming.modelled(),
        "contact_forces_N": {
            term.tool.name: float(np.linalg.norm(term.force())) for term in forming.pressing
        },
    }
    closed = forming.closes and result.rows[-1]["load"] == 1
    plies = of_plies(forming, result, forming.punch_tool, closed)
    return found | of_contact(forming, result) | plies


def of_contact(forming: Any, result: Result) -> dict[str, Any]:
    """What speaks for or against the contact with tools in a run of a `BetweenTools`."""
    rows, scene = result.rows, forming.scene
    total = sum((reports.tool_force(scene, term.tool) for term in forming.pressing), np.zeros(3))
    total += sum((term.force() for term in scene.terms if isinstance(term, Springs)), np.zeros(3))
    kept = sum(rows[-1].get(f"{kind}_energy_Nmm", 0.0) for kind in STRETCHING)
    return {
        "unbalanced_force_N": float(abs(total[2])),
        "penalty_N_per_mm3": forming.penalty,
        "penetration_mm": max(map(contact_output.penetration, forming.contacts)),
        "penetration_largest_mm": max(map(contact_output.largest_penetration, forming.contacts)),
        "penetration_of_thickness": reports.deepest(scene)[0],
        "sticking_slip_mm": forming.slip if forming.friction else None,
        "viscous_of_strain_energy": rows[-1]["viscous_energy_Nmm"] / kept if kept else 0.0,
    }


def of_plies(forming: Any, result: Result, tool: Tool, closed: bool) -> dict[str, Any]:
    """Of the one ply, or of a stack over all plies and of each. tool: which wrinkles are measured
    from, if it is `closed`."""
    from ..results import formed

    parts = forming.blank.parts or {"": forming.blank.whole}
    plies, below = {}, 0.0
    fabrics: list[Part] = []
    metals: list[Part] = []
    for ply, (name, part) in zip(forming.plies, parts.items()):
        thickness = ply.thickness_under(0.0)
        (metals if ply.metal else fabrics).append(part)
        of_cells = formed.metal_quantities if ply.metal else formed.fabric_quantities
        middle = below + thickness / 2
        plies[name] = of_cells(result, [part])
        plies[name] |= formed.shape(result, part, tool, middle, closed)
        below += thickness
    if not forming.stack:
        return plies[""]
    return formed.stack_quantities(result, plies, fabrics, metals) | {"plies": plies}


def pictures(forming: Any, result: Result, folder: Path) -> None:
    """Strain states, the formed plies, paths and metal of a run."""
    from ..results import formed

    angles = [
        (ply.fibre_angle, ply.fibre_angle + ply.yarn_angle) if ply.fabric else ()
        for ply in forming.plies
    ]
    formed.draw_plies(folder, result.grids, angles, forming.punch_mesh())
    formed.draw_compared(folder, result.grids, forming.punch_tool)


def compare(forming: Any, results: Mapping[str, Result], folder: Path) -> None:
    """Outlines and paths of plies {label: `Result`} side by side, into `folder`."""
    from ..results import formed

    grids = {
        " ".join(filter(None, (label, name))): grid
        for label, result in results.items()
        for name, grid in result.grids.items()
    }
    formed.draw_compared(folder, grids, forming.punch_tool)
