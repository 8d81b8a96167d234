"""Friction at points that are pressed on a tool or on another sheet: its state, and their slip."""

from collections.abc import Callable
from typing import Protocol, Self

import numpy as np
from mpi4py import MPI

from ..energy.nodes import Nodes
from ..energy.term import Triplets
from ..surfaces.tool import Tool
from .contact_points import ContactPairs, ContactPoints, RelativeMotion
from .coulomb import Coulomb, slipped


class SlipMap(Protocol):
    """Motion of n points along what they touch, since this was made.

    normals (n, 3): unit vectors across the touching faces then
    """

    normals: np.ndarray

    def slid(self) -> np.ndarray:
        """Motion to the present displacement, in which it is linear, (n, 3) [mm]."""

    def exact(self, now: Self) -> np.ndarray:
        """Exact motion to the present state, in which the map `now` was made, (n, 3) [mm]."""


class ToolSlip:
    """Slip of the sheet's faces along a tool since this was made, at the nodes.

    A face slips as its node moves relative to the tool, less the change of the node's offset from
    the tool, which turns with the surface. The linear part uses the offsets' derivatives in the
    first state.

    - normals (nodes, 3): unit vectors; offsets (nodes, 3) [mm]: NaN where the tool is far off
    - derivative (nodes, 3, 3): of the face's place in the node's, symmetric
    """

    def __init__(
        self,
        nodes: Nodes,
        tool: Tool,
        normals: np.ndarray,
        offsets: np.ndarray,
        derivative: np.ndarray,
    ) -> None:
        self.normals, self.offsets, self._derivative = normals, offsets, derivative
        self._nodes, self._tool = nodes, tool
        self._place, self._tool_place = nodes.displacement(), tool.displacement.copy()
        self._slid = 2 * (np.full((nodes.count, 3), np.nan),)  # of the last motion

    def tool_moved(self) -> np.ndarray:
        """Motion of the tool (3,) [mm]."""
        return self._tool.displacement - self._tool_place

    def _moved(self):
        return self._nodes.view() - self._place - self.tool_moved()

    def slid(self) -> np.ndarray:
        if not np.array_equal(moved := self._moved(), self._slid[0]):
            self._slid = moved, self.on_nodes(moved)
        return self._slid[1]

    def exact(self, now: "ToolSlip") -> np.ndarray:
        """As in `SlipMap`, of places less offsets."""
        return self._moved() - np.nan_to_num(now.offsets - self.offsets)

    def on_nodes(self, forces: np.ndarray) -> np.ndarray:
        """Forces on the nodes (nodes, 3) of forces on the faces (nodes, 3) [N]."""
        return np.einsum("nij,nj->ni", self._derivative, forces)  # faster than sums of rows

    def on_node_blocks(self, blocks: np.ndarray) -> np.ndarray:
        """Stiffness at the nodes of stiffness at the faces, (nodes, 3, 3) [N/mm]."""
        return self._derivative @ blocks @ self._derivative


