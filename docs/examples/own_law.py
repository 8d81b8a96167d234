"""A law of your own: yarns that are linear in tension, and shear that stiffens.

Checks its derivatives, and prints the reaction of a bias test with it [N].
"""

from dataclasses import dataclass

import fabric_fenicsx as ff
from fabric_fenicsx.core.rules import above_zero
from fabric_fenicsx.material.functions import negative, positive, tan


@dataclass(frozen=True)
class Plain(ff.Law):
    """W_i = E eps_i^2 / 2, in compression a hundredth of it; W_S = G tan(gamma)^2 / 2."""

    law = "plain"  # its name in material files
    rules = {"E": above_zero("stress"), "G": above_zero("stress")}

    E: float
    G: float

    def energy(self, eps_a, eps_b, gamma):
        """The parts along a, along b and in shear [MPa]."""
        along = [
            self.E * (positive(eps) ** 2 + 0.01 * negative(eps) ** 2) / 2 for eps in (eps_a, eps_b)
        ]
        return *along, self.G * tan(gamma) ** 2 / 2


fabric = Plain(E=300.0, G=0.05, thickness=0.5)
assert "agree" in ff.check_derivatives(fabric)
result = ff.BiasExtension(fabric, nx=16, strain=0.05).job(steps=3).run()
print(round(result.summary["reaction_N"], 3))
result.plot("shear_angle", "own_law.png")
