"""Nodes of `MorleyCells` beyond the rank: motions in, forces and stiffness out."""

import numpy as np
from scipy import sparse

from ..gathered import CoupledNodes, GatheredNodes
from ..term import Triplets
from .morley import MorleyCells


class Stencil:
    """The nodes that the 12 of each of this rank's cells are, mirror images counted apart.

    columns: which of them each of a cell's 12 is, (cells, 12); count: how many there are
    """

    def __init__(self, cells: MorleyCells) -> None:
        self._dim, self._mirrors = cells.corners.shape[2], cells.mirrors
        keys, columns = np.unique(
            cells.nodes * len(cells.mirrors) + cells.codes, return_inverse=True
        )
        self.columns = columns.reshape(cells.nodes.shape)
        self._nodes, self._codes = np.divmod(keys, len(cells.mirrors))
        self._mirrored = np.flatnonzero(self._codes)
        self._gathered = GatheredNodes(cells.blank, self._nodes)
        self.count = len(keys)
        entries = np.ones(columns.size), (columns.ravel(), np.arange(columns.size))
        self._on_nodes = sparse.csr_matrix(entries, shape=(self.count, columns.size))

    def displacement(self) -> np.ndarray:
        """Motion of nodes and mirror images along the frame's axes, (count, gdim) [mm]."""
        U, at = self._gathered.displacement(), self._mirrored
        U[at] = np.einsum("nij,nj->ni", self._mirrors[self._codes[at]], U[at])
        return U

    def summed(self, forces: np.ndarray) -> np.ndarray:
        """Forces on nodes and images (count, gdim) of those on the cells' (cells, 12, gdim) [N]."""
        return self._on_nodes @ forces.reshape(-1, self._dim)

    def add_forces(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add forces (count, gdim) [N], which this overwrites, to f (local dofs,) of whatever rank
        their nodes are."""
        at = self._mirrored
        forces[at] = np.einsum("nij,ni->nj", self._mirrors[self._codes[at]], forces[at])
        self._gathered.add(forces, f)

    def coupled(self, counts: np.ndarray) -> CoupledNodes:
        """Pairs of nodes that `counts` (cells, 12, 12) for some cell, by its 12 ones."""
        return CoupledNodes(self._nodes, self.columns, counts, self._dim)

    def triplets(self, coupled: CoupledNodes, blocks: np.ndarray) -> Triplets:
        """As `Term.tangent` gives them, from the blocks (count, gdim, gdim) of such pairs [N/mm],
        which this turns into those of the nodes that images stand for."""
        i, j = (self._codes[end] for end in coupled.ends)
        for mirror, transposed in ((i, True), (j, False)):
            at = mirror > 0
            R = self._mirrors[mirror[at]]
            blocks[at] = R.swapaxes(1, 2) @ blocks[at] if transposed else blocks[at] @ R
        return coupled.rows, coupled.cols, blocks.ravel()
