"""What every law has: checked parameters, an energy, its derivatives, and a material file."""

import dataclasses
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import tomli_w
from numpy.typing import ArrayLike

from ...readers.units import UNITS
from ...runtime.errors import InputError
from ...runtime.formatting import rounded
from ...runtime.rules import Rule, check_complete, shown, unknown_key
from ..compaction import Compaction, compaction_of, table_of
from ..files import FIBRES, SHEET, read_sheet_numbers, read_toml, take_units, write_whole
from ..hyperdual import HyperDual
from ..parameters import Parameters

COUPLINGS = ("biaxial", "tension_shear", "compression_shear")
LAWS: "dict[str, type[Law]]" = {}  # by their names in material files
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
        allowed = ", ".join(COUPLINGS)
        raise InputError(f"{label} is {shown(names)}; allowed is a list of {allowed}")
    found = set()
    for given in names:
        name = given.replace("-", "_").replace("–", "_") if isinstance(given, str) else given
        if name not in COUPLINGS:
            raise unknown_key(name, COUPLINGS, f"{label}: coupling {shown(given)}")
        found.add(name)
    return frozenset(found)


class Derivatives(NamedTuple):
    """The energy at n states and its derivatives in (eps_a, eps_b, gamma) [MPa].

    - parts: (n, 3): along a, along b, shear with its couplings; W is their sum
    - first: (3, n): the conjugate stresses sigma_a, sigma_b, tau
    - second: (6, n): the tangents aa, ab, bb, ag, bg, gg; None unless asked for
    """

    parts: np.ndarray
    first: np.ndarray
    second: np.ndarray | None


class Range(NamedTuple):
    """Strains that a law's numbers are for.

    - strain: "eps_a", "eps_b" or "gamma", of which the size counts
    - source: what says so, as "the table of warp"
    - low, high: the least and the greatest [-, rad]; infinite where it has no end
    - beyond: what the law does beyond them, in words
    """

    strain: str
    source: str
    low: float
    high: float
    beyond: str


class Material(Parameters):
    """Parameters of a sheet's material that a file holds; a subclass says what in `table`, and
    reads it in `from_document`. thickness: of the sheet [mm]."""

    thickness: float

    def thickness_under(self, pressure: float) -> float:
        """Thickness of the sheet between faces that press it [MPa], in mm."""
        return self.thickness

    def assumed_values(self) -> dict[str, str]:
        """What numbers are that act and that no test has determined, {name: value with unit}."""
        return {}

    @property
    def label(self) -> str:
        """What the material is called in sentences."""
        return getattr(self, "name", "") or getattr(self, "law", "material")

    def replace(self, **changes: Any) -> Self:
        """A changed copy; InputError for an unknown name."""
        own = [field.name for field in dataclasses.fields(self)]
        for key in changes:
            if key not in own:
                raise unknown_key(key, own, f"replace: {key}")
        return dataclasses.replace(self, **changes)

    def table(self) -> dict[str, Any]:
        """What a material file says."""
        raise NotImplementedError

    @classmethod
    def from_document(cls, document: dict[str, Any], folder: Path) -> Self:
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


