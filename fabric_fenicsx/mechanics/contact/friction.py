"""Coulomb friction of a sheet on tools, as an incremental potential."""

from collections.abc import Mapping

import numpy as np

from ...runtime.errors import InputError
from ...tools.tool import Tool, checked_tool
from ..term import SceneFacts, Term, Triplets
from .nodes import PressingTerm
from .slipping import elastic, potential, stiffness, tangent, traction, turned


class Friction(Term):
    """Friction of coefficient `mu` with a `tool`, where a term of the scene presses nodes with it;
    mu: a number, or of a stack one for each sheet, {name: number}.

    Sliding along the tool since the last accepted state adds to an elastic slip z, in the plane
    that was tangent then, and takes mu P (|z|^2 / 2 s up to |z| = s, |z| - s / 2 beyond) from a
    node pressed by P [N]: a potential, as P is that of the last accepted state. In sticking a node
    so slips by at most `slip` s [mm]; an accepted state keeps of z what is elastic. Pressed nodes
    start from z = 0.

    lag: how much of the normal forces may differ from those that friction was reckoned with, of
    their sum, before the state is solved for anew with these; None: any, as they follow a step
    behind. settled: force of the tool on the ply (3,) [N] in the last accepted state, before normal
    forces were taken anew. largest: of the coefficients. Raises InputError for numbers out of
    range, and if not exactly one term of the scene presses with the tool.
    """

    name = energy_kind = "friction"

    def __init__(
        self,
        tool: Tool,
        mu: float | Mapping[str, float],
        slip: float = 0.1,
        lag: float | None = None,
    ) -> None:
        checked_tool("friction", tool)
        each = list(mu.values()) if isinstance(mu, Mapping) else [mu]
        checks = (
            *(("coefficient", value, value >= 0) for value in each),
            ("slip", slip, slip > 0),
            ("lag", lag, lag is None or lag > 0),
        )
        for name, value, fits in checks:
            if not (fits and np.isfinite(value or 0.0)):
                allowed = "from 0" if name == "coefficient" else "above 0"
                raise InputError(
                    f"friction on {tool.name} has {name} {value}; allowed is a number {allowed}"
                )
        self.tool, self._coefficient, self.slip, self.lag = tool, mu, slip, lag
        self.largest = max(each, default=0.0)
        self.resists = ("slide",) if any(each) else ()
        self.mu: float | np.ndarray = 0.0 if isinstance(mu, Mapping) else mu  # or one for each node

    def set_up(self, scene: SceneFacts) -> None:
        """As in `Term`."""
        pressing = [
            term
            for term in scene.terms
            if isinstance(term, PressingTerm) and term.tool is self.tool
        ]
        if len(pressing) != 1:
            found = "no term" if not pressing else f"{len(pressing)} terms"
            raise InputError(
                f"friction on {self.tool.name} finds {found} of its scene that press with this "
                "tool; allowed is one, as `Contact(tool)` with the same tool, or the blank holder's"
            )
        (self._pressing,) = pressing
        self._pressing.bind(scene)  # before this one, in whatever order they are given
        self.nodes = self._pressing.nodes
        if isinstance(self._coefficient, Mapping):
            self.mu = np.zeros(self.nodes.count)
            for name, mu in self._coefficient.items():
                self.mu[scene.blank.part(name).nodes] = mu
        if self.tool.force:
            self._pressing.add_friction(self)
        self._taken = np.zeros(self.nodes.count)  # of energy at accepted states
        self._z, self._limit = np.zeros((self.nodes.count, 3)), np.zeros(self.nodes.count)
        self._start()
        self.settled = self.force()

    # -- what a scene calls

    def at(self, load: float) -> None:
        """Go back to the normal forces of the last accepted state, or take those that the load
        factor prescribes."""
        self._limit = (
            self.mu * self._normal_forces()[0]
            if self._pressing.prescribed
            else self._accepted_limit
        )

    def accept(self) -> None:
        """Keep what slip is elastic; what energy changes as normal forces do counts as taken."""
        z = self._slipped()
        self.settled = self.force()
        self._taken = self._taken + potential(z, self._limit, self.slip)
        self._z = elastic(z, self.slip)
        self._start()
        self._taken -= potential(self._z, self._limit, self.slip)

    def work(self) -> float:
        """Work of the tool's motion since the last accepted state, on rank 0 [N mm]."""
        work = 0.5 * (self._force + self.force()) @ (self.tool.displacement - self._tool)
        return float(work) if self.nodes.comm.rank == 0 else 0.0

    def update_lagged(self) -> bool:
        """Take the present normal forces, if they differ by more than allowed; whether they did."""
        if self.lag is None:
            return False
        now = self._normal_forces()[0]
        changed, all_of_it = self.nodes.total(
            np.column_stack([abs(self.mu * now - self._limit), self.mu * now])
        )
        if changed <= self.lag * all_of_it:
            return False
        self._limit = self.mu * now
        self._pressing.rebalance()
        return True

    def stored(self) -> float:
        """Energy taken by this rank's nodes, elastic and dissipated [N mm]."""
        # puts a tool moved by force where it is balanced, here and below
        self._pressing.normal_forces()
        return float((self._taken + potential(self._slipped(), self._limit, self.slip)).sum())

    def add_forces(self, f: np.ndarray) -> None:
        """Add the potential's derivative to f, of this rank's degrees of freedom [N]."""
        self._pressing.normal_forces()
        f[: 3 * self.nodes.count] -= self.forces().ravel()

    def applied_forces(self) -> np.ndarray:
        """As in `Term`."""
        return self.forces().ravel()

    def tangent(self) -> Triplets:
        """As in `Term`, (9 nodes,) each [N/mm]."""
        self._pressing.normal_forces()
        return self.nodes.rows, self.nodes.cols, self.blocks().ravel()

    def memory(self) -> dict[str, np.ndarray]:
        """Elastic slip (nodes, 3) [mm] and energy taken (nodes, 1) [N mm] when last
        accepted."""
        energy = self._taken + potential(self._z, self._limit, self.slip)
        return {"slip": self._z, "energy": energy[:, None]}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Take back what `memory` gave."""
        self._z, self._taken = memory["slip"], memory["energy"][:, 0]
        self._from, self._tool = self.nodes.displacement(), self.tool.displacement.copy()
        self._limit = np.zeros(self.nodes.count)  # until `accept`

    # -- results

    def forces(self) -> np.ndarray:
        """Of the tool on this rank's nodes (nodes, 3) [N]."""
        return -traction(self._slipped(), self._limit, self.slip)

    def blocks(self) -> np.ndarray:
        """By which forces fall as nodes move, (nodes, 3, 3) [N/mm]: mu P / max(|z|, s) times the
        tangent plane, less the direction of slip where it slides."""
        return stiffness(self._slipped(), self._limit, self._normal, self.slip)

    def tool_force(self, tool: Tool) -> np.ndarray:
        """As in `Term`."""
        return self.settled if tool is self.tool else np.zeros(3)

    def force(self) -> np.ndarray:
        """Of the tool on the ply, of all ranks (3,) [N]."""
        return self.nodes.total(self.forces())

    # --

    def _start(self):
        """Take normal forces, their directions and places from the present state, and turn the slip
        with them."""
        normal_forces, self._normal = self._normal_forces()
        self._limit = self._accepted_limit = self.mu * normal_forces
        self._z = turned(self._z, self._limit, self._normal)
        self._from, self._tool = self.nodes.displacement(), self.tool.displacement.copy()
        self._force = self.force()

    def _normal_forces(self):
        return np.linalg.norm(self._pressing.normal_forces(), axis=1), self._pressing.normals()

    def _slipped(self):
        moved = self.nodes.displacement() - self._from - (self.tool.displacement - self._tool)
        return self._z + tangent(moved, self._normal)
