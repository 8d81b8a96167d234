"""The law of Schäfer, Werner, Henning and Kärger: biaxial and normal-shear couplings."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from ...core.errors import InputError
from ...core.rules import (
    Rule,
    above_zero,
    check_complete,
    fraction,
    not_negative,
    of_either_sign,
    repr_short,
)
from ..energy import COUPLINGS, Derivatives, check_couplings
from ..files import OWN_UNITS, Document, read_numbers, take_table, take_units
from ..functions import Number, exp, negative, positive
from ..material import Parameters, parameter, parameters
from .base import Law, sheet_fields


@parameters
@dataclass(frozen=True, kw_only=True)
class Yarn(Parameters):
    """The seven parameters of one yarn direction.

    Only b and d are needed: by default there is no cubic term and no coupling.

    Examples
    --------
    >>> ff.Yarn(b=600.0, d=0.5).p_min
    0.0
    """

    prefix = "Yarn."

    a: float = parameter(not_negative("stress"), "cubic term in tension [MPa], eqs (15), (16)", 0.0)
    b: float = parameter(above_zero("stress"), "quadratic term in tension [MPa], eqs (15), (16)")
    d: float = parameter(above_zero("stress"), "compression [MPa], eqs (22), (23)")
    p_min: float = parameter(fraction(), "floor of the biaxial coupling [-], eqs (17), (18)", 0.0)
    c: float = parameter(not_negative(), "rate of the biaxial coupling [-], eqs (17), (18)", 0.0)
    s_T: float = parameter(not_negative("stress"), "tension-shear [MPa], eqs (26), (27)", 0.0)
    s_C: float = parameter(not_negative(), "compression-shear coupling [-], eqs (28), (29)", 0.0)


YARN: dict[str, Rule] = {**Yarn.rules}


@parameters
@dataclass(frozen=True)
class WovenFabric(Law):
    """A woven fabric with biaxial and normal-shear couplings, in 17 parameters.

    Parameters
    ----------
    warp, weft : Yarn
        Yarns along a0 and b0, the same one twice in a balanced fabric.
    couplings : collection of str
        Those that are on, any of `biaxial`, `tension_shear`, `compression_shear`.

    References
    ----------
    Schäfer, Werner, Henning and Kärger: the law of the paper, eqs (13) to (30).

    Examples
    --------
    >>> yarn = ff.Yarn(b=600.0, d=0.5, p_min=0.7, c=20.0)
    >>> fabric = ff.WovenFabric(yarn, yarn, s1=0.02, thickness=0.4)
    >>> fabric.is_balanced
    True
    >>> fabric.replace(b=300.0).warp.b  # of both yarns
    300.0
    >>> sorted(fabric.without("biaxial").couplings)
    ['compression_shear', 'tension_shear']
    """

    law = "coupled"
    factors = {"shear_factor": ("s1", "s2", "s3"), "yarn_factor": ("warp", "weft")}

    warp: Yarn
    weft: Yarn
    s1: float = parameter(above_zero("stress"), "factor of the shear angle [MPa], eqs (24), (25)")
    s2: float = parameter(of_either_sign("stress"), "factor of its square [MPa]", 0.0)
    s3: float = parameter(not_negative("stress"), "factor of its cube [MPa]", 0.0)
    couplings: frozenset[str] = frozenset(COUPLINGS)

    def __post_init__(self) -> None:
        for direction in ("warp", "weft"):
            if not isinstance(yarn := getattr(self, direction), Yarn):
                raise InputError(f"{direction} is {repr_short(yarn)}; expected a Yarn")
        super().__post_init__()
        object.__setattr__(self, "couplings", check_couplings(self.couplings))

    def _acts(self, name):
        biaxial, tension_shear, compression_shear = COUPLINGS
        needed = {"p_min": biaxial, "c": biaxial, "s_T": tension_shear, "s_C": compression_shear}
        return needed.get(name) in (None, *self.couplings)

    @property
    def parameters(self) -> tuple[str, ...]:
        return (*YARN, *SHEAR)

    @classmethod
    def numbers(cls) -> Mapping[str, Rule]:
        return {**YARN, **super().numbers()}

    def values(self, name: str) -> list[float]:
        if name not in YARN:
            return super().values(name)
        return [*dict.fromkeys(getattr(yarn, name) for yarn in (self.warp, self.weft))]

    @property
    def is_balanced(self) -> bool:
        """True if warp and weft are equal."""
        return self.warp == self.weft

    def _yarns(self):
        return {"yarns": self.warp} if self.is_balanced else {"warp": self.warp, "weft": self.weft}

    def energy(self, eps_a: Number, eps_b: Number, gamma: Number) -> tuple[Number, ...]:
        r"""The parts of W_tot, eq. (30), with the sums over both yarns i and j the other of them:

        $$
        W_{tot} = \sum_i \left(W_{T,i} + W_{C,i}\right)
                + \left(W_S + \sum_i W_{ST,i}\right) \prod_i k_{SC,i}
        $$

        For $\epsilon_i > 0$, otherwise $W_{T,i} = W_{ST,i} = 0$:

        $$
        W_{T,i} = \left(a_i \epsilon_i^3 + b_i \epsilon_i^2\right) k_{TC,i}, \qquad
        k_{TC,i} = (1 - p_{min,i}) \exp(c_i \epsilon_j) + p_{min,i}, \qquad
        W_{ST,i} = \tfrac13 |\gamma|^3 s_{T,i} (I_i - 1)^2
        $$

        For $\epsilon_i \le 0$, otherwise $W_{C,i} = 0$ and $k_{SC,i} = 1$:

        $$
        W_{C,i} = d_i \epsilon_i^2, \qquad k_{SC,i} = \exp\left(s_{C,i} (I_i - 1)^3\right)
        $$

        In all cases, with $I_4 - 1 = \epsilon_a (2 + \epsilon_a)$ and $I_8 - 1$ alike:

        $$
        W_S = \tfrac12 s_1 \gamma^2 + \tfrac13 s_2 |\gamma|^3 + \tfrac14 s_3 \gamma^4
        $$

        This equals the four cases of eq. (30): in a case that lacks a factor this is 1, and a term
        that it lacks is 0. The paper is read in two ways of our own. Shear energies take |gamma|,
        since a weave resists shear in both senses alike, and with signed odd powers the energy
        would be unbounded below. The last case of eq. (13) is read as I8 <= 1, as in eq. (30). A
        coupling that is off leaves no trace in the expression.
        """
        a, b, gamma = self.warp, self.weft, abs(gamma)
        tension_a, tension_b = positive(eps_a), positive(eps_b)
        compression_a, compression_b = negative(eps_a), negative(eps_b)

        k_TC_a = k_TC_b = k_SC_a = k_SC_b = 1.0
        W_ST_a = W_ST_b = 0.0
        if "biaxial" in self.couplings:
            k_TC_a = (1 - a.p_min) * exp(a.c * eps_b) + a.p_min  # (17)
            k_TC_b = (1 - b.p_min) * exp(b.c * eps_a) + b.p_min  # (18)
        W_T_a = (a.a * tension_a + a.b) * tension_a**2 * k_TC_a  # (15), (19)
        W_T_b = (b.a * tension_b + b.b) * tension_b**2 * k_TC_b  # (16), (20)
        W_C_a = a.d * compression_a**2  # (22)
        W_C_b = b.d * compression_b**2  # (23)
        W_S = self.s1 * gamma**2 / 2 + self.s2 * gamma**3 / 3 + self.s3 * gamma**4 / 4  # (25)
        if "tension_shear" in self.couplings:
            W_ST_a = gamma**3 * a.s_T * (tension_a * (2 + tension_a)) ** 2 / 3  # (26)
            W_ST_b = gamma**3 * b.s_T * (tension_b * (2 + tension_b)) ** 2 / 3  # (27)
        if "compression_shear" in self.couplings:
            k_SC_a = exp(a.s_C * (compression_a * (2 + compression_a)) ** 3)  # (28)
            k_SC_b = exp(b.s_C * (compression_b * (2 + compression_b)) ** 3)  # (29)
        return W_T_a + W_C_a, W_T_b + W_C_b, (W_S + W_ST_a + W_ST_b) * k_SC_a * k_SC_b

    def derivatives(
        self, eps_a: np.ndarray, eps_b: np.ndarray, gamma: np.ndarray, second: bool = True
    ) -> Derivatives:
        # in closed form, ten times as quick as from `energy`
        a, b, g, sign = self.warp, self.weft, np.abs(gamma), np.sign(gamma)
        (A, A_a, A_b, A_aa, A_ab, A_bb) = self._along(a, eps_a, eps_b)
        (B, B_b, B_a, B_bb, B_ab, B_aa) = self._along(b, eps_b, eps_a)
        (Ta, Ta1, Ta2), (Tb, Tb1, Tb2) = self._W_ST(a, eps_a), self._W_ST(b, eps_b)
        (ka, ka1, ka2), (kb, kb1, kb2) = self._k_SC(a, eps_a), self._k_SC(b, eps_b)
        T, g3 = Ta + Tb, g**3 / 3
        # eq. (24), and what eqs (26), (27) add
        tau = ((self.s3 * g + self.s2) * g + self.s1) * g + g**2 * T
        H = ((self.s3 / 4 * g + self.s2 / 3) * g + self.s1 / 2) * g**2 + g3 * T
        k = ka * kb
        parts = np.stack([A, B, H * k], -1)
        first = np.stack(
            [
                A_a + B_a + (g3 * Ta1 * ka + H * ka1) * kb,
                A_b + B_b + (g3 * Tb1 * kb + H * kb1) * ka,
                sign * tau * k,
            ]
        )
        if not second:
            return Derivatives(parts, first, None)
        tau_g = (3 * self.s3 * g + 2 * self.s2) * g + self.s1 + 2 * g * T
        tangent = np.stack(
            [
                A_aa + B_aa + (g3 * Ta2 * ka + 2 * g3 * Ta1 * ka1 + H * ka2) * kb,
                A_ab + B_ab + g3 * Ta1 * ka * kb1 + g3 * Tb1 * kb * ka1 + H * ka1 * kb1,
                A_bb + B_bb + (g3 * Tb2 * kb + 2 * g3 * Tb1 * kb1 + H * kb2) * ka,
                sign * (g**2 * Ta1 * ka + tau * ka1) * kb,
                sign * (g**2 * Tb1 * kb + tau * kb1) * ka,
                tau_g * k,
            ]
        )
        return Derivatives(parts, first, tangent)

    def _along(self, y, e, e_other):
        """W_T + W_C of one yarn, with derivatives in its strain 1, the other's 2, 11, 12, 22."""
        k0, k1, k2 = np.ones_like(e), 0.0 * e, 0.0 * e
        if "biaxial" in self.couplings:
            k1 = (1 - y.p_min) * np.exp(y.c * e_other)
            k0, k1, k2 = k1 + y.p_min, y.c * k1, y.c**2 * k1
        T0, T1 = (y.a * e + y.b) * e**2, (3 * y.a * e + 2 * y.b) * e
        T2 = 6 * y.a * e + 2 * y.b
        t = e > 0
        return (
            np.where(t, T0 * k0, y.d * e**2),
            np.where(t, T1 * k0, 2 * y.d * e),
            np.where(t, T0 * k1, 0),
            np.where(t, T2 * k0, 2 * y.d),
            np.where(t, T1 * k1, 0),
            np.where(t, T0 * k2, 0),
        )

    def _W_ST(self, y, e):
        """3 W_ST / |gamma|^3 = s_T (I - 1)^2 with derivatives, zero in compression."""
        p = np.maximum(e * (2 + e), 0) if "tension_shear" in self.couplings else 0 * e
        slope = 2 * (1 + e)  # of I
        return y.s_T * p**2, 2 * y.s_T * p * slope, 2 * y.s_T * (slope**2 * (p > 0) + 2 * p)

    def _k_SC(self, y, e):
        """k_SC with derivatives, one in tension."""
        if "compression_shear" not in self.couplings:
            return np.ones_like(e), 0 * e, 0 * e
        m, slope = np.minimum(e * (2 + e), 0), 2 * (1 + e)
        m2 = m * m  # NumPy takes ten times as long for m**3
        k = np.exp(y.s_C * m2 * m)
        k1 = 3 * y.s_C * m2 * slope
        return k, k1 * k, (6 * y.s_C * (m * slope**2 + m2) + k1**2) * k

    def plausibility_warnings(self) -> list[str]:
        values = {f"b of {name}": yarn.b for name, yarn in self._yarns().items()}
        return self._implausible(values | {"s1": self.s1})

    def without(self, *names: str) -> Self:
        off = check_couplings(names, "without")
        return dataclasses.replace(self, couplings=self.couplings - off)

    def _fields(self, changes):
        yarn = {key: changes.pop(key) for key in YARN if key in changes}
        for name in ("warp", "weft") if yarn else ():
            changes[name] = dataclasses.replace(changes.get(name, getattr(self, name)), **yarn)
        return changes

    def table(self) -> Document:
        entries: Document = {"law": self.law} if self.law != WovenFabric.law else {}
        entries |= {name: getattr(self, name) for name in self._added()}  # of a law made from this
        couplings = [name for name in COUPLINGS if name in self.couplings]
        entries |= self.sheet_table() | {"couplings": couplings, "units": OWN_UNITS}
        entries |= {key: dataclasses.asdict(yarn) for key, yarn in self._yarns().items()}
        return entries | {"shear": {name: getattr(self, name) for name in SHEAR}}

    @classmethod
    def _added(cls):
        inherited = {each.name for each in dataclasses.fields(WovenFabric)}
        return [each.name for each in dataclasses.fields(cls) if each.name not in inherited]

    @classmethod
    def from_document(cls, document: Document, folder: Path) -> Self:
        document.pop("law", None)
        tables = {key: take_table(document, key) for key in ("yarns", "warp", "weft", "shear")}
        units = take_units(document)
        taken = [key for key in ("couplings", *cls._added()) if key in document]
        fields = {key: document.pop(key) for key in taken}
        fields |= sheet_fields(cls, document, units, ("law", "couplings", "units", *tables), {})
        fields |= read_numbers(tables.pop("shear"), SHEAR, units, "shear.")
        check_complete(fields, SHEAR, "shear.", "in [shear]")
        numbers = {key: read_numbers(t, YARN, units, f"{key}.") for key, t in tables.items()}
        for direction in ("warp", "weft"):
            yarn = numbers["yarns"] | numbers[direction]
            table = direction if numbers[direction] or not numbers["yarns"] else "yarns"
            check_complete(yarn, YARN, f"{table}.", f"in [yarns] or [{direction}]")
            fields[direction] = Yarn(**yarn)
        return cls(**fields)


SHEAR: dict[str, Rule] = {**WovenFabric.rules}
