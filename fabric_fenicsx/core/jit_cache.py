"""FFCx's cache of compiled forms, shared by processes that may be killed at any time."""

import logging
import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from mpi4py import MPI

from .status import task
from .timing import phase

T = TypeVar("T")
TIMEOUT = 120  # seconds that FFCx waits for another process that compiles the same form


def compiled(comm: MPI.Comm, make: Callable[[], T]) -> T:
    """Call `make`, which compiles a form, on all ranks of `comm`, and return its result. DOLFINx
    has rank 0 compile it and the others read it. A file that another process began and did not
    finish within `TIMEOUT`, as one that was killed, is removed and recompiled."""
    logging.disable(logging.INFO)  # the C compiler's command lines
    try:
        with phase("compile"), task("compiling forms, cached for later runs"):
            return make()
    except (TimeoutError, RuntimeError) as error:  # RuntimeError where there are more ranks
        # the file that FFCx waited for in vain
        named = "timed out" in str(error) and re.search(r"remove (.+?\.c)\)", str(error))
        file = comm.bcast(Path(named[1]) if named else None)
        if not file:
            raise
        if comm.rank == 0:
            file.unlink(missing_ok=True)
        return compiled(comm, make)
    finally:
        logging.disable(logging.NOTSET)
