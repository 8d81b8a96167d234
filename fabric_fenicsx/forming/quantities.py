"""The quantities of a formed blank, as functions of the built scene and the result."""

from typing import Any

import numpy as np

from ..job.job import Result
from ..mechanics.contact.coulomb import MAX_SLIP
from ..mechanics.springs import Springs
from ..postprocess.ply import Grid
from ..postprocess.wrinkles import height_map, wrinkles
from ..results import measures, quantities
from ..results.history import energies_of, stretching
from ..runtime.collective_errors import on_root
from ..runtime.formatting import share
from ..scene import output
from ..sheets.blank import Part
from .forming_scene import FormingScene


def all_of(made: FormingScene, result: Result) -> dict[str, Any]:
    """Forces, penetrations, shear, strains, draw-in, thickness, wrinkles; for metal thinning,
    plastic strain and stress; for a stack the pressure between sheets. Those of a stack are for all
    sheets together; `plies` has those of each sheet."""
    numbers = (
        force_quantities(made, result)
        | contact_quantities(made, result)
        | sheet_quantities(made, result)
    )
    if fields := made.fields():
        numbers["fields"] = fields
    if "sheet_pressure" in result.fields:  # means of cells on the next sheet
        pressure = np.nan_to_num(result.fields["sheet_pressure"])
        numbers["sheet_pressure_largest_MPa"] = measures.extremes(made.comm, pressure)[1]
    return numbers


def force_quantities(made: FormingScene, result: Result) -> dict[str, Any]:
    """Forces [N]: of the leading tool towards the blank, as `force_N` and under its name, on the
    modelled part and on the whole blank; the size of each contact force on the modelled part; the
    force of each tool along z on the whole blank."""
    part, force, leader = made.modelled_share(), result.rows[-1]["reaction_N"], made.leader().name
    return {
        "force_N": force,
        "force_of_whole_blank_N": force / part,
        f"{leader}_force_N": force,
        f"{leader}_force_of_whole_ply_N": force / part,
        "contact_forces_N": {
            term.tool.name: float(np.linalg.norm(term.force())) for term in made.pressing
        },
        "tool_forces_of_whole_blank_N": {
            term.tool.name: float(output.tool_force(made.scene, term.tool)[2]) / part
            for term in made.pressing
        },
    }


def contact_quantities(made: FormingScene, result: Result) -> dict[str, Any]:
    """Forces that are not in balance, penetration of tools, and what else checks the contact."""
    scene, interface, energies = made.scene, made.data.interface, energies_of(result.rows[-1])
    total = sum((output.tool_force(scene, term.tool) for term in made.pressing), np.zeros(3))
    total += sum((term.force() for term in scene.terms if isinstance(term, Springs)), np.zeros(3))
    return {
        "unbalanced_force_N": float(abs(total[2])),
        "penalty_N_per_mm3": interface.penalty,
        "penetration_mm": max(each.penetration() for each in made.contacts),
        "penetration_largest_mm": max(each.largest_penetration() for each in made.contacts),
        "penetration_of_thickness": output.deepest(scene)[0],
        "sticking_slip_mm": (interface.slip or MAX_SLIP) if interface.friction else None,
        "viscous_of_strain_energy": share(energies["viscous"], stretching(energies)),
    }


def sheet_quantities(made: FormingScene, result: Result) -> dict[str, Any]:
    """Quantities of the one sheet, or of all sheets of a stack together and of each."""
    parts = made.blank.parts or {"": made.blank.whole}
    plies: dict[str, dict[str, Any]] = {}
    fabrics: list[Part] = []
    metals: list[Part] = []
    made.wrinkle_heights = wrinkle_heights(made, result)
    for sheet, (name, part) in zip(made.sheets, parts.items()):
        (metals if sheet.metal else fabrics).append(part)
        of_cells = quantities.metal_quantities if sheet.metal else quantities.fabric_quantities
        plies[name] = of_cells(result, [part])
        heights = made.wrinkle_heights.get(name)
        waves = on_root(made.comm, lambda: wrinkles(heights) if heights else None)
        plies[name] |= {"draw_in": result.draw_in(part.name), "wrinkles": waves}
    whole = plies.get("")
    if not whole:
        if name := quantities.middle_of(made.sheets):
            plies[name] |= quantities.middle_quantities(result, name)
        whole = quantities.stack_quantities(result, plies, fabrics, metals) | {"plies": plies}
    whole["shortening_mean"] = None
    if fabrics:  # of yarns by compression, over the area of fabric
        cells = np.concatenate([part.cells for part in fabrics])
        short, areas = quantities.shortening(result.fields)[cells], made.blank.areas()[cells]
        whole["shortening_mean"] = measures.mean(made.comm, short, areas)
    return whole


def wrinkle_heights(made: FormingScene, result: Result) -> dict[str, Grid]:
    """{name of a sheet: its `height_map`}, on rank 0 only. What lies on a sheet on that side is
    between it and the tools."""
    names = made.blank.parts or [""]
    parts = made.blank.parts.values() or [made.blank.whole]
    waves = [quantities.shortest_wave_of(made.scene, part) or 0.0 for part in parts]
    if made.comm.rank:
        return {}
    shortest = {n: wave if np.isfinite(wave) else 0.0 for n, wave in zip(names, waves)}
    thickness = np.array([sheet.thickness_under(0.0) for sheet in made.sheets])
    below = thickness.cumsum() - thickness / 2

    def distances(below, above):
        def height(x):
            least = np.full(len(x), np.inf)
            for tool in output.tools(result.scene):
                near = tool.evaluate(x)
                least = np.fmin(least, near.gap - np.where(near.normal[:, 2] > 0, below, above))
            return least

        return height

    over_tools = {n: distances(z, thickness.sum() - z) for n, z in zip(names, below)}
    plies = result.grids.items()
    return {name: height_map(grid, over_tools[name], shortest[name]) for name, grid in plies}
