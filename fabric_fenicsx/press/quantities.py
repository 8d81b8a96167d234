"""The quantities of a formed blank, as functions of the built press and the result."""

from functools import partial

import numpy as np

from ..contact.coulomb import MAX_SLIP
from ..core.collective_errors import on_root
from ..core.formatting import share
from ..energy.springs import Springs
from ..io.field import Field
from ..job.job import Result
from ..results import measures, quantities
from ..results.history import energies_of, stretching
from ..results.ply import Grid
from ..results.verdict import Numbers
from ..results.wrinkles import height_map, wrinkles
from ..scene import output
from ..sheet.part import Part
from .built import BuiltPress


def all_of(made: BuiltPress, result: Result) -> Numbers:
    """Forces, penetrations, shear, strains, draw-in, thickness, wrinkles; for metal thinning,
    plastic strain and stress; for a stack the pressure between sheets. Those of a stack are for all
    sheets together; `plies` has those of each sheet."""
    numbers = _of_contact(made, result) | _of_sheets(made, result)
    if fields := field_ranges(made):
        numbers["fields"] = fields
    if "sheet_pressure" in result.fields:  # means of cells on the next sheet
        pressure = np.nan_to_num(result.fields["sheet_pressure"])
        numbers["sheet_pressure_largest_MPa"] = measures.extremes(made.scene.comm, pressure)[1]
    return numbers


def field_ranges(made: BuiltPress) -> dict[str, str]:
    """{name: least to largest value and source} of what is a field; on all ranks."""
    units = {"fibre_angle": "deg", "thickness": "mm", "temperature": "C"}
    found = dict[str, tuple[Field, np.ndarray]]()
    for path, sheet, blank in zip(made.data.paths(), made.sheets, made.laid.blanks):
        of_sheet = {f"{path}.{name}_{units[name]}": getattr(sheet, name) for name in units}
        given = {name: value for name, value in of_sheet.items() if isinstance(value, Field)}
        found |= {name: (value, value.at(blank.centres())) for name, value in given.items()}
    for term in made.scene.terms:
        owner = term.tool.name if term.tool else term.name
        for name, (field, _, values) in term.fields.items():
            if name.startswith("friction"):
                found[f"{name} on {owner}"] = field, values
    extremes = partial(measures.extremes, made.scene.comm)
    return {name: field.told(*extremes(values)) for name, (field, values) in found.items()}


def _of_contact(made, result):
    """Force of the leading tool towards the whole blank; of each tool the force along z on the
    whole blank and the size of the contact force on the modelled part [N]; forces that are not in
    balance, penetration, and what else checks the contact."""
    scene, interface, energies = made.scene, made.data.interface, energies_of(result.rows[-1])
    part = made.modelled_share
    forces = [(term.tool.name, output.tool_force(scene, term.tool)) for term in made.pressing]
    total = sum((force for _, force in forces), np.zeros(3))
    total += sum((term.force() for term in scene.terms if isinstance(term, Springs)), np.zeros(3))
    return {
        "force_of_whole_blank_N": result.rows[-1]["reaction_N"] / part,
        "contact_forces_N": {
            term.tool.name: float(np.linalg.norm(term.force())) for term in made.pressing
        },
        "tool_forces_of_whole_blank_N": {name: float(force[2]) / part for name, force in forces},
        "unbalanced_force_N": float(abs(total[2])),
        "penalty_N_per_mm3": interface.penalty,
        "penetration_mm": max(each.penetration() for each in made.contacts),
        "penetration_largest_mm": max(each.largest_penetration() for each in made.contacts),
        "penetration_of_thickness": output.deepest(scene)[0],
        "sticking_slip_mm": (interface.slip or MAX_SLIP) if interface.friction else None,
        "viscous_of_strain_energy": share(energies["viscous"], stretching(energies)),
    }


def _of_sheets(made, result):
    """Quantities of the one sheet, or of all sheets of a stack together and of each."""
    blank, comm = made.scene.blank, made.scene.comm
    fabrics, metals = list[Part](), list[Part]()
    plies: dict[str, Numbers] = {}
    made.wrinkle_heights = wrinkle_heights(made, result)
    for sheet, (name, part) in zip(made.sheets, (blank.parts or {"": blank.whole}).items()):
        (metals if sheet.metal else fabrics).append(part)
        of_cells = quantities.metal_quantities if sheet.metal else quantities.fabric_quantities
        plies[name] = of_cells(result, [part]) | {"draw_in": result.draw_in(part.name)}
        plies[name]["wrinkles"] = on_root(comm, lambda: wrinkles(made.wrinkle_heights[name]))
    whole = plies.get("")
    if not whole:
        if name := quantities.middle_of(made.sheets):
            plies[name] |= quantities.middle_quantities(result, name)
        whole = quantities.stack_quantities(result, plies, fabrics, metals) | {"plies": plies}
    whole["shortening_mean"] = None
    if fabrics:  # of yarns by compression, over the area of fabric
        cells = measures.cells_of(fabrics)
        short, areas = quantities.shortening(result.fields)[cells], blank.areas()[cells]
        whole["shortening_mean"] = measures.mean(comm, short, areas)
    return whole


def wrinkle_heights(made: BuiltPress, result: Result) -> dict[str, Grid]:
    """{name of a sheet: its `height_map`}, on rank 0 only. What lies on a sheet on that side is
    between it and the tools."""
    parts = made.scene.blank.parts or {"": made.scene.blank.whole}
    waves = {n: quantities.shortest_wave_of(made.scene, part) for n, part in parts.items()}
    if made.scene.comm.rank:
        return {}
    thickness = np.array([sheet.thickness_under(0.0) for sheet in made.sheets])
    below = thickness.cumsum() - thickness / 2
    tools, heights = output.tools(result.scene), {}
    for (name, wave), z in zip(waves.items(), below):
        off = partial(_off_tools, tools, z, thickness.sum() - z)
        shortest = wave if wave and np.isfinite(wave) else 0.0
        heights[name] = height_map(result.grids[name], off, shortest)
    return heights


def _off_tools(tools, below, above, x):
    """Distance of places x (n, 3) of a sheet from the nearest tool, less what lies below or above
    the sheet [mm]."""
    least = np.full(len(x), np.inf)
    for near in (tool.evaluate(x) for tool in tools):
        least = np.fmin(least, near.gap - np.where(near.normal[:, 2] > 0, below, above))
    return least
