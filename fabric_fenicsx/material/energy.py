"""The energy density of a fabric in its strains: derivatives from that alone, and checks."""

from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.formatting import rounded
from ..core.rules import repr_short, unknown_key
from .functions import HyperDual, Number

COUPLINGS = ("biaxial", "tension_shear", "compression_shear")


class Derivatives(NamedTuple):
    """The energy at n states and its derivatives in (eps_a, eps_b, gamma) [MPa].

    - parts: (n, 3): along a, along b, shear with its couplings; W is their sum
    - first: (3, n): the conjugate stresses sigma_a, sigma_b, tau
    - second: (6, n): the tangents aa, ab, bb, ag, bg, gg; None unless asked for
    """

    parts: np.ndarray
    first: np.ndarray
    second: Any


class Range(NamedTuple):
    """Strains that a law's numbers are for.

    - strain: "eps_a", "eps_b" or "gamma", of which the size counts
    - source: their origin, as "the table of warp"
    - low, high: the least and the greatest [-, rad]; infinite where it has no end
    - beyond: a sentence on the law beyond them
    """

    strain: str
    source: str
    low: float
    high: float
    beyond: str


class Energy:
    """A strain energy density: a subclass has `energy`, from which all else follows."""

    law: ClassVar[str] = ""
    thickness: Number  # [mm]
    count = 1  # of points, each of which has its own numbers

    def energy(self, eps_a: Number, eps_b: Number, gamma: Number) -> tuple[Number, ...]:
        """The parts of the strain energy density W, along a, along b and shear with its couplings
        [MPa], of nominal strains of the yarns [-] and the shear angle of either sign [rad], UFL
        expressions, arrays or hyper-dual numbers, with the functions of `material.functions`."""
        raise NotImplementedError("there is no method energy(self, eps_a, eps_b, gamma)")

    def parts(self, eps_a: Number, eps_b: Number, gamma: Number) -> tuple[Number, ...]:
        """The parts of `energy`; InputError if that fails or gives something else than three."""
        allowed = (
            "expected three parts, written with + - * / **, abs and the functions of "
            "`material.functions`, as where(eps > 0, x, y) for `if`"
        )
        try:
            a, b, shear = self.energy(eps_a, eps_b, gamma)
        except InputError:
            raise
        except Exception as error:
            flaw = f"energy of law {self.law} fails ({type(error).__name__}: {error})"
            raise InputError(f"{flaw}; {allowed}") from error
        # where NumPy takes numbers for objects it gives an array
        if np.ndarray in map(type, (a, b, shear)) and not isinstance(eps_a, np.ndarray):
            raise InputError(f"energy of law {self.law} has a part of type ndarray; {allowed}")
        return a, b, shear

    def derivatives(
        self, eps_a: np.ndarray, eps_b: np.ndarray, gamma: np.ndarray, second: bool = True
    ) -> Derivatives:
        """Energy, stresses and, if asked for, tangents at states (n,), exact to rounding. At a kink
        they are those of the side up to it: eps = 0 counts as compression."""
        strains = HyperDual.variables(eps_a, eps_b, gamma)
        zero = 0.0 * strains[0]
        with np.errstate(all="ignore"):  # sides of a case that do not count
            parts = [part + zero for part in self.parts(*strains)]
            W = parts[0] + parts[1] + parts[2]
        values = np.stack([part.value for part in parts], -1)
        return Derivatives(values, W.first, W.second if second else None)

    @property
    def shear_stiffness(self) -> float:
        """The law's stiffness in shear at rest, d2W/dgamma2 [MPa]."""
        return float(self.derivatives(*np.zeros((3, 1))).second[5, 0])

    def ranges(self) -> tuple[Range, ...]:
        """The strains that the law's numbers are for, where they have an end: a run warns of
        states beyond."""
        return ()

    def couples(self, name: str) -> bool:
        """True if the energy depends on two strains together where this coupling acts."""
        # strains at which this coupling alone gives the energy mixed derivatives
        strains = {
            "biaxial": [(0.02, 0.03, 0.0), (-0.02, 0.03, 0.0), (0.02, -0.03, 0.0)],
            "tension_shear": [(0.02, 0.03, 0.3)],
            "compression_shear": [(-0.02, -0.03, 0.3)],
        }[name]
        second = Energy.derivatives(self, *np.transpose(strains)).second
        mixed = second[1:2] if name == "biaxial" else second[3:5]
        return bool(abs(mixed).max() > 1e-9 * abs(second).max())

    def check_rest(self) -> None:
        """InputError where the fabric as it lies, without strain, has energy or stress, or a
        negative stiffness."""
        rest = Energy.derivatives(self, *np.transpose([(0.0, 0.0, 0.0), (0.01, 0.01, 0.1)]))
        beside = Energy.derivatives(self, *np.array(3 * [[-1e-9, 1e-9]])).second  # sides of a kink
        stiffness = np.nanmax(abs(rest.second[[0, 2, 5]]), 1, initial=0.0)
        names = "energy", "stress sigma_a", "stress sigma_b", "stress tau"
        values, limits = [rest.parts[0].sum(), *rest.first[:, 0]], [1e-9 * stiffness.max()]
        flaws = [
            f"{name} of law {self.law} is {value:.3g} MPa without strain; expected 0: subtract its "
            "value at rest"
            for name, value, limit in zip(names, values, [*limits, *(1e-5 * stiffness)])
            if not abs(value) <= limit
        ]
        least = beside[[0, 2, 5]].min(1)
        flaws += [
            f"stiffness of law {self.law} along {name} is {rounded(value)} MPa without strain; "
            "expected 0 or more: check its signs"
            for name, value, scale in zip(("eps_a", "eps_b", "gamma"), least, stiffness)
            if value < -1e-6 * scale
        ]
        for flaw in flaws[:1]:
            raise InputError(f"the {flaw}")


def stresses_of_energy(
    law: Energy, eps_a: ArrayLike, eps_b: ArrayLike, gamma: ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """sigma_a, sigma_b, tau (n,) [MPa] at eps_a, eps_b [-] and gamma [rad], (n,) or a number each,
    from the energy alone, without the law's closed forms."""
    a, b, g = np.broadcast_arrays(*(np.atleast_1d(v).astype(float) for v in (eps_a, eps_b, gamma)))
    sigma_a, sigma_b, tau = Energy.derivatives(law, a, b, g, second=False).first
    return sigma_a, sigma_b, tau


def check_couplings(names: object, label: str = "couplings") -> frozenset[str]:
    """The named couplings as a set, each one of `COUPLINGS`, spelled with "_", "-" or an en dash;
    otherwise an InputError that calls them `label`."""
    if isinstance(names, (str, Mapping)) or not isinstance(names, Iterable):
        raise InputError(
            f"{label} is {repr_short(names)}; expected a list of {', '.join(COUPLINGS)}"
        )
    couplings = {str(word).replace("-", "_").replace("–", "_") for word in names}
    for name in couplings.difference(COUPLINGS):
        raise unknown_key(name, COUPLINGS, f"{label}: coupling {repr_short(name)}")
    return frozenset(couplings)
