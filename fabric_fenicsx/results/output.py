"""The folder of a run: locked against other runs, with the run's messages, tables, summary and
report."""

import platform
import resource
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
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
from ..core.files import csv_text, lock_folder, plain, read_json, replace_file, write_json
from ..core.status import MARKED, LogFile, log
from ..core.version import __version__
from . import report
from .verdict import DOUBTFUL, OK, VERDICTS, Numbers, Reason

LIST = ".files.json"
# of what runs write into their folder and those of their parts
NAMES = (
    f"{LIST} summary.json history.csv checkpoint.npz log.txt report.html press.toml press_*.toml "
    "fields.pvd tools.pvd fields/[0-9]*.vt* tools/[0-9]*.vt* wrinkles*.vtu paths*.csv axis.csv "
    "curves.csv parameters.csv variants.csv metal*.png middle*.png between*.png springback.png "
    f"shear_force.png fig7.png {'*.png '.join(report.CAPTIONS)}*.png"
).split()


class OwnedFiles:
    """Files of a run in `folder` and in those of its `parts`, as its list has them. While it is
    under way, or after it was killed, and for a summary without a list, as earlier versions wrote
    it, these are all files that have one of the `NAMES`. inputs: files that a run reads, which it
    does not replace."""

    def __init__(self, folder: Path) -> None:
        known = read_json(folder / LIST)
        if not known and "fabric_fenicsx" in read_json(folder / "summary.json").get("versions", ()):
            known = {"parts": [""], "files": None}
        self.folder, self.inputs = folder, list[Path]()
        self.parts, self._listed = known.get("parts", []), known.get("files", [])

    def _present(self, *parts):
        """Files of parts that have one of the `NAMES`, whosever they are."""
        found = (f for part in parts for name in NAMES for f in (self.folder / part).glob(name))
        return {str(file.relative_to(self.folder)) for file in found if file.is_file()}

    def names(self, *endings: str) -> list[str]:
        """Files of the run, as seen from its folder, with these endings of their paths."""
        listed = [name for name in self._listed or () if (self.folder / name).is_file()]
        own = self._present(*self.parts) if self._listed is None else listed
        return sorted(each for each in own if each.endswith(endings or ("",)))

    def others(self, part: str, resume: bool) -> list[str]:
        """What a run of this part would replace and is not its own: files, inputs, other runs."""
        own = set(self.names())
        found = self._present("", part) - own
        if not resume:
            runs = (f for name in (LIST, "summary.json") for f in self.folder.glob(f"*/{name}"))
            found |= {each.parent.name for each in runs} - {*self.parts, part}
            found |= {name for name in own if (self.folder / name).resolve() in self.inputs}
        return sorted(found)

    def note(self, *parts: str, is_over: bool = False) -> None:
        """Write the list, of all files once the run is over; parts: those that begin."""
        self.parts = [*dict.fromkeys([*self.parts, *parts])]
        self._listed = self.names() if is_over else None
        write_json(self.folder / LIST, {"parts": self.parts, "files": self._listed})

    def remove(self) -> None:
        """Remove the files of the run, and folders that are then empty."""
        files = [self.folder / name for name in self.names()]
        for file in files:
            file.unlink()
        for folder in sorted({file.parent for file in files} - {self.folder}, reverse=True):
            with suppress(OSError):  # not empty
                folder.rmdir()
        self.parts = []


