"""Runs as processes of `fabric form`, side by side; what their press tells before a run."""

import argparse
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from pathlib import Path
from threading import RLock

from ..core.errors import NOT_VALID, InputError, Interrupted
from ..core.files import failure_reason
from ..core.formatting import rounded
from ..core.processes import RANKS_ENVIRONMENT, on_ranks
from ..core.status import shown, task
from ..material.presets import read_laws
from ..press.press import Press
from ..press.schema import OF_ALL_PLIES, short_forms
from .folder import Range, Run, SweepFolder, Values


class SweepRun:
    """`fabric form` of a press file with these options, on so many ranks."""

    def __init__(self, press: Path, options: Sequence[str] = (), ranks: int = 1) -> None:
        self.press, self.options, self.ranks = press, list(options), ranks
        known = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
        for name in ("law_file", *OF_ALL_PLIES):
            known.add_argument(f"--{name.replace('_', '-')}")
        given, _ = known.parse_known_args(self.options)
        self._short_forms = short_forms(vars(given))
        if given.law_file:
            read_laws(given.law_file)

    def command(self, values: Values, folder: Path) -> list[str]:
        """The command of the run with these values into its folder, but for how it goes on."""
        settings = [word for pair in values.items() for word in ("--set", "=".join(pair))]
        ranks = on_ranks(self.ranks) if self.ranks > 1 else []
        start = [sys.executable, "-m", "fabric_fenicsx", "form", str(self.press)]
        return [*ranks, *start, *settings, "--out", str(folder), *self.options]

    def read(self, values: Values) -> Press:
        """The press with these values; InputError if it cannot have them."""
        return Press.read(self.press, [*self._short_forms, *map("=".join, values.items())])

    def scatter(self) -> list[Range]:
        """The intervals of the press's materials; one for all sheets of one fabric or metal."""
        found, press = [], self.read({})
        for kind in ("fabric", "metal"):
            own = {f"{p}.{kind}": getattr(s, kind) for p, s in zip(press.paths(), press.sheets)}
            materials = [material for material in own.values() if material]
            if materials and all(each == materials[0] for each in materials):
                own = {kind: materials[0]}
            for path, material in own.items():
                scatter = material.scatter if material else {}
                found += [Range(f"{path}.{n}", *ends) for n, ends in scatter.items()]
        return found


