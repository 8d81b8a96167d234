"""Nodes of `MorleyCells` beyond the rank: motions in, forces and stiffness out."""

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from ..gathered import GatheredNodes
from ..term import Triplets
from .morley import MorleyCells


class Stencil:
    """The nodes that the 12 of each of this rank's cells are, mirror images counted apart.

    columns: which of them each of a cell's 12 is, (cells, 12); count: how many there are.
    """

    def __init__(self, cells: MorleyCells) -> None:
        self._dim, self._mirrors = cells.corners.shape[2], cells.mirrors
        keys, columns = np.unique(
            cells.nodes * len(cells.mirrors) + cells.codes, return_inverse=True
        )
        self.columns = columns.reshape(cells.nodes.shape)
        self._nodes, self._codes = np.divmod(keys, len(cells.mirrors))
        self.count = len(keys)
        self._mirrored = np.flatnonzero(self._codes)
        self._gathered = GatheredNodes(cells.blank, self._nodes)

    def displacement(self) -> np.ndarray:
        """Motion of nodes and mirror images along the frame's axes, (count, gdim) [mm]."""
        U, at = self._gathered.displacement(), self._mirrored
        U[at] = np.einsum("nij,nj->ni", self._mirrors[self._codes[at]], U[at])
        return U

    def add_forces(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add forces (count, gdim) [N], which this overwrites, to f (local dofs,) of whatever rank
        their nodes are."""
        at = self._mirrored
        forces[at] = np.einsum("nij,ni->nj", self._mirrors[self._codes[at]], forces[at])
        self._gathered.add(forces, f)

    def places(self, i: np.ndarray, j: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Global rows and columns of the blocks of pairs (k,) of nodes, (k gdim^2,) each."""
        axis, nodes = np.arange(self._dim), self._nodes * self._dim
        rows, cols = nodes[i][:, None, None] + axis[:, None], nodes[j][:, None, None] + axis
        rows, cols = np.broadcast_arrays(rows, cols)
        return rows.astype(PETSc.IntType).ravel(), cols.astype(PETSc.IntType).ravel()

    def turn_back(self, blocks: np.ndarray, i: np.ndarray, j: np.ndarray) -> None:
        """Make blocks (k, gdim, gdim) of pairs (k,) those of the nodes that images stand for."""
        for mirror, transposed in ((self._codes[i], True), (self._codes[j], False)):
            at = mirror > 0
            R = self._mirrors[mirror[at]]
            blocks[at] = R.swapaxes(1, 2) @ blocks[at] if transposed else blocks[at] @ R


class CellSums:
    """Forces and stiffness of cells, summed on the nodes of a `stencil`.

    - counts: those of a cell's 12 nodes that matter, (cells, 12); stiffness is summed for pairs of
      these alone
    - places (cells, 12, 12): which of the `count` pairs of nodes each of a cell's is, -1 for others
    """

    def __init__(self, stencil: Stencil, counts: np.ndarray) -> None:
        self._stencil, columns, size = stencil, stencil.columns, stencil.count
        entries = np.ones(columns.size), (columns.ravel(), np.arange(columns.size))
        self._on_nodes = sparse.csr_matrix(entries, shape=(size, columns.size))
        cell, i, j = np.nonzero(counts[:, :, None] & counts[:, None])
        keys, pair = np.unique(columns[cell, i] * size + columns[cell, j], return_inverse=True)
        self._ends, self.count = np.divmod(keys, size), len(keys)
        self.places = np.full((len(counts), 12, 12), -1, dtype=np.int32)
        self.places[cell, i, j] = pair
        self._rows, self._cols = stencil.places(*self._ends)

    def add_forces(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add forces (cells, 12, gdim) [N] to f (local dofs,) of whatever rank their nodes are."""
        self._stencil.add_forces(self._on_nodes @ forces.reshape(-1, forces.shape[2]), f)

    def triplets(self, blocks: np.ndarray) -> Triplets:
        """As `Term.tangent` gives them, from the pairs' blocks (count, gdim, gdim) [N/mm]."""
        self._stencil.turn_back(blocks, *self._ends)
        return self._rows, self._cols, blocks.ravel()
