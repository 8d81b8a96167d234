"""Which numbers and names a user may give: one kind of rule for laws, tools, options and fields."""

import difflib
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from numbers import Real
from reprlib import repr as shown
from typing import Any

from .errors import InputError


@dataclass(frozen=True)
class Rule:
    """Finite numbers that pass `test`, in words `allowed`. kind: int for whole numbers; unit: kind
    of unit that a material file gives the number in, "" for a pure number."""

    allowed: str
    test: Callable[[Any], bool] = lambda v: True
    kind: type = float
    unit: str = ""

    def check(self, name: str, value: Any) -> Any:
        """`value` as `kind`; InputError, which calls it `name`, if the rule does not allow it."""
        if isinstance(value, Real) and not isinstance(value, bool):
            try:
                number = self.kind(value) + self.kind(0)  # -0.0 becomes 0.0
                if math.isfinite(number) and number == value and self.test(number):
                    return number
            except (
                ValueError,
                OverflowError,
            ):  # whole numbers of what is not finite, and huge ones
                pass
        raise InputError(f"{name} is {shown(value)}; allowed is {self.allowed}")


def above_zero(unit: str = "") -> Rule:
    """The rule for a number above 0."""
    return Rule("a number above 0", lambda v: v > 0, unit=unit)


def not_negative(unit: str = "") -> Rule:
    """The rule for a number of 0 or above."""
    return Rule("a number from 0", lambda v: v >= 0, unit=unit)


def of_either_sign(unit: str = "") -> Rule:
    """The rule for any number."""
    return Rule("a finite number", unit=unit)


def fraction() -> Rule:
    """The rule for a pure number from 0 to 1."""
    return Rule("a number from 0 to 1", lambda v: 0 <= v <= 1)


POSITIVE, FROM_ZERO, FINITE = above_zero(), not_negative(), of_either_sign()
COUNT = Rule("a whole number of 1 or more", lambda v: v >= 1, int)
SHARE = Rule("a fraction above 0 and up to 1, where 0.1 is 10 %", lambda v: 0 < v <= 1)
BELOW_180 = Rule("an angle above 0 and below 180 deg", lambda v: 0 < v < 180)


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
