"""Declared fields of dataclasses: one rule for what Python and the command line may give."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from .errors import InputError


@dataclass(frozen=True)
class Rule:
    """Finite numbers of one `kind` that pass `test`, in words `allowed`."""

    allowed: str
    test: Callable[[Any], bool]
    kind: type = float

    def check(self, name: str, value: Any) -> Any:
        """`value` as `kind`; InputError, which calls it `name`, if the rule does not allow it."""
        try:
            number = self.kind(value)
            good = math.isfinite(number) and self.test(number) and number == float(value)
            good = good and not isinstance(value, bool)
        except (TypeError, ValueError, OverflowError):
            good = False
        if not good:
            raise InputError(f"{name} is {value}; allowed is {self.allowed}")
        return number


FRACTION = Rule("a fraction above 0 and up to 1, where 0.1 is 10 %", lambda v: 0 < v <= 1)
COUNT = Rule("a whole number of 1 or more", lambda v: v >= 1, int)
POSITIVE = Rule("a number above 0", lambda v: v > 0)
FROM_ZERO = Rule("a number from 0", lambda v: v >= 0)
BETWEEN_YARNS = Rule("an angle above 0 and below 180 deg", lambda v: 0 < v < 180)
FINITE = Rule("a finite number", lambda v: True)


def declared(owner: Any) -> list[dataclasses.Field]:
    """The fields of a dataclass or an object of one that have a help text, so an option."""
    return [each for each in dataclasses.fields(owner) if "help" in each.metadata]


def check_fields(owner: Any, label: Callable[[str], str] = "`{}`".format) -> list[str]:
    """Give the declared fields of a dataclass object the kind of number that their rules ask for;
    sentences on values that are doubtful. label: what messages call a field of that name. Raises
    InputError for a value that is not allowed."""
    doubts = []
    for each in dataclasses.fields(owner):
        value, meta = getattr(owner, each.name), each.metadata
        if value is None:
            continue
        if "rule" in meta:
            value = meta["rule"].check(label(each.name), value)
            object.__setattr__(owner, each.name, value)
            most, hint = meta["doubt"] or (math.inf, "")
            if value > most:
                doubts.append(f"{label(each.name)} is {value:g}, which is much: {hint}")
        if value not in meta.get("choices", (value,)):
            allowed = ", ".join(meta["choices"])
            raise InputError(f"{label(each.name)} is {value!r}; allowed is one of {allowed}")
    return doubts


def number(
    default: float | None,
    rule: Rule,
    text: str,
    group: str = "test",
    doubt: tuple[float, str] | None = None,
) -> Any:
    """A field: a number by `rule`; text: what it is, group: of options. None stands
    for a default that depends on other fields, which the text then tells. doubt: a value above
    which a run warns, and a hint at the unit."""
    meta = {"rule": rule, "help": text, "group": group, "doubt": doubt}
    return field(default=default, metadata=meta)


def choice(default: str | None, allowed: tuple[str, ...], text: str, group: str = "test") -> Any:
    """A field: one of some words."""
    return field(default=default, metadata={"choices": allowed, "help": text, "group": group})


def switch(text: str, group: str = "test") -> Any:
    """A field: off unless asked for."""
    return field(default=False, metadata={"switch": True, "help": text, "group": group})


def text(default: str | None, words: str, metavar: str, group: str = "test") -> Any:
    """A field: a name, as of a file."""
    meta = {"metavar": metavar, "help": words, "group": group}
    return field(default=default, metadata=meta)
