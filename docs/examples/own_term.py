"""A term of your own: an elastic bedding under the sheet.

It appears in history.csv and in the energy balance by being in the scene.
Prints the energy of the bedding and of the strip [N mm].
"""

import ufl

import fabric_fenicsx as ff


class Bedding(ff.Term):
    """Resists the displacement u by `stiffness` k [N/mm^3]: k |u|^2 / 2."""

    name = energy_kind = "bedding"

    def __init__(self, stiffness):
        self.stiffness = stiffness

    def set_up(self, scene):
        """The energy, a UFL form; forces and stiffness follow from it."""
        u = scene.blank.u
        self.energy = 0.5 * self.stiffness * ufl.inner(u, u) * self.part.dx(4)


ply = ff.Blank.rectangle(100, 25, nx=12)
bedding = Bedding(0.02)
terms = [ff.Membrane(ff.load("komeili")), bedding]
scene = ff.Scene(ply, terms, supports=ff.clamped_ends(2.0))
assert "agree" in ff.check_derivatives(bedding, scene)
energy = ff.Job(scene, steps=4).run().summary["energy"]
print(round(energy["bedding"], 1), round(energy["strain"], 1))
