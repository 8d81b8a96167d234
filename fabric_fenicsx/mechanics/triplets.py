"""A PETSc matrix that is filled by triplets again and again."""

import numpy as np
from petsc4py import PETSc


class TripletMatrix:
    """`matrix`, of the sizes of A: the sum of values at global `rows` and `cols` (k,), which ranks
    may add to each other's rows."""

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
        """Take `values` (k,) for those that the triplets had before."""
        rows, starts, cols = self._csr
        summed = np.bincount(self._entry, values, len(cols))
        self.matrix.zeroEntries()
        self.matrix.setValuesIJV(starts, cols, summed, addv=PETSc.InsertMode.ADD, rowmap=rows)
        self.matrix.assemble()