@dataclass(frozen=True)
class Law(Material):
    """A fabric: the parameters of a law, thickness [mm], density [g/cm3], a name, its `Compaction`,
    None for fabric that keeps its thickness, and the fibre density [g/cm3], None if not known.
    assumed: names of its numbers that no test has determined.

    A law is one frozen dataclass. It states `law`, its name in material files; `rules`, a `Rule`
    for each of its numbers; and `energy`. All else follows from these: stresses and tangents, the
    compiled form, reading and writing. It may have closed forms for the kernel (`derivatives`).

    Raises InputError for a value out of its range.
    """

    law: ClassVar[str] = ""

    thickness: float = dataclasses.field(default=1.0, kw_only=True)
    density: float = dataclasses.field(default=0.75, kw_only=True)
    name: str = dataclasses.field(default="", kw_only=True)
    compaction: Compaction | None = dataclasses.field(default=Compaction(), kw_only=True)
    fibre_density: float | None = dataclasses.field(default=None, kw_only=True)
    # where numbers are from does not make another fabric
    assumed: tuple[str, ...] = dataclasses.field(default=(), kw_only=True, compare=False)

    def __init_subclass__(cls) -> None:
        known, here = LAWS.get(cls.law, cls), (cls.__module__, cls.__qualname__)
        # the same class again, as from a notebook's cell run twice, replaces itself
        if not cls.law or (known.__module__, known.__qualname__) != here:
            raise InputError(
                f"law of class {cls.__name__} is {cls.law!r}; allowed is a name of its own, other "
                f"than {', '.join(sorted(LAWS))}"
            )
        for name, rule in cls.rules.items():
            if not (isinstance(rule, Rule) and rule.unit in ("", *UNITS)):
                unit = rule.unit if isinstance(rule, Rule) else rule
                raise InputError(
                    f"rule of {name} of law {cls.law} is for {shown(unit)}; allowed is one of "
                    f"`runtime.rules`, as above_zero(unit), for {', '.join(UNITS)} or none"
                )
        LAWS[cls.law] = cls

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        """InputError for a class that is not a dataclass of its own."""
        named = {*cls.__dict__.get("__annotations__", {}), *cls.rules}
        if missing := sorted(named - {*cls.__dataclass_fields__}):
            raise InputError(
                f"law {cls.law} has no number {', '.join(missing)}; allowed is a class with "
                f"@dataclass(frozen=True) above it and `{missing[0]}: float` in it"
            )
        return super().__new__(cls)

    def __post_init__(self) -> None:
        super().__post_init__()
        for field in dataclasses.fields(self):  # a file would lack a number that no rule names
            number = field.init and field.type in (float, "float")
            if number and field.name not in self.rules and field.name not in SHEET:
                raise InputError(
                    f"{field.name} of law {self.law} has no rule; allowed is one for each number, "
                    "in `rules`"
                )
        for name, rule in SHEET.items():
            object.__setattr__(self, name, rule.check(name, getattr(self, name)))
        if not isinstance(self.name, str):
            raise InputError(f"name is {shown(self.name)}; allowed is a text")
        if not isinstance(self.compaction, Compaction | None):
            raise InputError(
                f"compaction is {shown(self.compaction)}; allowed is one, as `Compaction(16.0)`"
            )
        object.__setattr__(self, "assumed", self._checked_assumed())
        if self.fibre_density is not None:
            fibres = FIBRES["fibre_density"].check("fibre_density", self.fibre_density)
            object.__setattr__(self, "fibre_density", fibres)
            if not fibres > self.density:
                raise InputError(
                    f"fibre_density is {fibres:g} g/cm3; allowed is more than the fabric's density "
                    f"of {self.density:g} g/cm3, as fibres do not fill all of it"
                )

    def _checked_assumed(self):
        given = self.assumed
        if isinstance(given, str) or not isinstance(given, Iterable):
            allowed = f"allowed is a list of {', '.join(self.parameters)}"
            raise InputError(f"assumed is {shown(given)}; {allowed}")
        for name in given:
            if name not in self.parameters:
                raise unknown_key(name, self.parameters, f"assumed: {shown(name)}")
        return tuple(name for name in self.parameters if name in given)

    def assumed_values(self) -> dict[str, str]:
        """As in `Material`: numbers of couplings that are off are left out."""
        return {name: self._value_words(name) for name in self.assumed if self._acts(name)}

    def _value_words(self, name):
        unit = self.rules[name].unit
        return f"{getattr(self, name):g}" + (f" {next(iter(UNITS[unit]))}" if unit else "")

    def _acts(self, name):
        """Whether a number has an effect."""
        return True

    def energy(self, eps_a: Any, eps_b: Any, gamma: Any) -> tuple[Any, Any, Any]:
        """The three parts of the strain energy density W, along a, along b and shear with its
        couplings [MPa = N mm per mm3 of undeformed fabric].

        eps_a, eps_b: nominal strains of the yarns, eq. (9) [-]; gamma: shear angle, eq. (8), of
        either sign [rad]; UFL expressions, NumPy arrays or hyper-dual numbers. So the functions in
        it are those of `material.functions`.
        """
        raise InputError(
            f"law {self.law} has no energy; allowed is a method energy(self, eps_a, eps_b, gamma)"
        )

    def parts(self, eps_a: Any, eps_b: Any, gamma: Any) -> tuple[Any, Any, Any]:
        """What `energy` gives; InputError if that fails or gives something else than three parts,
        as where it is not written with the functions of `material.functions`."""
        allowed = (
            "allowed are three parts, written with + - * / **, abs and the functions of "
            "`material.functions`, as where(eps > 0, x, y) for `if`"
        )
        try:
            a, b, shear = self.energy(eps_a, eps_b, gamma)
        except InputError:
            raise
        except Exception as error:
            words = f"energy of law {self.law} fails ({type(error).__name__}: {error})"
            raise InputError(f"{words}; {allowed}") from error
        for part in (a, b, shear):  # where NumPy takes numbers for objects it gives an array
            if isinstance(part, np.ndarray) and not isinstance(eps_a, np.ndarray):
                raise InputError(
                    f"energy of law {self.law} has a part of type {type(part).__name__}; {allowed}"
                )
        return a, b, shear

    def derivatives(
        self, eps_a: np.ndarray, eps_b: np.ndarray, gamma: np.ndarray, second: bool = True
    ) -> Derivatives:
        """Energy, stresses and, if asked for, tangents at states (n,), exact to rounding:
        `Derivatives` of parts (n, 3), first (3, n) and second (6, n), None unless asked for [MPa].

        At a kink they are those of the side up to it: eps = 0 counts as compression.
        """
        strains = HyperDual.variables(eps_a, eps_b, gamma)
        zero = 0.0 * strains[0]
        with np.errstate(all="ignore"):  # sides of a case that do not count
            parts = [part + zero for part in self.parts(*strains)]
            W = parts[0] + parts[1] + parts[2]
        values = np.stack([part.value for part in parts], -1)
        return Derivatives(values, W.first, W.second if second else None)

    def ranges(self) -> tuple[Range, ...]:
        """The strains that the law's numbers are for, where they have an end: a run warns of
        states beyond."""
        return ()

    def thickness_under(self, pressure: float) -> float:
        """As in `Material`, by its `compaction`."""
        share = float(self.compaction.thickness(pressure)) if self.compaction else 1.0
        return share * self.thickness

    def fibre_volume_fraction(
        self, thickness: float | np.ndarray, area: float | np.ndarray = 1.0
    ) -> np.ndarray:
        """Share of the volume that is fibres where the sheet is `thickness` [mm] thick and `area`
        times as large as the flat fabric; InputError without a fibre density."""
        if self.fibre_density is None:
            raise InputError(
                f"fibre_density of material {self.name or self.law} is not known; allowed is a "
                "number above 0 [g/cm3]"
            )
        fibres = self.density / self.fibre_density * self.thickness  # as a layer without pores [mm]
        return fibres / (np.asarray(thickness, float) * area)

    @property
    def shear_stiffness(self) -> float:
        """The law's stiffness in shear at rest, d2W/dgamma2 [MPa]."""
        second = self.derivatives(*np.zeros((3, 1))).second
        assert second is not None
        return float(second[5, 0])

    @property
    def couplings(self) -> frozenset[str]:
        """Which of `COUPLINGS` are on."""
        return frozenset()

    def without(self, *names: str) -> Self:
        """A copy with these couplings off; InputError for an unknown name, and for a coupling that
        the energy has: a law that can switch it off overrides this and `couplings`."""
        off = check_couplings(names, "without")
        if kept := [name for name in COUPLINGS if name in off and self._couples(name)]:
            raise InputError(
                f"without: the energy of law {self.law} has the coupling {', '.join(kept)}, and "
                "the law cannot switch it off; allowed is a class that has a method for it"
            )
        return self

    def _couples(self, name):
        """Whether the energy depends on two strains together where this coupling acts."""
        second = Law.derivatives(self, *np.transpose(PROBES[name])).second
        assert second is not None
        mixed = second[1:2] if name == "biaxial" else second[3:5]
        return bool(abs(mixed).max() > 1e-9 * abs(second).max())

    def check_rest(self) -> None:
        """InputError where the fabric as it lies, without strain, has energy or stress, where its
        stiffness is negative there, and for `derivatives` of other shapes."""
        self.check_shapes()
        found = Law.derivatives(self, *np.transpose([(0.0, 0.0, 0.0), (0.01, 0.01, 0.1)]))
        assert found.second is not None
        stiffness = np.nanmax(abs(found.second[[0, 2, 5]]), 1, initial=0.0)
        words = f"of law {self.law} is %.3g MPa in fabric as it lies, without strain; allowed is 0"
        if abs(W := found.parts[0].sum()) > 1e-9 * stiffness.max():
            raise InputError(f"the energy {words % W}: take off what it is there")
        for name, stress, scale in zip(("sigma_a", "sigma_b", "tau"), found.first[:, 0], stiffness):
            if not abs(stress) <= 1e-5 * scale:
                raise InputError(f"the stress {name} {words % stress}")
        beside = Law.derivatives(self, *np.array(3 * [[-LITTLE, LITTLE]])).second
        assert beside is not None
        for name, k, scale in zip(("eps_a", "eps_b", "gamma"), beside[[0, 2, 5]], stiffness):
            if k.min() < -1e-6 * scale:
                raise InputError(
                    f"the stiffness of law {self.law} along {name} is {rounded(k.min())} MPa in "
                    "fabric as it lies, without strain; allowed is 0 or more: look at its signs"
                )

    def check_shapes(self) -> None:
        """InputError where closed forms of `derivatives` have not the shapes that it says."""
        none, right = np.zeros(2), [(2, 3), (3, 2), (6, 2)]
        for second in (True, False):
            shapes: list[object] = []
            try:
                given: Any = self.derivatives(none, none, none, second)
                shapes += [np.shape(each) for each in given]
                fits = shapes[: 2 + second] == right[: 2 + second]
                fits = fits and isinstance(given, Derivatives)
            except TypeError as error:
                fits, shapes = False, [error]
            if not fits:
                raise InputError(
                    f"`derivatives` of law {self.law} gives {', '.join(map(str, shapes))} at n = 2 "
                    f"states with second={second}; allowed is `Derivatives` of parts (n, 3), first "
                    "(3, n) and second (6, n), None where `second` is False"
                )

    def decoupled(self) -> Self:
        """A copy with every coupling off: three independent curves, like Abaqus' FABRIC."""
        return self.without(*COUPLINGS)

    def plausibility_warnings(self) -> list[str]:
        """Sentences on values outside of `PLAUSIBLE`, which may be in a wrong unit: of yarns the
        stiffness at 1 % strain."""
        second = self.derivatives(*np.array([[0.01], [0.01], [0.0]])).second
        assert second is not None
        values = [("stiffness along a", second[0, 0]), ("stiffness along b", second[2, 0])]
        return self._implausible([*values, ("stiffness in shear", self.shear_stiffness)])

    def _implausible(self, values):
        """A sentence on each of these (name, value), thickness and density that is so."""
        found = []
        values = [*values, ("thickness", self.thickness), ("density", self.density)]
        values += [] if self.fibre_density is None else [("fibre_density", self.fibre_density)]
        for name, value in values:
            low, high, unit = PLAUSIBLE[name]
            if not low <= value <= high:
                found.append(
                    f"{name} of material {self.name or self.law} is {value:g} {unit}, "
                    f"fabrics have {low:g} to {high:g}; look at its unit"
                )
        return found

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the law's numbers."""
        return tuple(self.rules)

    def require(self, names: Iterable[str], label: str) -> None:
        """InputError, which calls this fabric `label`, unless its law has these parameters."""
        if missing := [name for name in names if name not in self.parameters]:
            raise InputError(
                f"{label} is of the law {self.law}, which has no {', '.join(missing)}; "
                "allowed is a material of a law that has"
            )

    def table(self) -> dict[str, Any]:
        """What a material file says of the fabric."""
        units = {kind: next(iter(names)) for kind, names in UNITS.items() if kind != "areal_weight"}
        numbers = {name: getattr(self, name) for name in self.rules}
        return {"law": self.law} | self.sheet_table() | numbers | {"units": units}

    def sheet_table(self) -> dict[str, Any]:
        """What a material file of any law says: all but the law and its numbers."""
        known = {name: getattr(self, name) for name in ("name", *SHEET, *FIBRES)}
        told = {name: value for name, value in known.items() if value is not None}
        told |= {"assumed": list(self.assumed)} if self.assumed else {}
        return told | {"compaction": table_of(self.compaction)}

    @classmethod
    def from_document(cls, document: dict[str, Any], folder: Path) -> Self:
        """The fabric of a TOML document that lies in `folder`; InputError by field."""
        document.pop("law", None)
        fields = sheet_fields(document, take_units(document), ("law", "units"), cls.rules)
        return cls(**fields)


