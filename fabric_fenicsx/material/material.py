"""Numbers with rules, of which materials are made, and materials as files hold them."""

import copy
import dataclasses
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import tomli_w

from ..core.errors import InputError
from ..core.fields import Kind, declared, documented
from ..core.rules import POSITIVE, Rule, check_complete, unknown_key
from ..io.units import suffixes
from .files import OWN_UNITS, SHEET, Document, Several, read_numbers, read_toml, write_whole
from .functions import Number

Scatter = Mapping[str, tuple[float, float]]


def parameter(
    rule: Rule | Several | None, text: str, default: Any = dataclasses.MISSING, **options: Any
) -> Any:
    """A field of `Parameters`: a number by `rule`, or (None) another value; text: what it is, with
    its unit; default: value, or `dict`; options: others of `dataclasses.field`."""
    options["default_factory" if default is dict else "default"] = default
    return dataclasses.field(metadata={"rule": rule, "help": text}, **options)


def parameters(kind: Kind) -> Kind:
    """A dataclass whose `rules` and docstring have what it declares by `parameter`."""
    rules = {field.name: field.metadata["rule"] for field in declared(kind)}
    kind.rules = {name: rule for name, rule in rules.items() if rule}  # type: ignore[attr-defined]
    return documented(kind)


@dataclass(frozen=True)
class Parameters:
    """Numbers with rules: `rules` names those fields that are checked, and how, here and in tables
    of files."""

    rules: ClassVar[Mapping[str, Any]] = {}
    optional: ClassVar[tuple[str, ...]] = ()  # those that may be left out
    prefix: ClassVar[str] = ""  # of names in messages

    def __post_init__(self) -> None:
        for name, rule in self.rules.items():
            value = getattr(self, name)
            if name not in self.optional or value:
                object.__setattr__(self, name, rule.check(self.prefix + name, value))

    def table(self) -> Document:
        """Its table in a file that has the units `OWN_UNITS`; other units are in the keys."""
        entries = {}
        for name, rule in self.rules.items():
            if (value := getattr(self, name)) or name not in self.optional:
                is_plain = rule.unit in ("", *OWN_UNITS)
                entries[name if is_plain else f"{name}_{next(iter(suffixes(rule.unit)))}"] = value
        return entries

    @classmethod
    def from_table(cls, table: Mapping[str, object], units: Mapping[str, str], name: str) -> Self:
        """What the table [name] of a file has; units: those of the file. InputError by key."""
        numbers = read_numbers(table, cls.rules, units, f"{name}.")
        needed = [each for each in cls.rules if each not in cls.optional]
        check_complete(numbers, needed, f"{name}.", f"in [{name}]")
        return cls(**numbers)

    def __rmul__(self, factor: float) -> Self:
        """A copy with all stresses times a factor."""
        stresses = {n: getattr(self, n) for n, rule in self.rules.items() if rule.unit == "stress"}
        for name, value in stresses.items():
            several = isinstance(value, tuple)
            stresses[name] = tuple(factor * v for v in value) if several else factor * value
        return dataclasses.replace(self, **stresses)

    def symbols(self, make: Callable[[float], Number]) -> Self:
        """A copy, not checked, of which each number v of the energy is make(v); so make may give
        UFL constants. Densities, compaction and bending have no part in it; thickness comes
        last."""
        beside = "density fibre_density fibre_share compaction bending bending_friction".split()
        new, names = copy.copy(self), [field.name for field in dataclasses.fields(self)]
        for name in sorted(filter(lambda name: name not in beside, names), key="thickness".__eq__):
            value = getattr(self, name)
            if isinstance(value, float):
                object.__setattr__(new, name, make(value))
            elif isinstance(value, Parameters):
                object.__setattr__(new, name, value.symbols(make))
            elif isinstance(self.rules.get(name), Several):
                object.__setattr__(new, name, tuple(map(make, value)))
        return new


