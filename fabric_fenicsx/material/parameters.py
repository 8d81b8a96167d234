"""The parameters of a woven fabric, checked, with TOML files in and out (MPa, mm, g/cm3)."""

import dataclasses
import difflib
import math
import os
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from numbers import Real
from pathlib import Path
from reprlib import repr as shown
from types import SimpleNamespace
from typing import Any, NamedTuple, Self

import tomli_w

from ..errors import InputError

COUPLINGS = ("biaxial", "tension_shear", "compression_shear")


class _Rule(NamedTuple):
    kind: str  # of unit, "" for a pure number
    allowed: str
    test: Callable[[float], bool]


RULES = {
    "a": _Rule("stress", "at least 0", lambda v: v >= 0),
    "b": _Rule("stress", "above 0", lambda v: v > 0),
    "d": _Rule("stress", "above 0", lambda v: v > 0),
    "p_min": _Rule("", "from 0 to 1", lambda v: 0 <= v <= 1),
    "c": _Rule("", "at least 0", lambda v: v >= 0),
    "s_T": _Rule("stress", "at least 0", lambda v: v >= 0),
    "s_C": _Rule("", "at least 0", lambda v: v >= 0),
    "s1": _Rule("stress", "above 0", lambda v: v > 0),
    "s2": _Rule("stress", "of either sign", lambda v: True),
    "s3": _Rule("stress", "at least 0", lambda v: v >= 0),
    "thickness": _Rule("length", "above 0", lambda v: v > 0),
    "density": _Rule("density", "above 0", lambda v: v > 0),
    "areal_weight": _Rule("areal_weight", "above 0", lambda v: v > 0),
}
# what fabrics have, widely taken; beyond it a unit is probably wrong
PLAUSIBLE = {
    "b": (1.0, 1e5, "MPa"),
    "s1": (1e-4, 10.0, "MPa"),
    "thickness": (0.01, 20.0, "mm"),
    "density": (0.05, 10.0, "g/cm3"),
}
YARN = ("a", "b", "d", "p_min", "c", "s_T", "s_C")
SHEAR = ("s1", "s2", "s3")
SHEET = ("thickness", "density")

# Powers of ten from each unit to the first one of its kind, which is the package's own.
UNITS = {
    "stress": {"MPa": 0, "kPa": -3, "Pa": -6, "GPa": 3},
    "length": {"mm": 0, "cm": 1, "m": 3, "um": -3},
    "density": {"g/cm3": 0, "kg/m3": -3},
    "areal_weight": {"g/m2": 0, "kg/m2": 3},
}


def check_number(name: str, value: Any, label: str) -> float:
    """`value` as a float if `RULES[name]` allows it; otherwise an InputError that calls it `label`."""
    rule = RULES[name]
    if isinstance(value, Real) and not isinstance(value, bool):
        try:
            number = float(value) + 0.0  # -0.0 becomes 0.0
        except OverflowError:
            number = math.inf
        if math.isfinite(number) and rule.test(number):
            return number
    raise InputError(f"{label} is {shown(value)}, but it must be a finite number, {rule.allowed}")


def unknown_key(key: str, allowed: Iterable[str], label: str) -> InputError:
    """The error for a key that is not among those allowed; it names the nearest."""
    allowed = list(allowed)
    near = difflib.get_close_matches(str(key), allowed, n=1)
    hint = f" (did you mean {near[0]}?)" if near else ""
    return InputError(f"{label} is unknown{hint}; allowed are {', '.join(allowed)}")


def check_couplings(names: Any, label: str = "couplings") -> frozenset[str]:
    """The named couplings as a set, each one of `COUPLINGS`; otherwise an InputError that calls them `label`."""
    if isinstance(names, (str, Mapping)) or not isinstance(names, Iterable):
        raise InputError(f"{label} is {shown(names)}, but it must be a list of {', '.join(COUPLINGS)}")
    found = set()
    for given in names:
        name = given.replace("-", "_").replace("–", "_") if isinstance(given, str) else given
        if name not in COUPLINGS:
            raise unknown_key(name, COUPLINGS, f"{label}: coupling {shown(given)}")
        found.add(name)
    return frozenset(found)


