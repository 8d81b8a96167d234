"""A magnet pulls a strip: a load without UFL form. Prints its work and the strain energy [N mm]."""

import fabric_fenicsx as ff


class Magnet(ff.Term):
    """Pulls each node down by q / d^2 [N], at last q = 20 N mm^2; d [mm]: how far it now is."""

    name = "magnet"

    def set_load(self, load):
        self.now = 20.0 * load

    def d(self):
        own = slice(len(self.part.nodes))  # of this rank, so that no node counts twice
        return (self.blank.coordinates() + self.blank.nodal_displacement())[own, 2] + 20.0

    def stored(self):
        return -(self.now / self.d()).sum()

    def add_forces(self, f):
        f[2 : 3 * len(self.d()) : 3] += self.now / self.d() ** 2

    def tangent(self):
        first = self.blank.V.dofmap.index_map.local_range[0]
        dofs = [3 * (first + i) + 2 for i in range(len(self.d()))]
        return dofs, dofs, -2 * self.now / self.d() ** 3

    def accept(self):
        self.last = self.d(), self.now / self.d() ** 2

    def work(self):
        return ((self.last[0] - self.d()) * (self.last[1] + self.now / self.d() ** 2)).sum() / 2


terms = [ff.Membrane(ff.load("fabric")), ff.Bending(modulus=100.0), magnet := Magnet()]
scene = ff.Scene(ff.Blank.rectangle(100, 25, nx=12, spatial=True), terms, ff.clamped_ends())
assert "agree" in ff.check_derivatives(magnet, scene)
row = ff.Job(scene, steps=20).run().rows[-1]
print(round(row["external_work_Nmm"], 2), round(row["strain_energy_Nmm"], 2))
