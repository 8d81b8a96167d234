"""How the touching faces of two sheets slide on each other."""

from typing import NamedTuple

import numpy as np

from ...runtime.compiled import compiled
from ...sheets.blank import Blank
from ...tools.facets import LAST, NEXT
from ..gathered import GatheredNodes
from .coupled import Coupled


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
        self._coupled: Coupled | None = None

    def slid(self) -> np.ndarray:
        """Since it was made, (n, 3) [mm]."""
        return _slid(self._levers, self._nodes, self._gathered.displacement() - self._start)

    def add(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add to f, of this rank's degrees of freedom [N], forces (n, 3) [N] on the faces of the
        points, and their reactions, as forces on the nodes."""
        self._gathered.add(_borne(self._levers, self._nodes, forces, len(self._known)), f)

    @property
    def coupled(self) -> Coupled:
        """The nodes that the points couple; not found before a stiffness is asked for."""
        if self._coupled is None:
            self._coupled = Coupled(self._nodes, self._known)
        return self._coupled

    def values(self, blocks: np.ndarray) -> np.ndarray:
        """Stiffness (m,) [N/mm] at the rows and columns of `coupled`. blocks (n, 3, 3): by how much
        the force on each point's face grows as it slides."""
        return self.coupled.levered(self._levers, blocks)


def _levers(corners, normals):
    """From displacements of the corners to those of the faces' points (n, 3, 9)."""
    x = corners.places
    across = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    square = np.maximum((across**2).sum(1), 1e-300)[:, None, None]
    slopes = np.cross(across[:, None], x[:, LAST] - x[:, NEXT]) / square  # grad N_i (n, 3, 3)
    moves = corners.weights[:, None, :, None] * np.eye(3)[:, None]  # (n, 3, corners, 3)
    turns = slopes.swapaxes(1, 2)[..., None] * normals[:, None, None]
    return (moves - corners.arm[:, None, None, None] * turns).reshape(len(x), 3, 9)


@compiled
def _slid(levers, nodes, moved):
    """Sums (n, 3) of levers times what the nodes `moved` (k, 3)."""
    found = np.zeros((len(levers), 3))
    for n in range(len(levers)):
        for j in range(levers.shape[2]):
            for a in range(3):
                found[n, a] += levers[n, a, j] * moved[nodes[n, j // 3], j % 3]
    return found


@compiled
def _borne(levers, nodes, forces, count):
    """Forces on nodes (count, 3) of forces (n, 3) on the faces."""
    found = np.zeros((count, 3))
    for n in range(len(levers)):
        for j in range(levers.shape[2]):
            for a in range(3):
                found[nodes[n, j // 3], j % 3] += levers[n, a, j] * forces[n, a]
    return found
