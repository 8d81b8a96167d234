"""Runs as processes, side by side."""

import csv
import math
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from threading import Condition

from ..runtime.errors import NOT_BELIEVED, InputError, Interrupted
from ..runtime.formatting import rounded
from ..runtime.ranks import RANKS_ENVIRONMENT
from ..runtime.status import shown, task
from .folder import Run, SweepFolder
from .form import Form
from .varied import Values

ENDS = "fabric form: "  # begin of the line with the reason why a run ended
CONSOLE = "console.txt"  # in a run's folder: what it printed
RANK_MEMORY = 2048  # MiB, of a rank before a run has ended: that of 80 000 cells on one


class Runner:
    """Runs of a sweep's `folder` by the processes of a `program`, so many `jobs` at a time, by
    default as many as cores and free memory allow."""

    def __init__(self, folder: SweepFolder, program: Form, jobs: int | None = None) -> None:
        self.folder, self.program = folder, program
        self._memory = math.inf if jobs else free_memory()
        self._most = jobs or max(1, len(os.sched_getaffinity(0)) // program.ranks)
        self._under_way: list[tuple[Run, subprocess.Popen]] = []
        self._ended = Condition()  # notified as a run ends; its lock guards what is under way
        self._stops = 0

    def room(self, runs: Sequence[Run]) -> int:
        """How many of these runs have room side by side, by the memory of those that have ended."""
        memory = max((run.memory() for run in runs), default=0) or RANK_MEMORY * self.program.ranks
        return int(max(1, min(self._most, self._memory // memory)))

    def all(self, values: Iterable[Values]) -> list[Run]:
        """Have the runs with these values all done; returns them. Raises InputError with the
        sentence of a run that met bad input, and Interrupted on SIGINT, SIGTERM or SIGHUP, after
        all processes have ended."""
        runs = [self.folder.run(each) for each in values]
        todo = [run for run in runs if not run.is_done(self.program.options)]
        for run in todo:  # before any starts, so that one that another one ends is known, too
            run.status, run.reason = None, ""
        with (
            _on_signal(self._stop) as came,
            shown(),
            task(partial(self._words, todo)),
            ThreadPoolExecutor(self._most) as pool,
        ):
            for each in as_completed([pool.submit(self._do, run, runs) for run in todo]):
                each.result()
        if came:
            name = signal.Signals(came[0]).name
            raise Interrupted(f"stopped by {name}; the same command goes on from there")
        return runs

    def _do(self, run, runs):
        """Start a run once it has room, and note how it ended; nothing once all are to stop."""
        with self._ended:
            self._ended.wait_for(lambda: len(self._under_way) < self.room(runs))
            if self._stops:
                return
            mine, began = (run, self._start(run)), time.monotonic()
            self._under_way.append(mine)
        status = mine[1].wait()
        with self._ended:
            self._under_way.remove(mine)
            self._ended.notify_all()
            if status == 2:
                self._stop()
                raise InputError(f"run {run.label}: {_last_words(run.folder / CONSOLE)}")
            _note(run, status)
            print(_line(run, time.monotonic() - began), flush=True)

    def _start(self, run):
        words = self.program.command(run.values, run.folder)
        if (run.folder / "checkpoint.npz").exists():
            words.append("--resume")
        elif run.folder.exists():
            words.append("--overwrite")
        run.folder.mkdir(exist_ok=True)
        run.options = list(self.program.options)
        run.save()
        with open(run.folder / CONSOLE, "w") as console:
            return subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=subprocess.STDOUT,
                env=os.environ | RANKS_ENVIRONMENT,
                start_new_session=True,  # Ctrl-C is for the sweep, which then asks its runs to end
            )

    def _stop(self):
        """Ask all runs to end after their step; in a second call end them at once."""
        with self._ended:
            self._stops += 1
            if self._stops == 1 and self._under_way:
                count = len(self._under_way)
                print(f"ending after their step: {count}; Ctrl-C again ends them at once")
            for _, process in self._under_way:
                if self._stops == 1:
                    process.terminate()  # alone: it ends by itself what it has started
                else:
                    with suppress(ProcessLookupError):
                        os.killpg(process.pid, signal.SIGKILL)  # with all that it has started

    def _words(self, todo):
        """How many of the runs have ended, and which loads others have reached."""
        ended = sum(run.status is not None for run in todo)
        loads = [f"{_load(run.folder / 'history.csv'):.0%}" for run, _ in self._under_way[:]]
        return f"{ended} of {len(todo)} runs, others at {', '.join(loads) or '-'}"


@contextmanager
def _on_signal(action: Callable[[], None]) -> Iterator[list[int]]:
    """Do this on a signal to stop while it is open; the signals that came."""
    came: list[int] = []

    def handle(number, _):
        came.append(number)
        action()

    stops = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
    before = {each: signal.signal(each, handle) for each in stops}
    try:
        yield came
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def free_memory() -> float:
    """The memory that the system can give to programs [MiB], inf where it does not tell."""
    with suppress(OSError):
        lines = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        return int(lines["MemAvailable"].split()[0]) / 1024
    return math.inf


def _load(history):
    """The load factor in the last whole row of history.csv, 0 if there is none."""
    with suppress(OSError, ValueError, IndexError, KeyError, TypeError), open(history) as file:
        return float([*csv.DictReader(file)][-1]["load"])
    return 0.0


def _last_words(console):
    """A run's sentence on how it ended, else its last line; libraries of MPI may print after it."""
    lines = re.split(r"[\r\n]+", console.read_text(errors="replace").strip())
    own = [line for line in lines if line.startswith(ENDS)]
    return re.sub(rf"^{ENDS}(error: |stopped: )?", "", (own or lines)[-1]) or "no words"


def _note(run, status):
    """Note in a run's folder how its process ended."""
    summary = run.summary()
    run.status = status
    if run.is_believed():
        run.reason = ""
    elif status < 0:
        name = signal.Signals(-status).name
        memory = " (as the system does when memory is short)" if name == "SIGKILL" else ""
        run.reason = f"ended by {name}{memory}"
    else:
        own = "" if summary.get("converged") else summary.get("reason")  # else of a later run
        run.reason = (status == 3 and own) or _last_words(run.folder / CONSOLE)
    if run.reason.startswith(("stopped by", "interrupted")):
        run.status = None  # by somebody else: the next call goes on with it
    run.save()


def _line(run, seconds):
    """The line that tells of a run that ended."""
    summary = run.summary()
    if not run.is_believed():
        reached = summary.get("stroke_reached", 0)
        how = "not believed" if run.reason.startswith(NOT_BELIEVED) else "gave up"
        at = f" at load {rounded(reached)}" if reached < 1 else ""
        return f"{run.label}: {how}{at}: {run.reason.removeprefix(NOT_BELIEVED)}"
    force = summary.get("reaction_N")
    result = "" if force is None else f", {summary.get('reaction_is', 'force')} {force:.5g} N"
    return f"{run.label}: done in {seconds:.0f} s{result}"
