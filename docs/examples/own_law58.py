"""Radioss' LAW58, without crimp and hysteresis, as a law of your own. Prints its three stresses."""

from dataclasses import dataclass

import fabric_fenicsx as ff
from fabric_fenicsx.core.rules import above_zero, fraction, not_negative
from fabric_fenicsx.material.functions import cos, log, negative, positive, tan, where


@dataclass(frozen=True)
class Law58(ff.Law):
    law = "law58"
    rules = dict.fromkeys(("E_a", "E_b", "G_0", "G_T"), above_zero("stress"))
    rules |= dict.fromkeys(("B_a", "B_b"), not_negative("stress"))
    rules |= {"flex": fraction(), "gamma_T": above_zero()}
    factors = {"shear_factor": ("G_0", "G_T"), "yarn_factor": ("E_a", "E_b", "B_a", "B_b")}

    E_a: float
    E_b: float
    B_a: float
    B_b: float
    flex: float  # stiffness in compression relative to E
    G_0: float
    G_T: float  # shear stiffness from gamma_T on
    gamma_T: float

    def energy(self, eps_a, eps_b, gamma):
        along, g, lock = [], abs(gamma), self.gamma_T
        for eps, E, B in ((eps_a, self.E_a, self.B_a), (eps_b, self.E_b, self.B_b)):
            pull, m = positive(eps), where(B * eps > E, E / where(B > 0, B, 1.0), positive(eps))
            softening = E * m**2 / 2 - B * m**3 / 6 + (E * m - B * m**2 / 2) * (pull - m)
            along.append(softening + self.flex * E * negative(eps) ** 2 / 2)
        beyond = log(cos(g) / cos(lock)) + tan(lock) * (g - lock)
        shear = where(g > lock, self.G_0 - self.G_T * cos(lock) ** 2, 0.0) * beyond
        return *along, shear - self.G_0 * log(cos(g))


fabric = Law58(1335.0, 900.0, 4000.0, 0.0, 1e-3, 0.025, 0.6, 0.8, thickness=0.4, name="law58")
print(fabric.derivatives([0.01], [0.05], [1.2]).first.ravel().round(3).tolist())