@dataclass(frozen=True)
class Yarn:
    """The seven parameters of one yarn direction; raises InputError for a value out of its range.

    - a, b [MPa]: tension, cubic and quadratic term of the energy (eqs 15, 16)
    - d [MPa]: compression (eqs 22, 23)
    - p_min, c [-]: biaxial coupling, its floor, 0 to 1, and its rate (eqs 17, 18)
    - s_T [MPa]: tension-shear coupling (eqs 26, 27)
    - s_C [-]: compression-shear coupling (eqs 28, 29)
    """

    a: float
    b: float
    d: float
    p_min: float
    c: float
    s_T: float
    s_C: float

    def __post_init__(self) -> None:
        for name in YARN:
            object.__setattr__(self, name, check_number(name, getattr(self, name), f"Yarn.{name}"))


@dataclass(frozen=True)
class WovenFabric:
    """A woven fabric: 17 parameters, thickness, density and the couplings that are on.

    - warp, weft: yarns along a0 and b0 (`Yarn`)
    - s1, s2, s3: shear stress over shear angle [MPa] (eqs 24, 25)
    - thickness [mm], density [g/cm3]
    - couplings: any of `COUPLINGS`, spelled with "_", "-" or an en dash

    Raises InputError for a value out of its range.
    """

    warp: Yarn
    weft: Yarn
    s1: float
    s2: float
    s3: float
    thickness: float = 1.0
    density: float = 0.75
    couplings: frozenset[str] = frozenset(COUPLINGS)
    name: str = ""

    def __post_init__(self) -> None:
        for direction in ("warp", "weft"):
            if not isinstance(getattr(self, direction), Yarn):
                raise InputError(f"{direction} is {shown(getattr(self, direction))}, but it must be a Yarn")
        for name in SHEAR + SHEET:
            object.__setattr__(self, name, check_number(name, getattr(self, name), name))
        object.__setattr__(self, "couplings", check_couplings(self.couplings))
        if not isinstance(self.name, str):
            raise InputError(f"name is {shown(self.name)}, but it must be a text")

    @classmethod
    def balanced(
        cls,
        a: float,
        b: float,
        d: float,
        p_min: float,
        c: float,
        s_T: float,
        s_C: float,
        s1: float,
        s2: float,
        s3: float,
        **sheet: Any,
    ) -> Self:
        """The same yarn in both directions; `sheet` is thickness, density, couplings, name."""
        yarn = Yarn(a, b, d, p_min, c, s_T, s_C)
        return cls(yarn, yarn, s1, s2, s3, **sheet)

    curves = None  # a `TabulatedFabric` has them

    @property
    def is_balanced(self) -> bool:
        """Whether warp and weft are equal."""
        return self.warp == self.weft

    @property
    def biaxial(self) -> bool:
        """Whether k_TC acts (eqs 17, 18)."""
        return "biaxial" in self.couplings

    @property
    def tension_shear(self) -> bool:
        """Whether W_ST acts (eqs 26, 27)."""
        return "tension_shear" in self.couplings

    @property
    def compression_shear(self) -> bool:
        """Whether k_SC acts (eqs 28, 29)."""
        return "compression_shear" in self.couplings

    def doubts(self) -> list[str]:
        """Sentences on values outside of `PLAUSIBLE`, which may be in a wrong unit."""
        values = [("b", self.warp.b), ("s1", self.s1), ("thickness", self.thickness)]
        values += [("density", self.density)]
        values += [("b", self.weft.b)] if self.weft.b != self.warp.b else []
        return [
            f"{name} of material {self.name} is {value:g} {unit}, fabrics have {low:g} to {high:g}; look at its unit"
            for name, value in values for low, high, unit in [PLAUSIBLE[name]] if not low <= value <= high
        ]  # fmt: skip

    def without(self, *names: str) -> Self:
        """A copy with these couplings off; InputError for an unknown name."""
        return dataclasses.replace(self, couplings=self.couplings - check_couplings(names, "without"))

    def decoupled(self) -> Self:
        """A copy with every coupling off: three independent curves, like the Abaqus FABRIC model."""
        return self.without(*COUPLINGS)

    def replace(self, **changes: Any) -> Self:
        """A changed copy; a Yarn's field (`p_min=0.1`) changes in both directions."""
        own = [field.name for field in dataclasses.fields(self)]
        for key in changes:
            if key not in own and key not in YARN:
                raise unknown_key(key, (*own, *YARN), f"replace: {key}")
        yarn = {key: changes.pop(key) for key in YARN if key in changes}
        new = dataclasses.replace(self, **changes)
        return dataclasses.replace(
            new, warp=dataclasses.replace(new.warp, **yarn), weft=dataclasses.replace(new.weft, **yarn)
        )

    def symbols(self, make: Callable[[float], Any]) -> SimpleNamespace:
        """The parameters of the energy, each number v replaced by make(v), in the shape of a WovenFabric.

        The couplings stay plain booleans, so that what is off is not compiled; density has no part in it.
        """
        warp, weft = (
            SimpleNamespace(**{name: make(getattr(yarn, name)) for name in YARN}) for yarn in (self.warp, self.weft)
        )
        numbers = {name: make(getattr(self, name)) for name in (*SHEAR, "thickness")}
        return SimpleNamespace(
            warp=warp, weft=weft, curves=None, **numbers, **{name: getattr(self, name) for name in COUPLINGS}
        )

    def dumps(self, remarks: Iterable[str] = ()) -> str:
        """The TOML text, which reads back as an equal object; remarks: comment lines at its top."""
        table: dict[str, Any] = {"name": self.name, "thickness": self.thickness, "density": self.density}
        table["couplings"] = [name for name in COUPLINGS if name in self.couplings]
        table["units"] = {kind: next(iter(UNITS[kind])) for kind in ("stress", "length", "density")}
        yarns = {"yarns": self.warp} if self.is_balanced else {"warp": self.warp, "weft": self.weft}
        table |= {key: dataclasses.asdict(yarn) for key, yarn in yarns.items()}
        table["shear"] = {name: getattr(self, name) for name in SHEAR}
        return "".join(f"# {line}\n" for line in remarks) + tomli_w.dumps(table)

    def to_toml(self, path: str | os.PathLike[str], remarks: Iterable[str] = ()) -> None:
        """Write the file whole or not at all, with `remarks` as comments; InputError where it cannot be written."""
        path = Path(path)
        part = path.parent / f".{path.name}.{os.getpid()}.part"
        try:
            try:
                part.write_text(self.dumps(remarks), encoding="utf-8")
                os.replace(part, path)
            finally:
                part.unlink(missing_ok=True)
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: cannot be written ({_reason(error)})") from None

    @classmethod
    def from_toml(cls, path: str | os.PathLike[str]) -> Self:
        """Read a file written by hand or by `to_toml`; InputError with file, field and what is allowed."""
        return read_toml(path, lambda document: cls(**from_document(document)))


