"""Triplets of which the values are added to a PETSc matrix many times."""

import ctypes

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..runtime.compiled import compiled
from ..runtime.errors import InputError

NOWHERE = -1  # the place of what is not added here
PETSC = ctypes.CDLL(PETSc.__file__)  # for what petsc4py does not offer


class TripletPlaces:
    """Global `rows` and `cols` (k,) of triplets in matrices of the sizes of A; those at one place
    are summed. The rows may be those of other ranks. All ranks make and use it together."""

    def __init__(self, A: PETSc.Mat, rows: np.ndarray, cols: np.ndarray) -> None:
        self._sizes, self._comm, size = A.getSizes(), A.comm, A.size[0]
        keys, entry = np.unique(rows.astype(np.int64) * size + cols, return_inverse=True)
        self._keys, self._entry = keys, entry.astype(np.int32)
        # places of the triplets among a matrix' entries on this rank, all and without held ones
        self._places: list[np.ndarray] = []
        self._foreign: _Entries | None = None  # in rows of other ranks

    def matrix(self, values: np.ndarray) -> PETSc.Mat:
        """A matrix of nothing but the triplets with these values (k,)."""
        local, every = self._sizes[0][0], _Entries(self._keys, self._sizes[0][1])
        # as ranks add to others' rows
        room = np.full(local, every.longest_row(), dtype=PETSc.IntType)
        made = PETSc.Mat().create(self._comm)
        made.setSizes(self._sizes)
        made.setType("aij")
        made.setPreallocationNNZ((np.minimum(room, local), room))
        made.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        every.add(made, np.bincount(self._entry, values, len(self._keys)))
        made.assemble()
        return made

    def add(self, A: PETSc.Mat, values: np.ndarray, free: PETSc.Vec | None = None) -> None:
        """Add triplets with these values (k,) to A, of which `take_places` was told, and which is
        to be assembled then. free: 0 at rows and columns that take none, 1 at others; the same at
        each call. InputError for another number of values."""
        if len(values) != len(self._entry):
            raise InputError(
                "`tangent` of a term gives other places than before; allowed are always the same, "
                "unless `pattern` counts up (`check_derivatives` of such a `size` tells which)"
            )
        if free is not None and not self._places[1:]:
            self._places.append(self._without_held(free))
        values = np.ascontiguousarray(values, dtype=float)  # whole numbers of terms without any
        with _OwnEntries(A, self._counts) as (own, others):
            _add(own, others, self._places[free is not None], values)
        if self._foreign is not None:
            summed = np.bincount(self._entry, values, len(self._keys))
            self._foreign.add(A, summed, free)

    def take_places(self, A: PETSc.Mat) -> None:
        """Find the triplets among the entries of A, assembled, of type aij, with one for each."""
        size, (first, end) = A.size[0], A.getOwnershipRange()
        starts, cols, _ = A.getValuesCSR()
        here = np.repeat(np.arange(first, end), np.diff(starts)) * size + cols
        low, high = np.searchsorted(self._keys, (first * size, end * size))
        own = (cols >= first) & (cols < end)
        self._counts = own.sum(), (~own).sum()
        place = np.where(own, own.cumsum() - 1, own.sum() + (~own).cumsum() - 1)
        places = np.full(len(self._keys), NOWHERE)
        places[low:high] = place[np.searchsorted(here, self._keys[low:high])]
        if self._comm.tompi4py().allreduce(high - low < len(self._keys), MPI.LOR):
            foreign = np.append(np.arange(low), np.arange(high, len(self._keys)))
            self._foreign = _Entries(self._keys, size, foreign)
        self._places = [places[self._entry].astype(np.int32)]

    def _without_held(self, free):
        every = _Entries(self._keys, self._sizes[0][1])
        return np.where(every.free(free)[self._entry] > 0, self._places[0], np.int32(NOWHERE))


class _Entries:
    """Entries of a matrix of `size` rows, by sorted keys row * size + column: all or `some`."""

    def __init__(self, keys: np.ndarray, size: int, some: np.ndarray | slice = slice(None)) -> None:
        self._row, self._col = np.divmod(keys[some], size)
        self._some = some
        rows, counts = np.unique(self._row, return_counts=True)
        parts = rows, np.append(0, counts.cumsum()), self._col
        self._csr = [part.astype(PETSc.IntType) for part in parts]
        self._free: np.ndarray | None = None

    def longest_row(self) -> int:
        """Entries in it."""
        return int(np.diff(self._csr[1]).max(initial=0))

    def add(self, A: PETSc.Mat, values: np.ndarray, free: PETSc.Vec | None = None) -> None:
        """Add those of the `values` of all entries to A, as PETSc does: slowly, in any rank's
        rows."""
        rows, starts, cols = self._csr
        given = values[self._some]
        if free is not None:
            if self._free is None:
                self._free = self.free(free)
            given = given * self._free
        A.setValuesIJV(starts, cols, given, addv=PETSc.InsertMode.ADD, rowmap=rows)

    def free(self, free: PETSc.Vec) -> np.ndarray:
        """Product of `free` at the row and at the column of each entry. All ranks call it."""
        used, place = np.unique(np.append(self._row, self._col), return_inverse=True)
        here = PETSc.Vec().createSeq(len(used), comm=MPI.COMM_SELF)
        wanted = PETSc.IS().createGeneral(used.astype(PETSc.IntType), comm=MPI.COMM_SELF)
        PETSc.Scatter().create(free, wanted, here, None).scatter(free, here)
        row, col = here.array[place].reshape(2, -1)
        return row * col


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

    def __exit__(self, *_) -> None:
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
