"""A bias test with yarns that do not stretch, in equilibrium.

`pin_jointed` takes one direction of yarns a and one of yarns b where both are free. But any x =
p(alpha) + q(beta) with the right distance of the clamps is such a net. The one that a strip takes
has the least energy of shear. It is found here for yarns at 45 deg: there b is the mirror image of
a, and what is sought is by how much each yarn b turns yarns a, phi(alpha).
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.material.laws.base import Law


class RelaxedNet(NamedTuple):
    """Where both yarns are free: position (k,) along yarns, from the middle of the strip [mm], and
    by how much the other yarn turns them there, turn (k,) [rad]; energy [N mm] and force [N] of
    the strip."""

    position: np.ndarray
    turn: np.ndarray
    energy: float
    force: float

    def shear_angle(self, radius: float = 0.0) -> float:
        """Mean shear angle [rad] within a radius [mm] of the middle; at the middle, the least."""
        if not radius:
            return float(2 * self.turn.min())
        a, b = np.meshgrid(self.position, self.position)
        near = np.hypot(a, b) < radius
        return float((self.turn[:, None] + self.turn)[near].mean())


def relaxed_net(law: Law, length: float, width: float, stroke: float, n: int = 160) -> RelaxedNet:
    """The net of least energy of a strip [mm] of `law` whose clamp has moved by `stroke` [mm], with
    n yarns of each family.

    Raises InputError for a strip shorter than two widths, and beyond the reach of its yarns.
    """
    gap = (length - width) / math.sqrt(2)  # of a yarn, between the clamped parts of the strip
    if not (length >= 2 * width and 0 <= stroke < 2 * gap * (1 - math.sqrt(0.5))):
        raise InputError(
            f"a strip of {length:g} x {width:g} mm with stroke {stroke:g} mm has no net; allowed "
            "are two widths of length or more, and a stroke within the yarns' reach"
        )
    h = (length + width) / math.sqrt(2) / n
    along = (np.arange(n) + 0.5) * h
    a, b = np.meshgrid(along, along, indexing="ij")
    x, y = (a + b) / math.sqrt(2) - width / 2, (a - b) / math.sqrt(2) + width / 2
    inside = (x > 0) & (x < length) & (y > 0) & (y < width)
    free = np.flatnonzero(abs(along - along.mean()) < gap / 2)
    # of cos(angle to the load), summed over the yarns that turn; half of the stroke is of yarns a
    turned = len(free) * (math.sqrt(0.5) + stroke / 2 / gap)
    pairs = np.nonzero(inside)
    zero = np.zeros(len(pairs[0]))

    def energy(turn):
        phi = np.zeros(n)
        phi[free] = turn
        found = law.derivatives(zero, zero, phi[pairs[0]] + phi[pairs[1]], second=False)
        first, second = (np.bincount(k, found.first[2], n) for k in pairs)
        scale = law.thickness * h * h
        return scale * found.parts[:, 2].sum(), scale * (first + second)[free]

    def distance(turn):
        return np.cos(math.pi / 4 - turn).sum() - turned

    def slope(turn):
        return np.sin(math.pi / 4 - turn)

    start = np.full(len(free), math.pi / 4 - math.acos(turned / len(free)))
    found = minimize(
        energy,
        start,
        jac=True,
        constraints={"type": "eq", "fun": distance, "jac": slope},
        method="SLSQP",
        options={"maxiter": 1000, "ftol": 1e-13},
    )
    # dE = F d(stroke), by the multiplier of the distance
    reach = slope(found.x)
    force = (energy(found.x)[1] @ reach) / (reach @ reach) * len(free) / (2 * gap)
    middle = (length + width) / math.sqrt(8)
    return RelaxedNet(along[free] - middle, found.x, float(found.fun), float(force))