class FaceSlip:
    """Slip of the faces of two sheets at points of one over the other, from the `start` on. All
    ranks make and use it together.

    - start: the `ContactPairs` from which on
    - normals (count, 3): unit vectors across the faces at all points, 0 at those that lie over
      nothing
    """

    def __init__(self, points: ContactPoints, start: ContactPairs) -> None:
        normals = start.unit_normals()
        self._points, self.start = points, start
        self.normals = points.of_all(start, normals)
        self._motion = RelativeMotion(points.blank, start.corners, normals)
        self._place = self._motion.relative()
        self._moved, self._offsets = start.moved(), self._motion.offsets()

    def slid(self) -> np.ndarray:
        return self._points.of_all(self.start, self._motion.relative() - self._place)

    def exact(self, _: "FaceSlip") -> np.ndarray:
        """As in `SlipMap`, at any angle by which the triangles turn."""
        turned = self._motion.offsets() - self._offsets
        return self._points.of_all(self.start, self.start.moved() - self._moved + turned)

    def add(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add to f, of this rank's degrees of freedom [N], forces (count, 3) [N] on the faces of
        the points, and their reactions, as forces on the nodes."""
        self._motion.add(forces[self.start.points], f)

    def triplets(self, blocks: np.ndarray) -> Triplets:
        """As of `Term.tangent`. blocks (count, 3, 3): growth of each face's force [N/mm]."""
        return self._motion.triplets(blocks[self.start.points])


class FrictionState:
    """Coulomb friction at n points of this rank: elastic slip, normal forces and energy taken, in
    the last accepted state and in the trial state of a step.

    Within a solve friction is a potential, as normal forces and tangent planes are lagged. The
    tangential part of sliding adds to the elastic slip of the accepted state, which begins with 0
    where a point is pressed for the first time. `begin`, `update` and `accept` take normal forces
    (n,) [N]. All ranks use it together.

    - coefficient, stiffness: as in `Coulomb`, of all points, or one for each (n,)
    - slip_ratio (n,): largest slip in accepted states over the elastic one, above 1 where it slid
    - friction_limit (n,): friction that the points can bear in the accepted state [N]
    - start, sliding: from the accepted state on, and from where tangent planes were taken last
    """

    def __init__(
        self,
        law: Coulomb,
        coefficient: float | np.ndarray,
        normal_forces: np.ndarray,
        sliding: SlipMap,
        comm: MPI.Comm,
        stiffness: float | np.ndarray = 0.0,
    ) -> None:
        self._stiffness = stiffness
        self.law, self.coefficient, self._comm = law, coefficient, comm
        n = len(normal_forces)
        self._slip, self._accepted_energy = np.zeros((n, 3)), np.zeros(n)
        self.slip_ratio = np.zeros(n)
        self._start(normal_forces, sliding)

    def _start(self, normal_forces, sliding):
        """Take normal forces for the next step, and turn the slip into the new tangent planes."""
        self.start, self.friction_limit = sliding, self.coefficient * normal_forces
        self._slip = _turned(self._slip, self.friction_limit, sliding.normals)
        self.begin()

    def begin(self, normal_forces: np.ndarray | None = None) -> None:
        """Go back to the accepted state, under other normal forces without a change of energy."""
        limit = self.friction_limit if normal_forces is None else self.coefficient * normal_forces
        self._limit = limit
        held = self._potential(self._slip, self._limit)[0]  # by the elastic slip
        self._energy_correction = self._accepted_energy - held
        self._take(self.start, self._slip)

    def _take(self, sliding, slip):
        """Let `sliding` add to the `slip` (n, 3) [mm] where it began."""
        self.sliding, self._slip_before = sliding, slip
        self._known: tuple[np.ndarray, float, np.ndarray] | None = None

    def update(self, normal_forces: np.ndarray, sliding: Callable[[], SlipMap]) -> bool:
        """Take the present normal forces and tangent planes, and exact sliding since the start, if
        that changes friction by more than the law's `lag` of what there can be; true if so, the
        same on all ranks. sliding: makes that from now on. An infinite `lag` takes nothing."""
        if np.isinf(self.law.lag):
            return False
        limit = self.coefficient * normal_forces
        rubs = bool(limit.any() or self.friction_limit.any() or self._limit.any())
        if not self._comm.allreduce(rubs, MPI.LOR):
            return False
        now = sliding()
        slip = self._slip_at(self.start.exact(now), now)
        changes = self._potential(slip, limit)[1] - self.forces()
        sums = np.array([np.linalg.norm(changes, axis=1).sum(), limit.sum()])
        changed, total = self._comm.allreduce(sums)
        is_taken = changed > self.law.lag * total
        if is_taken:
            self._limit = limit
            self._take(now, slip)
        self._set_energy(slip, limit)
        return bool(is_taken)

    def accept(self, normal_forces: np.ndarray, sliding: SlipMap) -> None:
        """Take the present state as accepted: keep the elastic slip. sliding: from it on."""
        slip = self._slip_at(self.start.exact(sliding), self.sliding)
        self._accepted_energy = self._energy_correction + self._potential(slip, self._limit)[0]
        now = np.linalg.norm(slip, axis=1) / self.law.slips(self._limit, self._stiffness)
        self.slip_ratio = np.maximum(self.slip_ratio, np.where(self._limit > 0, now, 0.0))
        limit = self.coefficient * normal_forces  # which are all that is known when recalled
        self._slip = self.law.elastic(slip, limit, self._stiffness)
        self._start(normal_forces, sliding)

    def energy(self) -> float:
        """Energy taken at this rank's points, elastic and dissipated [N mm]."""
        return self._now()[1]

    def forces(self) -> np.ndarray:
        """Forces on the points (n, 3) [N]."""
        return self._now()[2]

    def blocks(self) -> np.ndarray:
        """Decrease of the forces as each point slides, (n, 3, 3) [N/mm]."""
        return self.law.blocks(
            self._slipped(self.sliding.slid()), self._limit, self.sliding.normals, self._stiffness
        )

    def memory(self) -> dict[str, np.ndarray]:
        """Accepted elastic slip (n, 3) [mm] and energy (n, 1) [N mm], and slip ratio (n, 1)."""
        ratio, energy = self.slip_ratio[:, None], self._accepted_energy[:, None]
        return {"slip": self._slip, "energy": energy, "used": ratio}

    def recall(self, memory: dict[str, np.ndarray], sliding: SlipMap) -> None:
        """Take back what `memory` gave; `accept` of that state, without motion, is to follow."""
        self._slip = np.ascontiguousarray(memory["slip"])
        self._accepted_energy = memory["energy"].reshape(-1)
        self.slip_ratio = memory["used"].reshape(-1)
        self.start, self.friction_limit = sliding, np.zeros(len(self._slip))
        self.begin()

    def _slip_at(self, exact, sliding):
        """Slip (n, 3) after `exact` sliding since the start, in the tangent planes of `sliding`."""
        turned = _turned(self._slip, self.friction_limit, sliding.normals)
        return slipped(self._slip if sliding is self.start else turned, exact, sliding.normals)

    def _slipped(self, slid):
        return slipped(self._slip_before, slid, self.sliding.normals)

    def _set_energy(self, slip, limit):
        """Let the energy be that of the state alone, however it was found: of the way to this slip,
        on which the friction that can be borne went to this limit."""
        mean = (self.friction_limit + limit) / 2
        before, after = (self._potential(z, mean)[0] for z in (self._slip, slip))
        held = self._potential(self._slipped(self.sliding.slid()), self._limit)[0]
        self._energy_correction = self._accepted_energy + after - before - held
        self._known = None

    def _potential(self, z, limit):
        return self.law.potential(z, limit, self._stiffness)

    def _now(self):
        """Sliding, energy and forces in the present state, evaluated once."""
        slid, known = self.sliding.slid(), self._known
        if known is None or not (slid is known[0] or np.array_equal(slid, known[0])):
            energy, forces = self._potential(self._slipped(slid), self._limit)
            known = self._known = slid, float((self._energy_correction + energy).sum()), forces
        return known


def _turned(slip, limit, normals):
    """The slip turned into the planes across `normals`; 0 where nothing presses."""
    length = np.linalg.norm(slip, axis=1)
    flat = slipped(np.zeros_like(slip), slip, normals)
    flat *= (length / np.maximum(np.linalg.norm(flat, axis=1), 1e-300))[:, None]
    return np.where((limit > 0)[:, None], flat, 0.0)
