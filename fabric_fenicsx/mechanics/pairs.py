"""Points of one sheet and the places on another one that lie below them."""

from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

from ..sheets.blank import Blank
from .gathered import GatheredNodes

TWICE = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)  # entries of a symmetric 3 x 3 matrix


class Pairs:
    """Points of a sheet that move relative to another one as `weights` (n, k) times the nodes (k,),
    which are global numbers. All ranks make and use it together."""

    def __init__(self, blank: Blank, nodes: np.ndarray, weights: sparse.csr_matrix) -> None:
        used = np.unique(weights.indices)
        self._relative = weights = weights[:, used].tocsr()
        self._transposed = weights.T.tocsr()
        known = nodes[used]
        self._gathered = GatheredNodes(blank, known)
        self._known = known
        self._product: Any = None

    def _take_places(self):
        """The places of weights^T factors weights, which PETSc keeps, so that values cost little;
        not before a stiffness is asked for."""
        weights, known = self._relative, self._known
        csr = weights.indptr.astype(PETSc.IntType), weights.indices.astype(PETSc.IntType)
        self._left, self._right = (
            PETSc.Mat().createAIJ(weights.shape, csr=(*csr, weights.data), comm=MPI.COMM_SELF)
            for _ in range(2)
        )
        self._product = self._left.transposeMatMult(self._right)
        starts, j, _ = self._product.getValuesCSR()
        axis, i = np.arange(3), np.repeat(np.arange(len(known)), np.diff(starts))
        rows = (known[i] * 3)[:, None, None] + axis[:, None]
        cols = (known[j] * 3)[:, None, None] + axis
        self._rows, self._cols = (
            a.astype(PETSc.IntType).ravel() for a in np.broadcast_arrays(rows, cols)
        )

    @property
    def rows(self) -> np.ndarray:
        """Global degrees of freedom (m,) of the rows of `values`."""
        if self._product is None:
            self._take_places()
        return self._rows

    @property
    def cols(self) -> np.ndarray:
        """Likewise of the columns."""
        if self._product is None:
            self._take_places()
        return self._cols

    def relative(self) -> np.ndarray:
        """Displacement of the points relative to the other sheet, (n, 3) [mm]."""
        return self._relative @ self._gathered.displacement()

    def apart(self, owned: np.ndarray) -> np.ndarray:
        """Values at the points less those on the other sheet below them, (n, 3); owned (nodes, 3):
        the values at this rank's owned nodes."""
        return self._relative @ self._gathered.values(owned)

    def add(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add forces (n, 3) on the points and their reactions to f, this rank's degrees of freedom
        [N]."""
        self._gathered.add(self._transposed @ forces, f)

    def values(self, blocks: np.ndarray) -> np.ndarray:
        """Stiffness (m,) [N/mm] at `rows` and `cols`. blocks (n, 3, 3), symmetric: by how much the
        force on each point grows as it moves."""
        weights = self._relative
        found = np.zeros((len(self.rows) // 9, 3, 3))
        if not blocks.any():
            return found.ravel()
        entries, starts = np.diff(weights.indptr), weights.indptr.astype(PETSc.IntType)
        columns = weights.indices.astype(PETSc.IntType)
        for i, j in TWICE:
            scaled = weights.data * np.repeat(blocks[:, i, j], entries)
            self._right.setValuesCSR(starts, columns, scaled)
            self._right.assemble()
            self._left.transposeMatMult(self._right, result=self._product)
            found[:, i, j] = found[:, j, i] = self._product.getValuesCSR()[2]
        return found.ravel()
