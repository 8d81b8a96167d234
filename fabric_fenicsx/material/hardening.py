"""Hardening of metals: yield stress over equivalent plastic strain, by a formula or a table.

Stresses are Kirchhoff's, which differ from Cauchy's by the change of volume, less than 1 in 1000.
A curve is one frozen dataclass, whose `law` is its name in material files; adding one touches this
file alone. Yield stresses never fall, so that what a step minimises is convex.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from ..readers.units import power_of_key
from ..runtime.errors import InputError
from ..runtime.rules import (
    FINITE,
    above_zero,
    check_complete,
    fraction,
    not_negative,
    shown,
    unknown_key,
)
from .files import read_numbers
from .parameters import Parameters

CURVES: "dict[str, type[Hardening]]" = {}  # by their names in material files
WHERE = "hardening."


@dataclass(frozen=True)
class Hardening(Parameters):
    """Yield stress of an equivalent plastic strain p, its slope, and the work that flow up to p
    takes, each of p (n,) from 0; raises InputError for a parameter out of its range."""

    law: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        CURVES[cls.law] = cls

    def stress(self, p: np.ndarray) -> np.ndarray:
        """Yield stress [MPa]."""
        raise NotImplementedError

    def slope(self, p: np.ndarray) -> np.ndarray:
        """Its derivative [MPa]."""
        raise NotImplementedError

    def work(self, p: np.ndarray) -> np.ndarray:
        """Its integral from 0, what flow dissipates per volume [N mm/mm^3]."""
        raise NotImplementedError

    def table(self) -> dict[str, Any]:
        """What a material file says of it, in MPa."""
        return {"law": self.law} | {name: getattr(self, name) for name in self.rules}

    @classmethod
    def from_table(cls, table: Mapping[str, Any], units: Mapping[str, str]) -> Self:
        """The curve of a file's table [hardening], without its law; InputError by key."""
        numbers = read_numbers(table, cls.rules, units, WHERE, ("law",))
        check_complete(numbers, cls.rules, WHERE, "in [hardening]")
        return cls(**numbers)


@dataclass(frozen=True)
class Swift(Hardening):
    """K (eps0 + p)^n (Swift, J. Mech. Phys. Solids 1, 1952): K [MPa], eps0, n [-]; n = 0 is ideal
    plasticity."""

    law = "swift"
    rules = {"K": above_zero("stress"), "eps0": above_zero(), "n": fraction()}

    K: float
    eps0: float
    n: float

    @classmethod
    def of_tensile_test(cls, proof: float, offset: float, tensile: float, n: float) -> Self:
        """The curve of a sheet with stress `proof` at plastic strain `offset`, the tensile strength
        `tensile` (engineering, [MPa]) and exponent `n`, above 0: the largest force is where stress
        equals its slope (Considère), at p = n - eps0, so tensile = K n^n exp(eps0 - n)."""
        eps0 = 0.0
        for _ in range(100):  # contracts, as K hardly depends on eps0
            K = tensile * np.exp(n - eps0) / n**n
            eps0 = (proof / K) ** (1 / n) - offset
        return cls(float(K), float(eps0), n)

    def stress(self, p: np.ndarray) -> np.ndarray:
        """As in `Hardening`."""
        return self.K * (self.eps0 + p) ** self.n

    def slope(self, p: np.ndarray) -> np.ndarray:
        """As in `Hardening`."""
        return self.n * self.K * (self.eps0 + p) ** (self.n - 1)

    def work(self, p: np.ndarray) -> np.ndarray:
        """As in `Hardening`."""
        power = self.n + 1
        return self.K / power * ((self.eps0 + p) ** power - self.eps0**power)


@dataclass(frozen=True)
class Voce(Hardening):
    """Y0 + Q (1 - exp(-b p)) (Voce, J. Inst. Met. 74, 1948): Y0, Q [MPa], b [-]."""

    law = "voce"
    rules = {"Y0": above_zero("stress"), "Q": not_negative("stress"), "b": above_zero()}

    Y0: float
    Q: float
    b: float

    def stress(self, p: np.ndarray) -> np.ndarray:
        """As in `Hardening`."""
        return self.Y0 - self.Q * np.expm1(-self.b * p)

    def slope(self, p: np.ndarray) -> np.ndarray:
        """As in `Hardening`."""
        return self.Q * self.b * np.exp(-self.b * p)

    def work(self, p: np.ndarray) -> np.ndarray:
        """As in `Hardening`."""
        return (self.Y0 + self.Q) * p + self.Q * np.expm1(-self.b * p) / self.b


