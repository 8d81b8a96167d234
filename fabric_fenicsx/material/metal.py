"""Sheet metals: elasticity, thickness, and yield stress over plastic strain, a formula or a table.

Stresses are Kirchhoff's, which differ from Cauchy's by the change of volume, less than 1 in 1000.
A curve is one frozen dataclass, whose `law` is its name in material files. Yield stresses never
fall, so that what a step minimises is convex.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Self

import numpy as np

from ..core import rules as numbers
from ..core.errors import InputError
from ..core.rules import Rule, above_zero, check_complete, not_negative, repr_short, unknown_key
from . import files
from .files import OWN_UNITS, Document, Several
from .functions import curve_through
from .material import Material, Parameters, Scatter, parameter, parameters


@dataclass(frozen=True)
class Hardening(Parameters):
    """Yield stress of an equivalent plastic strain p, its slope, and the work that flow up to p
    takes, each of p (n,) from 0; raises InputError for a parameter out of its range."""

    law: ClassVar[str] = ""
    known: "ClassVar[dict[str, type[Hardening]]]" = {}  # by their names in material files

    def __init_subclass__(cls) -> None:
        cls.known[cls.law] = cls

    def stress(self, p: np.ndarray) -> np.ndarray:
        """Yield stress [MPa]."""
        raise NotImplementedError

    def slope(self, p: np.ndarray) -> np.ndarray:
        """Its derivative [MPa]."""
        raise NotImplementedError

    def work(self, p: np.ndarray) -> np.ndarray:
        """Its integral from 0, which flow dissipates per volume [N mm/mm^3]."""
        raise NotImplementedError

    def table(self) -> Document:
        return {"law": self.law} | super().table()


@parameters
@dataclass(frozen=True)
class Swift(Hardening):
    """Yield stress K (eps0 + p)^n.

    References
    ----------
    Swift, J. Mech. Phys. Solids 1, 1952.

    Examples
    --------
    >>> ff.Swift(500.0, 0.01, 0.5).stress(np.array([0.0])).tolist()
    [50.0]
    """

    law = "swift"

    K: float = parameter(above_zero("stress"), "stress at eps0 + p = 1 [MPa]")
    eps0: float = parameter(above_zero(), "strain offset [-]")
    n: float = parameter(numbers.fraction(), "exponent, 0 to 1 [-]; 0 is ideal plasticity")

    def stress(self, p: np.ndarray) -> np.ndarray:
        return self.K * (self.eps0 + p) ** self.n

    def slope(self, p: np.ndarray) -> np.ndarray:
        return self.n * self.K * (self.eps0 + p) ** (self.n - 1)

    def work(self, p: np.ndarray) -> np.ndarray:
        power = self.n + 1
        return self.K / power * ((self.eps0 + p) ** power - self.eps0**power)


@parameters
@dataclass(frozen=True)
class Voce(Hardening):
    """Yield stress Y0 + Q (1 - exp(-b p)), which ends at Y0 + Q.

    References
    ----------
    Voce, J. Inst. Met. 74, 1948.

    Examples
    --------
    >>> ff.Voce(160.0, 180.0, 14.0).stress(np.array([0.0, 10.0])).tolist()
    [160.0, 340.0]
    """

    law = "voce"

    Y0: float = parameter(above_zero("stress"), "first yield stress [MPa]")
    Q: float = parameter(not_negative("stress"), "increase at large strain [MPa]")
    b: float = parameter(above_zero(), "rate of hardening [-]")

    def stress(self, p: np.ndarray) -> np.ndarray:
        return self.Y0 - self.Q * np.expm1(-self.b * p)

    def slope(self, p: np.ndarray) -> np.ndarray:
        return self.Q * self.b * np.exp(-self.b * p)

    def work(self, p: np.ndarray) -> np.ndarray:
        return (self.Y0 + self.Q) * p + self.Q * np.expm1(-self.b * p) / self.b


@parameters
@dataclass(frozen=True)
class HardeningTable(Hardening):
    """Yield stress through points.

    Between them it is a monotone cubic (SciPy's PCHIP), beyond the last a straight line with its
    slope there. Raises InputError for other points than these; it names the point.

    Examples
    --------
    >>> curve = ff.HardeningTable((0.0, 0.1, 0.3), (160.0, 260.0, 330.0))
    >>> curve.stress(np.array([0.1])).tolist()
    [260.0]
    """

    law = "table"

    eps: tuple[float, ...] = parameter(
        Several(numbers.FINITE), "plastic strains (n,), n >= 2, increasing from 0 [-]"
    )
    sigma: tuple[float, ...] = parameter(
        Several(numbers.of_either_sign("stress")), "positive, non-decreasing stresses (n,) [MPa]"
    )
    _curves: tuple = field(init=False, repr=False, compare=False)  # work, stress and slope

    def __post_init__(self) -> None:
        super().__post_init__()
        points = [*zip(self.eps, self.sigma)]
        flaws = [
            f"hardening: point {k} is {(e, stress)}; expected strains that increase from 0 and "
            "stresses above 0 that do not fall"
            for k, ((e, stress), (before, least)) in enumerate(zip(points, [(-1, 0), *points]), 1)
            if not (e > before and stress >= least and (k > 1 or e == 0 < stress))
        ]
        if len(self.eps) != len(self.sigma) or len(points) < 2:
            allowed = "expected two lists of 2 or more numbers"
            flaws = [f"hardening.eps and sigma differ in length or are too short; {allowed}"]
        for flaw in flaws[:1]:
            raise InputError(flaw)
        object.__setattr__(self, "_curves", curve_through(self.eps, self.sigma))

    def stress(self, p: np.ndarray) -> np.ndarray:
        return self._curves[1](p)

    def slope(self, p: np.ndarray) -> np.ndarray:
        return self._curves[2](p)

    def work(self, p: np.ndarray) -> np.ndarray:
        return self._curves[0](p)


@parameters
@dataclass(frozen=True)
class Metal(Material):
    """An isotropic metal with von Mises yielding.

    Examples
    --------
    >>> steel = ff.Metal(186600.0, 0.3, ff.Swift(520.0, 0.002, 0.2), thickness=1.0)
    >>> steel.replace(thickness=0.8).thickness
    0.8
    """

    factors = {"yield_factor": ("hardening",)}
    law: ClassVar[str] = "metal"  # its name in material files

    E: float = parameter(above_zero("stress"), "Young's modulus [MPa]")
    nu: float = parameter(
        Rule("a number from 0 to 0.5", lambda v: 0 <= v <= 0.5), "Poisson's ratio [-]"
    )
    hardening: Hardening = parameter(
        None, "`Swift`, `Voce` or `HardeningTable`: yield stress against equivalent plastic strain"
    )
    thickness: float = parameter(None, "thickness of the sheet [mm]")
    density: float = parameter(None, "mass per volume [g/cm3]", 7.85)
    name: str = parameter(None, "used in results and messages", "")
    scatter: Scatter = parameter(None, "as of a `Law`", dict, compare=False)

    def table(self) -> Document:
        numbers = {name: getattr(self, name) for name in ("law", "name", *self.numbers())}
        tables = {"units": OWN_UNITS, "hardening": self.hardening.table()}
        return numbers | tables | ({"scatter": dict(self.scatter)} if self.scatter else {})

    @classmethod
    def from_document(cls, document: Document, folder: Path) -> Self:
        law = document.pop("law", None)
        if law != cls.law:
            raise InputError(
                f"law is {repr_short(law)}; expected {repr_short(cls.law)} for a metal"
            )
        name = document.pop("name", "")
        units, curve = files.take_units(document), files.take_table(document, "hardening")
        scatter = files.read_scatter(document, cls.numbers(), cls.factors, units)
        also = ("law", "name", "units", "hardening")
        numbers = files.read_sheet_numbers(document, units, also, cls.rules)[0]
        check_complete(numbers, [*cls.rules, "thickness"], "", "at the top of the file")
        law, known = curve.pop("law", None), Hardening.known
        if not isinstance(law, str) or law not in known:
            raise unknown_key(law, known, f"hardening.law {repr_short(law)}")
        hardening = known[law].from_table(curve, units, "hardening")
        return cls(**numbers, hardening=hardening, name=name, scatter=scatter)


# E, nu and the stress of 159 MPa at 0.05 % plastic strain: Table 2 of the paper. It prints no
# curve, so Swift's is taken through that yield point and the tensile strength in the middle of what
# EN 10130 allows for DC04, 270 to 350 MPa, with an exponent of 0.2, where it asks for 0.18 or more.
# The largest force is where stress equals its slope, so 310 MPa = K n^n exp(eps0 - n).
# Thickness: DC04 in laminates of the same group, Werner, Poppe, Henning and Kärger, Procedia
# Manufacturing 47 (2020) 154-161.
_SWIFT = Swift(521.29711259593885, 0.0021397270602765543, 0.2)
_DC04 = Metal(186600.0, 0.3, _SWIFT, thickness=1.0, name="dc04")
METALS: Mapping[str, Metal] = MappingProxyType({"dc04": _DC04})


def load_metal(source: str | os.PathLike[str]) -> Metal:
    """Load a metal by the name of a preset or from a material file.

    Raises InputError if there is neither a preset nor a file, and for errors in the file, by
    field.

    Parameters
    ----------
    source : str or path
        A preset, or the path of a TOML file with `law = "metal"`. `dc04` is the deep-drawing
        steel of the paper's laminate, 1 mm thick: E, nu and Rp0.05 of its Table 2; tensile
        strength (310 MPa) and exponent (0.2) are within the limits of EN 10130 for DC04.

    Returns
    -------
    Metal

    Examples
    --------
    >>> ff.load_metal("dc04").E
    186600.0
    """
    return files.preset_or_file("metal", source, METALS, Metal.from_toml)
