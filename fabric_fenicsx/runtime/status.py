"""What this process is doing, in words, for a user who waits."""

import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import Any, TextIO

from tqdm import tqdm

from .cache_folders import RANK

RENEWED = 0.5  # s between two texts on a terminal
SILENCE = 3.0  # s without output after which a line is printed elsewhere

_tasks: list[tuple[str | Callable[[], str], float]] = []
_line: "_Line | None" = None


@contextmanager
def task(words: str | Callable[[], str]) -> Iterator[None]:
    """Tell the user of these words while it is open; a function is asked each time for them."""
    _tasks.append((words, time.monotonic()))
    try:
        yield
    finally:
        _tasks.pop()


def doing() -> str:
    """The task begun last, with its time, "" if there is none."""
    if not _tasks:
        return ""
    words, began = _tasks[-1]
    if callable(words):
        return words()
    return f"{words}, {tqdm.format_interval(time.monotonic() - began)}"


def on_terminal() -> bool:
    """Whether a line on standard output can renew itself; Open MPI says so even of a file."""
    return sys.stdout.isatty() and not any(name in os.environ for name in RANK)


@contextmanager
def shown(lines: bool = True, first: bool = True) -> Iterator[None]:
    """Show the tasks while it is open, unless they are shown already: on a terminal in one line
    that renews itself, elsewhere, with `lines`, in a new line after each `SILENCE`. first: whether
    this is the rank that speaks."""
    global _line
    if _line or not first or not (lines or on_terminal()):
        yield
        return
    _line = _Line()
    try:
        with redirect_stdout(_Above(sys.stdout, _line)), redirect_stderr(_Above(sys.stderr, _line)):
            yield
    finally:
        _line.close()
        _line = None


class _Line(threading.Thread):
    """The thread that shows tasks."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self._file: TextIO
        try:  # of its own, as readers take over what libraries print meanwhile
            self._file = os.fdopen(os.dup(sys.stdout.fileno()), "w")
        except (OSError, ValueError):
            self._file = sys.stdout
        look = {"bar_format": "{desc}", "ncols": shutil.get_terminal_size().columns}
        self.bar = tqdm(file=self._file, leave=False, **look) if on_terminal() else None
        self.lock, self.is_whole, self.printed = threading.RLock(), True, time.monotonic()
        self._ended = threading.Event()
        self.start()

    def run(self) -> None:
        """Renew the line until `close`."""
        while not self._ended.wait(RENEWED):
            text = doing()
            with self.lock:
                if self.bar is not None and self.is_whole:
                    self.bar.set_description_str(text)
                elif self.bar is None and text and time.monotonic() - self.printed > SILENCE:
                    print(text, file=self._file, flush=True)
                    self.printed = time.monotonic()

    def close(self):
        """End the thread, and clear its line."""
        self._ended.set()
        self.join()
        if self.bar is not None:
            self.bar.close()
        if self._file is not sys.stdout:
            self._file.close()


class _Above:
    """A stream to `file` whose lines stand above the line that renews itself."""

    def __init__(self, file: TextIO, line: _Line) -> None:
        self._file, self._line = file, line

    def write(self, text: str) -> int:
        line = self._line
        with line.lock:
            if line.bar is not None and line.is_whole:
                line.bar.clear()
            count = self._file.write(text)
            self._file.flush()
            line.is_whole, line.printed = text.endswith("\n"), time.monotonic()
        return count

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)
