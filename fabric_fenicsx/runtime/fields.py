"""Which numbers a scenario allows: one rule for its Python fields and for its options."""

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


def number(
    default: float | None,
    rule: Rule,
    text: str,
    group: str = "test",
    doubt: tuple[float, str] | None = None,
) -> Any:
    """A field of a scenario: a number by `rule`; text: what it is, group: of options. None stands
    for a default that depends on other fields, which the text then tells. doubt: a value above
    which a run warns, and a hint at the unit."""
    meta = {"rule": rule, "help": text, "group": group, "doubt": doubt}
    return field(default=default, metadata=meta)


def choice(default: str | None, allowed: tuple[str, ...], text: str, group: str = "test") -> Any:
    """A field of a scenario: one of some words."""
    return field(default=default, metadata={"choices": allowed, "help": text, "group": group})


def switch(text: str, group: str = "test") -> Any:
    """A field of a scenario: off unless asked for."""
    return field(default=False, metadata={"switch": True, "help": text, "group": group})


def text(default: str | None, words: str, metavar: str, group: str = "test") -> Any:
    """A field of a scenario: a name, as of a file."""
    meta = {"metavar": metavar, "help": words, "group": group}
    return field(default=default, metadata=meta)