def coupling_variants(fabric: WovenFabric) -> dict[str, WovenFabric]:
    """{label: fabric} with all couplings, without some, and the decoupled baseline, as Figs 10 and 16 compare them."""
    return {
        "all couplings": fabric,
        "without biaxial": fabric.without("biaxial"),
        "without shear couplings": fabric.without("tension_shear", "compression_shear"),
        "FABRIC": fabric.decoupled(),
    }


def read_toml(path: str | os.PathLike[str], make: Callable[[dict[str, Any]], Any]) -> Any:
    """make(document) of the TOML file at `path`; InputErrors name the file."""
    try:
        document = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is not valid TOML ({error})") from None
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as a TOML file ({_reason(error)})") from None
    try:
        return make(document)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def from_document(document: dict[str, Any]) -> dict[str, Any]:
    """The arguments of WovenFabric from a TOML document."""
    tables = {key: document.pop(key, {}) for key in ("units", "yarns", "warp", "weft", "shear")}
    for key, table in tables.items():
        if not isinstance(table, dict):
            raise InputError(f"{key} is {shown(table)}, but it must be a table, [{key}]")
    units = tables["units"]
    for kind, unit in units.items():
        if kind not in UNITS:
            raise unknown_key(kind, UNITS, f"units.{kind}")
        if unit not in list(UNITS[kind]):
            raise unknown_key(unit, UNITS[kind], f"units.{kind} {shown(unit)}")
    fields: dict[str, Any] = {key: document.pop(key) for key in ("name", "couplings") if key in document}
    fields |= read_sheet_numbers(document, units, ("name", "couplings", *tables))[0]
    fields |= read_numbers(tables["shear"], SHEAR, units, "shear.")
    check_complete(fields, SHEET, "", "at the top of the file")
    check_complete(fields, SHEAR, "shear.", "in [shear]")
    both, warp, weft = (read_numbers(tables[key], YARN, units, f"{key}.") for key in ("yarns", "warp", "weft"))
    for direction, own in (("warp", warp), ("weft", weft)):
        check_complete(both | own, YARN, f"{direction}.", f"in [yarns] or [{direction}]")
        fields[direction] = Yarn(**(both | own))
    return fields


