"""A term that is not a UFL form: springs at nodes hold one end of a strip, a grip pulls the other.

Prints the reaction of the grip [N] and the energy of the springs [N mm].
"""

import numpy as np

import fabric_fenicsx as ff


class Springs(ff.Term):
    """A spring k [N/mm] along the length at each node where `where(points)`, points (3, n)."""

    name = energy_kind = "springs"

    def __init__(self, k, where):
        self.k, self.where = k, where

    def set_up(self, scene):
        nodes, gdim = scene.blank.V.dofmap.index_map, scene.blank.mesh.geometry.dim
        own = np.flatnonzero(self.where(scene.blank.coordinates()[: nodes.size_local].T))
        self.dofs, self.first = gdim * own, gdim * nodes.local_range[0]  # dofs + 1: across

    def stored(self):
        return self.k * (self.blank.u.x.array[self.dofs] ** 2).sum() / 2

    def add_forces(self, f):
        f[self.dofs] += self.k * self.blank.u.x.array[self.dofs]

    def tangent(self):
        return self.first + self.dofs, self.first + self.dofs, np.full(len(self.dofs), self.k)


springs = Springs(50.0, lambda x: x[0] < 1e-6)
grip = ff.Support("grip", lambda x: x[0] > 100 - 1e-6, (0, 1), (2.0, 0.0))
ply, fabric = ff.Blank.rectangle(100, 25, nx=12, element="P1"), ff.load("komeili")
scene = ff.Scene(ply, [ff.Membrane(fabric.without("biaxial")), springs], supports=[grip])
assert "agree" in ff.check_derivatives(springs, scene)
energy = ff.Job(scene, steps=4).run().summary["energy"]
print(round(scene.reaction("grip")[0], 2), round(energy["springs"], 2))
