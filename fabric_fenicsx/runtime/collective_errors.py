"""Ranks that end together: one that fails alone would leave the others waiting for ever."""

import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

from mpi4py import MPI

PATIENCE = 10.0  # s, for the others


def is_alone(comm: MPI.Comm) -> bool:
    """Whether the other ranks do not come here, too."""
    everyone, end = comm.Ibarrier(), time.monotonic() + PATIENCE
    while not (come := everyone.Test()) and time.monotonic() < end:
        time.sleep(0.01)
    return not come


@contextmanager
def all_or_none(comm: MPI.Comm) -> Iterator[None]:
    """An exception within it that only some ranks meet is printed and ends all of them."""
    try:
        yield
    except Exception:
        if comm.size > 1 and is_alone(comm):
            traceback.print_exc()
            sys.stderr.flush()
            comm.Abort(1)
        raise
