"""Runs of a sweep: the values that each gives to keys of a press file, and the folders that keep
them and the press, in sweep.json."""

import dataclasses
import hashlib
import json
import math
import re
import tomllib
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ..core.errors import InputError
from ..core.files import lock_folder, read_json, write_json
from ..core.rules import unknown_key
from ..results.output import OwnedFiles
from ..results.verdict import INVALID

REFINED = "finer", "finest"  # folders of a run's own runs on the cells that waves need
Values = Mapping[str, str]  # of a run {key: value as the press file would have it}


class Range(NamedTuple):
    """The numbers of `key` from `low` to `high`."""

    key: str
    low: float
    high: float

    def at(self, share: float) -> float:
        """The number at a share, 0 to 1, of the range or its logarithm, to six digits."""
        low, high = self.low, self.high
        wide = is_wide([low, high])
        value = low * (high / low) ** share if wide else low + share * (high - low)
        return min(max(float(f"{value:.6g}"), low), high)

    def share(self, value: float) -> float:
        """The share, as of `at`, at which a number is."""
        if is_wide([self.low, self.high]):
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


def is_wide(numbers: Collection[float]) -> bool:
    """True for numbers above 0 and tenfold apart, which are shown and spread by logarithm."""
    return min(numbers) > 0 and max(numbers) / min(numbers) >= 10 * (1 - 1e-9)


def number(text: str) -> float | None:
    """The number that a text is, or None."""
    try:
        return float(text)
    except ValueError:
        return None


def spelled(value: float) -> str:
    """A number as runs are known by: 0.05 for 0.050 and 5e-2."""
    return f"{value:.12g}"


def lists(words: Sequence[str]) -> dict[str, list[str]]:
    """The values {key: values} of words "KEY=VALUE,VALUE..."; values may be TOML's texts, lists
    and tables. InputError for words of another form."""
    values = {}
    # what stands between commas that are in no quotes or brackets
    closed = r"""'[^']*'|"[^"]*"|\[(?:[^][]|\[[^][]*\])*\]|\{[^{}]*\}"""
    between = re.compile(rf"""((?:[^,"'[{{]|{closed}|.)*?),""")
    for key, text in _by_key(words, "KEY=VALUE,VALUE...").items():
        parts = map(str.strip, between.findall(text + ","))
        values[key] = [*dict.fromkeys(p if number(p) is None else spelled(float(p)) for p in parts)]
    return values


def ranges(words: Sequence[str]) -> list[Range]:
    """The ranges of words "KEY=LOW..HIGH"; InputError for words of another form."""
    found = []
    for key, text in _by_key(words, "KEY=LOW..HIGH").items():
        low, high = map(number, text.partition("..")[::2])
        if low is None or high is None or not -math.inf < low < high < math.inf:
            allowed = "allowed with --scatter is KEY=LOW..HIGH with numbers, LOW below HIGH"
            raise InputError(f"--vary {key}={text} is not a range; {allowed}")
        found.append(Range(key, low, high))
    return found


def _by_key(words, form):
    """What stands behind each key of words."""
    texts: dict[str, str] = {}
    for word in words:
        key, equals, text = word.partition("=")
        if not (equals and re.fullmatch(r"[^.=]+(\.[^.=]+)*", key)):
            raise InputError(f"--vary {word} is not a key with values; expected {form}")
        texts[key] = f"{texts[key]},{text}" if key in texts else text
    return texts


def label(values: Values) -> str:
    """The values as a reader would write them, by as little of each key as tells them apart."""
    return ", ".join(f"{name}={values[key]}" for key, name in short_names(values).items())


def short_names(keys: Collection[str]) -> dict[str, str]:
    """{key: the last words of it that no other key ends in}."""
    names = {}
    for key in keys:
        words, others = key.split("."), [f".{other}" for other in keys if other != key]
        ends = [".".join(words[-n:]) for n in range(1, len(words) + 1)]
        unique = [e for e in ends if not any(other.endswith(f".{e}") for other in others)]
        names[key] = [*unique, key][0]
    return names


def folder_name(values: Values, longest: int = 120) -> str:
    """The name of a run's folder: its values, in letters that all file systems take."""
    plain = label(values).replace(", ", "_")
    name = re.sub(r"[^\w.=+-]+", "-", plain, flags=re.ASCII)
    if name == plain and len(name) <= longest:
        return name
    mark = hashlib.sha256(plain.encode()).hexdigest()[:6]  # as two values may look alike now
    return f"{name[:longest]}-{mark}"


@dataclasses.dataclass
class Run:
    """A run with its values, in `folder`. status: of its process when it ended by itself, None
    before; options: behind `--` when it was started; reason: why it is not valid, or ""."""

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
        return read_json(self.results / "summary.json")

    def save(self) -> None:
        state = {key: value for key, value in vars(self).items() if key != "folder"}
        write_json(self.folder / "run.json", state)

    def memory(self) -> float:
        """The most that it took on all of its ranks [MiB], 0 as long as that is not known."""
        return self.summary().get("peak_memory_mib", 0) * self.summary().get("ranks", 1)

    def is_valid(self) -> bool:
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
        """True for a run with results that ended by itself at full load, or with these options."""
        ended = self.is_at_full_load() or self.options == list(options)
        return bool(self.summary()) and (self.status == 0 or (self.status == 3 and ended))

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
        """The quantity `name`, nan where the run, or the quantity, is not valid."""
        return self.number(name) if self.is_valid() and not self.doubts(name) else math.nan


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
        self.state: dict = {"keys": list(keys), "press": made_of}
        before = read_json(path / "sweep.json")
        if not before and any(not each.name.startswith(".") for each in path.glob("*")):
            flaw = f"--out {path} holds files that no sweep wrote"
            raise InputError(f"{flaw}; expected a folder of a sweep, an empty or a new one")
        if before and not overwrite and (wrong := self._other(before, press.name)):
            allowed = "another --out, or --overwrite, which deletes the runs there"
            raise InputError(f"--out {path} has {wrong}; expected {allowed}")
        path.mkdir(parents=True, exist_ok=True)
        self._lock = None if shared else lock_folder(path)
        if not (shared or self._lock):
            raise InputError(f"--out {path} is in use by another sweep; use another folder")
        if overwrite:
            for folder in (file.parent for file in path.glob("*/run.json")):
                OwnedFiles(folder).remove()
                for name in ("run.json", "console.txt", ".lock"):
                    (folder / name).unlink(missing_ok=True)
                with suppress(OSError):  # a user's files are there
                    folder.rmdir()
            for name in "table.csv report.html curves.png maps.png trends.png".split():
                (path / name).unlink(missing_ok=True)
        runs = {file.parent: json.loads(file.read_text()) for file in path.glob("*/run.json")}
        self.runs = {folder.name: Run(folder=folder, **run) for folder, run in runs.items()}
        if overwrite or not before:
            self.save()

    def _other(self, before, press):
        """What sweep it was `before`, if it was another one than now; else ""."""
        now = self.state
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
        write_json(self.path / "sweep.json", self.state)

    def close(self) -> None:
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
