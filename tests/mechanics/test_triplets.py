"""Triplets that are added to a matrix."""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fabric_fenicsx.mechanics.triplets import TripletPlaces


def matrix():
    A = PETSc.Mat().createDense((3, 3), comm=MPI.COMM_SELF)
    A.setUp()
    A.assemble()
    return A


def test_places_are_summed_and_held_ones_are_left_out():
    A, free = matrix(), PETSc.Vec().createSeq(3, comm=MPI.COMM_SELF)
    free.array[:] = 1, 1, 0
    places = TripletPlaces(A, np.array([0, 0, 1, 2]), np.array([1, 1, 1, 0]))
    places.add(A, np.array([1.0, 2.0, 4.0, 8.0]), free)
    A.assemble()
    assert (A[:, :] == [[0, 3, 0], [0, 4, 0], [0, 0, 0]]).all()
    assert (places.matrix(np.ones(4))[:, :] == [[0, 2, 0], [0, 1, 0], [1, 0, 0]]).all()


def test_a_rank_may_have_none():
    A, none = matrix(), np.empty(0)
    free = PETSc.Vec().createSeq(3, comm=MPI.COMM_SELF)
    free.set(1.0)
    TripletPlaces(A, none.astype(int), none.astype(int)).add(A, none, free)
    A.assemble()
    assert A.norm() == 0
