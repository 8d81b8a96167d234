"""Output of interactions: forces, gaps, depths and sliding in a state, and fields, entries and
warnings of a run (the `outputs` of terms, see `mechanics.output`). Arrays are of this rank."""

from typing import Any

import numpy as np
from mpi4py import MPI

from ...runtime.formatting import of_sheet
from ..output import Value, joined, largest, least, size_of, total
from .interaction import Interaction
from .pressure_law import Rigid

# the classes name these functions in their `outputs`, so they are not known here
Contact = Any
BlankHolderPressure = Any
SheetContact = Any


# -- depths in accepted states


def largest_depth(term: Interaction) -> float:
    """Largest overlap in accepted states, of all ranks [mm]."""
    return _largest(term, term.depth)


def largest_penetration(term: Interaction) -> float:
    """Largest penetration of rigid faces in accepted states, of all ranks [mm]."""
    return _largest(term, _penetrated(term))


def penetration_of_thickness(term: Interaction) -> float:
    """See `Penetrated`."""
    return _largest(term, _penetrated(term) / term.thickness)


def _penetrated(term):
    return np.where(term.rigid, term.depth, 0.0)


def _largest(term, values):
    return term.blank.mesh.comm.allreduce(float(values.max(initial=0.0)), MPI.MAX)


# -- tools


def tractions(contact: Contact) -> np.ndarray:
    """Tractions of the tool on the nodes, (nodes, 3) [MPa]."""
    return contact.state().forces / np.maximum(contact.nodes.areas, 1e-300)[:, None]


def gap(contact: Contact) -> np.ndarray:
    """Gap from the sheet's face to the tool at the nodes, below 0 inside, (nodes,) [mm]."""
    x = contact.nodes.places + contact.nodes.displacement()
    found = contact.tool.evaluate(x).gap
    for reach in (0.0, float(contact.thickness.max(initial=0.0))):
        lost = np.isnan(found)  # so far off that no nearest point is found: a bound will do
        found[lost] = contact.tool.evaluate(x[lost], reach).gap
    found[~contact.nodes.own] = np.inf
    return found - contact.thickness / 2


def penetration(contact: Contact) -> float:
    """Largest depth of the tool in rigid faces in the present state, of all ranks [mm]."""
    return _largest(contact, 0.0 - contact.state().gap[contact.rigid])


def touched(contact: Contact) -> bool:
    """True if the tool pressed the sheet in any accepted state."""
    return largest_depth(contact) > 0


def where_tool_is_deepest(contact: Contact) -> str:
    """See `Penetrated`, with the place in the undeformed sheet."""
    depth, places = _penetrated(contact), contact.nodes.places
    i = int(depth.argmax()) if depth.size else None
    mine = (0.0, ()) if i is None else (depth[i], tuple(places[i]))
    _, place = max(contact.nodes.comm.allgather(mine))
    at = of_sheet(place[:2] if contact.blank.is_flat() else place)
    return f"{contact.tool.name} at {at}"


def tool_cell_fields(contact: Contact) -> dict[str, Value]:
    """Fields of `PlyThickness`."""
    lost = np.where(contact.rigid, 0.0, np.maximum(0.0, -contact.state().gap))
    return contact.plies.fields(contact.blank.cell_means(lost))


def tool_nodal_fields(contact: Contact) -> dict[str, Value]:
    """Traction (nodes, 3) of all tools together, which is 0 where two press a ply from both sides;
    the pressure, of several tools the largest; and the gap to the nearest tool."""
    traction = tractions(contact)
    return {
        "contact_traction": total(traction, "MPa"),
        "contact_pressure": largest(np.linalg.norm(traction, axis=1), "MPa"),
        "contact_gap": least(gap(contact), "mm"),
    }


def surface_warnings(contact: Contact) -> list[str]:
    """See `Term`: if the tool's surface gave no number, which may be why steps failed."""
    lost = next(filter(None, contact.nodes.comm.allgather(contact.undefined_at)), "")
    if not lost:
        return []
    surface = type(contact.tool.surface).__name__
    return [
        f"the surface {surface} of {contact.tool.name} gives no number at {lost}; "
        "`check_derivatives` tells what is wrong with a surface of your own"
    ]


def holder_cell_fields(holder: BlankHolderPressure) -> dict[str, Value]:
    """Fields of `PlyThickness`, of the face that the holder presses."""
    share = holder.areas / np.maximum(holder.nodes.areas, 1e-300)
    lost = holder.blank.cell_means(share) * holder.plies.lost_under(holder.now)
    return holder.plies.fields(lost)


# -- sheets


def sliding(contact: SheetContact) -> np.ndarray:
    """Distance by which the face at each point has slid along that of the other sheet from the
    place that it lay on at the start, (points, 3) [mm]; NaN where it lay or lies over none."""
    points, first, now = contact.points, contact.first, contact.faces.now
    moved = points.of_all(first, first.moved(), np.nan)
    moved -= points.of_all(now, now.offsets(), np.nan)
    moved += points.of_all(first, first.offsets(), np.nan)
    normal = points.of_all(now, now.normal, np.nan)
    return moved - (moved * normal).sum(1, keepdims=True) * normal


def sheet_cell_fields(contact: SheetContact) -> dict[str, Value]:
    """Means over the cells of the sheet that has the points: pressure, and the sliding on the other
    sheet, as a vector and its size; of two other sheets the larger."""
    points = contact.points
    shape = len(points.part.cells), points.per_cell
    pressure = contact.normal_forces() / points.areas
    slid = np.nan_to_num(sliding(contact)).reshape(*shape, 3).mean(1)
    return {
        "sheet_pressure": largest(points.part.spread(pressure.reshape(shape).mean(1)), "MPa"),
        "sliding": largest(points.part.spread(slid), "mm"),
        "sliding_size": size_of("sliding", "mm"),
    } | contact.plies.fields(_lost(contact, pressure))


def _lost(contact, pressure):
    """Thickness that both sheets lose on these faces, (owned cells,) [mm]."""
    points, laws = contact.points, contact.face_laws
    above, below = (
        np.zeros(points.count) if isinstance(law, Rigid) else law.depth(pressure)
        for law in (laws[::-1] if points.side > 0 else laws)
    )
    lost = contact.blank.cell_means(points.below(contact.faces.now, below))
    lost[points.part.cells] += above.reshape(-1, points.per_cell).mean(1)
    return lost


def sheet_summary(contact: SheetContact) -> dict[str, Value]:
    """Force, penetration and largest sliding of the pair."""
    comm, sizes = contact.blank.mesh.comm, np.linalg.norm(sliding(contact), axis=1)
    pair = {
        "force_N": float(np.linalg.norm(contact.totals[:3])),
        "normal_force_N": float(contact.totals[3]),
        "penetration_of_thickness": penetration_of_thickness(contact),
        "sliding_largest_mm": comm.allreduce(float(np.nanmax(sizes, initial=0.0)), MPI.MAX),
    }
    return {"sheet_contacts": joined({f"{contact.sheets[0]}, {contact.sheets[1]}": pair})}
