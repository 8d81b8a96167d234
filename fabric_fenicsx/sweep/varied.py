"""Values that a sweep gives to keys of a press file, and how a run of them is called."""

import hashlib
import math
import re
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from ..core.errors import InputError

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


def is_wide(numbers: Collection[float], times: float = 10.0) -> bool:
    """True for numbers above 0 that are so many times apart, which are shown and spread by
    logarithm."""
    return min(numbers) > 0 and max(numbers) / min(numbers) >= times * (1 - 1e-9)


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
            raise InputError(f"--vary {key}={text} is no range; {allowed}")
        found.append(Range(key, low, high))
    return found


def _by_key(words, form):
    """What stands behind each key of words."""
    texts: dict[str, str] = {}
    for word in words:
        key, equals, text = word.partition("=")
        if not (equals and re.fullmatch(r"[^.=]+(\.[^.=]+)*", key)):
            raise InputError(f"--vary {word} is no key with values; allowed is {form}")
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
    """The name of a run's folder: its values, in letters that all file systems take, so many at
    most."""
    plain = label(values).replace(", ", "_")
    name = re.sub(r"[^\w.=+-]+", "-", plain, flags=re.ASCII)
    if name == plain and len(name) <= longest:
        return name
    mark = hashlib.sha256(plain.encode()).hexdigest()[:6]  # as two values may look alike now
    return f"{name[:longest]}-{mark}"
