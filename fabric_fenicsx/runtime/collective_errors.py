"""Errors on some ranks alone end all of them, which would otherwise wait for ever."""

import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

from mpi4py import MPI

PATIENCE = 10.0  # s, for the others


def is_alone(comm: MPI.Comm) -> bool:
    """True if other ranks do not call this, too, within `PATIENCE`."""
    barrier, end = comm.Ibarrier(), time.monotonic() + PATIENCE
    while not (done := barrier.Test()) and time.monotonic() < end:
        time.sleep(0.01)
    return not done


@contextmanager
def all_or_none(comm: MPI.Comm) -> Iterator[None]:
    """Print an exception that only some ranks meet inside, and end all of them."""
    try:
        yield
    except Exception:
        if comm.size > 1 and is_alone(comm):
            traceback.print_exc()
            sys.stderr.flush()
            comm.Abort(1)
        raise
