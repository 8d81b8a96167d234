"""What a term on `MorleyCells` asks of nodes beyond its rank: motions in, forces and stiffness
out."""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

from .. import dolfinx_compat as compat
from .morley import MorleyCells
from .term import Triplets


class Stencil:
    """The nodes that the 12 of each of this rank's cells are, mirror images counted apart, and
    forces and stiffness of cells summed on them.

    columns: which node each of a cell's 12 is (cells, 12). counts: those of the 12 that matter,
    (cells, 12); stiffness is asked for pairs of these alone.
    """

    def __init__(self, cells: MorleyCells, counts: np.ndarray) -> None:
        self._dim, self._vector = cells.corners.shape[2], compat.petsc_vector(cells.blank.u)
        mirrors = len(cells.mirrors)
        keys, columns = np.unique(cells.nodes * mirrors + cells.codes, return_inverse=True)
        self.columns = columns.reshape(cells.nodes.shape)
        self._nodes, codes = np.divmod(keys, mirrors)
        self._mirrors = cells.mirrors[codes]
        self._mirrored = np.flatnonzero(codes)
        wanted = PETSc.IS().createBlock(
            self._dim, self._nodes.astype(PETSc.IntType), comm=MPI.COMM_SELF
        )
        self._sent = PETSc.Vec().createSeq(len(keys) * self._dim, comm=MPI.COMM_SELF)
        self._scatter = PETSc.Scatter().create(self._vector, wanted, self._sent, None)
        self._sum = self._vector.duplicate()
        self._sum_nodes = _adding(self.columns.ravel(), len(keys))
        self._pairs(counts)

    def _pairs(self, counts):
        """Pairs of nodes that cells couple, and what adds up their 3 x 3 blocks."""
        size = len(self._nodes)
        cell, i, j = np.nonzero(counts[:, :, None] & counts[:, None])
        keys, pair = np.unique(
            self.columns[cell, i] * size + self.columns[cell, j], return_inverse=True
        )
        place = (cell * 12 + i) * 12 + j
        self._sum_pairs = sparse.csr_matrix(
            (np.ones(len(place)), (pair, place)), shape=(len(keys), 144 * len(counts))
        )
        self._ends = np.divmod(keys, size)
        axis = np.arange(self._dim)
        i, j = (self._nodes[end] * self._dim for end in self._ends)
        rows, cols = i[:, None, None] + axis[:, None], j[:, None, None] + axis
        self._rows, self._cols = (
            k.astype(PETSc.IntType).ravel() for k in np.broadcast_arrays(rows, cols)
        )

    def displacement(self) -> np.ndarray:
        """Of the nodes and mirror images, along the frame's axes, (nodes, gdim) [mm]."""
        self._scatter.scatter(self._vector, self._sent)
        U, at = self._sent.array.reshape(-1, self._dim).copy(), self._mirrored
        U[at] = np.einsum("nij,nj->ni", self._mirrors[at], U[at])
        return U

    def add_forces(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add forces (cells, 12, gdim) [N] to f (local dofs,), on whatever rank their nodes are."""
        total, at = self._sum_nodes @ forces.reshape(-1, self._dim), self._mirrored
        total[at] = np.einsum("nij,ni->nj", self._mirrors[at], total[at])
        self._sent.array[:] = total.ravel()
        self._sum.set(0)
        self._scatter.scatter(
            self._sent, self._sum, addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE
        )
        f[: self._sum.local_size] += self._sum.array

    def triplets(self, blocks: np.ndarray) -> Triplets:
        """As `Term.tangent` gives them, from blocks (cells, 12, 12, gdim, gdim) [N/mm]."""
        values = self._sum_pairs @ blocks.reshape(-1, self._dim**2)
        values = values.reshape(-1, self._dim, self._dim)
        first, second = (self._mirrors[end] for end in self._ends)
        return self._rows, self._cols, (first.swapaxes(1, 2) @ values @ second).ravel()


def _adding(places, size):
    """Sparse matrix (size, k) that adds k rows up at their `places` (k,)."""
    count = len(places)
    return sparse.csr_matrix((np.ones(count), (places, np.arange(count))), shape=(size, count))
