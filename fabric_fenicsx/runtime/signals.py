"""Signals that ask a run to stop."""

import signal
from types import FrameType

from mpi4py import MPI


class StopSignals:
    """Remembers the first SIGINT or SIGTERM. A second one ends the run at once."""

    def __init__(self, comm: MPI.Comm) -> None:
        self.comm, self._number = comm, 0
        numbers = signal.SIGINT, signal.SIGTERM
        self._before = {each: signal.signal(each, self._note) for each in numbers}

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._number = number
        self.forget()

    def __call__(self) -> str:
        """What any rank received, as a text on all ranks; "" if nothing came."""
        number = self.comm.allreduce(self._number, MPI.MAX)
        return f"stopped by {signal.Signals(number).name}" if number else ""

    def forget(self) -> None:
        """Restore the signal handlers from before."""
        for each, handler in self._before.items():
            signal.signal(each, handler)
