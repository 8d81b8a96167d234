"""Checks of numbers and names that users give."""

import difflib
import math
from collections.abc import Callable, Iterable
from numbers import Real
from reprlib import repr as shown
from typing import Any, NamedTuple

from ..runtime.errors import InputError


class Rule(NamedTuple):
    """What a number may be: its kind of unit, "" for a pure number, and the values allowed."""

    kind: str
    allowed: str
    test: Callable[[float], bool]


def above_zero(kind: str = "") -> Rule:
    """The rule for a number above 0."""
    return Rule(kind, "above 0", lambda v: v > 0)


def not_negative(kind: str = "") -> Rule:
    """The rule for a number of 0 or above."""
    return Rule(kind, "at least 0", lambda v: v >= 0)


def of_either_sign(kind: str = "") -> Rule:
    """The rule for any number."""
    return Rule(kind, "of either sign", lambda v: True)


def fraction() -> Rule:
    """The rule for a pure number from 0 to 1."""
    return Rule("", "from 0 to 1", lambda v: 0 <= v <= 1)


def check_number(rule: Rule, value: Any, label: str) -> float:
    """`value` as a float if `rule` allows it; otherwise an InputError that calls it `label`."""
    if isinstance(value, Real) and not isinstance(value, bool):
        try:
            number = float(value) + 0.0  # -0.0 becomes 0.0
        except OverflowError:
            number = math.inf
        if math.isfinite(number) and rule.test(number):
            return number
    raise InputError(f"{label} is {shown(value)}; allowed is a finite number, {rule.allowed}")


def unknown_key(key: object, allowed: Iterable[str], label: str) -> InputError:
    """The error for a key that is not among those allowed; it names the nearest."""
    allowed = list(allowed)
    near = difflib.get_close_matches(str(key), allowed, n=1)
    hint = f" (did you mean {near[0]}?)" if near else ""
    return InputError(f"{label} is unknown{hint}; allowed are {', '.join(allowed)}")


def check_complete(found: Iterable[str], names: Iterable[str], where: str, place: str) -> None:
    """InputError if one of the `names` was not found; where: what stands before them in a message,
    place: where they must be given."""
    if missing := [where + name for name in names if name not in found]:
        raise InputError(f"missing {', '.join(missing)}; allowed is to give all, {place}")
