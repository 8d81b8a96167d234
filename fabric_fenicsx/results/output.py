"""The folder of a run: locked against other runs, with the run's messages, tables, summary and
report."""

import csv
import json
import math
import platform
import resource
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import dolfinx
import numpy as np
import petsc4py
from mpi4py import MPI
from petsc4py import PETSc

from ..runtime import timing
from ..runtime.collective_errors import on_root
from ..runtime.errors import InputError
from ..runtime.files import lock_folder, plain, replace_file
from ..runtime.formatting import rounded
from ..runtime.logs import MARKED, LogFile, log
from ..runtime.version import __version__
from .verdict import INVALID, OK, Reason

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
    every summary of the run repeats."""

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
        self.facts: dict[str, Any] = {}
        self.parts: list[str] = []
        self.is_kept = True  # otherwise only while the run lasts
        self.is_quiet = False  # whether warnings are only for the summary
        self.begun = False
        # with what was compiled and set up before, which `wall_s` has as well
        self._started = time.perf_counter() - sum(timing.seconds.values())
        # since the last summary: remarks on what was given, and reasons of the verdict
        self.warnings: list[str] = []
        self.reasons: list[Reason] = []
        self._warned: set[str] = set()
        self._said: set[tuple[str, str]] = set()  # assumed numbers
        self._lock: IO | None = None
        self._log: LogFile | None = None

    def say(self, text: str) -> None:
        """Print on rank 0, and to log.txt."""
        if self.comm.rank == 0:
            log.info(text)

    def say_assumed(self, name: str, values: Mapping[str, str]) -> None:
        """Say which numbers {number: value} of the material `name` no test has determined, each
        once, unless warnings are quiet, too."""
        new = [f"{k} = {value}" for k, value in values.items() if (name, k) not in self._said]
        self._said |= {(name, k) for k in values}
        if new and not self.is_quiet:
            self.say(f"no test has determined these numbers of {name}: {', '.join(new)}")

    def warn(self, text: str) -> None:
        """Print a text once, on rank 0, as `tell`; the summary repeats it."""
        text = self.tell(text)
        if text and text not in self.warnings:
            self.warnings.append(text)

    def doubt(self, reason: Reason) -> None:
        """As `warn`, a reason of the verdict; one why it is invalid is not printed."""
        said = self.translated if reason.verdict == INVALID else self.tell
        reason = reason._replace(text=said(reason.text))
        if reason.text and reason not in self.reasons:
            self.reasons.append(reason)

    def tell(self, text: str) -> str:
        """Print once, on rank 0, what the user should look at; the text that is printed."""
        text = self.translated(text)
        if text and self.comm.rank == 0 and text not in self._warned and not self.is_quiet:
            log.warning(text, extra=MARKED)
        self._warned.add(text)
        return text

    def folder(self, part: str = "") -> Path:
        """Make the folder, or its subfolder `part`, and return it. Raises InputError if it can't be
        written to, another run uses it, or it holds results and neither resume nor overwrite is
        set."""
        path = self.path / part
        on_root(self.comm, lambda: self._make(path))
        self.begun = True
        if part and part not in self.parts:
            self.parts.append(part)
        return path

    def _make(self, path):
        """Make the folder and, the first time, lock it."""
        resumable = any(file.name == "checkpoint.npz" for file in self._results())
        if self.resume and not (self._lock or resumable):
            flaw = f"`resume=True` finds no checkpoint in {path}"
            raise InputError(f"{flaw}; allowed is the `out` of a run that was begun")
        try:
            path.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=path).close()
            if self._lock:
                return
            self._lock = lock_folder(self.path)
        except OSError as error:
            flaw = f"`out` {path} can't be written to ({error.strerror})"
            raise InputError(f"{flaw}; allowed is a folder that can be made") from None
        if not self._lock:
            allowed = "another folder, or this one when that run has ended"
            raise InputError(f"`out` {self.path} is in use by another run; allowed is {allowed}")
        old = self._results()  # now that no other run adds to them
        if old and not (self.resume or self.overwrite):
            self.close()
            found = f"`out` {self.path} holds results ({old[0].relative_to(self.path)})"
            allowed = "`resume=True` to go on with them, `overwrite=True` to lose them"
            raise InputError(f"{found}; allowed is another folder, {allowed}")
        if self.overwrite:
            for file in (*old, *self.path.glob("*.png"), self.path / "report.html"):
                file.unlink(missing_ok=True)
        self._log = LogFile(self.path / "log.txt", "a" if self.resume else "w", self.command)
        log.addHandler(self._log)

    def _results(self):
        """Files in the folder by which it is known to hold results."""
        return [
            f for name in RESULTS for f in (*self.path.glob(name), *self.path.glob(f"*/{name}"))
        ]

    def where(self, folder: Path, load: float) -> str:
        """Text that tells up to which load there are results, and if they are kept, where."""
        end = f"; the run ends at load factor {rounded(load, 6)}" if load < 1 else ""
        return f"{end}; the results are in {folder}" if self.is_kept else end

    def write_table(self, path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write dicts to a CSV file, on rank 0, with a column for each of their keys."""
        if self.comm.rank == 0:
            with open(path, "w", newline="") as file:
                writer = csv.DictWriter(file, dict.fromkeys(key for row in rows for key in row))
                writer.writeheader()
                writer.writerows(rows)

    def summarise(self, folder: Path | None, **facts: Any) -> dict[str, Any]:
        """`facts` with verdict, costs, warnings and versions, written to summary.json."""
        total = time.perf_counter() - self._started
        wall = {name: round(seconds, 4) for name, seconds in timing.taken().items()}
        self._started = time.perf_counter()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        if "reason" in facts:
            facts["reason"] = self.translated(facts["reason"])
        summary = {"study": self.name, "ranks": self.comm.size} | facts | self.facts
        summary = plain(summary) | {
            **self._verdict(),
            "warnings": self.warnings,
            "wall_s": wall | {"total": round(total, 4)},
            "peak_memory_mib": round(self.comm.allreduce(peak, MPI.MAX), 1),
            "versions": VERSIONS,
        }
        self.warnings, self.reasons = [], []
        self._write_summary(folder, summary)
        return summary

    def _verdict(self, before=()):
        """Entries of the summary; before: reasons that it had."""
        reasons = [*before, *(each._asdict() for each in self.reasons)]
        reasons.sort(key=lambda each: each["verdict"] != INVALID)
        return {"verdict": reasons[0]["verdict"] if reasons else OK, "reasons": reasons}

    def amend(self, folder: Path, summary: Mapping[str, Any], **facts: Any) -> dict[str, Any]:
        """`summary` with `facts` and what was warned of since it was written, written anew."""
        warnings = [*summary["warnings"], *self.warnings]
        verdict = self._verdict(summary.get("reasons", ()))
        amended = {**summary, **plain(facts), **verdict, "warnings": warnings}
        timing.taken()
        self._started, self.warnings, self.reasons = time.perf_counter(), [], []
        self._write_summary(folder, amended)
        return amended

    def _write_summary(self, folder, summary):
        if folder and self.comm.rank == 0:
            text = json.dumps(finite(summary), indent=2, allow_nan=False) + "\n"
            replace_file(folder / "summary.json", text)

    def report(self, description: str, ending: str, title: str = "") -> None:
        """Write report.html of all that was written; ending: as of `report.page`."""
        if self.comm.rank != 0 or not self.begun:
            return
        from . import report

        parts = {part: self.path / part for part in ("", *self.parts)}
        runs = {part: (at / "summary.json", at.glob("*.png")) for part, at in parts.items()}
        page = report.page(title or self.name, runs, description, ending, self.path / "log.txt")
        replace_file(self.path / "report.html", page)

    def close(self) -> None:
        """Close the log and let other runs use the folder."""
        if self._log:
            log.removeHandler(self._log)
            self._log.close()
        if self._lock:
            self._lock.close()
        self._log = self._lock = None
