"""Sliding of the touching faces of two sheets."""

from functools import cached_property

import numpy as np

from ...runtime.compiled import compiled
from ...tools.facets import LAST, NEXT
from ..gathered import GatheredNodes
from .coupled import Coupled
from .sheet_points import Facing, SheetPoints


class FaceSliding:
    """Sliding of the faces of two sheets at points of one over the other, from the `start` on.

    A face's point moves as its triangle does, and by its offset as the triangle turns: by offset
    times -sum_i (n.u_i) grad N_i. So a force at the faces is borne by forces of the nodes that have
    its moment, too: forces and moments balance. All ranks make and use it together.

    normals (count, 3): unit vectors across the faces at all points, 0 at those that lie over
    nothing
    """

    def __init__(self, points: SheetPoints, start: Facing) -> None:
        self._points, self._start = points, start
        over, below = start.corners
        normals = start.unit_normals()
        self.normals = points.of_all(start, normals)
        nodes = np.concatenate([over.nodes, below.nodes], 1)
        self._known, local = np.unique(nodes, return_inverse=True)
        self._nodes = local.reshape(nodes.shape)
        self._gathered = GatheredNodes(points.blank, self._known)
        motions = _motions(over, normals), -_motions(below, normals)
        self._motions = np.concatenate(motions, 2)
        self._place = self._gathered.displacement()

    def slid(self) -> np.ndarray:
        """See `Sliding`, 0 at points that lay over nothing."""
        moved = self._gathered.displacement() - self._place
        return self._points.of_all(self._start, _slid(self._motions, self._nodes, moved))

    def exact(self, now: Facing) -> np.ndarray:
        """Sliding that is not linear, to another `Facing`: the motion of the points less the change
        of their offsets, (count, 3) [mm]."""
        moved = self._points.of_all(self._start, self._start.moved())
        before, after = (
            self._points.of_all(each, each.offsets(), np.nan) for each in (self._start, now)
        )
        return moved - np.nan_to_num(after - before)

    def add(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add to f, of this rank's degrees of freedom [N], forces (count, 3) [N] on the faces of
        the points, and their reactions, as forces on the nodes."""
        forces = forces[self._start.points]
        self._gathered.add(_borne(self._motions, self._nodes, forces, len(self._known)), f)

    @cached_property
    def coupled(self) -> Coupled:
        """The nodes that the points couple."""
        return Coupled(self._nodes, self._known)

    def values(self, blocks: np.ndarray) -> np.ndarray:
        """Stiffness (m,) [N/mm] at the rows and columns of `coupled`. blocks (count, 3, 3): growth
        of the force on each point's face as it slides."""
        return self.coupled.moved(self._motions, blocks[self._start.points])


def _motions(corners, normals):
    """Matrices from displacements of the corners to those of the faces' points (n, 3, 9)."""
    x = corners.places
    across = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    square = np.maximum((across**2).sum(1), 1e-300)[:, None, None]
    slopes = np.cross(across[:, None], x[:, LAST] - x[:, NEXT]) / square  # grad N_i (n, 3, 3)
    moves = corners.weights[:, None, :, None] * np.eye(3)[:, None]  # (n, 3, corners, 3)
    turns = slopes.swapaxes(1, 2)[..., None] * normals[:, None, None]
    return (moves - corners.offset[:, None, None, None] * turns).reshape(len(x), 3, 9)


@compiled
def _slid(motions, nodes, moved):
    """Sums (n, 3) of matrices (n, 3, 3 k) times the motion of nodes, `moved` (known, 3)."""
    found = np.zeros((len(motions), 3))
    for n in range(len(motions)):
        for j in range(motions.shape[2]):
            for a in range(3):
                found[n, a] += motions[n, a, j] * moved[nodes[n, j // 3], j % 3]
    return found


@compiled
def _borne(motions, nodes, forces, count):
    """Forces on nodes (count, 3) of forces (n, 3) on the faces."""
    found = np.zeros((count, 3))
    for n in range(len(motions)):
        for j in range(motions.shape[2]):
            for a in range(3):
                found[nodes[n, j // 3], j % 3] += motions[n, a, j] * forces[n, a]
    return found
