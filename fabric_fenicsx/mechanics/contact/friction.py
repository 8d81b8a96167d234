"""Friction at points that are pressed on a tool or on another sheet."""

import numpy as np
from mpi4py import MPI

from ...runtime.compiled import compiled
from .coulomb import Coulomb

INEXACT = 0.01  # of the friction that there can be, by which held sliding may be off


class Friction:
    """Friction at n points of this rank: their elastic slip, and the energy that it took.

    Within a step it is a potential, as the normal forces and the tangent planes are those of the
    last accepted state. In the methods `moved` (n, 3) [mm] is how far each point has moved since
    then, relative to what it touches. Its tangential part adds to the elastic slip of that state,
    which begins with 0 where a point is pressed for the first time. coefficient: of all points, or
    one for each (n,). All ranks use it together.

    version: a number that changes when energy and forces of the same motion do
    """

    version = 0

    def __init__(
        self,
        law: Coulomb,
        coefficient: float | np.ndarray,
        normal_forces: np.ndarray,
        normals: np.ndarray,
        comm: MPI.Comm,
    ) -> None:
        self.law, self.coefficient, self._comm = law, coefficient, comm
        self._lag = law.lag or np.inf
        self._slip = np.zeros((len(normals), 3))
        self._accepted_energy = np.zeros(len(normals))
        self._taken = self._accepted_energy  # of that, what the elastic slip does not hold
        self._begin(normal_forces, normals)

    def _begin(self, normal_forces, normals):
        """Take normal forces (n,) [N] and unit normals (n, 3) for the next step, and turn the slip
        into the new tangent planes."""
        self.version += 1
        self._limit = self._accepted_limit = self.coefficient * normal_forces
        self._normals = np.ascontiguousarray(normals)
        self._slip = _turned(self._slip, self._limit, self._normals)

    @property
    def most(self) -> np.ndarray:
        """What the points can bear in the last accepted state, (n,) [N]."""
        return self._accepted_limit

    def restore(self) -> None:
        """Go back to the normal forces of the last accepted state."""
        self.version += 1
        self._limit = self._accepted_limit

    def press(self, normal_forces: np.ndarray) -> None:
        """Take these normal forces (n,) [N] for the present step. The energy that changes because
        they do counts as taken."""
        self.version += 1
        self._limit = self.coefficient * normal_forces
        self._taken = self._accepted_energy - self.law.energy(self._slip, self._limit)

    def update_lagged(
        self, normal_forces: np.ndarray, moved: np.ndarray, exact: np.ndarray
    ) -> bool:
        """Take these normal forces (n,) [N] if they differ from the held ones by more than the
        law's `lag`; whether they do, or friction does by more than `INEXACT` between what points
        are held to have `moved` and what they have (n, 3) [mm]; the same on all ranks. Nothing is
        taken where it is to follow one step behind."""
        if np.isinf(self._lag):
            return False
        now = self.coefficient * normal_forces
        off = np.linalg.norm(self.forces(exact) - self.forces(moved), axis=1).sum()
        sums = np.array([abs(now - self._limit).sum(), now.sum(), off, self._limit.sum()])
        changed, total, off, limit = self._comm.allreduce(sums)
        if changed <= self._lag * total and off <= INEXACT * limit:
            return False
        self.version += 1
        self._limit = now
        return True

    def accept(self, moved: np.ndarray, normal_forces: np.ndarray, normals: np.ndarray) -> None:
        """Take the present state as the last accepted one: keep the elastic part of the slip. The
        energy that changes because normal forces (n,) [N] do counts as taken."""
        slipped = self._slipped(moved)
        self._accepted_energy = self._taken + self.law.energy(slipped, self._limit)
        self._slip = self.law.elastic(slipped)
        self._begin(normal_forces, normals)
        self._taken = self._accepted_energy - self.law.energy(self._slip, self._limit)

    def energy(self, moved: np.ndarray) -> float:
        """Energy taken at this rank's points, elastic and dissipated [N mm]."""
        return self.potential(moved)[0]

    def forces(self, moved: np.ndarray) -> np.ndarray:
        """Forces on the points (n, 3) [N]."""
        return self.potential(moved)[1]

    def potential(self, moved: np.ndarray) -> tuple[float, np.ndarray]:
        """`energy` and `forces` at once."""
        energy, forces = self.law.potential(self._slipped(moved), self._limit)
        return float((self._taken + energy).sum()), forces

    def total(self, moved: np.ndarray) -> np.ndarray:
        """Sum of the forces on the points of all ranks (3,) [N]."""
        return self._comm.allreduce(self.forces(moved).sum(0))

    def blocks(self, moved: np.ndarray) -> np.ndarray:
        """By how much the forces fall as each point moves, (n, 3, 3) [N/mm]."""
        return self.law.blocks(self._slipped(moved), self._limit, self._normals)

    def memory(self) -> dict[str, np.ndarray]:
        """Elastic slip (n, 3) [mm] and energy taken (n,) [N mm] in the last accepted state."""
        return {"slip": self._slip, "energy": self._accepted_energy}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Take back what `memory` gave; `accept` of that state, without motion, is to follow."""
        self.version += 1
        self._slip = np.ascontiguousarray(memory["slip"])
        self._taken = self._accepted_energy = memory["energy"]
        self._limit = np.zeros(len(self._taken))

    def _slipped(self, moved):
        return _slipped(self._slip, moved, self._normals)


@compiled
def _slipped(slip, moved, normals):
    """Slip (n, 3) and the parts of motions `moved` (n, 3) across unit normals (n, 3), added up."""
    found = np.empty_like(slip)
    for i in range(len(slip)):
        x, n = moved[i], normals[i]
        along = x[0] * n[0] + x[1] * n[1] + x[2] * n[2]
        for k in range(3):
            found[i, k] = slip[i, k] + (x[k] - along * n[k])
    return found


def _turned(slip, limit, normals):
    """The slip turned into the planes across `normals`, as long as before; 0 where nothing
    presses."""
    length = np.linalg.norm(slip, axis=1)
    flat = _slipped(np.zeros_like(slip), slip, normals)
    flat *= (length / np.maximum(np.linalg.norm(flat, axis=1), 1e-300))[:, None]
    return np.where((limit > 0)[:, None], flat, 0.0)
