"""Straight yarns and shear with a locking angle, as Radioss' fabric LAW58 has them."""

import math
from dataclasses import dataclass
from typing import Any

from ...runtime.rules import Rule, above_zero, fraction, not_negative
from ..functions import cos, log, negative, positive, tan, where
from .base import Law, Range


@dataclass(frozen=True)
class Law58(Law):
    """Loading of Radioss' /MAT/LAW58 (FABR_A) without hysteresis, for yarns without crimp (Altair
    Radioss Reference Guide; OpenRadioss, hm_read_mat58.F and, beyond E / B, sigeps58c.F).

    - E_a, E_b, B_a, B_b [MPa]: stiffness and softening of the yarns (E1, E2, B1, B2 there)
    - flex [-]: stiffness in compression over E
    - G_0 [MPa]: shear stiffness at rest; G_T [MPa]: that at the locking angle gamma_T [rad]
    """

    law = "law58"
    factors = {"shear_factor": ("G_0", "G_T"), "yarn_factor": ("E_a", "E_b", "B_a", "B_b")}
    rules = {
        **dict.fromkeys(("E_a", "E_b", "G_0", "G_T"), above_zero("stress")),
        **dict.fromkeys(("B_a", "B_b"), not_negative("stress")),
        "flex": fraction(),
        "gamma_T": Rule("an angle above 0 and below pi / 2", lambda v: 0 < v < 1.57),
    }

    E_a: float
    E_b: float
    B_a: float
    B_b: float
    flex: float
    G_0: float
    G_T: float
    gamma_T: float

    def energy(self, eps_a: Any, eps_b: Any, gamma: Any) -> tuple[Any, Any, Any]:
        r"""$W_i = \tfrac12 E_i m^2 - \tfrac16 B_i m^3 + \frac{E_i^2}{2 B_i} (\epsilon_i - m)$ with
        $m = \min(\epsilon_i, E_i / B_i)$ in tension, and
        $W_i = \tfrac12 flex E_i \epsilon_i^2$ in compression. In shear, with
        $G = G_T / (1 + \tan^2\gamma_T)$, $\tau = G_0 \tan\gamma$ up to $\gamma_T$ and
        $\tau = G \tan\gamma + (G_0 - G) \tan\gamma_T$ beyond it."""
        gamma, lock, G = abs(gamma), tan(self.gamma_T), self.G_T * cos(self.gamma_T) ** 2
        W_a, W_b = (
            _pulled(positive(e), E, B) + self.flex * E * negative(e) ** 2 / 2
            for e, E, B in ((eps_a, self.E_a, self.B_a), (eps_b, self.E_b, self.B_b))
        )
        beyond = log(cos(gamma) / cos(self.gamma_T)) + lock * (gamma - self.gamma_T)
        W_S = -self.G_0 * log(cos(gamma)) + where(gamma > self.gamma_T, self.G_0 - G, 0.0) * beyond
        return W_a, W_b, W_S

    def ranges(self) -> tuple[Range, ...]:
        """Yarns up to E / B, where their stiffness ends."""
        yarns = ("a", self.E_a, self.B_a), ("b", self.E_b, self.B_b)
        beyond = "there the stress stays as it is"
        return tuple(
            Range(f"eps_{yarn}", f"E_{yarn} / B_{yarn}", -math.inf, E / B, beyond)
            for yarn, E, B in yarns
            if B
        )


def _pulled(e, E, B):
    """The energy of a yarn at strains e >= 0."""
    softens = where(B > 0, B, 1.0)  # without B no strain is beyond E / B
    m = where(B * e > E, E / softens, e)
    return E * m**2 / 2 - B * m**3 / 6 + E**2 / (2 * softens) * (e - m)
