"""Runs as processes, side by side."""

import csv
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any

from ..runtime.errors import NOT_BELIEVED, InputError, Interrupted
from ..runtime.formatting import rounded
from ..runtime.ranks import RANKS_ENVIRONMENT, on_ranks
from ..runtime.status import shown, task
from .folder import ALWAYS, Run, SweepFolder, flat, read_press
from .varied import Range, Values, changes, label, spelled

ENDS = "fabric form: "  # begin of the line with the reason why a run ended
CONSOLE = "console.txt"  # in a run's folder: what it printed
FINER = 1.5  # times as many cells along each side, on the finer mesh
CELLS = "nx", "ny", "size"  # entries of a sheet
UNKNOWN = 2048  # MiB of a rank before a run has ended: that of 80 000 cells on one
LOOK = 0.05  # s between looks at whether a run has ended
STOPS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP


class Form:
    """`fabric form` of a press file with these options, on so many ranks."""

    def __init__(self, press: Path, options: Sequence[str] = (), ranks: int = 1) -> None:
        self.press, self.options, self.ranks = press, list(options), ranks
        self._laws_are_read = False
        self._built: dict[str, Any] = {}  # presses by the labels of their values

    def command(self, values: Values, folder: Path) -> list[str]:
        """The command of the run with these values into its folder, but for how it goes on."""
        settings = [word for each in changes(values) for word in ("--set", each)]
        ranks = on_ranks(self.ranks) if self.ranks > 1 else []
        start = [sys.executable, "-m", "fabric_fenicsx", "form", str(self.press)]
        return [*ranks, *start, *settings, "--out", str(folder), *self.options]

    def check(self, values: Sequence[Values]) -> None:
        """InputError for the first values that the press file cannot have."""
        for each in values:
            try:
                self._read(each)
            except InputError as error:
                raise InputError(f"run {label(each)}: {error}") from None

    def _read(self, values=MappingProxyType({})):
        """The press with these values."""
        from ..forming.press import Press  # takes seconds to import
        from ..material.presets import read_laws

        words = [*(part for word in self.options for part in word.split("=", 1)), "--law-file", ""]
        law_file = words[words.index("--law-file") + 1]
        if law_file and not self._laws_are_read:
            read_laws(law_file)
            self._laws_are_read = True
        return Press.read(self.press, changes(values))

    def _build(self, values):
        """The built press with these values."""
        if label(values) not in self._built:
            self._built[label(values)] = self._read(values).build()
        return self._built[label(values)]

    def scatter(self) -> list[Range]:
        """The intervals of the press's materials; one for all sheets of one fabric or metal."""
        found, press = [], self._read()
        for kind in ("fabric", "metal"):
            own = {f"{p}.{kind}": getattr(s, kind) for p, s in zip(press.paths(), press.sheets)}
            own = {path: material for path, material in own.items() if material}
            first = next(iter(own.values()), None)
            if first and all(each == first for each in own.values()):
                own = {kind: first}
            for path, material in own.items():
                found += [Range(f"{path}.{n}", *ends) for n, ends in material.scatter.items()]
        return found

    def quantities(self, values: Values) -> list[str]:
        """Names of the numbers that the run with these values will have: those of its blank as it
        lies, which is not run."""
        from ..results.fields import FieldSeries
        from ..results.result import Result
        from ..scene.output import cell_fields

        made = self._build(values)
        fields = cell_fields(made.scene)
        row = defaultdict[str, Any](float, load=1.0)
        with TemporaryDirectory() as folder:
            FieldSeries(Path(folder), made.scene, ()).write(1.0, fields)
            result = Result({}, [row], fields, Path(folder), made.scene)
            return [*ALWAYS, "wall_s", *flat(made.quantities(result))]

    def finer(self, values: Values) -> dict[str, str]:
        """What makes the cells of the run with these values `FINER` times as fine: {key: value},
        nothing for own meshes and where `values` are of the cells."""
        document, found = read_press(self.press)[1], dict[str, str]()
        blank = document.get("blank", {})
        if {key.split(".")[-1] for key in values} & {*CELLS, "mesh"}:
            return {}
        sheets = self._build(values).laid.sheets
        for k, (sheet, ply) in enumerate(zip(sheets, document.get("ply", [{}])), 1):
            if sheet.mesh:
                return {}
            path = f"ply.{k}" if {*CELLS, "outline"} & {*ply} else "blank"
            if not sheet.nx:
                found[f"{path}.size"] = spelled(sheet.size / FINER)
                continue
            found[f"{path}.nx"] = str(_more(sheet.nx))
            if "ny" in {**blank, **ply}:
                found[f"{path}.ny"] = str(_more(sheet.ny))
        return found


def _more(count):
    """A number of rectangles times `FINER`; an even one stays even."""
    return 2 * math.ceil(FINER * count / 2) if count % 2 == 0 else math.ceil(FINER * count)


