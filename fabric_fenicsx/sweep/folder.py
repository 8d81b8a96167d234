"""The folder of a sweep: its press, in sweep.json, and the folder of each run."""

import dataclasses
import hashlib
import json
import math
import re
import shutil
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from ..core.errors import InputError
from ..core.files import lock_folder, read_summary, write_json
from ..core.rules import unknown_key
from ..results.verdict import INVALID
from .varied import Values, folder_name, label

REFINED = "finer", "finest"  # folders of a run's own runs on the cells that waves need


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
        return label(self.values)

    @property
    def results(self) -> Path:
        """The folder of its results: with `--refine` of those on the finest cells."""
        finer = [self.folder / name for name in REFINED if "--refine" in self.options]
        return [self.folder, *(each for each in finer if (each / "summary.json").is_file())][-1]

    def summary(self) -> dict:
        return read_summary(self.results / "summary.json")

    def save(self) -> None:
        state = {key: value for key, value in vars(self).items() if key != "folder"}
        write_json(self.folder / "run.json", state)

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
        return self.summary().get("stroke_reached", 0) >= 1

    def is_done(self, options: Sequence[str]) -> bool:
        """True for a run that ended by itself at full load, or with these options."""
        ended = self.is_at_full_load() or self.options == list(options)
        return self.status == 0 or (self.status == 3 and ended)

    def numbers(self) -> dict[str, float]:
        """Its quantities that are one number {name with dots: number}, nan without a value."""
        if not (summary := self.summary()):
            return {}
        first = {name: summary.get(name) for name in ("reaction_N", "stroke_reached")}
        first["wall_s"] = summary.get("wall_s", {}).get("total")
        return flat(first | summary.get("quantities", {}))

    def number(self, name: str) -> float:
        """The quantity `name`; InputError, which names the nearest, if it is not there."""
        if name not in (numbers := self.numbers()):
            raise unknown_key(name, numbers, f"quantity {name} of {self.folder}")
        return numbers[name]

    def value(self, name: str) -> float:
        """The quantity `name`, nan where the run, or the quantity, is not believed."""
        return self.number(name) if self.is_believed() and not self.doubts(name) else math.nan


def force_name(runs: Iterable[Run]) -> str:
    """Name of the runs' force, if it is the same in all, else "force"."""
    names = {run.summary().get("reaction_is", "force") for run in runs if run.summary()}
    return names.pop() if len(names) == 1 else "force"


def flat(values: Mapping[str, object], before: str = "") -> dict[str, float]:
    """What is one number in nested dicts, {name with dots: number}; nan for None."""
    numbers: dict[str, float] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            numbers |= flat(value, f"{before}{name}.")
        elif value is None or (isinstance(value, (int, float)) and not isinstance(value, bool)):
            numbers[f"{before}{name}"] = math.nan if value is None else value
    return numbers


class SweepFolder:
    """The folder `path` of a sweep of the press file `press` over `keys`, locked while it is open
    unless it is `shared` with processes that do other runs. runs: {folder's name: Run}, with those
    of earlier calls; state: the content of sweep.json. Raises InputError, before anything is
    written, if it is another sweep's or press's (`overwrite` loses that), or if it holds what no
    sweep wrote, or is in use; OSError if it can't be written to."""

    def __init__(
        self, path: Path, press: Path, keys: Sequence[str], overwrite: bool, shared: bool
    ) -> None:
        text = press.read_text()
        self.path, self.title = path, str(tomllib.loads(text).get("title", press.name))
        made_of = {"text": text, "files": _files_of(press, text)}
        self.state: dict = {"format": 2, "keys": list(keys), "press": made_of}
        before = read_summary(path / "sweep.json")
        if not before and any(not each.name.startswith(".") for each in path.glob("*")):
            flaw = f"--out {path} holds files that no sweep wrote"
            raise InputError(f"{flaw}; allowed is a folder of a sweep, an empty or a new one")
        if before and not overwrite and (wrong := self._other(before, press.name)):
            allowed = "another --out, or --overwrite, which loses the runs there"
            raise InputError(f"--out {path} has {wrong}; allowed is {allowed}")
        path.mkdir(parents=True, exist_ok=True)
        self._lock = None if shared else lock_folder(path)
        if not (shared or self._lock):
            raise InputError(f"--out {path} is in use by another sweep; allowed is another folder")
        if overwrite:
            for file in path.glob("*/run.json"):
                shutil.rmtree(file.parent)
            for name in "table.csv report.html curves.png maps.png trends.png".split():
                (path / name).unlink(missing_ok=True)
        runs = {file.parent: json.loads(file.read_text()) for file in path.glob("*/run.json")}
        self.runs = {folder.name: Run(folder=folder, **run) for folder, run in runs.items()}
        if overwrite or not before:
            self.save()

    def _other(self, before, press):
        """What sweep it was `before`, if it was another one than now; else ""."""
        now = self.state
        if before["format"] != now["format"]:
            return "a sweep of another version of this program"
        old, new = ({press: s["press"]["text"], **s["press"]["files"]} for s in (before, now))
        for name, _ in old.items() ^ new.items():
            return f"runs of another press ({name} has changed since)"
        keys = f"{', '.join(before['keys'])}, now it is {', '.join(now['keys'])}"
        return f"a sweep over {keys}" if before["keys"] != now["keys"] else ""

    def run(self, values: Values) -> Run:
        """The run with these values, one of before or new."""
        name = folder_name(values)
        return self.runs.setdefault(name, Run(dict(values), self.path / name))

    def save(self) -> None:
        """Write sweep.json."""
        write_json(self.path / "sweep.json", self.state)

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