class Output:
    """Output folder `path` of a run called `name`, with a subfolder for each part of it. resume: go
    on with the results there; overwrite: lose them. command: what log.txt begins with; translated:
    function of a message to its text with parameters as the reader writes them. `facts` are what
    every summary of the run repeats; `is_quiet`: warnings are only for the summary."""

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
        self.translated, self.owned = translated, OwnedFiles(path)
        self.facts: dict[str, object] = {"command": command} if command else {}
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

    def remark(self, text: str) -> None:
        """Say it once, unless warnings are quiet, too."""
        if not self.is_quiet and text not in self._said:
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

    def folder(self, part: str = "", is_shown: bool = True) -> Path:
        """Make the folder, or its subfolder `part`, and return it; is_shown: the report tells of
        it. Raises InputError if it can't be written to, another run uses it, it holds what is not
        of a run of it, or results, and neither resume nor overwrite is set."""
        path = self.path / part
        on_root(self.comm, lambda: self._make(path, part))
        if is_shown and part not in self.parts:
            self.parts.append(part)
        return path

    def _make(self, path, part):
        """Make the folder and, the first time, lock it."""
        is_first = not self.parts
        if self.resume and is_first and not self.owned.names("checkpoint.npz"):
            flaw = f"`resume=True` finds no checkpoint in {path}"
            raise InputError(f"{flaw}; expected the `out` of an earlier run")
        if others := self.owned.others(part, self.resume):
            flaw = f"`out` {self.path} holds inputs, or files that no run of it wrote"
            raise InputError(f"{flaw}: {', '.join(others)}; expected another folder")
        try:
            path.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=path).close()
        except OSError as error:
            flaw = f"`out` {path} can't be written to ({error.strerror})"
            raise InputError(f"{flaw}; expected a folder that can be created") from None
        if not is_first:
            return self.owned.note(part)
        if not (lock := lock_folder(self.path)):
            allowed = "another folder, or wait until that run has ended"
            raise InputError(f"`out` {self.path} is in use by another run; expected {allowed}")
        self._open.enter_context(lock)
        old = self.owned.names("summary.json", "history.csv", "checkpoint.npz")
        if old and not (self.resume or self.overwrite):
            self._open.close()
            found = f"`out` {self.path} holds results ({old[0]})"
            allowed = "`resume=True` to continue, `overwrite=True` to delete them"
            raise InputError(f"{found}; expected another folder, {allowed}")
        if not self.resume:
            self.owned.remove()
        self.owned.note("", part)
        mode, command = "a" if self.resume else "w", str(self.facts.get("command", ""))
        handler = LogFile(self.path / "log.txt", mode, command)
        log.addHandler(handler)
        self._open.callback(handler.close)
        self._open.callback(log.removeHandler, handler)

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
        return self.amend(folder, plain(summary), **costs)

    def amend(self, folder: Path | None, summary: Numbers, **facts: Any) -> Numbers:
        """`summary` with `facts`, and with verdict and warnings of what was said since it was
        written, rewritten; what is said and taken from now on is of the next one."""
        reasons = [*summary.get("reasons", []), *(each._asdict() for each in self.reasons)]
        reasons.sort(key=lambda each: -VERDICTS.index(each["verdict"]))
        verdict = reasons[0]["verdict"] if reasons else OK
        warnings = [*summary.get("warnings", []), *self.warnings]
        judged = {"verdict": verdict, "reasons": reasons, "warnings": warnings}
        summary = {**summary, **judged, **plain(facts)}
        timing.taken()
        self._started, self.warnings, self.reasons = time.perf_counter(), [], []
        if folder and self.comm.rank == 0:
            write_json(folder / "summary.json", summary)
        return summary

    def report(self, description: str, ending: str, title: str = "") -> None:
        """Write report.html, and say the verdict of a run; ending: as of `report.page`."""
        if self.comm.rank != 0 or not self.parts:
            return
        folders = {part: self.path / part for part in ["", *self.parts]}
        runs = {part: (at / "summary.json", at.glob("*.png")) for part, at in folders.items()}
        page = report.page(title or self.name, runs, description, ending, self.path / "log.txt")
        replace_file(self.path / "report.html", page)
        if ending == "done" and runs[""][0].is_file():
            summary = read_json(runs[""][0])
            texts = (each["text"] for each in summary["reasons"] if each["verdict"] != OK)
            changes = dict.fromkeys(text.rpartition("; ")[2] for text in texts)
            self.say("; ".join([f"verdict: {summary['verdict']}", *changes]))
        self.close()

    def close(self) -> None:
        """List the files of the run, close the log and let other runs use the folder."""
        if self.parts and self.comm.rank == 0:
            self.owned.note(is_over=True)
        self._open.close()