def check_complete(found: Iterable[str], names: Iterable[str], where: str, place: str) -> None:
    """InputError if a name is missing."""
    if missing := [where + name for name in names if name not in found]:
        raise InputError(f"missing {', '.join(missing)}, which must be given {place}")


def read_sheet_numbers(
    table: Mapping[str, Any], units: Mapping[str, str], also: tuple[str, ...] = ()
) -> tuple[dict[str, float], float | None]:
    """Those of thickness [mm] and density [g/cm3] that a table has, and the areal weight [g/m2] if the density is from
    one: areal weight / thickness. InputError by key; also: keys that belong to others."""
    numbers = read_numbers(table, (*SHEET, "areal_weight"), units, "", also)
    weight = numbers.pop("areal_weight", None)
    if weight is not None and "thickness" in numbers:
        if "density" in numbers:
            raise InputError("density and areal_weight are both given; allowed is one, as each follows from the other")
        # of g/(m2 mm), to the rounding of a number typed by hand
        numbers["density"] = float(f"{1e-3 * weight / numbers['thickness']:.15g}")
    return numbers, weight


def read_numbers(
    table: Mapping[str, Any], names: tuple[str, ...], units: Mapping[str, str], where: str, also: tuple[str, ...] = ()
) -> dict[str, float]:
    """The numbers of one TOML table in the package's units; the unit is in the key or in `units`."""
    found: dict[str, float] = {}
    spelled: dict[str, str] = {}
    for key, value in table.items():
        name = key if key in names else next((n for n in names if key.startswith(f"{n}_")), None)
        if name is None:
            raise unknown_key(key, (*names, *also), where + key)
        if name in found:
            raise InputError(f"{where}{key} repeats {where}{spelled[name]}; {name} must be given once")
        exponent = _exponent(name, key, units, where + key)
        number = Decimal(repr(check_number(name, value, where + key))).scaleb(exponent)
        found[name] = check_number(name, float(number), where + key)
        spelled[name] = key
    return found


def _exponent(name: str, key: str, units: Mapping[str, str], label: str) -> int:
    """The power of ten from the unit of `key` to the package's own."""
    kind = RULES[name].kind
    if not kind:
        if key != name:
            raise InputError(f"{label} has a unit, but {name} is a pure number; the key must be {name}")
        return 0
    suffixes = {unit.replace("/", "_per_"): exponent for unit, exponent in UNITS[kind].items()}
    if key != name:
        unit = key.removeprefix(f"{name}_")
        if unit not in suffixes:
            raise unknown_key(unit, suffixes, f"{label}: {kind} unit {shown(unit)}")
        return suffixes[unit]
    if kind not in units:
        keys = " or ".join(f"{name}_{unit}" for unit in suffixes)
        raise InputError(f"{label} has no unit; write {keys}, or give {kind} in [units]")
    return UNITS[kind][units[kind]]
