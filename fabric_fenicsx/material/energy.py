"""The energy density of a fabric in its strains, and its derivatives from that alone."""

from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError
from .hyperdual import HyperDual, Number


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
            "allowed are three parts, written with + - * / **, abs and the functions of "
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

    def shear_stiffnesses(self) -> np.ndarray:
        """That of each of its points, (count,)."""
        return self.derivatives(*np.zeros((3, self.count))).second[5]

    def ranges(self) -> tuple[Range, ...]:
        """The strains that the law's numbers are for, where they have an end: a run warns of
        states beyond."""
        return ()


def stresses_of_energy(
    law: Energy, eps_a: ArrayLike, eps_b: ArrayLike, gamma: ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """sigma_a, sigma_b, tau (n,) [MPa] at eps_a, eps_b [-] and gamma [rad], (n,) or a number each,
    from the energy alone, without the law's closed forms."""
    a, b, g = np.broadcast_arrays(*(np.atleast_1d(v).astype(float) for v in (eps_a, eps_b, gamma)))
    sigma_a, sigma_b, tau = Energy.derivatives(law, a, b, g, second=False).first
    return sigma_a, sigma_b, tau
