"""What a program tells: messages, on the console and in log.txt, and what it is doing now."""

import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

from tqdm import tqdm

from .cache_folders import RANK

log = logging.getLogger("fabric_fenicsx")
# of records that a user should look at: what console and log.txt write before them, while handlers
# of other programs have the level for that
MARKED = {"mark": "warning: "}
_tasks: list[Callable[[], str]] = []
_shown = threading.Lock()  # held while tasks are shown


@contextmanager
def task(words: str | Callable[[], str]) -> Iterator[None]:
    """Tell the user of these words while it is open; a function is asked each time for them."""
    began, timed = time.monotonic(), tqdm.format_interval
    tell = words if callable(words) else lambda: f"{words}, {timed(time.monotonic() - began)}"
    _tasks.append(tell)
    try:
        yield
    finally:
        _tasks.pop()


def doing() -> str:
    """The task begun last, with its time, "" if there is none."""
    return _tasks[-1]() if _tasks else ""


def on_terminal() -> bool:
    """Whether a line on standard output can renew itself; Open MPI says so even of a file."""
    return sys.stdout.isatty() and not any(name in os.environ for name in RANK)


@contextmanager
def shown(lines: bool = True, first: bool = True, seconds: float = 3.0) -> Iterator[None]:
    """Show the tasks while it is open, unless they are shown already: on a terminal in one line
    that renews itself, elsewhere, with `lines`, in a new line after each so many `seconds` if there
    is something new. first: whether this is the rank that speaks."""
    renews = on_terminal()
    if not (first and (lines or renews) and _shown.acquire(blocking=False)):
        yield
        return
    out, ended = sys.stdout, threading.Event()
    bar = tqdm(bar_format="{desc}", file=out, leave=False, dynamic_ncols=True, disable=not renews)

    def tell():
        before = ""
        while not ended.wait(0.5 if renews else seconds):
            if renews:
                bar.set_description_str(doing())
            elif (text := doing()) not in ("", before):
                print(before := text, file=out, flush=True)

    thread = threading.Thread(target=tell, daemon=True)
    thread.start()
    above = [out, sys.stderr]
    if renews:  # lines of the program stand above one that renews itself
        from tqdm.contrib import DummyTqdmFile  # imports asyncio

        above = [DummyTqdmFile(file) for file in above]
    try:
        with redirect_stdout(above[0]), redirect_stderr(above[1]):
            yield
    finally:
        ended.set()
        thread.join()
        bar.close()
        _shown.release()


class Console(logging.Handler):
    """Results to standard output, warnings to standard error, each at once."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.setFormatter(_formatter(""))

    def emit(self, record: logging.LogRecord) -> None:
        """Print it."""
        file = sys.stderr if record.levelno >= logging.WARNING else sys.stdout
        print(self.format(record), file=file, flush=True)


class LogFile(logging.FileHandler):
    """log.txt, which starts with the command."""

    def __init__(self, path: Path, mode: str, command: str) -> None:
        super().__init__(path, mode, encoding="utf-8")
        self.setFormatter(_formatter("%(asctime)s  "))
        print(command, file=self.stream)

    def handleError(self, record: logging.LogRecord) -> None:
        """Nothing: what a full disk does to the log ends no run."""


def _formatter(before):
    """Of messages with their mark; before: what of a record stands in front of it."""
    return logging.Formatter(f"{before}%(mark)s%(message)s", "%H:%M:%S", defaults={"mark": ""})
