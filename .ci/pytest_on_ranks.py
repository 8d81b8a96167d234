"""pytest on every rank of mpirun. A rank whose test fails ends them all, where the others would
wait for it for ever."""

import sys

import pytest
from mpi4py import MPI

slowest = ["--durations", "20"] if MPI.COMM_WORLD.rank == 0 else []
status = pytest.main([*sys.argv[1:], *slowest])
sys.stdout.flush()
if status not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
    MPI.COMM_WORLD.Abort(int(status))
