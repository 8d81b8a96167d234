"""Friction at points that are pressed on a tool or on another sheet."""

import numpy as np
from mpi4py import MPI

from .coulomb import Coulomb

ARMS = 0.01  # of the friction that there can be, by which turned arms may change it


class Friction:
    """Friction at n points of this rank: their elastic slip, and the energy that it took.

    Within a step it is a potential, as the normal forces and the tangent planes are those of the
    last accepted state. In the methods `moved` (n, 3) [mm] is how far each point has moved since
    then, relative to what it touches. Its tangential part adds to the elastic slip of that state,
    which begins with 0 where a point is pressed for the first time. coefficient: of all points, or
    one for each (n,). All ranks use it together.

    Faces slide, not mid-surfaces: what the point's arm has turned by does not count. The arm (n, 3)
    [mm] is the vector to the point from the other mid-surface, or the tool, across the faces, NaN
    where there is none. So a pair of sheets that turns as a whole does not slide, and one that is
    bent does. Arms are held during a solve. Forces act on mid-surfaces, so they leave a `couple`.
    """

    def __init__(
        self,
        law: Coulomb,
        coefficient: float | np.ndarray,
        normal_forces: np.ndarray,
        normals: np.ndarray,
        arms: np.ndarray,
        comm: MPI.Comm,
    ) -> None:
        self.law, self.coefficient, self._comm = law, coefficient, comm
        self._lag = law.lag or np.inf
        self._slip = np.zeros((len(normals), 3))
        self._accepted_energy = np.zeros(len(normals))
        self._taken = self._accepted_energy  # of that, what the elastic slip does not hold
        self._begin(normal_forces, normals, arms)

    def _begin(self, normal_forces, normals, arms):
        """Take normal forces (n,) [N], unit normals (n, 3) and arms for the next step, and turn the
        slip into the new tangent planes."""
        self._arms, self._turned = arms, np.zeros_like(arms)
        self._limit = self._accepted_limit = self.coefficient * normal_forces
        self._normals = normals
        self._slip = _turned(self._slip, self._limit, normals)

    def restore(self) -> None:
        """Go back to the normal forces and arms of the last accepted state."""
        self._limit, self._turned = self._accepted_limit, np.zeros_like(self._arms)

    def press(self, normal_forces: np.ndarray) -> None:
        """Take these normal forces (n,) [N] for the present step. The energy that changes because
        they do counts as taken."""
        self._limit = self.coefficient * normal_forces
        self._taken = self._accepted_energy - self.law.energy(self._slip, self._limit)

    def update_lagged(self, moved: np.ndarray, normal_forces: np.ndarray, arms: np.ndarray) -> bool:
        """Take these normal forces (n,) [N] and arms if they differ from the held ones by more than
        the law's `lag`, arms by what they change in the forces; whether they do, the same on all
        ranks. Where normal forces lag behind by a step, arms do by `ARMS`."""
        now, turned = self.coefficient * normal_forces, self._turn(arms)
        slipped = [
            self._slip + _tangential(moved - t, self._normals) for t in (self._turned, turned)
        ]
        before, after = (self.law.forces(each, self._limit) for each in slipped)
        by_arms = np.linalg.norm(after - before, axis=1).sum()
        sums = np.array([abs(now - self._limit).sum(), now.sum(), by_arms, self._limit.sum()])
        changed, total, by_arms, limit = self._comm.allreduce(sums)
        if changed <= self._lag * total and by_arms <= min(self._lag, ARMS) * limit:
            return False
        self._turned = turned
        if np.isfinite(self._lag):
            self._limit = now
        return True

    def accept(
        self,
        moved: np.ndarray,
        normal_forces: np.ndarray,
        normals: np.ndarray,
        arms: np.ndarray,
    ) -> None:
        """Take the present state as the last accepted one: keep the elastic part of the slip. The
        energy that changes because normal forces (n,) [N] and arms do counts as taken."""
        self._turned = self._turn(arms)
        slipped = self._slipped(moved)
        self._accepted_energy = self._taken + self.law.energy(slipped, self._limit)
        self._slip = self.law.elastic(slipped)
        self._begin(normal_forces, normals, arms)
        self._taken = self._accepted_energy - self.law.energy(self._slip, self._limit)

    def energy(self, moved: np.ndarray) -> float:
        """Energy taken at this rank's points, elastic and dissipated [N mm]."""
        return float((self._taken + self.law.energy(self._slipped(moved), self._limit)).sum())

    def forces(self, moved: np.ndarray) -> np.ndarray:
        """Forces on the points (n, 3) [N]."""
        return self.law.forces(self._slipped(moved), self._limit)

    def couple(self, moved: np.ndarray) -> np.ndarray:
        """Sum over the points of all ranks of arm x force (3,) [N mm]."""
        couples = np.cross(np.nan_to_num(self._arms), self.forces(moved))
        return self._comm.allreduce(couples.sum(0))

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
        self._slip = memory["slip"]
        self._taken = self._accepted_energy = memory["energy"]
        self._limit = np.zeros(len(self._taken))

    def _turn(self, arms):
        """By how much arms have turned since the last accepted state, 0 where that is not known."""
        return np.nan_to_num(arms - self._arms)

    def _slipped(self, moved):
        return self._slip + _tangential(moved - self._turned, self._normals)


def _tangential(vectors, normals):
    """The parts of vectors (n, 3) across unit normals (n, 3)."""
    return vectors - (vectors * normals).sum(1, keepdims=True) * normals


def _turned(slip, limit, normals):
    """The slip turned into the planes across `normals`, as long as before; 0 where nothing
    presses."""
    length = np.linalg.norm(slip, axis=1)
    flat = _tangential(slip, normals)
    flat *= (length / np.maximum(np.linalg.norm(flat, axis=1), 1e-300))[:, None]
    return np.where((limit > 0)[:, None], flat, 0.0)
