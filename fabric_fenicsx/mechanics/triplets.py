"""A PETSc matrix that is filled from triplets many times."""

import numpy as np
from petsc4py import PETSc


class TripletMatrix:
    """`matrix`, of the sizes of A: values summed at global `rows` and `cols` (k,). The rows may be
    those of other ranks."""

    def __init__(self, A: PETSc.Mat, rows: np.ndarray, cols: np.ndarray) -> None:
        size, (low, high) = A.size[0], A.getOwnershipRange()
        keys, self._entry = np.unique(rows.astype(np.int64) * size + cols, return_inverse=True)
        rows, cols = np.divmod(keys, size)
        rows, counts = np.unique(rows, return_counts=True)
        parts = rows, np.append(0, counts.cumsum()), cols
        self._csr = [part.astype(PETSc.IntType) for part in parts]
        # as ranks add to others' rows
        room = np.full(high - low, counts.max(initial=0), dtype=PETSc.IntType)
        self.matrix = PETSc.Mat().create(A.comm)
        self.matrix.setSizes(A.getSizes())
        self.matrix.setType("aij")
        self.matrix.setPreallocationNNZ((np.minimum(room, high - low), room))
        self.matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)

    def fill(self, values: np.ndarray) -> None:
        """Replace the triplets' values by `values` (k,)."""
        rows, starts, cols = self._csr
        summed = np.bincount(self._entry, values, len(cols))
        self.matrix.zeroEntries()
        self.matrix.setValuesIJV(starts, cols, summed, addv=PETSc.InsertMode.ADD, rowmap=rows)
        self.matrix.assemble()
