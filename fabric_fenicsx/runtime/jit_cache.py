"""FFCx's cache of compiled forms, shared by processes that may be killed at any time."""

import fcntl
import logging
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from mpi4py import MPI

from .cache_folders import cache
from .status import task
from .timing import phase

T = TypeVar("T")
TIMEOUT = 1  # seconds that FFCx waits for another process: after that `compiled` waits better


def compiled(comm: MPI.Comm, make: Callable[[], T]) -> T:
    """Call `make`, which compiles a form, on all ranks of `comm`, and return its result. FFCx gives
    up after a time if another process compiles the same form, and for ever if one was killed while
    it did. Here others are waited for, and an unfinished file is removed when nobody compiles."""
    logging.disable(logging.INFO)  # the C compiler's command lines
    try:
        with phase("compile"), task("compiling forms, which are kept for later runs"):
            try:
                with _lock(comm, fcntl.LOCK_SH):
                    return make()
            except (TimeoutError, RuntimeError) as error:  # RuntimeError where there are more ranks
                # the file that FFCx waited for in vain
                named = "timed out" in str(error) and re.search(r"remove (.+?\.c)\)", str(error))
                file = comm.bcast(Path(named[1]) if named else None)
                if not file:
                    raise
            with _lock(comm, fcntl.LOCK_EX):
                if comm.rank == 0 and not file.with_suffix(".c.cached").exists():
                    file.unlink(missing_ok=True)
                return make()
    finally:
        logging.disable(logging.NOTSET)


@contextmanager
def _lock(comm: MPI.Comm, kind: int) -> Iterator[None]:
    """Hold the cache's lock on rank 0, which compiles, if the file system has locks."""
    folder, file = cache() / "fenics", None
    if comm.rank == 0:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            file = open(folder / "fabric_fenicsx.lock", "w")
            fcntl.flock(file, kind)
        except OSError:
            pass
    try:
        yield
    finally:
        if file:
            file.close()
