"""Triplets that are added to a matrix."""

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from fabric_fenicsx.mechanics.triplets import TripletPlaces


def matrix(comm=MPI.COMM_SELF):
    """Of three rows, with a place everywhere."""
    A = PETSc.Mat().createAIJ((3, 3), nnz=(3, 3), comm=comm)
    for i in range(*A.getOwnershipRange()):
        A.setValues(i, range(3), np.ones(3))
    A.assemble()
    A.zeroEntries()
    return A


def dense(A):
    """All of A, on each rank."""
    rows = A.getValuesCSR()[2].reshape(-1, 3)
    return np.concatenate(A.comm.tompi4py().allgather(rows))


def test_places_are_summed_and_held_ones_are_left_out():
    A, free = matrix(), PETSc.Vec().createSeq(3, comm=MPI.COMM_SELF)
    free.array[:] = 1, 1, 0
    places = TripletPlaces(A, np.array([0, 0, 1, 2]), np.array([1, 1, 1, 0]))
    before = A.stateGet()
    places.add(A, np.array([1.0, 2.0, 4.0, 8.0]), free)
    assert A.stateGet() > before  # a change of the matrix
    A.assemble()
    assert (dense(A) == [[0, 3, 0], [0, 4, 0], [0, 0, 0]]).all()
    places.add(A, np.array([1, 1, 1, 1]))
    assert (dense(A) == [[0, 5, 0], [0, 5, 0], [1, 0, 0]]).all()


@pytest.mark.mpi
def test_ranks_add_to_rows_and_columns_of_one_another():
    comm = MPI.COMM_WORLD
    A, free = matrix(comm), PETSc.Vec().createMPI(3, comm=comm)
    free.set(1.0)
    free.array[: max(0, 1 - free.getOwnershipRange()[0])] = 0  # of row 0
    rows, cols = np.repeat(range(3), 3), np.tile(range(3), 3)
    places = TripletPlaces(A, rows, cols)
    places.add(A, 3.0 * rows + cols, free)
    A.assemble()
    held = np.arange(9.0).reshape(3, 3) * comm.size
    held[0], held[:, 0] = 0, 0
    assert (dense(A) == held).all()
    places.add(A, np.ones(9))
    A.assemble()
    assert (dense(A) == held + comm.size).all()
