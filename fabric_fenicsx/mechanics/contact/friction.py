"""The state of friction at points that are pressed on a tool or on another sheet."""

from typing import Protocol

import numpy as np
from mpi4py import MPI

from .coulomb import Coulomb

INEXACT = 0.01  # of the friction that there can be, by which linear sliding may be off


class Sliding(Protocol):
    """Motion of n points along what they touch, since an accepted state.

    normals (n, 3): unit vectors across the touching faces in that state
    """

    normals: np.ndarray

    def slid(self) -> np.ndarray:
        """Motion to the present displacement, in which it is linear, (n, 3) [mm]."""


class FrictionState:
    """Coulomb friction at n points of this rank: elastic slip, normal forces and energy taken, in
    the last accepted state and in the trial state of a step.

    Within a step friction is a potential, as normal forces and tangent planes are lagged. The
    tangential part of `sliding` adds to the elastic slip of the accepted state, which begins with 0
    where a point is pressed for the first time. `begin`, `update` and `accept` take normal forces
    (n,) [N]. All ranks use it together.

    - coefficient: of all points, or one for each (n,)
    - limit (n,): friction that the points can bear in the accepted state [N]
    """

    def __init__(
        self,
        law: Coulomb,
        coefficient: float | np.ndarray,
        normal_forces: np.ndarray,
        sliding: Sliding,
        comm: MPI.Comm,
    ) -> None:
        self.law, self.coefficient, self._comm = law, coefficient, comm
        self._lag = law.lag or np.inf
        n = len(normal_forces)
        self._slip, self._accepted_energy = np.zeros((n, 3)), np.zeros(n)
        self._start(normal_forces, sliding)

    def _start(self, normal_forces, sliding):
        """Take normal forces for the next step, and turn the slip into the new tangent planes."""
        self.sliding, self.limit = sliding, self.coefficient * normal_forces
        self._slip = _turned(self._slip, self.limit, sliding.normals)
        self.begin()

    def begin(self, normal_forces: np.ndarray | None = None) -> None:
        """Go back to the accepted state, or to it under other normal forces. The energy that
        changes because they do counts as taken."""
        self._limit = self.limit if normal_forces is None else self.coefficient * normal_forces
        # what the elastic slip does not hold
        self._taken = self._accepted_energy - self.law.potential(self._slip, self._limit)[0]
        self._offset = 0.0  # of sliding, by which it is not linear
        self._known: tuple[np.ndarray, float, np.ndarray] | None = None

    def update(self, normal_forces: np.ndarray, exact: np.ndarray) -> bool:
        """Take the present normal forces and `exact` sliding (n, 3) [mm], if these forces differ
        from the lagged ones by more than the law's `lag`, or friction does by more than `INEXACT`
        for the sliding; true if so, the same on all ranks. With an infinite `lag` nothing is."""
        if np.isinf(self._lag):
            return False
        linear, now = self._slid(), self.coefficient * normal_forces
        missed = self._potential(exact)[1] - self._potential(linear)[1]
        off = np.linalg.norm(missed, axis=1).sum()
        sums = np.array([abs(now - self._limit).sum(), now.sum(), off, self._limit.sum()])
        changed, total, off, limit = self._comm.allreduce(sums)
        if changed <= self._lag * total and off <= INEXACT * limit:
            return False
        self._limit, self._known = now, None
        self._offset = self._offset + exact - linear
        return True

    def accept(self, normal_forces: np.ndarray, exact: np.ndarray, sliding: Sliding) -> None:
        """Take the present state as the accepted one: keep the elastic part of the slip. exact
        (n, 3): how far points slid to it [mm]; sliding: from it on."""
        slipped = self._slipped(exact)
        self._accepted_energy = self._taken + self.law.potential(slipped, self._limit)[0]
        self._slip = self.law.elastic(slipped)
        self._start(normal_forces, sliding)

    def energy(self) -> float:
        """Energy taken at this rank's points, elastic and dissipated [N mm]."""
        return self._now()[1]

    def forces(self) -> np.ndarray:
        """Forces on the points (n, 3) [N]."""
        return self._now()[2]

    def blocks(self) -> np.ndarray:
        """Decrease of the forces as each point slides, (n, 3, 3) [N/mm]."""
        return self.law.blocks(self._slipped(self._slid()), self._limit, self.sliding.normals)

    def memory(self) -> dict[str, np.ndarray]:
        """Elastic slip (n, 3) [mm] and energy taken (n, 1) [N mm] in the accepted state."""
        return {"slip": self._slip, "energy": self._accepted_energy[:, None]}

    def recall(self, memory: dict[str, np.ndarray], sliding: Sliding) -> None:
        """Take back what `memory` gave; `accept` of that state, without motion, is to follow."""
        self._slip = np.ascontiguousarray(memory["slip"])
        self._accepted_energy = memory["energy"].reshape(-1)
        self.sliding, self.limit = sliding, np.zeros(len(self._slip))
        self.begin()

    def _slid(self):
        return self._offset + self.sliding.slid()

    def _slipped(self, slid):
        return _slipped(self._slip, slid, self.sliding.normals)

    def _potential(self, slid):
        """Energy of each point (n,) and forces (n, 3) after sliding."""
        return self.law.potential(self._slipped(slid), self._limit)

    def _now(self):
        """Sliding, energy and forces in the present state, evaluated once."""
        slid, known = self._slid(), self._known
        if known is None or not np.array_equal(slid, known[0]):
            energy, forces = self._potential(slid)
            known = self._known = slid, float((self._taken + energy).sum()), forces
        return known


def _slipped(slip, moved, normals):
    """Slip (n, 3) and the parts of motions `moved` (n, 3) across unit normals (n, 3), added up."""
    x, n = moved.T, normals.T
    along = x[0] * n[0] + x[1] * n[1] + x[2] * n[2]
    return slip + (moved - along[:, None] * normals)


def _turned(slip, limit, normals):
    """The slip turned into the planes across `normals`, as long as before; 0 where nothing
    presses."""
    length = np.linalg.norm(slip, axis=1)
    flat = _slipped(np.zeros_like(slip), slip, normals)
    flat *= (length / np.maximum(np.linalg.norm(flat, axis=1), 1e-300))[:, None]
    return np.where((limit > 0)[:, None], flat, 0.0)