def sheet_fields(
    document: dict[str, Any],
    units: Mapping[str, str],
    also: tuple[str, ...] = (),
    rules: Mapping[str, Rule] | None = None,
) -> dict[str, Any]:
    """The fields that every law has, and the numbers of `rules`, from what a law leaves of a TOML
    document; units: of its table [units], also: keys that the law took. Raises InputError by key,
    and for a number that is missing."""
    fields = {"name": document.pop("name", ""), "compaction": compaction_of(document, units)}
    fields |= {"assumed": document.pop("assumed", ())}
    known, rules = (*also, *fields), rules or {}
    fields |= read_sheet_numbers(document, units, known, {**FIBRES, **rules})[0]
    check_complete(fields, (*SHEET, *rules), "", "at the top of the file")
    return fields


def coupling_variants(fabric: Law) -> dict[str, Law]:
    """{label: fabric} with all couplings, without some, and the decoupled baseline, as Figs 10 and
    16 of the paper compare them. InputError for a fabric without couplings."""
    variants = {
        "all couplings": fabric,
        "without biaxial": fabric.without("biaxial"),
        "without shear couplings": fabric.without("tension_shear", "compression_shear"),
        "FABRIC": fabric.decoupled(),
    }
    if not fabric.couplings:
        raise InputError(
            f"variants of the couplings are asked for, and the fabric, of law {fabric.law}, has "
            "none; allowed is a fabric with couplings, as komeili"
        )
    return variants


def stresses_of_energy(
    law: Law, eps_a: ArrayLike, eps_b: ArrayLike, gamma: ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """sigma_a, sigma_b, tau (n,) [MPa] from the energy alone, without the law's closed forms.

    eps_a, eps_b [-], gamma [rad]: (n,) or a number each. Per undeformed volume, so F:P-conjugate
    (eq. 14 calls sigma_a at eps_b = 0, gamma = 0 sigma-hat). Kernel and elements must hit them.
    """
    ea, eb, g = np.broadcast_arrays(
        *(np.atleast_1d(v).astype(float) for v in (eps_a, eps_b, gamma))
    )
    sigma_a, sigma_b, tau = Law.derivatives(law, ea, eb, g, second=False).first
    return sigma_a, sigma_b, tau
