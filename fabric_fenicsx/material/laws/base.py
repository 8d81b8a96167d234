"""A law of fabrics: the numbers that every one has, and what is asked of it."""

import dataclasses
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Self

import numpy as np

from ...core.errors import InputError
from ...core.rules import FINITE, POSITIVE, Rule, check_complete, repr_short, unknown_key
from ...core.tables import as_list
from ...io.units import OWN
from .. import files
from ..bending import MeasuredBending
from ..compaction import Compaction
from ..energy import COUPLINGS, Derivatives, Energy, Range, check_couplings, stresses_of_energy
from ..files import FIBRES, OWN_UNITS, SHEET, Document, read_numbers
from ..friction import BendingFriction, ShearFriction
from ..functions import Number
from ..material import Material, Parameters, Scatter, parameter, parameters

__all__ = ["COUPLINGS", "LAWS", "Derivatives", "Law", "Material", "Range", "stresses_of_energy"]

LAWS: "dict[str, type[Law]]" = {}  # by their names in material files
# fields of a law that are tables of its file, where `false` stands for none
TABLES: dict[str, type[Parameters]] = {
    "compaction": Compaction,
    "shear_friction": ShearFriction,
    "bending_friction": BendingFriction,
    "bending": MeasuredBending,
}


@parameters
@dataclass(frozen=True)
class Law(Material, Energy):
    """A fabric: the parameters of a constitutive law and common properties.

    A law is one frozen dataclass in one file. It defines `law`, its name in material files;
    `rules`, a `Rule` for each parameter; and `energy`, from which all else is derived. It may have
    closed forms for the kernel (`derivatives`), and `factors` that multiply several parameters
    together, for `changed`.

    Examples
    --------
    >>> fabric = ff.load("komeili")
    >>> fabric.law
    'coupled'
    >>> states = np.array([[0.01, 0.02], [0.0, 0.0], [0.0, 0.3]])  # eps_a, eps_b, gamma
    >>> fabric.derivatives(*states).first.shape  # sigma_a, sigma_b, tau [MPa]
    (3, 2)
    >>> fabric.replace(thickness=0.5).thickness
    0.5
    """

    _: KW_ONLY
    thickness: float = parameter(None, "thickness of the sheet [mm]", 1.0)
    density: float = parameter(None, "mass per volume of the sheet [g/cm3]", 0.75)
    name: str = parameter(None, "used in results and messages", "")
    compaction: Compaction | None = parameter(
        None, "law of compaction; None for rigid faces", Compaction()
    )
    shear_friction: ShearFriction | None = parameter(
        None, "friction between yarns in shear, `ShearFriction`; None for elastic shear", None
    )
    bending_friction: BendingFriction | None = parameter(None, "the same in bending", None)
    bending: MeasuredBending | None = parameter(
        None, "measured bending, `MeasuredBending`; None for the bending modulus of the sheet", None
    )
    fibre_density: float | None = parameter(
        None, "density of the fibres [g/cm3], None if unknown", None
    )
    fibre_share: float | None = parameter(
        None, "mass fraction of fibres in fabric that contains its matrix; None for 1", None
    )
    at_temperatures: Mapping[float, Mapping[str, float]] = parameter(
        None, "{temperature [deg C]: {parameter or factor: value}}, for `at`", dict, hash=False
    )
    # where numbers are from does not make another fabric
    assumed: tuple[str, ...] = parameter(
        None, "names of parameters that no test has determined", (), compare=False
    )
    scatter: Scatter = parameter(
        None, "{parameter or factor: (lowest, highest)}, for `fabric sweep`", dict, compare=False
    )

    def __init_subclass__(cls) -> None:
        other = LAWS.get(cls.law, cls)
        has_energy = "energy" in vars(cls) and "derivatives" not in vars(cls)
        flaw = ""
        # the same class again, as from a notebook's cell run twice, replaces itself
        if (other.__module__, other.__qualname__) != (cls.__module__, cls.__qualname__):
            flaw = f"of class {cls.__name__} is {cls.law!r}; expected a name of its own, other "
            flaw += f"than {', '.join(sorted(LAWS))}"
        elif has_energy and cls.derivatives != Law.derivatives:
            flaw = f"{cls.law} has an `energy` of its own but inherits closed-form `derivatives`; "
            flaw += "expected `derivatives = ff.Law.derivatives`, or its own"
        if flaw:
            raise InputError(f"law {flaw}")
        LAWS[cls.law] = cls

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.assumed:
            if name not in self.parameters:
                raise unknown_key(name, self.parameters, f"assumed: {repr_short(name)}")
        assumed = tuple(filter(self.assumed.__contains__, self.parameters))
        object.__setattr__(self, "assumed", assumed)
        object.__setattr__(self, "at_temperatures", self._checked_temperatures())
        for name, rule in FIBRES.items():
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, rule.check(name, value))
        if self.fibre_density is not None and not self.fibre_density > self._fibre_mass:
            raise InputError(
                f"fibre_density is {self.fibre_density:g} g/cm3; expected more than the "
                f"{self._fibre_mass:g} g of fibres in 1 cm3 of fabric (by `fibre_share`, if it has "
                "a matrix)"
            )

    @property
    def _fibre_mass(self):
        return self.density * (self.fibre_share or 1.0)  # per volume of fabric [g/cm3]

    def _checked_temperatures(self):
        tables = {FINITE.check("temperature", t): at for t, at in self.at_temperatures.items()}
        if len(tables) == 1:
            raise InputError(f"at has only the temperature {min(tables):g}; expected 2 or more")
        rules, names = self.rules_at_temperatures(), {*next(iter(tables.values()), ())}
        for temperature, numbers in tables.items():
            where = f"at temperature {temperature:g}: "
            tables[temperature] = read_numbers(numbers, rules, OWN, where)
            check_complete(numbers, names, where, "at each temperature the same")
            names |= {*numbers}
        return dict(sorted(tables.items()))

    @classmethod
    def rules_at_temperatures(cls) -> Mapping[str, Rule]:
        """The rules of what may depend on the temperature: numbers but for those of the sheet, and
        factors."""
        rules = {name: rule for name, rule in cls.numbers().items() if name not in SHEET}
        return rules | dict.fromkeys(cls.factors, POSITIVE)

    def _measured(self):
        plain, at = dataclasses.replace(self, at_temperatures={}), self.at_temperatures
        return [*at], [Material.changed(plain, numbers) for numbers in at.values()]

    def check_temperatures(self, temperatures: Number | None) -> list[float]:
        """The temperatures [deg C]; InputError for one beyond those that are known, without such,
        and for None where there are some."""
        known = [*self.at_temperatures]
        given: list = [None] if temperatures is None else np.ravel(temperatures).tolist()
        for t in given:
            if not known or t is None or not known[0] <= t <= known[-1]:
                value = "missing" if t is None else f"{t:g}"
                ends = f"from {known[0]:g} to {known[-1]:g} deg C" if known else "none"
                raise InputError(
                    f"`temperature` is {value}; expected {ends}, as material {self.label} has "
                    f"{'' if known else 'no '}parameters at temperatures, [[at]]"
                )
        return given

    def at(self, temperature: float | None) -> Self:
        """The fabric at a temperature [deg C], with each number interpolated linearly between those
        at the temperatures next to it. InputError as of `check_temperatures`."""
        if temperature is None and not self.at_temperatures:
            return self
        (warm,) = self.check_temperatures(temperature)
        known, tables = [*self.at_temperatures], [*self.at_temperatures.values()]
        numbers = {k: float(np.interp(warm, known, [at[k] for at in tables])) for k in tables[0]}
        plain = dataclasses.replace(self, at_temperatures={}, name=f"{self.label} at {warm:g} C")
        return Material.changed(plain, numbers)

    def numbers_at(self, temperatures: np.ndarray) -> np.ndarray:
        """The numbers of `symbols` at temperatures (n,) [deg C], (n, numbers), as of `at`."""
        known, fabrics = self._measured()
        columns = np.transpose([numbers_of(fabric) for fabric in fabrics])
        return np.stack([np.interp(temperatures, known, column) for column in columns], axis=1)

    def by_points(self, numbers: np.ndarray) -> Self:
        """The law of points of which each has its `numbers` (n, numbers), in the order of
        `symbols`, for their states alone."""
        columns = iter(np.transpose(numbers))
        new = self.symbols(lambda _: next(columns))
        object.__setattr__(new, "count", len(numbers))
        return new

    def changed(self, numbers: Mapping[str, object]) -> Self:
        new = super().changed(numbers)
        for name in numbers if self.at_temperatures else ():
            alone = super().changed({name: numbers[name]})
            if alone != self and alone._measured() == self._measured():
                raise InputError(
                    f"{name} is changed, and material {self.label} has its own at each "
                    "temperature; change only parameters that are not in [[at]]"
                )
        return new

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the law's numbers."""
        return tuple(self.rules)

    def assumed_values(self) -> dict[str, str]:
        values = {}
        for name in filter(self._acts, self.assumed):
            unit = OWN.get(self.numbers()[name].unit, "")
            values[name] = " and ".join(f"{v:g} {unit}".strip() for v in self.values(name))
        return values

    def _acts(self, name):
        return True

    def thickness_under(self, pressure: float) -> float:
        share = float(self.compaction.thickness(pressure)) if self.compaction else 1.0
        return share * self.thickness

    def fibre_volume_fraction(
        self, thickness: float | np.ndarray, area: float | np.ndarray = 1.0
    ) -> np.ndarray:
        """Share of the volume that is fibres where the sheet is `thickness` [mm] thick and `area`
        times as large as the flat fabric; InputError without a fibre density."""
        if self.fibre_density is None:
            raise InputError(
                f"fibre_density of material {self.label} is not known; expected one [g/cm3]"
            )
        fibres = self._fibre_mass / self.fibre_density * self.thickness
        return fibres / (np.asarray(thickness, float) * area)

    @property
    def couplings(self) -> frozenset[str]:
        """The couplings of `COUPLINGS` that are on."""
        return frozenset()

    def without(self, *names: str) -> Self:
        """A copy with these couplings off; InputError for an unknown name, and for a coupling that
        the energy has: a law that can switch it off overrides this and `couplings`."""
        for name in sorted(check_couplings(names, "without")):
            if self.couples(name):
                raise InputError(
                    f"without: the energy of law {self.law} has the coupling {name}, and the law "
                    "cannot switch it off; expected a class that has a method for it"
                )
        return self

    def decoupled(self) -> Self:
        """A copy with every coupling off: three independent curves, like Abaqus' FABRIC."""
        return self.without(*COUPLINGS)

    def plausibility_warnings(self) -> list[str]:
        """As of `Material`, of yarns on the stiffness at 1 % strain."""
        along_a, _, along_b, *_ = self.derivatives(*np.array([[0.01], [0.01], [0.0]])).second[:, 0]
        values = {"stiffness along a": along_a, "stiffness along b": along_b}
        return self._implausible(values | {"stiffness in shear": self.shear_stiffness})

    def _implausible(self, values):
        """A sentence on each value {name: value} that fabrics hardly have, also of the sheet."""
        sheet = {name: getattr(self, name) for name in (*SHEET, *FIBRES)}
        # what fabrics have, widely taken; beyond it a unit is probably wrong
        plausible = {
            "thickness": (0.01, 20.0, "mm"),
            "density": (0.05, 10.0, "g/cm3"),
            "fibre_density": (0.8, 10.0, "g/cm3"),
            "fibre_share": (0.1, 1.0, "of the mass"),
            **{f"b of {yarn}": (1.0, 1e5, "MPa") for yarn in ("yarns", "warp", "weft")},
            "s1": (1e-4, 10.0, "MPa"),
            "stiffness along a": (2.0, 2e5, "MPa"),
            "stiffness along b": (2.0, 2e5, "MPa"),
            "stiffness in shear": (1e-4, 10.0, "MPa"),
        }
        sentences = []
        for name, value in (values | sheet).items():
            low, high, unit = plausible[name]
            if value is not None and not low <= value <= high:
                fabrics = f"fabrics have {low:g} to {high:g}; check its unit"
                sentences.append(f"{name} of material {self.label} is {value:g} {unit}, {fabrics}")
        return sentences

    def table(self) -> Document:
        numbers = {name: getattr(self, name) for name in self.rules}
        return {"law": self.law} | self.sheet_table() | numbers | {"units": OWN_UNITS}

    def sheet_table(self) -> Document:
        """A material file's content but for the law and its numbers."""
        entries = {name: getattr(self, name) for name in (*SHEET, *FIBRES)}
        entries |= {"assumed": list(self.assumed), "scatter": dict(self.scatter)}
        at = self.at_temperatures.items()
        entries["at"] = [{"temperature": warm, **numbers} for warm, numbers in at]
        tables = {name: part.table() for name in TABLES if (part := getattr(self, name))}
        written = {name: value for name, value in entries.items() if value}
        return {"name": self.name} | written | {"compaction": False} | tables

    @classmethod
    def from_document(cls, document: Document, folder: Path) -> Self:
        document.pop("law", None)
        units = files.take_units(document)
        return cls(**sheet_fields(cls, document, units, ("law", "units"), cls.rules))


