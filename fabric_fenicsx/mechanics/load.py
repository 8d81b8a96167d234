"""Dead loads on a blank."""

import numpy as np
import ufl
from dolfinx import fem


class DeadPressure:
    """Load of `pressure` [MPa] per undeformed area along a fixed `direction` (gdim,), growing with the load factor.

    Its energy is the potential -p u·n [N mm], so it counts as negative work done.
    """

    name = "dead pressure"
    energy_kind = "load"

    def __init__(self, blank, pressure, direction):
        self.pressure = pressure
        self._now = fem.Constant(blank.mesh, 0.0)
        direction = np.asarray(direction, float) / np.linalg.norm(direction)
        self.energy = -self._now * ufl.dot(blank.displacement, ufl.as_vector(direction.tolist())) * ufl.dx(blank.mesh)

    def at(self, load):
        """Set the load factor."""
        self._now.value = load * self.pressure
