"""Triplets of which the values are added to a PETSc matrix many times."""

import ctypes

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from ..runtime.compiled import compiled
from ..runtime.errors import InputError

NOWHERE = -1  # the place of what is not added here
PETSC = ctypes.CDLL(PETSc.__file__)  # for what petsc4py does not offer


class TripletPlaces:
    """Global `rows` and `cols` (k,) of triplets in matrices of the sizes of A; those at one place
    are summed. The rows may be those of other ranks. All ranks make and use it together."""

    def __init__(self, A: PETSc.Mat, rows: np.ndarray, cols: np.ndarray) -> None:
        self._sizes, self._comm = A.getSizes(), A.comm
        self._rows, self._cols = (each.astype(PETSc.IntType) for each in (rows, cols))
        # where triplets are among a matrix' entries on this rank, and those in rows of other ranks:
        # of all, and of those in free rows and columns
        self._places: list[np.ndarray] = []
        self._foreign: list[np.ndarray] = []

    def matrix(self, values: np.ndarray) -> PETSc.Mat:
        """A matrix of nothing but the triplets with these values (k,)."""
        local = self._sizes[0][0]
        longest = np.bincount(self._rows).max(initial=0)
        # as ranks add to others' rows
        room = np.full(local, longest, dtype=PETSc.IntType)
        made = PETSc.Mat().create(self._comm)
        made.setSizes(self._sizes)
        made.setType("aij")
        made.setPreallocationNNZ((np.minimum(room, local), room))
        made.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        self._insert(made, slice(None), values)
        made.assemble()
        return made

    def take_places(self, A: PETSc.Mat) -> None:
        """Find the triplets among the entries of A, assembled, of type aij, with one for each."""
        first, end = A.getOwnershipRange()
        starts, cols, _ = A.getValuesCSR()
        own = (cols >= first) & (cols < end)
        self._counts = own.sum(), (~own).sum()
        place = np.where(own, own.cumsum() - 1, own.sum() + (~own).cumsum() - 1).astype(np.int32)
        self._places = [_find(starts, cols, place, first, self._rows, self._cols)]
        self._foreign = [np.flatnonzero((self._rows < first) | (self._rows >= end))]

    def add(self, A: PETSc.Mat, values: np.ndarray, free: PETSc.Vec | None = None) -> None:
        """Add triplets with these values (k,) to A, of which `take_places` was told, and which is
        to be assembled then. free: 0 at rows and columns that take none, 1 at others; the same at
        each call. InputError for another number of values."""
        if len(values) != len(self._rows):
            raise InputError(
                "`tangent` of a term gives other places than before; allowed are always the same, "
                "unless `pattern` counts up (`check_derivatives` of such a `size` tells which)"
            )
        if free is not None and not self._places[1:]:
            self._leave_out_held(free)
        which = int(free is not None)
        values = np.ascontiguousarray(values, dtype=float)  # whole numbers of terms without any
        with _OwnEntries(A, self._counts) as (own, others):
            _add(own, others, self._places[which], values)
        if len(some := self._foreign[which]):
            self._insert(A, some, values[some])

    def _leave_out_held(self, free):
        everywhere = np.concatenate(self._comm.tompi4py().allgather(free.array > 0))
        counts = everywhere[self._rows] & everywhere[self._cols]
        self._places.append(np.where(counts, self._places[0], np.int32(NOWHERE)))
        self._foreign.append(self._foreign[0][counts[self._foreign[0]]])

    def _insert(self, A, some, values):
        """Add `some` triplets with these values to A as PETSc does: in any rank's rows, slowly."""
        size = self._sizes[0][1]
        places = self._rows[some], self._cols[some]
        summed = sparse.coo_matrix((values, places), (size, size)).tocsr()
        rows = np.flatnonzero(np.diff(summed.indptr))
        rows, starts, cols = (
            each.astype(PETSc.IntType)
            for each in (rows, np.append(summed.indptr[rows], summed.nnz), summed.indices)
        )
        A.setValuesIJV(starts, cols, summed.data, addv=PETSc.InsertMode.ADD, rowmap=rows)


class _OwnEntries:
    """Values of A's entries in this rank's rows, in PETSc's own memory. counts: how many are in
    columns of this rank, and in those of others, which PETSc keeps apart."""

    def __init__(self, A: PETSc.Mat, counts: tuple[int, int]) -> None:
        parts = [ctypes.c_void_p(A.handle)]
        if A.getType() == "mpiaij":
            parts = [ctypes.c_void_p(), ctypes.c_void_p()]
            _call("MatMPIAIJGetSeqAIJ", ctypes.c_void_p(A.handle), *map(ctypes.byref, parts), None)
        self._parts, self._counts = parts, counts

    def __enter__(self) -> list[np.ndarray]:
        """Both, to be written."""
        self._arrays = [ctypes.POINTER(ctypes.c_double)() for _ in self._parts]
        for part, array in zip(self._parts, self._arrays):
            _call("MatSeqAIJGetArray", part, ctypes.byref(array))
        found = [
            np.ctypeslib.as_array(array, (count,)) if count else np.empty(0)
            for array, count in zip(self._arrays, self._counts)
        ]
        return [*found, np.empty(0)][:2]

    def __exit__(self, *_: object) -> None:
        for part, array in zip(self._parts, self._arrays):
            _call("MatSeqAIJRestoreArray", part, ctypes.byref(array))


def _call(name, *given):
    if code := getattr(PETSC, name)(*given):
        raise PETSc.Error(code)


@compiled
def _add(own, others, places, values):
    """Add values (k,) to entries at places (k,), among `own` and, behind them, `others`."""
    for place, value in zip(places, values):
        if place >= len(own):
            others[place - len(own)] += value
        elif place >= 0:
            own[place] += value


@compiled
def _find(starts, cols, place, first, rows, wanted):
    """The `place` of entries at global `rows` and columns `wanted` (k,), `NOWHERE` in rows of
    others. starts, cols: of this rank's rows, which begin with the `first`."""
    places = np.full(len(rows), NOWHERE, dtype=place.dtype)
    for k in range(len(rows)):
        row = rows[k] - first
        if row < 0 or row >= len(starts) - 1:
            continue
        low, high = starts[row], starts[row + 1] - 1
        while low < high:
            middle = (low + high) // 2
            if cols[middle] < wanted[k]:
                low = middle + 1
            else:
                high = middle
        places[k] = place[low]
    return places
