"""pytest on every rank of mpirun. A rank whose test fails ends them all, where the others would
wait for it for ever."""

import sys

import pytest
from mpi4py import MPI

status = pytest.main(sys.argv[1:])
sys.stdout.flush()
if status != pytest.ExitCode.OK:
    MPI.COMM_WORLD.Abort(int(status))
