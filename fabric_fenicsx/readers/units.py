"""Units in files: powers of ten to the package's own, mm, MPa, g/cm3, rad."""

import math
from collections.abc import Mapping

from ..runtime.errors import InputError
from ..runtime.rules import unknown_key

# kind -> unit -> power of ten to the first one of its kind, which is the package's own
UNITS = {
    "stress": {"MPa": 0, "kPa": -3, "Pa": -6, "GPa": 3},
    "length": {"mm": 0, "cm": 1, "m": 3, "um": -3},
    "density": {"g/cm3": 0, "kg/m3": -3},
    "areal_weight": {"g/m2": 0, "kg/m2": 3},
}
DEG = math.pi / 180
ANGLE = {"rad": 1.0, "deg": DEG}
STRAIN = {"-": 1.0, "%": 0.01}


def factors(kind: str) -> dict[str, float]:
    """Factor from each unit of a kind to the package's own."""
    return {unit: float(f"1e{power}") for unit, power in UNITS[kind].items()}


def check_unit(kind: str, unit: object) -> None:
    """InputError unless `unit` is one of the kind."""
    if kind not in UNITS:
        raise unknown_key(kind, UNITS, f"units.{kind}")
    if unit not in list(UNITS[kind]):
        raise unknown_key(str(unit), UNITS[kind], f"units.{kind} {unit!r}")


def suffixes(kind: str) -> dict[str, int]:
    """Powers of ten of a kind's units, as they stand at the end of a key: g_per_cm3 for g/cm3."""
    return {unit.replace("/", "_per_"): power for unit, power in UNITS.get(kind, {}).items()}


def power_of_key(name: str, kind: str, key: str, units: Mapping[str, str], label: str) -> int:
    """Power of ten from the unit of a `key` in a file to the package's own.

    The unit is in the key (`d_kPa` for the name d) or in `units`, the file's table {kind: unit};
    kind is "" for a pure number. Raises InputError, which calls the key `label`.
    """
    if not kind:
        if key != name:
            raise InputError(
                f"{label} has a unit, but {name} is a pure number; allowed is the key {name}"
            )
        return 0
    known = suffixes(kind)
    if key != name:
        unit = key.removeprefix(f"{name}_")
        if unit not in known:
            raise unknown_key(unit, known, f"{label}: {kind} unit {unit!r}")
        return known[unit]
    if kind not in units:
        keys = " or ".join(f"{name}_{unit}" for unit in known)
        raise InputError(f"{label} has no unit; allowed is {keys}, or {kind} in [units]")
    return UNITS[kind][units[kind]]
