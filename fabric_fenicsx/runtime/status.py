"""What this process is doing, in words, for a user who waits."""

import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

from tqdm import tqdm

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
    """Whether a line on standard output can renew itself."""
    return sys.stdout.isatty()


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
        yield
    finally:
        _line.close()
        _line = None


def write(text: str, file: TextIO) -> None:
    """Print a line at once, above the one that renews itself."""
    if _line:
        _line.write(text, file)
    else:
        print(text, file=file, flush=True)


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
        self._bar = tqdm(file=self._file, leave=False, **look) if on_terminal() else None
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._printed = time.monotonic()
        self.start()

    def run(self) -> None:
        """Renew the line until `close`."""
        while not self._ended.wait(RENEWED):
            text = doing()
            with self._lock:
                if self._bar is not None:
                    self._bar.set_description_str(text)
                elif text and time.monotonic() - self._printed > SILENCE:
                    print(text, file=self._file, flush=True)
                    self._printed = time.monotonic()

    def write(self, text, file):
        with self._lock:
            if self._bar is not None:
                self._bar.clear()
            print(text, file=file, flush=True)
            if self._bar is not None:
                self._bar.refresh()
            self._printed = time.monotonic()

    def close(self):
        """End the thread, and clear its line."""
        self._ended.set()
        self.join()
        if self._bar is not None:
            self._bar.close()
        if self._file is not sys.stdout:
            self._file.close()