class Runner:
    """Runs of a sweep's `folder` by the processes of a `program`, so many `jobs` at a time, by
    default as many as cores and free memory allow."""

    def __init__(self, folder: SweepFolder, program: Form, jobs: int | None = None) -> None:
        self.folder, self.program, self.jobs = folder, program, jobs
        self._free = free_memory()
        self._todo: list[Run] = []
        self._under_way: list[tuple[Run, subprocess.Popen, float]] = []

    def room(self, runs: Sequence[Run]) -> int:
        """How many of these runs have room side by side, by the memory of those that have ended."""
        if self.jobs:
            return self.jobs
        ranks = self.program.ranks
        memory = max((run.memory() for run in runs), default=0) or UNKNOWN * ranks
        return max(1, int(min(len(os.sched_getaffinity(0)) // ranks, self._free // memory)))

    def all(self, values: Iterable[Values]) -> list[Run]:
        """Have the runs with these values all done; returns them. Raises InputError with the
        sentence of a run that met bad input, and Interrupted on SIGINT, SIGTERM or SIGHUP, after
        all processes have ended."""
        runs = [self.folder.run(each) for each in values]
        self._todo = [run for run in runs if not run.is_done(self.program.options)]
        for run in self._todo:  # before any starts, so that one that another one ends is known, too
            run.status, run.reason = None, ""
        words = partial(self._words, len(self._todo))
        with _signals_noted() as stop:
            try:
                with shown(), task(words):
                    self._work(runs, stop)
            finally:  # whatever happens, no process is left
                self._end(stop)
        return runs

    def _work(self, runs, stop):
        room = self.room(runs)
        while self._todo or self._under_way:
            if stop:
                name = signal.Signals(stop[0]).name
                raise Interrupted(f"stopped by {name}; the same command goes on from there")
            while self._todo and len(self._under_way) < room:
                self._start(self._todo.pop(0))
            time.sleep(LOOK)
            for each in [each for each in self._under_way if each[1].poll() is not None]:
                self._under_way.remove(each)
                self._note(*each)
                room = self.room(runs)

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
            process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=subprocess.STDOUT,
                env=os.environ | RANKS_ENVIRONMENT,
                # Ctrl-C is for the sweep, which then asks its runs to end
                start_new_session=True,
            )
        self._under_way.append((run, process, time.monotonic()))

    def _note(self, run, process, began):
        """Note a run that has ended; raises InputError if it met bad input."""
        words = _last_words(run.folder / CONSOLE)
        if process.returncode == 2:
            raise InputError(f"run {run.label}: {words}")
        run.status = process.returncode
        run.reason = "" if run.is_believed() else _reason(run, words)
        if run.summary().get("reason", "").startswith("stopped by"):
            run.status = None  # by somebody else: the next call goes on with it
        run.save()
        print(_line(run, time.monotonic() - began), flush=True)

    def _words(self, count):
        """How many of the runs have ended, and which loads others have reached."""
        ended = count - len(self._todo) - len(self._under_way)
        loads = [f"{_load(run.folder / 'history.csv'):.0%}" for run, *_ in self._under_way[:]]
        return f"{ended} of {count} runs, others at {', '.join(loads) or '-'}"

    def _end(self, stop):
        """Ask what is under way to end, which it does after its step; a further signal ends it at
        once."""
        processes = [process for _, process, _ in self._under_way]
        self._under_way = []
        for process in processes:
            process.terminate()  # alone: it ends by itself what it has started
        if processes:
            count = len(processes)
            print(f"ending after their step: {count}; Ctrl-C again ends them at once", flush=True)
        asked = len(stop)
        while left := [process for process in processes if process.poll() is None]:
            if len(stop) > asked:
                asked = len(stop)
                for process in left:
                    with suppress(ProcessLookupError):
                        os.killpg(process.pid, signal.SIGKILL)  # with all that it has started
            time.sleep(LOOK)


@contextmanager
def _signals_noted() -> Iterator[list[int]]:
    """The signals to stop that came while this is open."""
    came: list[int] = []
    before = {each: signal.signal(each, lambda n, _: came.append(n)) for each in STOPS}
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
    try:
        with open(history, newline="") as file:
            return float([*csv.DictReader(file)][-1]["load"])
    except (OSError, ValueError, IndexError, KeyError, TypeError):
        return 0.0


def _last_words(console):
    """A run's sentence on how it ended, else the last line that it printed; libraries of MPI may
    print after it."""
    lines = re.split(r"[\r\n]+", console.read_text(errors="replace").strip())
    own = [line for line in lines if line.startswith(ENDS)]
    return re.sub(rf"^{ENDS}(error: |stopped: )?", "", (own or lines)[-1]) or "no words"


def _reason(run, words):
    """Reason why a run that ended is not believed."""
    if run.status < 0:
        name = signal.Signals(-run.status).name
        memory = " (as the system does when memory is short)" if name == "SIGKILL" else ""
        return f"ended by {name}{memory}"
    known = run.summary()
    ended_by_itself = run.status == 3 and not known.get("converged", True)
    return str(known.get("reason", words)) if ended_by_itself else words


def _line(run, seconds):
    """The line that tells of a run that ended."""
    known = run.summary()
    if not run.is_believed():
        reached = known.get("stroke_reached", 0)
        how = "not believed" if run.reason.startswith(NOT_BELIEVED) else "gave up"
        at = f" at load {rounded(reached)}" if reached < 1 else ""
        return f"{run.label}: {how}{at}: {run.reason.removeprefix(NOT_BELIEVED)}"
    force = known.get("reaction_N")
    told = "" if force is None else f", {known.get('reaction_is', 'force')} {force:.5g} N"
    return f"{run.label}: done in {seconds:.0f} s{told}"
