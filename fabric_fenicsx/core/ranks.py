"""Commands on several ranks, and their environment."""

import os
import sys
from importlib.util import find_spec
from pathlib import Path

# Open MPI's own beside those that count for any MPI; MPICH heeds none of them.
RANKS_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
}


def on_ranks(ranks: int) -> list[str]:
    """Beginning of a command on so many ranks, with this Python's MPI: MPICH of pip's DOLFINx, in
    the same folder as Python, else Debian's Open MPI."""
    if find_spec("dolfinx_solver"):
        return [str(Path(sys.executable).with_name("mpiexec")), "-n", str(ranks)]
    # Ranks give up their core while they wait only where they must share it: a core given up to
    # other work comes back late (Linux since 6.6), and Open MPI gives it up on one rank, too.
    shares = ranks > len(os.sched_getaffinity(0))
    idle = ["--mca", "mpi_yield_when_idle", str(int(shares))]
    where = ["--map-by", ":OVERSUBSCRIBE", "--bind-to", "none"]
    return ["mpirun.openmpi", *where, *idle, "-n", str(ranks)]
