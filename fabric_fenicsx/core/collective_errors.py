"""Errors on some ranks alone: they are raised on all, or end all, which would wait for ever."""

import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from mpi4py import MPI

from .errors import InputError
from .files import unwritable

T = TypeVar("T")


def on_root(comm: MPI.Comm, make: Callable[[], T]) -> T:
    """What make() gives on rank 0, on all ranks; an InputError there, also for a file that can't be
    read or written, is raised on all."""

    def readable():
        try:
            return make() if comm.rank == 0 else None
        except OSError as error:
            raise unwritable(error) from None

    return comm.bcast(on_all(comm, readable))


def on_all(comm: MPI.Comm, make: Callable[[], T]) -> T:
    """What make() gives on each rank; an InputError on any, also for a file that can't be read or
    written, is raised on all."""
    result, error = None, ""
    try:
        result = make()
    except InputError as e:
        error = str(e)
    except OSError as e:
        if e.errno is None:  # of a library, not of a file
            raise
        error = str(unwritable(e))
    if error := max(comm.allgather(error)):
        raise InputError(error)
    return result  # type: ignore[return-value]


def is_alone(comm: MPI.Comm, patience: float = 10.0) -> bool:
    """True if other ranks do not call this, too, within so many seconds."""
    barrier, end = comm.Ibarrier(), time.monotonic() + patience
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
