"""Errors on some ranks alone: they are raised on all, or end all, which would wait for ever."""

import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from mpi4py import MPI

from .errors import InputError
from .files import unwritable

T = TypeVar("T")
PATIENCE = 10.0  # s, for the others


def on_root(comm: MPI.Comm, make: Callable[[], T]) -> T:
    """What make() gives on rank 0, on all ranks; an InputError there, also for a file that can't be
    read or written, is raised on all."""
    result, error = None, ""
    if comm.rank == 0:
        try:
            result = make()
        except InputError as e:
            error = str(e)
        except OSError as e:
            if e.errno is None:  # of a library, not of a file
                raise
            error = str(unwritable(e))
    result, error = comm.bcast((result, error))
    if error:
        raise InputError(error)
    return result


def on_all(comm: MPI.Comm, make: Callable[[], T]) -> T:
    """What make() gives on each rank; an InputError on any is raised on all."""
    result: Any = None
    error = ""
    try:
        result = make()
    except InputError as e:
        error = str(e)
    if error := next(filter(None, comm.allgather(error)), ""):
        raise InputError(error)
    return result


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
