"""What presses the nodes of a sheet and rubs on them: tools and blank holders."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ...runtime.compiled import compiled
from ...tools.tool import Tool
from ..term import NO_TANGENT, Term, Triplets
from .coulomb import Coulomb, as_coulomb
from .friction import Friction
from .nodes import Nodes

NEVER = np.inf  # how normal forces on tools lag by default: they follow one step behind


class _Rubbing(NamedTuple):
    """What friction does at displacements u (nodes, 3) and `tool` (3,) [mm], with a `version` of
    `Friction`: energy [N mm] and forces on the nodes (nodes, 3) [N]."""

    u: np.ndarray
    tool: np.ndarray
    version: int
    energy: float
    forces: np.ndarray


class PressingTerm(Term):
    """A term by which a `tool` presses the sheet's `nodes`, with friction.

    A subclass tells what presses (`normal_forces`, `normals`, `pressing_forces`, `force`), and
    calls `start_friction` last in its `set_up`. In `set_load`, `update_lagged`, `accept` and
    `recall` it does its own part first, then friction's.

    coulomb: the law of friction, None if there is none; friction: its state at the nodes
    """

    tool: Tool
    nodes: Nodes
    coulomb: Coulomb | None
    friction: Friction | None = None
    _rubbing: _Rubbing | None = None

    def __init__(
        self, tool: Tool, friction: float | Mapping[str, float] | Coulomb, owner: str
    ) -> None:
        self.tool, self.coulomb = tool, as_coulomb(friction, owner, NEVER)
        if self.coulomb:
            self.resists = (*self.resists, "slide")

    # -- what a subclass tells

    def normal_forces(self) -> np.ndarray:
        """Sizes of the forces by which the tool presses this rank's nodes, (nodes,) [N]."""
        raise NotImplementedError

    def normals(self) -> np.ndarray:
        """Unit vectors along which this rank's nodes are or would be pressed, (nodes, 3)."""
        raise NotImplementedError

    def arms(self) -> np.ndarray:
        """Vectors from the tool to this rank's nodes, across its surface (nodes, 3) [mm], NaN where
        it is far off; 0 by default, as of a tool that is flat."""
        return np.zeros((self.nodes.count, 3))

    def levers(self) -> np.ndarray:
        """By how much the sheet's face slides as each node moves: the derivative of the node's
        place less that of its arm, symmetric (nodes, 3, 3); by default 1."""
        return np.tile(np.eye(3), (self.nodes.count, 1, 1))

    def pressing_forces(self) -> np.ndarray:
        """Forces by which the tool presses this rank's nodes, without friction, (nodes, 3) [N]. A
        tool moved by force is then where its force is balanced, on all ranks."""
        raise NotImplementedError

    def force(self) -> np.ndarray:
        """Sum of the `pressing_forces` of all ranks, (3,) [N]."""
        raise NotImplementedError

    # -- friction

    def start_friction(self) -> None:
        """Begin friction in the present state."""
        self._note_start()
        self._friction_force = np.zeros(3)  # in the last accepted state, before it was accepted
        if self.coulomb:
            given = self._coefficient(self.coulomb), self.normal_forces(), self.normals()
            self.friction = Friction(self.coulomb, *given, self.nodes.comm)
            self._friction_at_start = np.zeros(3)

    def _coefficient(self, coulomb):
        """Of all nodes, or of each."""
        if not isinstance(coulomb.coefficient, Mapping):
            return coulomb.coefficient
        found = np.zeros(self.nodes.count)
        for name, coefficient in coulomb.coefficient.items():
            found[self.blank.part(name).nodes] = coefficient
        return found

    def _note_start(self):
        """Sliding counts from here."""
        self._rubbing = None
        self._start = self.nodes.displacement(), self.tool.displacement.copy()
        self._offset = 0.0  # of sliding, by which it is not linear in the nodes' motion
        if self.coulomb:
            self._arms, self._levers = self.arms(), np.ascontiguousarray(self.levers())

    def slid(self) -> np.ndarray:
        """How far the sheet's face has slid along the tool since the last accepted state, as it is
        held during a solve: linear in the nodes' motion (nodes, 3) [mm]."""
        return self._offset + _moved(self._levers, *self._motion())

    def _motion(self):
        """Displacements of nodes now and at the start (nodes, 3), and how far the tool moved since
        then (3,) [mm]."""
        place, tool = self._start
        return self.nodes.view(), place, self.tool.displacement - tool

    def _slid_exactly(self):
        """As `slid`, not held: the nodes' motion relative to the tool less the change of their arms
        (nodes, 3) [mm]."""
        now, place, tool = self._motion()
        return now - place - tool - np.nan_to_num(self.arms() - self._arms)

    def rubbing_forces(self) -> np.ndarray:
        """Forces on this rank's nodes that have the moment of friction at the face (nodes, 3) [N]:
        less than friction where the sheet lies round a bar, more where it lies in a hollow."""
        if not self.friction:
            return np.zeros((self.nodes.count, 3))
        return self._rub(self.friction).forces

    def _rub(self, friction):
        """What friction does in the present state, reckoned once."""
        u, tool, now = self.nodes.view(), self.tool.displacement, self._rubbing
        if now and now.version == friction.version and (now.tool == tool).all():
            if (now.u == u).all():
                return now
        energy, forces = friction.potential(self.slid())
        forces = _times(self._levers, forces)
        self._rubbing = _Rubbing(u.copy(), tool, friction.version, energy, forces)
        return self._rubbing

    def rubbing_blocks(self) -> np.ndarray:
        """By which the forces of friction fall as nodes move (nodes, 3, 3) [N/mm]."""
        if not self.friction:
            return np.zeros((self.nodes.count, 3, 3))
        return _between(self._levers, self.friction.blocks(self.slid()))

    def update_friction(self) -> bool:
        """Have friction take normal forces and sliding anew if needed; whether it did."""
        if not self.friction:
            return False
        held, exact = self.slid(), self._slid_exactly()
        if not self.friction.update_lagged(self.normal_forces(), held, exact):
            return False
        self._offset, self._rubbing = self._offset + exact - held, None
        return True

    def restore_friction(self) -> None:
        """Have friction go back to the last accepted state."""
        if self.friction:
            self.friction.restore()
            self._offset, self._rubbing = 0.0, None

    def accept_friction(self) -> None:
        """Have friction take the present state as the last accepted one."""
        if self.friction:
            self._friction_force = self.nodes.total(self.rubbing_forces())
            given = self.normal_forces(), self.normals()
            self.friction.accept(self._slid_exactly(), *given)
            self._note_start()
            self._friction_at_start = self.nodes.total(self.rubbing_forces())

    def rubbed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As in `Rubbing`: the nodes."""
        most = self.friction.most if self.friction else np.zeros(self.nodes.count)
        pressed = most > 0
        return self.nodes.places[pressed], self.normals()[pressed], most[pressed]

    def friction_work(self) -> float:
        """Work of the tool's motion against friction since the last accepted state, by trapezoids,
        on rank 0 [N mm]."""
        if not self.friction:
            return 0.0
        moved = self.tool.displacement - self._start[1]
        work = 0.5 * (self._friction_at_start + self.nodes.total(self.rubbing_forces())) @ moved
        return float(work) if self.nodes.comm.rank == 0 else 0.0

    def forces(self) -> np.ndarray:
        """Forces of the tool on this rank's nodes, friction included (nodes, 3) [N]."""
        return self.pressing_forces() + self.rubbing_forces()

    # -- what a scene calls

    def energies(self) -> dict[str | None, float]:
        """As in `StoresKinds`: what friction took."""
        if not self.friction:
            return {}
        self.pressing_forces()  # so that a tool moved by force is where it is balanced
        return {"friction": self._rub(self.friction).energy}

    def stored(self) -> float:
        """As in `Term`, what friction took included."""
        return sum(self.energies().values())

    def add_forces(self, f: np.ndarray) -> None:
        """As in `Term`."""
        f[: 3 * self.nodes.count] -= self.forces().ravel()

    def applied_forces(self) -> np.ndarray:
        """As in `Loaded`."""
        return self.forces().ravel()

    def tangent(self) -> Triplets:
        """As in `Term`: that of friction, (9 nodes,) each [N/mm]."""
        if not self.friction:
            return NO_TANGENT
        return self.nodes.rows, self.nodes.cols, self.rubbing_blocks().ravel()

    def memory(self) -> dict[str, np.ndarray]:
        """Elastic slip (nodes, 3) [mm] and energy taken by friction (nodes, 1) [N mm] in the last
        accepted state."""
        if not self.friction:
            return {}
        known = self.friction.memory()
        return {"slip": known["slip"], "energy": known["energy"][:, None]}

    def recall_friction(self, memory: dict[str, Any]) -> None:
        """Give friction back what `memory` told of it."""
        if self.friction:
            self.friction.recall({"slip": memory["slip"], "energy": memory["energy"][:, 0]})
            self._note_start()

    def tool_force(self) -> np.ndarray:
        """As in `Pressing`."""
        return self.force() + self._friction_force


@compiled
def _times(matrices, vectors):
    """Products (n, 3) of matrices (n, 3, 3) and vectors (n, 3)."""
    found = np.empty_like(vectors)
    for i in range(len(vectors)):
        A, x = matrices[i], vectors[i]
        for j in range(3):
            found[i, j] = A[j, 0] * x[0] + A[j, 1] * x[1] + A[j, 2] * x[2]
    return found


@compiled
def _between(levers, blocks):
    """Products (n, 3, 3) of levers, blocks and the same levers again."""
    found = np.zeros_like(blocks)
    for n in range(len(blocks)):
        B, L = blocks[n], levers[n]
        if not B.any():
            continue
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    for m in range(3):
                        found[n, i, j] += L[i, k] * B[k, m] * L[m, j]
    return found


@compiled
def _moved(levers, now, start, tool):
    """`_times` of levers and what nodes moved relative to a tool."""
    return _times(levers, now - start - tool)