class Runner:
    """Runs of a sweep's `folder` by the processes of a `program`, so many `jobs` at a time: by
    default as many as there are cores, and as free memory allows by what earlier runs took. Each
    run that is valid must have the quantities `asked` for."""

    def __init__(
        self, folder: SweepFolder, program: SweepRun, jobs: int | None, asked: Sequence[str]
    ) -> None:
        self.folder, self.program, self.asked = folder, program, asked
        memory = max((run.memory() for run in folder.runs.values()), default=0)
        # of 80 000 cells on one rank, before a run has ended [MiB]
        needed = memory or 2048 * program.ranks
        lines = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        room = int(lines["MemAvailable"].split()[0]) / 1024 // needed
        cores = len(os.sched_getaffinity(0)) // program.ranks
        self.jobs = jobs or int(max(1, min(cores, room)))
        self._under_way: list[subprocess.Popen] = []
        self._lock = RLock()  # of what is under way
        self._stopped = False

    def all(self, values: Iterable[Values]) -> list[Run]:
        """Have the runs with these values all done; returns them. Raises InputError with the
        sentence of a run that met bad input, and Interrupted on SIGINT, SIGTERM or SIGHUP, after
        all processes have ended."""
        runs = [self.folder.run(each) for each in values]
        todo = [run for run in runs if not run.is_done(self.program.options)]
        for run in todo:  # before any starts, so that one that another one ends is known, too
            run.status, run.reason = None, ""

        def words():
            return f"{sum(run.status is not None for run in todo)} of {len(todo)} runs have ended"

        def stop(number, _):
            came.append(signal.Signals(number).name)
            self._stop()

        came: list[str] = []
        stops = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
        before = {each: signal.signal(each, stop) for each in stops}
        try:
            with shown(), task(words), ThreadPoolExecutor(self.jobs) as pool:
                for each in as_completed([pool.submit(self._do, run) for run in todo]):
                    each.result()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
        if came:
            raise Interrupted(f"stopped by {came[0]}; the same command continues from there")
        return runs

    def _do(self, run):
        """Start a run, and note how it ended; nothing once all are to stop."""
        with self._lock:
            if self._stopped:
                return
            process, began = self._start(run), time.monotonic()
            self._under_way.append(process)
        status = process.wait()
        with self._lock:
            self._under_way.remove(process)
            try:
                if status == 2:
                    raise InputError(f"run {run.label}: {_last_words(run)}")
                if "--dry-run" in self.program.options and status == 0:  # which leaves no results
                    print(f"{run.label}: {_last_words(run, 'the run takes .*')}", flush=True)
                    return
                _note(run, status)
                print(_line(run, time.monotonic() - began), flush=True)
                for name in self.asked if run.is_valid() else ():
                    run.number(name)
            except InputError:
                self._stop()
                raise

    def _start(self, run):
        begun = (run.folder / "checkpoint.npz").exists()
        again = ["--resume" if begun else "--overwrite"] if run.folder.exists() else []
        words = self.program.command(run.values, run.folder) + again
        run.folder.mkdir(exist_ok=True)
        run.options = list(self.program.options)
        run.save()
        # Ctrl-C is for the sweep, which then asks its runs to end
        how: dict = {"env": os.environ | RANKS_ENVIRONMENT, "start_new_session": True}
        how |= {"stdin": subprocess.DEVNULL, "stderr": subprocess.STDOUT}
        with open(run.folder / "console.txt", "w") as console:
            return subprocess.Popen(words, stdout=console, **how)

    def _stop(self):
        """Ask all runs to end after their step; in a second call end them at once."""
        with self._lock:
            if not self._stopped and (count := len(self._under_way)):
                print(f"ending after the current step: {count}; Ctrl-C again ends them at once")
            for process in self._under_way:
                with suppress(ProcessLookupError):
                    if self._stopped:
                        os.killpg(process.pid, signal.SIGKILL)  # with all that it has started
                    else:
                        process.terminate()  # alone: it ends by itself what it has started
            self._stopped = True


def _last_words(run, of="fabric form: (?:error: |stopped: )?(.+)"):
    """A run's sentence on how it ended, else its last line; libraries of MPI may print after it."""
    text = (run.folder / "console.txt").read_text(errors="replace")
    own = re.findall(f"^{of}", text, re.MULTILINE)
    return (own or [line for line in text.splitlines() if line] or ["no words"])[-1]


def _note(run, status):
    run.status, run.reason = status, ""
    if status < 0:
        name = signal.Signals(-status).name
        memory = " (as the system does if memory runs out)" if name == "SIGKILL" else ""
        run.reason = f"ended by {name}{memory}"
    elif not run.is_valid():
        own = status == 3 and failure_reason(run.results / "summary.json")  # else of a later run
        run.reason = own or _last_words(run)
    if run.reason.startswith(("stopped by", "interrupted")):
        run.status = None  # by somebody else: the next call goes on with it
    run.save()


def _line(run, seconds):
    summary = run.summary()
    if not run.is_valid():
        reached = summary.get("stroke_reached", 0)
        how = "not valid" if run.reason.startswith(NOT_VALID) else "gave up"
        at = f" at load {rounded(reached)}" if reached < 1 else ""
        return f"{run.label}: {how}{at}: {run.reason.removeprefix(NOT_VALID)}"
    force = summary.get("reaction_N")
    result = "" if force is None else f", {summary.get('reaction_is', 'force')} {force:.5g} N"
    return f"{run.label}: done in {seconds:.0f} s{result}"
