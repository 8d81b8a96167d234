"""TOML files of materials: numbers with units in, whole files out."""

import os
import tomllib
from collections.abc import Callable, Iterable, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from ..core.errors import InputError
from ..core.files import replace_file, unwritable
from ..core.rules import POSITIVE, SHARE, Rule, above_zero, did_you_mean, repr_short, unknown_key
from ..core.tables import as_table
from ..io.units import OWN, UNITS, suffixes

Document = dict[str, Any]  # of a TOML file: its keys, or those of a table
T = TypeVar("T")
SHEET = {"thickness": above_zero("length"), "density": above_zero("density")}
OWN_UNITS = {kind: OWN[kind] for kind in ("stress", "length", "density")}  # of files we write
FIBRES = {"fibre_density": above_zero("density"), "fibre_share": SHARE}


class Several(NamedTuple):
    """The rule for one or several numbers that `rule` allows, in its unit."""

    rule: Rule

    @property
    def unit(self) -> str:
        return self.rule.unit

    def check(self, name: str, value: object) -> tuple[float, ...]:
        """As of `Rule`, the numbers."""
        numbers = value if isinstance(value, (list, tuple)) and value else [value]
        return tuple(self.rule.check(name, each) for each in numbers)


class Interval(Several):
    """The rule for two numbers that `rule` allows, the first below the second."""

    def check(self, name: str, value: object) -> tuple[float, ...]:
        numbers = super().check(name, value)
        if len(numbers) == 2 and numbers[0] < numbers[1]:
            return numbers
        raise InputError(f"{name} is {repr_short(value)}; expected two numbers, [lowest, highest]")


def preset_or_file(
    kind: str, source: object, presets: Mapping[str, T], read: Callable[[str | os.PathLike], T]
) -> T:
    """The preset of this name, else read(source) of a file; InputError, which calls it `kind`, if
    neither exists."""
    if isinstance(source, str) and source in presets:
        return presets[source]
    if isinstance(source, (str, os.PathLike)) and os.path.exists(source):
        return read(source)
    raise InputError(
        f"{kind} {repr_short(source)} is unknown{did_you_mean(source, presets)}; expected a "
        f"preset ({', '.join(presets)}) or a file that exists"
    )


def read_toml(path: str | os.PathLike[str], make: Callable[[Document], T]) -> T:
    """make(document) of the TOML file at `path`; InputErrors name the file."""
    try:
        document = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or error
        if isinstance(error, UnicodeDecodeError):
            is_wide = error.object.startswith((b"\xff\xfe", b"\xfe\xff"))
            reason = f"it is in {'UTF-16' if is_wide else 'Latin-1 or another encoding'}"
        raise InputError(f"{path}: cannot be read ({reason}); expected TOML in UTF-8") from None
    try:
        return make(document)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_whole(path: str | os.PathLike[str], text: str) -> None:
    """Write a file whole or not at all; InputError where it cannot be written."""
    try:
        replace_file(Path(path), text)
    except OSError as error:
        raise unwritable(error) from None


def take_table(document: Document, key: str) -> Document:
    """The table of this key, taken out of the document, empty if it is not there."""
    return as_table(document.pop(key, {}), key, f"a table, [{key}]")


def take_units(document: Document) -> dict[str, str]:
    """The table [units], {kind: unit}, taken out of the document; InputError for another unit."""
    units = take_table(document, "units")
    for kind, unit in units.items():
        if unit not in [*UNITS.get(kind, ())]:
            raise unknown_key(str(unit), UNITS.get(kind, UNITS), f"units.{kind} {unit!r}")
    return units


def read_numbers(
    table: Mapping[str, object],
    rules: Mapping[str, Rule | Several],
    units: Mapping[str, str],
    where: str,
    also: Iterable[str] = (),
) -> Document:
    """The numbers of one TOML table by the names of `rules`, in the package's units: the unit is in
    the key, as `d_kPa`, or in the file's `units` {kind: unit}. where: what stands before a key in
    messages; also: keys that belong to others. Raises InputError by key."""
    numbers: Document = {}
    # {key: (name in `rules`, power of ten from the key's unit to the package's own)}
    keys = {name: (name, 0) for name, rule in rules.items() if not rule.unit}
    for name, rule in rules.items():
        powers = suffixes(rule.unit)
        keys |= {f"{name}_{unit}": (name, power) for unit, power in powers.items()}
        if rule.unit in units:
            keys[name] = name, UNITS[rule.unit][units[rule.unit]]
    for key, value in table.items():
        label = where + key
        if key not in keys:
            spelled = [each for each, (name, _) in keys.items() if f"{key}_".startswith(f"{name}_")]
            if key in rules:
                raise InputError(f"{label} has no unit; expected {' or '.join(spelled)}")
            raise unknown_key(key, spelled or (*rules, *also), label)
        name, power = keys[key]
        if name in numbers:
            raise InputError(f"{label} repeats {where}{name}; expected {name} once")
        numbers[name] = _scaled(rules[name].check(label, value), power)
    return numbers


def read_scatter(
    document: Document, rules: Mapping[str, Rule], factors: Iterable[str], units: Mapping[str, str]
) -> dict[str, tuple[float, float]]:
    """The table [scatter], taken out of a material's document: intervals of the numbers of `rules`,
    in the package's units, and of `factors`. Raises InputError by key."""
    intervals = {name: Interval(rule) for name, rule in rules.items()}
    intervals |= dict.fromkeys(factors, Interval(POSITIVE))
    return read_numbers(take_table(document, "scatter"), intervals, units, "scatter.")


def _scaled(value, power):
    """A number, or each of a list, times a power of ten, as exact as one typed by hand."""
    if isinstance(value, tuple):
        return tuple(_scaled(each, power) for each in value)
    return float(Decimal(repr(value)).scaleb(power))


def read_sheet_numbers(
    table: Mapping[str, object],
    units: Mapping[str, str],
    also: Iterable[str],
    rules: Mapping[str, Rule],
) -> tuple[Document, float | None]:
    """The numbers that a table has of thickness, density and the names of `rules`, and the areal
    weight [g/m2] if the density is from one; also: keys of others. Raises InputError by key."""
    all_rules = {**SHEET, "areal_weight": above_zero("areal_weight"), **rules}
    numbers = read_numbers(table, all_rules, units, "", also)
    weight = numbers.pop("areal_weight", None)
    if weight is not None and "thickness" in numbers:
        if "density" in numbers:
            raise InputError("density and areal_weight are both given; use one of them")
        # from g/(m2 mm), rounded as a number typed by hand
        numbers["density"] = float(f"{1e-3 * weight / numbers['thickness']:.15g}")
    return numbers, weight
