"""Rigid motions of a sheet that neither supports nor terms hold."""

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI

from ..mechanics.term import Term, overrides
from ..runtime.errors import InputError
from ..sheets.blank import Blank
from .dirichlet import FixedDofs

TURNS = {2: [(0, 1)], 3: [(1, 2), (2, 0), (0, 1)]}  # axes of each turn's plane, by dimension


def check_held(blank: Blank, terms: Sequence[Term], supports: FixedDofs) -> str:
    """Raise InputError, naming the motion, if supports and terms let the blank, as it is now, move
    as a rigid body; a warning if, in its plane, only shapes of smooth tools may hold it, else "".

    Planes never do, nor does a ball against turning: motions along which no tool's normal anywhere
    points are refused. Other tools may once the sheet is formed, so refusing them would be wrong.
    """
    low, high = blank.extent()
    # so much that a smooth tool does not hold it within its plane
    flat = len(low) == 2 or (high - low)[2] <= 0.05 * (high - low).max()
    resisted = {motion for term in terms for motion in term.resists}
    node, axis = np.divmod(supports.dofs, len(low))
    x, along = blank.coordinates()[node], np.eye(3)[axis]
    x[:, : len(low)] += blank.nodal_displacement()[node]
    free, smooth = free_motion(blank, x, along, resisted), "lift" in resisted
    if not free:
        return ""
    touching = [term for term in terms if overrides(term, "may_press")]
    if smooth and not (flat and len({term.tool for term in touching}) == 1):
        pressed = [each for term in touching for each in term.may_press()]
        places, normals = (np.vstack(each) for each in zip((x, along), *pressed))
        by_shapes = free_motion(blank, places, normals, resisted)
        if flat and not by_shapes:
            return (
                f"nothing but the shapes of tools without friction holds {blank.name}, which may "
                f"{free} until it is formed: steps are slow till then and may fail; friction, or "
                "supports that only locate it (`Support(..., locates=True)`), would hold it"
            )
        free = by_shapes
    if free:
        names = ", ".join(support.name for support in supports) or "none"
        raise InputError(
            f"the supports ({names}) leave {blank.name} free to {free}"
            + (", which contact without friction does not resist" if smooth else "")
            + "; allowed are supports, or a term's `resists`, that hold every rigid motion"
            + (", or friction, as `Contact(tool, friction=0.25)`" if smooth else "")
        )
    return ""


def is_held_by_friction(blank: Blank, terms: Sequence[Term]) -> bool:
    """True if the largest friction of tools in the accepted state holds the blank in its plane,
    against turning not only near one point; of a stack, whose sheets slide on one another, not
    known."""
    contacts = [term.rubbed() for term in terms if overrides(term, "rubbed")]
    if blank.parts or not contacts:
        return False
    x, normals, most = (np.concatenate(each) for each in zip(*contacts))
    total = blank.mesh.comm.allreduce(float(most.sum()))
    if not total:
        return False
    share, axes = np.sqrt(most / total)[:, None], enumerate(np.eye(3))
    tangents = np.concatenate([share * (axis - normals * normals[:, [i]]) for i, axis in axes])
    resisted = {motion for term in terms for motion in term.resists} - {"slide"}
    # from 1e-3 on, friction holds more than one place against turning
    return not free_motion(blank, np.tile(x, (3, 1)), tangents, resisted, least=1e-3)


def free_motion(
    blank: Blank, places: np.ndarray, along: np.ndarray, resisted: set[str], least: float = 1e-9
) -> str:
    """The rigid motion, such as "turn about its length", that neither terms (`resisted`) hold nor
    points of this rank at `places` (k, 3) [mm] along axes of the frame or vectors `along` (k, 3);
    "" if there is none. least: stiffness from which a motion is held, of unit vectors."""
    gdim = blank.mesh.geometry.dim
    low, high = (corner[:, None] for corner in blank.extent())
    x = (blank.along(places.T) - (low + high) / 2) / (high - low).max()
    moves, axes = list(along.T[:gdim]), ("length", "width", "normal")
    turns = [x[i] * moves[j] - x[j] * moves[i] for i, j in TURNS[gdim]]
    names = [f"move along its {axis}" for axis in axes[:gdim]]
    names += [f"turn about its {axis}" for axis in axes[-len(turns) :]]
    lifts = "move along its normal", "turn about its length", "turn about its width"
    kinds = [{name.split()[0], "lift" if name in lifts else "slide"} for name in names]
    left = [i for i, kind in enumerate(kinds) if not kind & resisted]
    motions = np.array(moves + turns)
    products = blank.mesh.comm.allreduce(motions @ motions.T, MPI.SUM)[np.ix_(left, left)]
    stiffness, free = np.linalg.eigh(products)
    if not left or stiffness[0] > least * max(stiffness[-1], 1.0):
        return ""
    return names[left[np.abs(free[:, 0]).argmax()]]
