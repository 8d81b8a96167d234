"""Triplets of which the values are added to a PETSc matrix many times."""

import ctypes

import numpy as np
from petsc4py import PETSc

from ..core.errors import InputError

PETSC = ctypes.CDLL(PETSc.__file__)  # for what petsc4py does not offer


class TripletPlaces:
    """Global `rows` and `cols` (k,) of triplets, for which A, assembled, is given places beside its
    own; those at one place are summed. The rows may be those of other ranks. All ranks make and use
    it together."""

    def __init__(self, A: PETSc.Mat, rows: np.ndarray, cols: np.ndarray) -> None:
        self._comm, self._rows, self._cols = A.comm.tompi4py(), rows, cols
        names = A.getLGMap()
        starts, own, _ = A.getValuesCSR()
        first, end = A.getOwnershipRange()
        self._none = np.zeros(len(own))  # is added to A's own places
        own_rows = np.repeat(np.arange(first, end), np.diff(starts))
        places = [np.concatenate(each) for each in ((own_rows, rows), (own, cols))]
        pointers = [each.astype(PETSc.IntType).ctypes.data_as(ctypes.c_void_p) for each in places]
        _call("MatSetPreallocationCOO", A, ctypes.c_ssize_t(len(places[0])), *pointers)
        A.setLGMap(*names)
        self._counts: np.ndarray | None = None  # which ones are in free rows and columns
        self.add(A, np.zeros(len(rows)))  # before which A is not assembled

    def add(self, A: PETSc.Mat, values: np.ndarray, free: PETSc.Vec | None = None) -> None:
        """Add triplets with these values (k,) to A. free: 0 at rows and columns that take none, 1
        at others; the same at each call. InputError for another number of values."""
        if len(values) != len(self._rows):
            raise InputError(
                "`tangent` of a term gives other places than before; allowed are always the same, "
                "unless `pattern` counts up (`check_derivatives` of such a `size` tells which)"
            )
        if free is not None:
            if self._counts is None:
                everywhere = np.concatenate(self._comm.allgather(free.array > 0))
                self._counts = everywhere[self._rows] & everywhere[self._cols]
            values = np.where(self._counts, values, 0.0)
        given = np.concatenate([self._none, values])
        pointer = given.ctypes.data_as(ctypes.c_void_p)
        _call("MatSetValuesCOO", A, pointer, ctypes.c_int(PETSc.InsertMode.ADD))


def _call(name, A, *given):
    if code := getattr(PETSC, name)(ctypes.c_void_p(A.handle), *given):
        raise PETSc.Error(code)
