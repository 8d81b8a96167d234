"""Isostatic supports: they hold a sheet's remaining rigid motions, and bear nothing in
equilibrium."""

from collections.abc import Iterable, Sequence

import numpy as np
from mpi4py import MPI

from ..sheets.blank import Blank
from ..sheets.sheet_mesh import bounds
from .rigid_motions import TURNS
from .supports import Support

PLANE_TOLERANCE = 1e-6  # of a blank's size, within which nodes lie in one plane


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
        if (high - low)[0] <= PLANE_TOLERANCE * _size(blank):
            planes[axis] = support
    return planes


def beyond_planes(blank: Blank, supports: Iterable[Support]) -> dict[str, tuple[int, float]]:
    """Number of nodes beyond each plane of symmetry that bounds the flat sheets, by its support's
    name, and the farthest one's distance from it [mm]; none where there are none."""
    near, comm, found = PLANE_TOLERANCE * _size(blank), blank.mesh.comm, {}
    owned = len(blank.whole.nodes)
    x = blank.coordinates()[:owned]
    now, flat = (blank.along(each.T) for each in (x + blank.nodal_displacement()[:owned], x))
    low, high = blank.extent()
    for axis, support in planes_of_symmetry(blank, supports).items():
        _, (place,) = bounds(comm, flat[[axis]][:, support.where(x.T)])
        side = int(place <= low[axis] + near) - int(place >= high[axis] - near)
        beyond = side * (place - now[axis])
        if count := comm.allreduce(int((beyond > near).sum())):
            found[support.name] = count, comm.allreduce(beyond.max(initial=0.0), MPI.MAX)
    return found


def isostatic(blank: Blank, kept: Sequence[Support]) -> list[Support]:
    """Supports of few nodes of each sheet of `blank`, where these are now, that hold the rigid
    motions which the `kept` ones leave, firmly as it lies now and as it was laid: of the node that
    those hold most, or nearest to the centre, and of nodes far from each other in either shape."""
    parts = [part for part in blank.parts.values() if part.thickness] or [blank.whole]
    return [support for part in parts for support in _of_sheet(blank, part, kept)]


def _of_sheet(blank, part, kept):
    places, moved, fixed = _nodes(blank, part, kept)
    shapes = [(x - x.mean(0)) / _size(blank) for x in (places + moved, places)]
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
    found = dict[int, list[int]]()
    corners = list(dict.fromkeys(k for x in (places, shapes[0]) for k in _corners(x, fixed)))
    for least in (firm, loose):
        for k in corners:
            for axis in range(gdim) if k == corners[0] else reversed(range(gdim)):
                more = [_with(b, [_row(x[k], axis)], least) for b, x in zip(bases, shapes)]
                if all(len(after) > len(b) for after, b in zip(more, bases)):
                    bases = more
                    found.setdefault(k, []).append(axis)
    name = part.name or blank.name
    return [
        _support(blank, f"point {i} of {name}", places[k], sorted(axes), moved[k])
        for i, (k, axes) in enumerate(found.items(), 1)
    ]


def _nodes(blank, part, kept):
    """Places and displacements (n, gdim) along the frame's axes [mm] of the sheet's nodes of all
    ranks, sorted by place, and a mask of the components that `kept` supports fix."""
    owned, gdim = len(part.nodes), blank.mesh.geometry.dim
    x, fixed = blank.coordinates()[:owned], np.zeros((owned, gdim))
    for support in kept:
        fixed[np.ix_(np.flatnonzero(support.where(x.T)), support.components)] = 1
    u = blank.u.x.array[: owned * gdim].reshape(-1, gdim)
    mine = np.hstack([blank.along(x.T).T, u, fixed])[part.nodes]
    rows = np.concatenate(blank.mesh.comm.allgather(mine))
    rows = rows[np.lexsort((rows[:, :gdim] / _size(blank)).round(9).T[::-1])]
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
    near = PLANE_TOLERANCE * _size(blank)

    def where(x):
        return np.linalg.norm(blank.along(x).T - place, axis=1) < near

    return Support(name, where, axes, lambda x, load: np.tile(moved[:, None], (1, x.shape[1])))


def _size(blank):
    low, high = blank.extent()
    return float((high - low).max())
