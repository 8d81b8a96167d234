"""Displacements of, and forces on, nodes of any rank."""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..sheets.blank import Blank


class GatheredNodes:
    """Nodes of a blank by their global numbers (n,), of whatever rank. All ranks make
    and use it together."""

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
