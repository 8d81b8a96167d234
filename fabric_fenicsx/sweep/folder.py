"""The folder of a sweep: its press, in sweep.json, and the folder of each run."""

import dataclasses
import hashlib
import json
import math
import re
import shutil
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..results.verdict import INVALID
from ..runtime.errors import InputError
from ..runtime.files import lock_folder, plain, read_summary, replace_file
from ..runtime.rules import did_you_mean
from .varied import Values, folder_name, label

STATE, RUN = "sweep.json", "run.json"  # in the folder of a sweep, and in that of each run
FORMAT = 2  # of sweep.json; another one is refused
REFINED = "finer", "finest"  # folders of a run's own runs on the cells that waves need
ALWAYS = "reaction_N", "stroke_reached"  # numbers of every run
OWN = STATE, "table.csv", "report.html", "curves.png", "maps.png", "trends.png"


@dataclasses.dataclass
class Run:
    """A run with its values, in `folder`. status: of its process when it ended by itself, None
    before; options: behind `--` when it was started; reason: why it is not believed, or ""."""

    values: Values
    folder: Path
    status: int | None = None
    options: list[str] = dataclasses.field(default_factory=list)
    reason: str = ""

    @property
    def label(self) -> str:
        """Its values, as a reader would write them."""
        return label(self.values)

    @property
    def results(self) -> Path:
        """The folder of its results: with `--refine` of those on the finest cells."""
        finer = [self.folder / name for name in REFINED if "--refine" in self.options]
        return [self.folder, *(each for each in finer if (each / "summary.json").is_file())][-1]

    def summary(self) -> dict[str, Any]:
        """The summary.json of its results, {} if there is none yet."""
        return read_summary(self.results / "summary.json")

    def save(self) -> None:
        """Write run.json into its folder."""
        state = {key: value for key, value in vars(self).items() if key != "folder"}
        replace_file(self.folder / RUN, json.dumps(plain(state), indent=2) + "\n")

    def memory(self) -> float:
        """The most that it took on all of its ranks [MiB], 0 as long as that is not known."""
        summary = self.summary()
        return summary.get("peak_memory_mib", 0) * summary.get("ranks", 1)

    def is_believed(self) -> bool:
        """True once its process ended well and its result is not invalid."""
        return self.verdict() not in ("", INVALID)

    def verdict(self) -> str:
        """That of its summary, of a run that did not end well "invalid"; "" without a summary."""
        verdict = str(self.summary().get("verdict", ""))
        return verdict and (verdict if self.status == 0 else INVALID)

    def doubts(self, quantity: str = "") -> list[str]:
        """Doubts about its result, or those that are about this quantity alone."""
        reasons = self.summary().get("reasons", ())
        return [r["text"] for r in reasons if not quantity or (r["of"] and r["of"] in quantity)]

    def is_at_full_load(self) -> bool:
        """True once it reached the load, believed or not."""
        return self.summary().get("stroke_reached", 0) >= 1

    def is_done(self, options: Sequence[str]) -> bool:
        """True for a run that ended by itself at full load, or with these options."""
        ended = self.is_at_full_load() or self.options == list(options)
        return self.status == 0 or (self.status == 3 and ended)

    def numbers(self) -> dict[str, float]:
        """Its quantities that are one number {name with dots: number}, nan without a value."""
        if not (summary := self.summary()):
            return {}
        first = {name: summary.get(name) for name in ALWAYS}
        first["wall_s"] = summary.get("wall_s", {}).get("total")
        return flat(first | summary.get("quantities", {}))

    def number(self, name: str) -> float:
        """The quantity `name`; InputError, which names the nearest, if it is not there."""
        numbers = self.numbers()
        check_quantity(name, numbers, f"not in the summary of {self.folder}")
        return numbers[name]

    def value(self, name: str) -> float:
        """The quantity `name`, nan where the run, or the quantity, is not believed."""
        return self.number(name) if self.is_believed() and not self.doubts(name) else math.nan


@contextmanager
def _readable(file):
    """InputError for what else than a sweep's JSON the file is, while it is read."""
    try:
        yield
    except (OSError, ValueError, TypeError, KeyError) as error:
        flaw = f"{file} can't be read ({type(error).__name__}: {error})"
        raise InputError(f"{flaw}; allowed is one that a sweep wrote") from None


def force_name(runs: Sequence[Run]) -> str:
    """Name of the runs' force, if it is the same in all, else "force"."""
    names = {run.summary().get("reaction_is", "force") for run in runs if run.summary()}
    return names.pop() if len(names) == 1 else "force"


