"""How the touching faces of two sheets slide on each other."""

from typing import NamedTuple

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from ...sheets.blank import Blank
from ...tools.facets import LAST, NEXT
from ..gathered import GatheredNodes


class Corners(NamedTuple):
    """The flat triangles that n points lie in: nodes (n, 3), global numbers; places (n, 3, 3) [mm];
    weights (n, 3), barycentric; arm (n,) [mm]: how far the touching face is from the triangle
    along the points' normals, with a sign."""

    nodes: np.ndarray
    places: np.ndarray
    weights: np.ndarray
    arm: np.ndarray


class FaceSliding:
    """Sliding of the faces at n points of a sheet over another one, linear in the displacement.

    A face's point moves as its triangle does, and by its arm as the triangle turns: by arm times
    -sum_i (n.u_i) grad N_i. So a force at the faces is borne by forces of the nodes that have its
    moment, too: forces and moments balance. All ranks make and use it together.

    normals (n, 3): unit vectors across the faces.
    """

    def __init__(self, blank: Blank, over: Corners, below: Corners, normals: np.ndarray) -> None:
        nodes = np.concatenate([over.nodes, below.nodes], 1)
        self._known, local = np.unique(nodes, return_inverse=True)
        self._nodes = local.reshape(nodes.shape)
        self._gathered = GatheredNodes(blank, self._known)
        self._levers = np.concatenate([_levers(over, normals), -_levers(below, normals)], 2)
        self._start = self._gathered.displacement()
        self._sums: sparse.csr_matrix | None = None

    def slid(self) -> np.ndarray:
        """Since it was made, (n, 3) [mm]."""
        moved = (self._gathered.displacement() - self._start)[self._nodes]
        return (self._levers @ moved.reshape(*self._levers.shape[::2], 1))[..., 0]

    def add(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add to f, of this rank's degrees of freedom [N], forces (n, 3) [N] on the faces of the
        points, and their reactions, as forces on the nodes."""
        each = (self._levers.swapaxes(1, 2) @ forces[..., None]).reshape(-1, 3)
        at, k = self._nodes.ravel(), len(self._known)
        total = [np.bincount(at, each[:, axis], k) for axis in range(3)]
        self._gathered.add(np.column_stack(total), f)

    def values(self, blocks: np.ndarray) -> np.ndarray:
        """Stiffness (m,) [N/mm] at `rows` and `cols`. blocks (n, 3, 3): by how much the force on
        each point's face grows as it slides."""
        self._take_places()
        assert self._sums is not None
        at = np.flatnonzero(blocks.any((1, 2)))
        levers = self._levers[at]
        stiffness = levers.swapaxes(1, 2) @ blocks[at] @ levers
        m = self._nodes.shape[1]
        pairs = stiffness.reshape(-1, m, 3, m, 3).swapaxes(2, 3).reshape(-1, 9)
        columns = (at[:, None] * m * m + np.arange(m * m)).ravel()
        return (self._sums[:, columns] @ pairs).ravel()

    @property
    def rows(self) -> np.ndarray:
        """Global degrees of freedom (m,) of the rows of `values`."""
        self._take_places()
        return self._rows

    @property
    def cols(self) -> np.ndarray:
        """Global degrees of freedom (m,) of the columns of `values`."""
        self._take_places()
        return self._cols

    def _take_places(self):
        """Which pairs of nodes each point couples; not before a stiffness is asked for."""
        if self._sums is not None:
            return
        known, nodes = self._known, self._nodes.astype(np.int64)
        keys = (nodes[:, :, None] * len(known) + nodes[:, None]).ravel()
        keys, place = np.unique(keys, return_inverse=True)
        here = np.arange(len(place))
        shape = len(keys), len(place)
        self._sums = sparse.csc_matrix((np.ones(len(place)), (place, here)), shape)
        i, j = np.divmod(keys, max(len(known), 1))
        axis = np.arange(3)
        rows = (known[i] * 3)[:, None, None] + axis[:, None]
        cols = (known[j] * 3)[:, None, None] + axis
        self._rows, self._cols = (
            each.astype(PETSc.IntType).ravel() for each in np.broadcast_arrays(rows, cols)
        )


def _levers(corners, normals):
    """From displacements of the corners to those of the faces' points (n, 3, 9)."""
    x = corners.places
    across = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    square = np.maximum((across**2).sum(1), 1e-300)[:, None, None]
    slopes = np.cross(across[:, None], x[:, LAST] - x[:, NEXT]) / square  # grad N_i (n, 3, 3)
    moves = corners.weights[:, None, :, None] * np.eye(3)[:, None]  # (n, 3, corners, 3)
    turns = slopes.swapaxes(1, 2)[..., None] * normals[:, None, None]
    return (moves - corners.arm[:, None, None, None] * turns).reshape(len(x), 3, 9)
