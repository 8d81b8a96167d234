"""Values or ranges of keys of a press file that a sweep varies, and the names of its runs."""

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..runtime.errors import InputError

WIDE = 10.0  # highest over lowest of numbers from which on they are shown and spread by logarithm
MAX_NAME = 120  # characters of a folder's name
Values = Mapping[str, str]  # of a run {key: value as the press file would have it}


class Range(NamedTuple):
    """The numbers of `key` from `low` to `high`."""

    key: str
    low: float
    high: float

    def at(self, share: float) -> float:
        """The number at a share, 0 to 1, of the range or its logarithm, to six digits."""
        low, high = self.low, self.high
        is_log = is_wide([low, high])
        value = low * (high / low) ** share if is_log else low + share * (high - low)
        return min(max(float(f"{value:.6g}"), low), high)

    def share(self, value: float) -> float:
        """The share, as of `at`, at which a number is."""
        if is_wide([self.low, self.high]):
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


def is_wide(numbers: Sequence[float]) -> bool:
    """True for numbers above 0 that are `WIDE` apart, which are shown and spread by logarithm."""
    return min(numbers) > 0 and max(numbers) / min(numbers) >= WIDE * (1 - 1e-9)


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
    and tables. InputError for words of another form and a key given twice."""
    values: dict[str, list[str]] = {}
    for word in words:
        key, text = _split(word, values, "KEY=VALUE,VALUE...")
        parts = [part if number(part) is None else spelled(float(part)) for part in _parts(text)]
        if not all(parts):
            raise InputError(f"--vary {word} has an empty value; allowed is KEY=VALUE,VALUE...")
        if any(None not in _ends(part) for part in parts):
            allowed = "one with --scatter, else KEY=VALUE,VALUE..."
            raise InputError(f"--vary {word} is a range; allowed is {allowed}")
        values[key] = list(dict.fromkeys(parts))
    return values


def ranges(words: Sequence[str]) -> list[Range]:
    """The ranges of words "KEY=LOW..HIGH"; InputError for words of another form."""
    ranges: dict[str, Range] = {}
    for word in words:
        key, text = _split(word, ranges, "KEY=LOW..HIGH")
        low, high = _ends(text)
        if low is None or high is None or not -math.inf < low < high < math.inf:
            allowed = "KEY=LOW..HIGH with numbers, LOW below HIGH"
            raise InputError(f"--vary {word} is no range; allowed with --scatter is {allowed}")
        ranges[key] = Range(key, low, high)
    return list(ranges.values())


def _split(word, before, form):
    key, equals, text = word.partition("=")
    if not (equals and re.fullmatch(r"[^.=]+(\.[^.=]+)*", key)):
        raise InputError(f"--vary {word} is no key with values; allowed is {form}")
    if key in before:
        raise InputError(f"--vary {key} is given twice; allowed is all of its values behind one")
    return key, text


def _ends(text):
    """Both numbers of "LOW..HIGH", None for what is no number."""
    low, _, high = text.partition("..")
    return number(low), number(high)


def _parts(text):
    """The parts of a text between commas that stand in no quotes or brackets."""
    closed = r"""'[^']*'|"[^"]*"|\[(?:[^][]|\[[^][]*\])*\]|\{[^{}]*\}"""
    parts = re.findall(rf"""((?:[^,"'[{{]|{closed}|.)*?),""", text + ",")
    return [part.strip() for part in parts]


def changes(values: Values) -> list[str]:
    """The values of a run as `fabric form --set` takes them."""
    return [f"{key}={value}" for key, value in values.items()]


def label(values: Values) -> str:
    """The values as a reader would write them, by as little of each key as tells them apart."""
    return ", ".join(f"{name}={values[key]}" for key, name in short_names(values).items())


def short_names(keys: Sequence[str] | Values) -> dict[str, str]:
    """{key: the last words of it that no other key ends in}."""
    names = {}
    for key in keys:
        words = key.split(".")
        ends = (".".join(words[-n:]) for n in range(1, len(words) + 1))
        others = [f".{other}" for other in keys if other != key]
        names[key] = next(
            (end for end in ends if not any(other.endswith(f".{end}") for other in others)), key
        )
    return names


def folder_name(values: Values) -> str:
    """The name of a run's folder: its values, in letters that all file systems take."""
    plain = label(values).replace(", ", "_")
    name = re.sub(r"[^\w.=+-]+", "-", plain, flags=re.ASCII)
    if name == plain and len(name) <= MAX_NAME:
        return name
    mark = hashlib.sha256(plain.encode()).hexdigest()[:6]  # as two values may look alike now
    return f"{name[:MAX_NAME]}-{mark}"
