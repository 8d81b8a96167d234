"""Hardening of metals: yield stress over equivalent plastic strain, by a formula or a table.

Stresses are Kirchhoff's, which differ from Cauchy's by the change of volume, less than 1 in 1000.
A curve is one frozen dataclass, whose `law` is its name in material files; adding one touches this
file alone. Yield stresses never fall, so that what a step minimises is convex.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..core import rules as numbers
from ..core.errors import InputError
from ..core.rules import above_zero, not_negative
from .files import Document, Several
from .material import Parameters, parameter, parameters


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
    eps0: float = parameter(above_zero(), "strain before the first yield [-]")
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
    Q: float = parameter(not_negative("stress"), "its growth [MPa]")
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

    Between them it is a monotone cubic (SciPy's PCHIP), beyond the last a straight line at its
    slope there. Raises InputError for other points than these; it names the point.

    Examples
    --------
    >>> curve = ff.HardeningTable((0.0, 0.1, 0.3), (160.0, 260.0, 330.0))
    >>> curve.stress(np.array([0.1])).tolist()
    [260.0]
    """

    law = "table"

    eps: tuple[float, ...] = parameter(
        Several(numbers.FINITE), "plastic strains (n,), n >= 2, rising from 0 [-]"
    )
    sigma: tuple[float, ...] = parameter(
        Several(numbers.of_either_sign("stress")), "stresses (n,) above 0 that do not fall [MPa]"
    )
    _curves: tuple = field(init=False, repr=False, compare=False)  # stress, slope and work

    def __post_init__(self) -> None:
        super().__post_init__()
        points = [*zip(self.eps, self.sigma)]
        flaws = [
            f"hardening: point {k} is {(e, stress)}; allowed are strains that rise from 0 and "
            "stresses above 0 that do not fall"
            for k, ((e, stress), (before, least)) in enumerate(zip(points, [(-1, 0), *points]), 1)
            if not (e > before and stress >= least and (k > 1 or e == 0 < stress))
        ]
        if len(self.eps) != len(self.sigma) or len(points) < 2:
            allowed = "allowed are two lists of 2 or more numbers"
            flaws = [f"hardening.eps and sigma differ in length or are too short; {allowed}"]
        for flaw in flaws[:1]:
            raise InputError(flaw)
        from scipy.interpolate import PchipInterpolator  # takes long to import

        curve = PchipInterpolator(self.eps, self.sigma)
        slope = max(float(curve(self.eps[-1], 1)), 0.0)
        end = [0, 0, slope, self.sigma[-1]]  # a straight line, which goes on
        curve.extend(np.reshape(end, (4, 1)), [self.eps[-1] + 1])
        object.__setattr__(self, "_curves", (curve, curve.derivative(), curve.antiderivative()))

    def stress(self, p: np.ndarray) -> np.ndarray:
        return self._curves[0](p)

    def slope(self, p: np.ndarray) -> np.ndarray:
        return self._curves[1](p)

    def work(self, p: np.ndarray) -> np.ndarray:
        return self._curves[2](p)


def hardening_from(table: Document, units: Mapping[str, str]) -> Hardening:
    """The curve of a file's table [hardening]; units: of its table [units]. InputError by key."""
    law = table.pop("law", None)
    if not isinstance(law, str) or law not in Hardening.known:
        raise numbers.unknown_key(law, Hardening.known, f"hardening.law {numbers.repr_short(law)}")
    return Hardening.known[law].from_table(table, units, "hardening")
