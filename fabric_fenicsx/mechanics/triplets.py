"""Triplets of which the values are added to a PETSc matrix many times."""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..runtime.errors import InputError


class TripletPlaces:
    """Global `rows` and `cols` (k,) of triplets in matrices of the sizes of A; those at one place
    are summed. The rows may be those of other ranks. All ranks make and use it together."""

    def __init__(self, A: PETSc.Mat, rows: np.ndarray, cols: np.ndarray) -> None:
        self._sizes, self._comm, size = A.getSizes(), A.comm, A.size[0]
        keys, self._entry = np.unique(rows.astype(np.int64) * size + cols, return_inverse=True)
        self._row, self._col = np.divmod(keys, size)
        rows, counts = np.unique(self._row, return_counts=True)
        parts = rows, np.append(0, counts.cumsum()), self._col
        self._csr = [part.astype(PETSc.IntType) for part in parts]
        self._free: np.ndarray | None = None

    def matrix(self, values: np.ndarray) -> PETSc.Mat:
        """A matrix of nothing but the triplets with these values (k,)."""
        local = self._sizes[0][0]
        # as ranks add to others' rows
        room = np.full(local, np.diff(self._csr[1]).max(initial=0), dtype=PETSc.IntType)
        made = PETSc.Mat().create(self._comm)
        made.setSizes(self._sizes)
        made.setType("aij")
        made.setPreallocationNNZ((np.minimum(room, local), room))
        made.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        self.add(made, values)
        made.assemble()
        return made

    def add(self, A: PETSc.Mat, values: np.ndarray, free: PETSc.Vec | None = None) -> None:
        """Add triplets with these values (k,) to A, which is to be assembled then. free: 0 at rows
        and columns that take none, 1 at others; the same at each call. InputError for another
        number of values."""
        if len(values) != len(self._entry):
            raise InputError(
                "`tangent` of a term gives other places than before; allowed are always the same, "
                "unless `pattern` counts up (`check_derivatives` of such a `size` tells which)"
            )
        rows, starts, cols = self._csr
        summed = np.bincount(self._entry, values, len(cols)).astype(float)  # whole numbers of none
        if free is not None:
            if self._free is None:
                self._free = self._of_entries(free)
            summed *= self._free
        A.setValuesIJV(starts, cols, summed, addv=PETSc.InsertMode.ADD, rowmap=rows)

    def _of_entries(self, free):
        """Product of `free` at the row and at the column of each entry."""
        used, place = np.unique(np.append(self._row, self._col), return_inverse=True)
        here = PETSc.Vec().createSeq(len(used), comm=MPI.COMM_SELF)
        wanted = PETSc.IS().createGeneral(used.astype(PETSc.IntType), comm=MPI.COMM_SELF)
        PETSc.Scatter().create(free, wanted, here, None).scatter(free, here)
        row, col = here.array[place].reshape(2, -1)
        return row * col
