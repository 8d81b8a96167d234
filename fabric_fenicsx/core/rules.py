"""Rules for numbers and names that a user gives, to laws, tools, options and fields alike."""

import difflib
import math
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from numbers import Real
from reprlib import repr as repr_short
from typing import Any

from .errors import InputError


@dataclass(frozen=True)
class Rule:
    """Finite numbers that pass `test`, described by `allowed`. kind: int for whole numbers; unit:
    kind of unit in material files, "" for a pure number; endless: inf is allowed, too."""

    allowed: str
    test: Callable[[Any], bool] = lambda v: True
    kind: type = float
    unit: str = ""
    endless: bool = False

    def check(self, name: str, value: Any) -> Any:
        """`value` as `kind`; InputError, which calls it `name`, if the rule does not allow it."""
        plain = value.item() if getattr(value, "shape", None) == () else value  # of NumPy
        if isinstance(plain, Real) and not isinstance(plain, bool):
            with suppress(ValueError, OverflowError):  # no whole number, or a huge one
                number = self.kind(plain) + self.kind(0)  # -0.0 becomes 0.0
                finite = math.isfinite(number) or (self.endless and number == math.inf)
                if finite and number == plain and self.test(number):
                    return number
        raise InputError(f"{name} is {repr_short(value)}; expected {self.allowed}")


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
ABOVE_ZERO_OR_INF = Rule("a number above 0, or inf", lambda v: v > 0, endless=True)
COUNT = Rule("a whole number of 1 or more", lambda v: v >= 1, int)
SHARE = Rule("a fraction above 0 and up to 1, where 0.1 is 10 %", lambda v: 0 < v <= 1)
BELOW_180 = Rule("an angle above 0 and below 180 deg", lambda v: 0 < v < 180)


def did_you_mean(word: object, allowed: Iterable[str]) -> str:
    """Hint " (did you mean x?)" at the allowed name that is nearest in spelling or has the word as
    a synonym; "" if none is near."""
    synonyms = {  # names that others use, by ours
        "fabric": "material cloth",
        "fibre_angle": "orientation angle",
        "ply": "layer plies",
        "unit": "units",
        "mesh": "file",
        "nx": "cells",
        "outline": "dxf polygon contour",
        "size": "mesh_size",
        "start_distance": "off",
        "friction": "mu",
        "E": "young youngs_modulus",
        "nu": "poisson",
        "density": "rho mass_density",
        "areal_weight": "areal_density",
    }
    names = list(allowed)
    known = {each: name for name in names for each in synonyms.get(name, "").split()}
    known |= {name.lower(): name for name in names}
    near = difflib.get_close_matches(str(word).lower(), known, n=1)
    return f" (did you mean {known[near[0]]}?)" if near else ""


def unknown_key(key: object, allowed: Iterable[str], label: str) -> InputError:
    """The error for a key that is not among those allowed; it names the nearest."""
    allowed = list(allowed)
    hint = did_you_mean(key, allowed)
    return InputError(f"{label} is unknown{hint}; expected {', '.join(allowed)}")


def check_complete(found: Iterable[str], names: Iterable[str], where: str, place: str) -> None:
    """Raise InputError if one of the `names` was not found; where: prefix of names in the message,
    place: where they must be given."""
    if missing := [where + name for name in names if name not in found]:
        raise InputError(f"missing {', '.join(missing)}; expected all of them, {place}")
