"""Signals that ask a run to stop, or say that its output has lost its reader."""

import os
import select
import signal
import threading
from types import FrameType
from typing import Any


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