@dataclass(frozen=True)
class HardeningTable(Hardening):
    """Through points: plastic strains `eps`, rising from 0, and stresses `sigma` [MPa] above 0 that
    do not fall, two or more of each.

    Between them a monotone cubic (SciPy's PCHIP), beyond the last a straight line at its slope
    there. Raises InputError, which names the point, for other points than these.
    """

    law = "table"

    eps: tuple[float, ...]
    sigma: tuple[float, ...]
    _curve: Any = field(init=False, repr=False, compare=False)
    _slope: Any = field(init=False, repr=False, compare=False)
    _work: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        try:
            eps, sigma = (
                np.array([FINITE.check("", each) for each in values])
                for values in (self.eps, self.sigma)
            )
        except (TypeError, InputError):
            raise InputError(
                f"{WHERE}eps or sigma is {shown((self.eps, self.sigma))}; allowed are lists of "
                "numbers"
            ) from None
        if eps.ndim != 1 or eps.shape != sigma.shape or len(eps) < 2:
            raise InputError(
                f"{WHERE}eps and sigma have shapes {eps.shape} and {sigma.shape}; allowed are two "
                "lists of 2 or more numbers, as many of each"
            )
        last = 0.0, 0.0
        for k, point in enumerate(zip(eps.tolist(), sigma.tolist())):
            rises = point[0] > last[0] if k else point[0] == 0
            if not (np.isfinite(point).all() and rises and point[1] > 0 and point[1] >= last[1]):
                raise InputError(
                    f"{WHERE}eps and sigma: point {k + 1} is {point}; allowed are strains that "
                    "rise from 0 and stresses above 0 that do not fall"
                )
            last = point
        object.__setattr__(self, "eps", tuple(eps.tolist()))
        object.__setattr__(self, "sigma", tuple(sigma.tolist()))
        from scipy.interpolate import PchipInterpolator  # takes long to import

        curve = PchipInterpolator(eps, sigma)
        object.__setattr__(self, "_curve", curve)
        object.__setattr__(self, "_slope", curve.derivative())
        object.__setattr__(self, "_work", curve.antiderivative())

    def _split(self, p):
        """What of p is within the table, and what beyond."""
        within = np.minimum(p, self.eps[-1])
        return within, p - within

    def stress(self, p: np.ndarray) -> np.ndarray:
        """As in `Hardening`."""
        within, beyond = self._split(p)
        return self._curve(within) + beyond * self._slope(self.eps[-1])

    def slope(self, p: np.ndarray) -> np.ndarray:
        """As in `Hardening`."""
        return self._slope(self._split(p)[0])

    def work(self, p: np.ndarray) -> np.ndarray:
        """As in `Hardening`."""
        within, beyond = self._split(p)
        end = self.sigma[-1] + beyond * self._slope(self.eps[-1]) / 2
        return self._work(within) + beyond * end

    def table(self) -> dict[str, Any]:
        """As in `Hardening`."""
        return {"law": self.law, "eps": list(self.eps), "sigma": list(self.sigma)}

    @classmethod
    def from_table(cls, table: Mapping[str, Any], units: Mapping[str, str]) -> Self:
        """As in `Hardening`."""
        found: dict[str, Any] = {}
        for key, values in table.items():
            name = "sigma" if key.startswith("sigma") else key
            if name not in ("eps", "sigma"):
                raise unknown_key(key, ("law", "eps", "sigma"), WHERE + key)
            if name in found:
                raise InputError(f"{WHERE}{key} repeats {WHERE}{name}; allowed is {name} once")
            if not isinstance(values, list):
                raise InputError(f"{WHERE}{key} is {shown(values)}; allowed is a list of numbers")
            kind = "stress" if name == "sigma" else ""
            power = power_of_key(name, kind, key, units, WHERE + key)
            try:
                found[name] = tuple(float(f"{float(v)!r}e{power}") for v in values)
            except (TypeError, ValueError):
                raise InputError(
                    f"{WHERE}{key} is {shown(values)}; allowed is a list of numbers"
                ) from None
        check_complete(found, ("eps", "sigma"), WHERE, "in [hardening]")
        return cls(**found)


def hardening_from(table: dict[str, Any], units: Mapping[str, str]) -> Hardening:
    """The curve of a file's table [hardening]; InputError by key."""
    law = table.pop("law", None)
    if not isinstance(law, str) or law not in CURVES:
        raise unknown_key(law, CURVES, f"{WHERE}law {shown(law)}")
    return CURVES[law].from_table(table, units)
