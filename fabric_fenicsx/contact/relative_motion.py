"""Points of one sheet and the places on another one that lie below them."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy import sparse

from ..core.compiled import compiled
from ..energy.gathered import CoupledNodes, GatheredNodes
from ..energy.term import Triplets
from ..sheet.blank import Blank
from ..surfaces.facets import LAST, NEXT
from .faces import Corners


class RelativeMotion:
    """Points of a sheet that move relative to another one.

    They move as the flat triangles do that they and the places below them lie in, `corners`. If
    unit `normals` (n, 3) are given, the points are those of the touching faces: a face's point
    moves by its offset, too, as its triangle turns: by offset times -sum_i (n.u_i) grad N_i. So
    forces there are borne by forces of the nodes that have their moment, too. All ranks make and
    use it together. Images of triangles move as their `mirrors` say.
    """

    def __init__(
        self, blank: Blank, corners: Sequence[Corners], normals: np.ndarray | None = None
    ) -> None:
        over, below = self._corners = corners
        nodes = np.concatenate([over.nodes, below.nodes], 1)
        self._known, places = np.unique(nodes, return_inverse=True)
        self._nodes = places.reshape(nodes.shape)
        self._normals = normals
        self._motions = np.concatenate([_motions(over, normals), -_motions(below, normals)], 2)
        self._gathered = GatheredNodes(blank, self._known)
        self._before = self._gathered.displacement()
        each = np.ones(self._nodes.size), (self._nodes.ravel(), np.arange(self._nodes.size))
        self._on_nodes = sparse.csr_matrix(each, shape=(len(self._known), self._nodes.size))

    def relative(self) -> np.ndarray:
        """Displacement of the points relative to the other sheet, (n, 3) [mm]."""
        return self._of_points(self._gathered.displacement())

    def offsets(self) -> np.ndarray:
        """Offsets of the touching faces from their triangles, less those below, (n, 3) [mm]."""
        moved = self._gathered.displacement() - self._before
        over, below = (
            each.offset[:, None] * _unit_normals(each.places + moved[nodes], self._normals)
            for each, nodes in zip(self._corners, np.split(self._nodes, 2, axis=1))
        )
        return over - below

    def apart(self, owned: np.ndarray) -> np.ndarray:
        """Values at the points less those below them, (n, 3), from those at owned nodes."""
        return self._of_points(self._gathered.values(owned))

    def _of_points(self, values):
        of_points = values[self._nodes].reshape(len(self._nodes), 18)
        return np.einsum("naj,nj->na", self._motions, of_points)

    def add(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add forces (n, 3) on the points, and their reactions, to f (this rank's dofs,) [N]."""
        borne = np.einsum("naj,na->nj", self._motions, forces).reshape(-1, 3)
        self._gathered.add(self._on_nodes @ borne, f)

    @cached_property
    def _coupled(self):
        return CoupledNodes(self._known, self._nodes)

    def triplets(self, blocks: np.ndarray) -> Triplets:
        """As of `Term.tangent`. blocks (n, 3, 3): growth of each point's force [N/mm]."""
        coupled = self._coupled
        values = _stiffness(self._motions, blocks, coupled.places, coupled.count)
        return coupled.rows, coupled.cols, values.ravel()


def _motions(corners, normals):
    """Matrices from displacements of the corners to those of the points (n, 3, 9)."""
    x, mirrors = corners.places, corners.mirrors
    moves = corners.weights[:, None, :, None] * np.eye(3)[:, None]  # (n, 3, corners, 3)
    if normals is not None:
        across = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        square = np.maximum((across**2).sum(1), 1e-300)[:, None, None]
        slopes = np.cross(across[:, None], x[:, LAST] - x[:, NEXT]) / square  # grad N_i (n, 3, 3)
        if mirrors is not None:
            normals = np.einsum("nij,nj->ni", mirrors, normals)
        turns = slopes.swapaxes(1, 2)[..., None] * normals[:, None, None]
        moves = moves - corners.offset[:, None, None, None] * turns
    if mirrors is not None:
        moves = np.einsum("nij,njcx->nicx", mirrors, moves)
    return moves.reshape(len(x), 3, 9)


def _unit_normals(x, along):
    """Unit normals (n, 3) of triangles x (n, 3, 3), on the side of `along` (n, 3)."""
    across = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    across *= np.sign((across * along).sum(1))[:, None]
    return across / np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]


@compiled
def _stiffness(motions, blocks, places, count):
    """Sums (count, 3, 3) of transposed matrix times block times matrix."""
    values, pulled = np.zeros((count, 3, 3)), np.empty(motions.shape[1:])
    for n in range(len(motions)):
        L, B = motions[n], blocks[n]
        if not B.any():
            continue
        for a in range(3):
            for j in range(L.shape[1]):
                pulled[a, j] = B[a, 0] * L[0, j] + B[a, 1] * L[1, j] + B[a, 2] * L[2, j]
        for i in range(places.shape[1]):
            for j in range(places.shape[2]):
                mine, others, value = L[:, 3 * i :], pulled[:, 3 * j :], values[places[n, i, j]]
                for a in range(3):
                    for b in range(3):
                        value[a, b] += (
                            mine[0, a] * others[0, b]
                            + mine[1, a] * others[1, b]
                            + mine[2, a] * others[2, b]
                        )
    return values
