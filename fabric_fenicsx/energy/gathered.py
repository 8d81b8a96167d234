"""Nodes of any rank: their displacements, forces on them, and stiffness between them."""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..sheet.blank import Blank


class GatheredNodes:
    """Nodes of a blank by their global numbers (n,), of any rank. All ranks use it together."""

    def __init__(self, blank: Blank, nodes: np.ndarray) -> None:
        self._u = compat.petsc_vector(blank.u)
        self._dim = blank.mesh.geometry.dim
        wanted = PETSc.IS().createBlock(self._dim, nodes.astype(PETSc.IntType), comm=MPI.COMM_SELF)
        self._here = PETSc.Vec().createSeq(len(nodes) * self._dim, comm=MPI.COMM_SELF)
        self._scatter = PETSc.Scatter().create(self._u, wanted, self._here, None)
        self._sum = self._u.duplicate()

    def displacement(self) -> np.ndarray:
        """(n, gdim) [mm]."""
        return self._of(self._u)

    def values(self, owned: np.ndarray) -> np.ndarray:
        """Values here, (n, gdim), from those at each rank's owned nodes (nodes, gdim)."""
        self._sum.array[:] = owned.ravel()
        return self._of(self._sum)

    def _of(self, vector):
        self._scatter.scatter(vector, self._here)
        return self._here.array.reshape(-1, self._dim).copy()

    def add(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add forces (n, gdim) of all ranks to f, of this rank's degrees of freedom [N]."""
        self._here.array[:] = forces.ravel()
        self._sum.set(0)
        self._scatter.scatter(
            self._here, self._sum, addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE
        )
        f[: self._sum.local_size] += self._sum.array


class CoupledNodes:
    """Pairs of nodes that are coupled, as both are of one cell or move with one point.

    nodes: global numbers (known,); columns (n, k): which of them each of n cells or points has;
    coupled (n, k, k): True for pairs of these that count, by default all

    - ends: first and last node (count,) of each pair, of `nodes`; places (n, k, k): which pair each
      of a cell's is, -1 for those that do not count
    - rows, cols (count dim^2,): global degrees of freedom of the pairs' blocks
    """

    def __init__(
        self,
        nodes: np.ndarray,
        columns: np.ndarray,
        coupled: np.ndarray | None = None,
        dim: int = 3,
    ) -> None:
        wide = columns.shape[1]
        self.places = np.full((len(columns), wide, wide), -1, dtype=np.int32)
        cell, i, j = np.nonzero(self.places if coupled is None else coupled)
        keys = columns[cell, i].astype(np.int64) * len(nodes) + columns[cell, j]
        keys, self.places[cell, i, j] = np.unique(keys, return_inverse=True)
        self.ends, self.count = np.divmod(keys, max(len(nodes), 1)), len(keys)
        axis, (i, j) = np.arange(dim), (dim * nodes[end][:, None, None] for end in self.ends)
        both = np.broadcast_arrays(i + axis[:, None], j + axis)
        self.rows, self.cols = (each.astype(PETSc.IntType).ravel() for each in both)
