"""What a running program says and hears: messages, its log, signals, files that are whole at any moment."""

import fcntl
import logging
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import IO

from mpi4py import MPI
from tqdm import tqdm

LOCK = ".lock"  # the file in a folder by which a run holds it


class Console(logging.Handler):
    """Results to standard output, warnings to standard error, neither into the progress bar."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print at once."""
        file = sys.stderr if record.levelno >= logging.WARNING else sys.stdout
        tqdm.write(self.format(record), file=file)
        file.flush()


class LogFile(logging.FileHandler):
    """log.txt, opened with the first message; it starts with the command."""

    def __init__(self, path: Path, mode: str, command: str) -> None:
        super().__init__(path, mode, delay=True)
        self.command = command
        self.setFormatter(logging.Formatter("%(asctime)s  %(message)s", "%H:%M:%S"))

    def _open(self):
        file = super()._open()
        file.write(f"{self.command}\n")
        return file

    def handleError(self, record: logging.LogRecord) -> None:
        """Nothing: what a full disk does to the log ends no run."""


class Asked:
    """Notes SIGINT and SIGTERM, of which a second one is not noted but ends the run at once."""

    def __init__(self, comm: MPI.Comm) -> None:
        self.comm, self._number = comm, 0
        self._before = {each: signal.signal(each, self._note) for each in (signal.SIGINT, signal.SIGTERM)}

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._number = number
        self.forget()

    def __call__(self) -> str:
        """On all ranks, what one of them got, in words; "" for nothing."""
        number = self.comm.allreduce(self._number, MPI.MAX)
        return f"stopped by {signal.Signals(number).name}" if number else ""

    def forget(self) -> None:
        """Leave signals to what they did before."""
        for each, handler in self._before.items():
            signal.signal(each, handler)


def hold(folder: Path) -> IO | None:
    """Hold `folder` for this process as long as the file that this returns is open; None if another one holds it.

    The system lets go when the process ends, however it does. On NFS this works between machines if its server has locks;
    where a file system has none, nothing is held. Raises OSError where the folder can't be written to.
    """
    file = open(folder / LOCK, "a")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        return None
    except OSError:  # no locks here
        pass
    return file


def replace(path: Path, content: str | bytes, lasting: bool = False) -> None:
    """Make `content` that of the file `path`, at once; lasting: on the disk before this returns.

    Raises OSError, naming the file, where it can't be written; it then is what it was.
    """
    part = path.with_name(path.name + ".part")
    try:
        with open(part, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            if lasting:
                os.fsync(file.fileno())
        os.replace(part, path)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from None
