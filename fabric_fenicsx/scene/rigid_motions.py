"""Rigid motions of a sheet that neither supports nor terms hold, and isostatic supports that hold
them, and bear nothing in equilibrium."""

from collections.abc import Iterable, Sequence

import numpy as np
from mpi4py import MPI

from ..core.errors import InputError
from ..energy.term import Term, overrides
from ..sheet.blank import Blank
from ..sheet.sheet_mesh import bounds
from .supports import FixedDofs, Support

TURNS = {2: [(0, 1)], 3: [(1, 2), (2, 0), (0, 1)]}  # axes of each turn's plane, by dimension
PLANE_TOLERANCE = 1e-6  # of a blank's size, within which nodes lie in one plane


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
                f"{free} until it is formed: until then steps are slow and may fail; add friction "
                "or supports that only locate it (`Support(..., locates=True)`)"
            )
        free = by_shapes
    if free:
        names = ", ".join(support.name for support in supports) or "none"
        raise InputError(
            f"the supports ({names}) leave {blank.name} free to {free}"
            + (", which contact without friction does not resist" if smooth else "")
            + "; expected supports, or a term's `resists`, that prevent all rigid motions"
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


# -- isostatic supports


def planes_of_symmetry(blank: Blank, supports: Iterable[Support]) -> dict[int, Support]:
    """Those of the `supports` that are planes of symmetry, by the axis across them: they fix nodes
    of one plane, of the blank's length or width, along that axis alone, where they were."""
    planes, x = {}, blank.coordinates()
    for support in supports:
        moves = callable(support.value) or any(support.value)
        if support.components not in ((0,), (1,)) or moves or support.locates:
            continue
        (axis,) = support.components
        low, high = bounds(blank.mesh.comm, blank.along(x[support.where(x.T)].T)[[axis]])
        if (high - low)[0] <= PLANE_TOLERANCE * blank.sides().max():
            planes[axis] = support
    return planes


def beyond_planes(blank: Blank, supports: Iterable[Support]) -> dict[str, tuple[int, float]]:
    """Number of nodes beyond each plane of symmetry that bounds the flat sheets, by its support's
    name, and the farthest one's distance from it [mm]; none where there are none."""
    near, comm, crossed = PLANE_TOLERANCE * blank.sides().max(), blank.mesh.comm, {}
    owned = len(blank.whole.nodes)
    x = blank.coordinates()[:owned]
    now, flat = (blank.along(each.T) for each in (x + blank.nodal_displacement()[:owned], x))
    low, high = blank.extent()
    for axis, support in planes_of_symmetry(blank, supports).items():
        _, (place,) = bounds(comm, flat[[axis]][:, support.where(x.T)])
        side = int(place <= low[axis] + near) - int(place >= high[axis] - near)
        beyond = side * (place - now[axis])
        if count := comm.allreduce(int((beyond > near).sum())):
            crossed[support.name] = count, comm.allreduce(beyond.max(initial=0.0), MPI.MAX)
    return crossed


def isostatic(blank: Blank, kept: Sequence[Support]) -> list[Support]:
    """Supports of few nodes of each sheet of `blank`, where these are now, that hold the rigid
    motions which the `kept` ones leave, firmly as it lies now and as it was laid: of the node that
    those hold most, or nearest to the centre, and of nodes far from each other in either shape."""
    parts = [part for part in blank.parts.values() if part.thickness] or [blank.whole]
    return [support for part in parts for support in _of_sheet(blank, part, kept)]


def _of_sheet(blank, part, kept):
    places, moved, fixed = _nodes(blank, part, kept)
    shapes = [(x - x.mean(0)) / blank.sides().max() for x in (places + moved, places)]
    gdim = places.shape[1]
    motions = gdim + len(TURNS[gdim])
    firm, loose = 0.01, 1e-6  # share of a motion left by those before, from which a node holds it
    bases = []
    for x in shapes:
        basis = np.empty((0, motions))
        for axis in planes_of_symmetry(blank, kept):  # and no turn but about the axis
            turns = np.eye(motions)[gdim:]
            across = turns[[2]] if gdim == 2 else np.delete(turns, axis, 0)
            basis = _with(basis, np.vstack([_row(x[0], axis), across]), loose)
        rows = [_row(x[k], axis) for k, axis in zip(*np.nonzero(fixed))]
        bases.append(_with(basis, rows, loose))
    held = dict[int, list[int]]()
    corners = list(dict.fromkeys(k for x in (places, shapes[0]) for k in _corners(x, fixed)))
    for least in (firm, loose):
        for k in corners:
            for axis in range(gdim) if k == corners[0] else reversed(range(gdim)):
                more = [_with(b, [_row(x[k], axis)], least) for b, x in zip(bases, shapes)]
                if all(len(after) > len(b) for after, b in zip(more, bases)):
                    bases = more
                    held.setdefault(k, []).append(axis)
    name = part.name or blank.name
    return [
        _support(blank, f"point {i} of {name}", places[k], sorted(axes), moved[k])
        for i, (k, axes) in enumerate(held.items(), 1)
    ]


def _nodes(blank, part, kept):
    """Places and displacements (n, gdim) along the frame's axes [mm] of the sheet's nodes of all
    ranks, sorted by place, and a mask of the components that `kept` supports fix."""
    owned, gdim = len(part.nodes), blank.mesh.geometry.dim
    x, fixed = blank.coordinates()[:owned], np.zeros((owned, gdim))
    for support in kept:
        fixed[np.ix_(np.flatnonzero(support.where(x.T)), support.components)] = 1
    u = blank.u.x.array[: owned * gdim].reshape(-1, gdim)
    rows = np.hstack([blank.along(x.T).T, u, fixed])[part.nodes]
    rows = np.concatenate(blank.mesh.comm.allgather(rows))
    rows = rows[np.lexsort((rows[:, :gdim] / blank.sides().max()).round(9).T[::-1])]
    places, moved, fixed = np.split(rows, [gdim, 2 * gdim], axis=1)
    return places, moved, fixed > 0


def _corners(places, fixed):
    """Three nodes far from each other, the first one held most or in the middle."""
    middle = np.linalg.norm(places - places.mean(0), axis=1)
    counts = fixed.sum(1)
    first = _largest(-middle - 1e3 * middle.max() * (counts.max() - counts))
    offsets = places - places[first]
    second = _largest(np.linalg.norm(offsets, axis=1))
    along = offsets[second] / max(np.linalg.norm(offsets[second]), 1e-300)
    third = _largest(np.linalg.norm(offsets - np.outer(offsets @ along, along), axis=1))
    return [first, second, third]


def _largest(values):
    """The last of those that are largest, but for rounding: the same on any ranks."""
    return int(np.flatnonzero(values >= values.max() - 1e-9 * abs(values).max())[-1])


def _row(place, axis):
    """Displacement of a place along an axis by each rigid move and turn."""
    along = np.eye(len(place))[axis]
    turns = [place[i] * along[j] - place[j] * along[i] for i, j in TURNS[len(place)]]
    return np.append(along, turns)


def _with(basis, rows, least):
    """Orthonormal rows: `basis`, and what more than the share `least` of further rows adds."""
    for row in rows:
        row = row / np.linalg.norm(row)
        rest = row - basis.T @ (basis @ row)
        rest -= basis.T @ (basis @ rest)
        if len(basis) < len(row) and np.linalg.norm(rest) > least:
            basis = np.vstack([basis, rest / np.linalg.norm(rest)])
    return basis


def _support(blank, name, place, axes, moved):
    near = PLANE_TOLERANCE * blank.sides().max()

    def where(x):
        return np.linalg.norm(blank.along(x).T - place, axis=1) < near

    return Support(name, where, axes, lambda x, load: np.tile(moved[:, None], (1, x.shape[1])))