def sheet_fields(
    law: type[Law],
    document: Document,
    units: Mapping[str, str],
    also: tuple[str, ...],
    rules: Mapping[str, Rule],
) -> Document:
    """The fields that every law has, and the numbers of `rules`, from what a `law` leaves of a TOML
    document; units: of its table [units], also: keys that the law took. Raises InputError by key,
    and for a number that is missing."""
    fields: Document = {"name": document.pop("name", "")}
    for key, kind in TABLES.items():
        if document.get(key) is False:
            fields[key] = document.pop(key) or None
        elif key in document:
            fields[key] = kind.from_table(files.take_table(document, key), units, key)
    fields["assumed"] = assumed = document.pop("assumed", ())
    if not isinstance(assumed, (list, tuple)):
        raise InputError(f"assumed is {repr_short(assumed)}; expected a list of parameters")
    fields |= {"scatter": files.read_scatter(document, law.numbers(), law.factors, units)}
    at_rules, at = {"temperature": FINITE} | dict(law.rules_at_temperatures()), {}
    tables = as_list(document.pop("at"), "at") if "at" in document else []
    for k, table in enumerate(tables, 1):
        numbers = read_numbers(table, at_rules, units, f"at.{k}.")
        check_complete(numbers, ["temperature"], f"at.{k}.", "in each [[at]]")
        if (temperature := numbers.pop("temperature")) in at:
            raise InputError(f"at.{k}.temperature is {temperature:g} again; use each once")
        at[temperature] = numbers
    fields["at_temperatures"] = at
    keys = (*also, *fields, "at", *TABLES)
    fields |= files.read_sheet_numbers(document, units, keys, {**FIBRES, **rules})[0]
    check_complete(fields, (*SHEET, *rules), "", "at the top of the file")
    return fields


def numbers_of(law: Parameters) -> list[float]:
    """The numbers that `symbols` replaces, in its order."""
    numbers: list[float] = []
    law.symbols(numbers.append)
    return numbers