class Material(Parameters):
    """Parameters of a sheet's material that a file holds; a subclass says what in `table`, and
    reads it in `from_document`. thickness: of the sheet [mm]; scatter: {name of a number or factor:
    its lowest and highest value}; factors: {name: fields that it multiplies together}."""

    thickness: float
    name: str
    scatter: Scatter
    factors: ClassVar[Mapping[str, tuple[str, ...]]] = {}

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, rule in SHEET.items():
            object.__setattr__(self, name, rule.check(name, getattr(self, name)))
        for name, (low, high) in self.scatter.items():
            values = [1.0] if name in self.factors else self.values(name)
            if len(values) > 1 or not low <= values[0] <= high:
                raise InputError(
                    f"scatter.{name} is from {low:g} to {high:g}, and {name} is "
                    f"{' and '.join(f'{v:g}' for v in values)}; expected an interval around one "
                    "number (yarn_factor is of warp and weft)"
                )

    def plausibility_warnings(self) -> list[str]:
        """Sentences on values that such a sheet hardly has, which may be in a wrong unit."""
        return []

    @classmethod
    def numbers(cls) -> Mapping[str, Rule]:
        """The rules of the numbers that `changed` takes and that may scatter, by name."""
        return {**cls.rules, **SHEET}

    def values(self, name: str) -> list[float]:
        """The number of that name, or two where warp and weft differ in it."""
        return [getattr(self, name)]

    def changed(self, numbers: Mapping[str, object]) -> Self:
        """A copy with these `numbers`, in the package's units, or with fields times a factor of
        `factors`. InputError by name."""
        for name in numbers:
            if name not in (known := (*self.numbers(), *self.factors)):
                raise unknown_key(name, known, name)
        fields = {name: value for name, value in numbers.items() if name not in self.factors}
        new = self.replace(**fields) if fields else self
        for name, scaled in self.factors.items():  # of what is set
            factor = POSITIVE.check(name, numbers.get(name, 1.0))
            if factor != 1:
                new = new.replace(**{n: factor * getattr(new, n) for n in scaled})
        return new

    def thickness_under(self, pressure: float) -> float:
        """Thickness of the sheet between faces that press it [MPa], in mm."""
        return self.thickness

    def assumed_values(self) -> dict[str, str]:
        """Numbers that act and that no test has determined, {name: value with unit}."""
        return {}

    @property
    def label(self) -> str:
        """The material's name in sentences."""
        return self.name or getattr(self, "law", "material")

    def replace(self, **changes: object) -> Self:
        """A changed copy, without the intervals of what is changed; InputError for an unknown
        name."""
        names = dict.fromkeys([*(f.name for f in dataclasses.fields(self)), *self.numbers()])
        for key in changes:
            if key not in names:
                raise unknown_key(key, names, f"replace: {key}")
        kept = {name: ends for name, ends in self.scatter.items() if name not in changes}
        return dataclasses.replace(self, **{"scatter": kept} | self._fields(changes))

    def _fields(self, changes):
        return changes

    def table(self) -> Document:
        """The content of a material file."""
        raise NotImplementedError

    @classmethod
    def from_document(cls, document: Document, folder: Path) -> Self:
        """The material of a TOML document that lies in `folder`; InputError by field."""
        raise NotImplementedError

    def dumps(self, remarks: Iterable[str] = ()) -> str:
        """The TOML text, which reads back as an equal object; remarks: comment lines at its top."""
        return "".join(f"# {line}\n" for line in remarks) + tomli_w.dumps(self.table())

    def to_toml(self, path: str | os.PathLike[str], remarks: Iterable[str] = ()) -> None:
        """Write the file whole or not at all, with `remarks` as comments; InputError where it
        cannot be written."""
        write_whole(path, self.dumps(remarks))

    @classmethod
    def from_toml(cls, path: str | os.PathLike[str]) -> Self:
        """Read a file written by hand or by `to_toml`; InputError with file, field and what is
        allowed."""
        return read_toml(path, lambda document: cls.from_document(document, Path(path).parent))
