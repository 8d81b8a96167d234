"""Checks of laws as users write them, and of numbers that may be in a wrong unit."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..readers.units import UNITS
from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..runtime.rules import Rule, shown, unknown_key
from .energy import Derivatives, Energy
from .files import SHEET

COUPLINGS = ("biaxial", "tension_shear", "compression_shear")
# what fabrics have, widely taken; beyond it a unit is probably wrong
PLAUSIBLE = {
    "thickness": (0.01, 20.0, "mm"),
    "density": (0.05, 10.0, "g/cm3"),
    "fibre_density": (0.8, 10.0, "g/cm3"),
    **{f"b of {yarn}": (1.0, 1e5, "MPa") for yarn in ("yarns", "warp", "weft")},
    "s1": (1e-4, 10.0, "MPa"),
    "stiffness along a": (2.0, 2e5, "MPa"),
    "stiffness along b": (2.0, 2e5, "MPa"),
    "stiffness in shear": (1e-4, 10.0, "MPa"),
}
# strains at which a coupling alone gives the energy mixed derivatives
PROBES = {
    "biaxial": [(0.02, 0.03, 0.0), (-0.02, 0.03, 0.0), (0.02, -0.03, 0.0)],
    "tension_shear": [(0.02, 0.03, 0.3)],
    "compression_shear": [(-0.02, -0.03, 0.3)],
}
LITTLE = 1e-9  # strain, to tell the sides of a kink


def check_couplings(names: Any, label: str = "couplings") -> frozenset[str]:
    """The named couplings as a set, each one of `COUPLINGS`, spelled with "_", "-" or an en dash;
    otherwise an InputError that calls them `label`."""
    if isinstance(names, (str, Mapping)) or not isinstance(names, Iterable):
        raise InputError(f"{label} is {shown(names)}; allowed is a list of {', '.join(COUPLINGS)}")
    found = set()
    for given in names:
        name = given.replace("-", "_").replace("–", "_") if isinstance(given, str) else given
        if name not in COUPLINGS:
            raise unknown_key(name, COUPLINGS, f"{label}: coupling {shown(given)}")
        found.add(name)
    return frozenset(found)


def couples(law: Energy, name: str) -> bool:
    """True if the energy depends on two strains together where this coupling acts."""
    second = Energy.derivatives(law, *np.transpose(PROBES[name])).second
    mixed = second[1:2] if name == "biaxial" else second[3:5]
    return bool(abs(mixed).max() > 1e-9 * abs(second).max())


def check_class(cls: Any) -> None:
    """InputError for a class of a law that is no dataclass of its own, or whose numbers and rules
    do not match."""
    named = {*cls.__dict__.get("__annotations__", {}), *cls.rules}
    if missing := sorted(named - {*cls.__dataclass_fields__}):
        raise InputError(
            f"law {cls.law} has no number {', '.join(missing)}; allowed is a class with "
            f"@dataclass(frozen=True) above it and `{missing[0]}: float` in it"
        )
    for name, rule in cls.rules.items():
        unit = getattr(rule, "unit", rule)
        if not isinstance(rule, Rule) or unit not in ("", *UNITS):
            raise InputError(
                f"rule of {name} of law {cls.law} is for {shown(unit)}; allowed is one of "
                f"`runtime.rules`, as above_zero(unit), for {', '.join(UNITS)} or none"
            )
    for field in dataclasses.fields(cls):  # a file would lack a number that no rule names
        number = field.init and field.type in (float, "float")
        if number and field.name not in cls.rules and field.name not in SHEET:
            allowed = "allowed is one for each number, in `rules`"
            raise InputError(f"{field.name} of law {cls.law} has no rule; {allowed}")


def check_rest(law: Energy) -> None:
    """InputError where the fabric as it lies, without strain, has energy or stress, or a negative
    stiffness."""
    found = Energy.derivatives(law, *np.transpose([(0.0, 0.0, 0.0), (0.01, 0.01, 0.1)]))
    stiffness = np.nanmax(abs(found.second[[0, 2, 5]]), 1, initial=0.0)
    text = f"of law {law.law} is %.3g MPa in fabric as it lies, without strain; allowed is 0"
    if abs(W := found.parts[0].sum()) > 1e-9 * stiffness.max():
        raise InputError(f"the energy {text % W}: take off what it is there")
    for name, stress, scale in zip(("sigma_a", "sigma_b", "tau"), found.first[:, 0], stiffness):
        if not abs(stress) <= 1e-5 * scale:
            raise InputError(f"the stress {name} {text % stress}")
    beside = Energy.derivatives(law, *np.array(3 * [[-LITTLE, LITTLE]])).second
    for name, k, scale in zip(("eps_a", "eps_b", "gamma"), beside[[0, 2, 5]], stiffness):
        if k.min() < -1e-6 * scale:
            raise InputError(
                f"the stiffness of law {law.law} along {name} is {rounded(k.min())} MPa in "
                "fabric as it lies, without strain; allowed is 0 or more: look at its signs"
            )


def check_shapes(law: Energy) -> None:
    """InputError where closed forms of `derivatives` have other shapes than `Derivatives`."""
    none, right = np.zeros(2), [(2, 3), (3, 2), (6, 2)]
    for second in (True, False):
        given: Any = None
        try:
            given = law.derivatives(none, none, none, second)
            shapes: list[object] = [np.shape(each) for each in given]
        except TypeError as error:
            shapes = [error]
        if not isinstance(given, Derivatives) or shapes[: 2 + second] != right[: 2 + second]:
            raise InputError(
                f"`derivatives` of law {law.law} gives {', '.join(map(str, shapes))} at n = 2 "
                f"states with second={second}; allowed is `Derivatives` of parts (n, 3), first "
                "(3, n) and second (6, n), None where `second` is False"
            )


def implausible(label: str, values: Mapping[str, float | None]) -> list[str]:
    """A sentence on each value {name: value}, of a material `label`, outside of `PLAUSIBLE`."""
    known = [(name, value, *PLAUSIBLE[name]) for name, value in values.items() if value is not None]
    return [
        f"{name} of material {label} is {value:g} {unit}, fabrics have {low:g} to {high:g}; "
        "look at its unit"
        for name, value, low, high, unit in known
        if not low <= value <= high
    ]
