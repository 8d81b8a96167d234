"""A term of your own: an elastic bedding under the sheet.

As part of the scene it also appears in history.csv and in the energy balance.
Prints the energies of bedding and strip, and the maximum traction of the bedding [N mm, MPa].
"""

import numpy as np
import ufl
from dolfinx import fem

import fabric_fenicsx as ff


class Bedding(ff.Term):
    """Resists the displacement u by `stiffness` k [N/mm^3]: k |u|^2 / 2."""

    name = energy_kind = "bedding"

    def __init__(self, stiffness):
        self.stiffness = stiffness

    def set_up(self, scene):
        """The energy, a UFL form; forces and stiffness follow from it."""
        k, u = fem.Constant(scene.blank.mesh, self.stiffness), scene.blank.u
        self.energy = 0.5 * k * ufl.inner(u, u) * self.part.dx(4)

    def nodal_fields(self):
        u = self.blank.nodal_displacement()[: len(self.part.nodes)]
        return {"bedding_traction": ff.Value(self.stiffness * np.linalg.norm(u, axis=1), "MPa")}


bedding = Bedding(0.02)
terms = [ff.Membrane(ff.load("komeili")), bedding]
scene = ff.Scene(ff.Blank.rectangle(100, 25, nx=12), terms, supports=ff.clamped_ends(2.0))
assert "agree" in ff.check_derivatives(bedding, scene)
result = ff.Job(scene, steps=4).run()
traction = result.grid["bedding_traction"]
print(*(round(result.summary["energy"][k], 1) for k in ("bedding", "strain")), traction.max())
