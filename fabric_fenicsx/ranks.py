"""What starts a command on several ranks, and the environment that it needs."""

import sys
from importlib.util import find_spec
from pathlib import Path

# Open MPI's own beside those that count for any MPI; MPICH heeds none of them.
RANKS_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_mpi_yield_when_idle": "1",  # other runs may share the cores
}


def on_ranks(ranks: int) -> list[str]:
    """First words of a command that runs on so many ranks, with the MPI that this Python has: of
    pip's DOLFINx, MPICH in the same folder as Python; else Debian's Open MPI."""
    if find_spec("dolfinx_solver"):
        return [str(Path(sys.executable).with_name("mpiexec")), "-n", str(ranks)]
    return ["mpirun.openmpi", "--map-by", ":OVERSUBSCRIBE", "--bind-to", "none", "-n", str(ranks)]