def check_quantity(name: str, names: Iterable[str], where: str) -> None:
    """InputError, which names the nearest, for a quantity that is none of `names`, but `where`."""
    if name not in names:
        hint, allowed = did_you_mean(name, names), ", ".join(names)
        raise InputError(f"quantity {name} is {where}{hint}; allowed is one of {allowed}")


def flat(values: Mapping[str, Any], before: str = "") -> dict[str, float]:
    """What is one number in nested dicts, {name with dots: number}; nan for None."""
    numbers: dict[str, float] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            numbers |= flat(value, f"{before}{name}.")
        elif value is None:
            numbers[f"{before}{name}"] = math.nan
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            numbers[f"{before}{name}"] = value
    return numbers


class SweepFolder:
    """The folder `path` of a sweep of the press file `press` over `keys`, locked while it is open
    unless it is `shared` with processes that do other runs. runs: {folder's name: Run}, with those
    of earlier calls; facts: what else sweep.json keeps. Raises InputError, before anything is
    written, if it is another sweep's or press's (`overwrite` loses that), or if it holds what no
    sweep wrote, or is in use."""

    def __init__(
        self,
        path: Path,
        press: Path,
        keys: Sequence[str],
        overwrite: bool = False,
        shared: bool = False,
    ) -> None:
        self.path, self.keys, text = path, list(keys), press.read_text()
        self.title = str(tomllib.loads(text).get("title", press.name))
        self.press: dict[str, Any] = {"text": text, "files": _files_of(press, text)}
        self.facts: dict[str, Any] = {}
        state = self._known()
        if state and not overwrite:
            self._refuse_another(state, press)
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._lock = None if shared else lock_folder(path)
        except OSError as error:
            flaw = f"can't be written to ({error.strerror})"
            raise InputError(f"--out {path} {flaw}; allowed is a folder that can be made") from None
        if not (shared or self._lock):
            raise InputError(f"--out {path} is in use by another sweep; allowed is another folder")
        self.runs = dict[str, Run]()
        for file in path.glob(f"*/{RUN}"):
            with _readable(file):
                run = Run(folder=file.parent, **json.loads(file.read_text()))
            self.runs[run.folder.name] = run
        if overwrite:
            for run in self.runs.values():
                shutil.rmtree(run.folder, ignore_errors=True)
            self.runs.clear()
            for name in OWN:
                (path / name).unlink(missing_ok=True)
        if overwrite or not state:
            self.save()

    def _known(self):
        """Content of sweep.json, {} where the folder is empty."""
        file = self.path / STATE
        if not file.exists():
            if any(not each.name.startswith(".") for each in self.path.glob("*")):
                flaw = f"--out {self.path} holds files that no sweep wrote"
                raise InputError(f"{flaw}; allowed is a folder of a sweep, an empty or a new one")
            return {}
        with _readable(file):
            state = json.loads(file.read_text())
            if state["format"] != FORMAT:
                raise ValueError("another format")
            return state

    def _refuse_another(self, state, press):
        """InputError if the `state` is of another press or varies other keys."""
        if state["press"] != self.press:
            files, now = ({"": p["text"], **p["files"]} for p in (state["press"], self.press))
            changed = next(name for name in {**files, **now} if files.get(name) != now.get(name))
            wrong = f"runs of another press ({changed or press} has changed since)"
        elif state["keys"] != self.keys:
            wrong = f"a sweep over {', '.join(state['keys'])}, now it is {', '.join(self.keys)}"
        else:
            return
        allowed = "another --out, or --overwrite, which loses the runs there"
        raise InputError(f"--out {self.path} has {wrong}; allowed is {allowed}")

    def run(self, values: Values) -> Run:
        """The run with these values, one of before or new."""
        name = folder_name(values)
        return self.runs.setdefault(name, Run(dict(values), self.path / name))

    def save(self) -> None:
        """Write sweep.json."""
        state = {"format": FORMAT, "keys": self.keys, **self.facts, "press": self.press}
        replace_file(self.path / STATE, json.dumps(plain(state), indent=2) + "\n")

    def close(self) -> None:
        """Let others use the folder."""
        if self._lock:
            self._lock.close()


def _files_of(press, text):
    """Checksums {name: ..} of files that a press names, beside it or in the present folder."""
    checksums = {}
    for name in map("".join, re.findall(r"""'([^'\n]+)'|"([^"\n]+)\"""", text)):
        for file in (Path(name), press.parent / name):  # the latter counts
            with suppress(OSError):  # no file
                checksums[name] = hashlib.sha256(file.read_bytes()).hexdigest()
    return checksums
