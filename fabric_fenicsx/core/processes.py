"""Other processes, for libraries that may crash and for commands on several ranks, and signals."""

import os
import pickle
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

T = TypeVar("T")
# Open MPI's own beside those that count for any MPI; MPICH heeds none of them.
RANKS_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
}
# it ends with this process (PR_SET_PDEATHSIG), finds modules where this one does, and keeps stdout
# for results
PROGRAM = """
import ctypes, os, pickle, sys
ctypes.CDLL(None).prctl(1, 9)
results = os.fdopen(os.dup(1), "wb")
os.dup2(2, 1)
sys.path = pickle.load(sys.stdin.buffer)
work, given = pickle.load(sys.stdin.buffer)
try:
    found = True, work(*given)
except Exception as error:
    found = False, " ".join(str(error).split()) or type(error).__name__
pickle.dump(found, results)
"""


def in_child(work: Callable[..., T], *given: object, patience: float | None = None) -> T:
    """What `work` returns, a function of a module, of what is `given`. Raises RuntimeError with
    the text of its error, if it crashes, and if it takes longer than `patience` [s]."""
    of_mpi = "OMPI_", "PMIX_", "PMI_", "MPI_", "HYDRA_", "HYDI_"  # how variables of a rank begin
    env = {name: value for name, value in os.environ.items() if not name.startswith(of_mpi)}
    sent, command = pickle.dumps(sys.path) + pickle.dumps((work, given)), (sys.executable, "-c")
    try:
        done = subprocess.run(
            [*command, PROGRAM], input=sent, capture_output=True, env=env, timeout=patience
        )
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"it did not end within {patience:g} s") from None
    if not done.stdout:
        if done.returncode < 0:
            raise RuntimeError(f"it crashed ({signal.Signals(-done.returncode).name})")
        words = done.stderr.decode(errors="replace").split()
        raise RuntimeError(" ".join(words) or f"it ended with status {done.returncode}")
    worked, answer = pickle.loads(done.stdout)
    if not worked:
        raise RuntimeError(answer)
    return answer


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


class StopSignals:
    """Remembers the first SIGINT or SIGTERM on a rank of `comm`, an MPI communicator. A second one
    ends the run at once."""

    def __init__(self, comm: Any) -> None:
        self.comm, self._number = comm, 0
        numbers = signal.SIGINT, signal.SIGTERM
        self._before = {each: signal.signal(each, self._note) for each in numbers}

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._number = number
        self.forget()

    def __call__(self) -> str:
        """Text on all ranks if any received a signal, else ""."""
        number = max(self.comm.allgather(self._number))
        return f"stopped by {signal.Signals(number).name}" if number else ""

    def forget(self) -> None:
        """Restore the signal handlers from before."""
        for each, handler in self._before.items():
            signal.signal(each, handler)


def end_with_reader() -> None:
    """End the process silently from here on if it prints to a pipe that has no reader any more, as
    after `| head`. Any other broken pipe stays Python's BrokenPipeError, which PETSc would make an
    abort of all ranks."""
    if threading.current_thread() is threading.main_thread():  # the one that may
        signal.signal(signal.SIGPIPE, _end_if_unread)


def _end_if_unread(number: int, frame: FrameType | None) -> None:
    pipes = select.poll()
    for file in (1, 2):
        pipes.register(file, 0)  # asks for errors alone
    if any(event & select.POLLERR for _, event in pipes.poll(0)):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGPIPE)
