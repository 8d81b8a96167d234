"""The folder of a run: locked against other runs, with the run's messages, tables, summary and
report."""

import json
import math
import platform
import resource
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import dolfinx
import numpy as np
import petsc4py
from mpi4py import MPI
from petsc4py import PETSc

from ..core import timing
from ..core.collective_errors import on_root
from ..core.errors import InputError
from ..core.files import csv_text, lock_folder, plain, replace_file
from ..core.logs import MARKED, LogFile, log
from ..core.version import __version__
from . import report
from .verdict import DOUBTFUL, OK, VERDICTS, Numbers, Reason


def finite(value: Any) -> Any:
    """The same, nested as it is, with None for numbers that JSON does not know."""
    if isinstance(value, Mapping):
        return {key: finite(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


class Output:
    """Output folder `path` of a run called `name`, with a subfolder for each part of it. resume: go
    on with the results there; overwrite: lose them. command: what log.txt begins with; translated:
    function of a message to its text with parameters as the reader writes them. `facts` are what
    every summary of the run repeats; `is_quiet`: warnings are only for the summary."""

    # the files by which a folder is known to hold results
    RESULTS = "summary.json", "history.csv", "checkpoint.npz"
    VERSIONS = {
        "fabric_fenicsx": __version__,
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
        "petsc4py": petsc4py.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }

    def __init__(
        self,
        name: str,
        path: Path,
        comm: MPI.Comm = MPI.COMM_WORLD,
        *,
        resume: bool = False,
        overwrite: bool = False,
        command: str = "",
        translated: Callable[[str], str] = str,
    ) -> None:
        self.name, self.path, self.comm = name, path, comm
        self.resume, self.overwrite = resume, overwrite
        self.command, self.translated = command, translated
        self.facts: dict[str, object] = {}
        self.parts: list[str] = []  # that were begun, "" for the folder itself
        self.is_quiet = False
        # since the last summary: remarks on what was given, and reasons of the verdict
        self.warnings: list[str] = []
        self.reasons: list[Reason] = []
        self._said = set[str]()
        self._open = ExitStack()  # the lock and the log, once the folder is made
        # with what was compiled and set up before, which `wall_s` has as well
        self._started = time.perf_counter() - sum(timing.seconds.values())

    def say(self, text: str) -> None:
        """Print on rank 0, and to log.txt."""
        if self.comm.rank == 0:
            log.info(text)

    def say_assumed(self, name: str, values: Mapping[str, str]) -> None:
        """Say which numbers {number: value} of the material `name` no test has determined, once,
        unless warnings are quiet, too."""
        numbers = ", ".join(f"{number} = {value}" for number, value in values.items())
        text = f"no test has determined these numbers of {name}: {numbers}"
        if values and not self.is_quiet and text not in self._said:
            self.say(text)
            self._said.add(text)

    def warn(self, text: str) -> None:
        """Print a text once, on rank 0, as `tell`; the summary repeats it."""
        text = self.tell(text)
        if text and text not in self.warnings:
            self.warnings.append(text)

    def doubt(self, reason: Reason) -> None:
        """As `warn`, a reason of the verdict; only one why it is doubtful is printed."""
        said = self.tell if reason.verdict == DOUBTFUL else self.translated
        reason = reason._replace(text=said(reason.text))
        if reason.text and reason not in self.reasons:
            self.reasons.append(reason)

    def tell(self, text: str) -> str:
        """Print once, on rank 0, what the user should look at; the text that is printed."""
        text = self.translated(text)
        if text and self.comm.rank == 0 and text not in self._said and not self.is_quiet:
            log.warning(text, extra=MARKED)
        self._said.add(text)
        return text

    def folder(self, part: str = "") -> Path:
        """Make the folder, or its subfolder `part`, and return it. Raises InputError if it can't be
        written to, another run uses it, or it holds results and neither resume nor overwrite is
        set."""
        path = self.path / part
        on_root(self.comm, lambda: self._make(path))
        if part not in self.parts:
            self.parts.append(part)
        return path

    def _make(self, path):
        """Make the folder and, the first time, lock it."""
        is_first = not self.parts
        if self.resume and is_first and "checkpoint.npz" not in {f.name for f in self._results()}:
            flaw = f"`resume=True` finds no checkpoint in {path}"
            raise InputError(f"{flaw}; allowed is the `out` of a run that was begun")
        try:
            path.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=path).close()
        except OSError as error:
            flaw = f"`out` {path} can't be written to ({error.strerror})"
            raise InputError(f"{flaw}; allowed is a folder that can be made") from None
        if not is_first:
            return
        if not (lock := lock_folder(self.path)):
            allowed = "another folder, or this one when that run has ended"
            raise InputError(f"`out` {self.path} is in use by another run; allowed is {allowed}")
        self._open.enter_context(lock)
        old = self._results()  # now that no other run adds to them
        if old and not (self.resume or self.overwrite):
            self.close()
            found = f"`out` {self.path} holds results ({old[0].relative_to(self.path)})"
            allowed = "`resume=True` to go on with them, `overwrite=True` to lose them"
            raise InputError(f"{found}; allowed is another folder, {allowed}")
        if self.overwrite:
            for file in (*old, *self.path.glob("*.png"), self.path / "report.html"):
                file.unlink(missing_ok=True)
        handler = LogFile(self.path / "log.txt", "a" if self.resume else "w", self.command)
        log.addHandler(handler)
        self._open.callback(handler.close)
        self._open.callback(log.removeHandler, handler)

    def _results(self):
        patterns = [under + name for name in self.RESULTS for under in ("", "*/")]
        return [file for pattern in patterns for file in self.path.glob(pattern)]

    def write_table(self, path: Path, rows: Sequence[Numbers]) -> None:
        """Write dicts to a CSV file, on rank 0, with a column for each of their keys."""
        if self.comm.rank == 0:
            replace_file(path, csv_text(rows))

    def summarise(self, folder: Path | None, **facts: Any) -> Numbers:
        """`facts` with verdict, costs, warnings and versions, written to summary.json."""
        wall = timing.taken() | {"total": time.perf_counter() - self._started}
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        if "reason" in facts:
            facts["reason"] = self.translated(facts["reason"])
        costs = {
            "wall_s": {name: round(seconds, 4) for name, seconds in wall.items()},
            "peak_memory_mib": round(self.comm.allreduce(peak, MPI.MAX), 1),
            "versions": self.VERSIONS,
        }
        summary = {"study": self.name, "ranks": self.comm.size} | facts | self.facts
        return self._write(folder, plain(summary) | self._judged([], []) | costs)

    def amend(self, folder: Path, summary: Numbers, **facts: Any) -> Numbers:
        """`summary` with `facts` and what was warned of since it was written, written anew."""
        judged = self._judged(summary.get("reasons", []), summary["warnings"])
        return self._write(folder, {**summary, **plain(facts), **judged})

    def _judged(self, reasons, warnings):
        """Entries of the summary with the verdict, after these reasons and warnings."""
        reasons = [*reasons, *(each._asdict() for each in self.reasons)]
        reasons.sort(key=lambda each: -VERDICTS.index(each["verdict"]))
        verdict = reasons[0]["verdict"] if reasons else OK
        return {"verdict": verdict, "reasons": reasons, "warnings": [*warnings, *self.warnings]}

    def _write(self, folder, summary):
        """The summary, written; what is said and taken from now on is of the next one."""
        timing.taken()
        self._started, self.warnings, self.reasons = time.perf_counter(), [], []
        if folder and self.comm.rank == 0:
            text = json.dumps(finite(summary), indent=2, allow_nan=False) + "\n"
            replace_file(folder / "summary.json", text)
        return summary

    def report(self, description: str, ending: str, title: str = "") -> None:
        """Write report.html of all that was written; ending: as of `report.page`."""
        if self.comm.rank != 0 or not self.parts:
            return
        folders = {part: self.path / part for part in ["", *self.parts]}
        runs = {part: (at / "summary.json", at.glob("*.png")) for part, at in folders.items()}
        page = report.page(title or self.name, runs, description, ending, self.path / "log.txt")
        replace_file(self.path / "report.html", page)

    def close(self) -> None:
        """Close the log and let other runs use the folder."""
        self._open.close()
