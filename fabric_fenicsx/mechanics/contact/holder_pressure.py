"""The pressure of a blank holder, without contact."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...runtime.errors import InputError
from ...runtime.rules import ABOVE_ZERO_OR_INF, FROM_ZERO
from ...tools.primitives import Plane
from ...tools.tool import Tool
from ...tools.values import checked_vector
from ..load import at_load, check_over_load
from ..output import Value
from ..term import SceneFacts
from ..term_checks import bind
from .coulomb import Coulomb
from .nodes import Nodes, values_at
from .pressing_term import PressingTerm
from .sheet_contact import SheetContact
from .thickness import PlyThickness

UPDATES = 3  # of the pressed areas in a step, at most: at the flange's end they may alternate
PRESSURE = "pressure of the blank holder [MPa]"


class BlankHolderPressure(PressingTerm):
    """Dead `pressure` [MPa] along `direction` (3,) on the parts of the sheet under a holder.

    pressure: a number, there from the start, or a function of the load factor. A `Contact` bears
    it on the other side of the sheet.
    under: function of positions (3, n) [mm] to the share (n,) of each node's area, 0 to 1, that is
    under the holder. The areas are lagged, but updated up to `UPDATES` times in a step if more than
    `lag` of their sum has changed; lag None: never within a step.
    against: contacts with and between the sheets that lie on this one, from it to the last. The
    pressure then acts only where all of them lie on one another, as a plate's does that rests on
    the whole stack: a rim that reaches beyond the next sheet is not pressed.
    tool: moves with the holder along a path, for its friction; by default one at rest.
    friction: of the holder's side, a coefficient or a `Coulomb`, as of `Contact`: without it the
    holder does not hold the sheet in its plane.

    Raises InputError for a direction or pressure that is not finite or below 0, for `under` of
    another shape, and as `Nodes` does.
    """

    name, energy_kind = "blank holder", "friction"

    def __init__(
        self,
        pressure: float | Callable[[float], float],
        direction: ArrayLike,
        under: Callable[[np.ndarray], np.ndarray],
        tool: Tool | None = None,
        lag: float | None = None,
        against: Sequence[SheetContact] = (),
        friction: float | Mapping[str, float] | Coulomb = 0.0,
    ) -> None:
        check_over_load(PRESSURE, FROM_ZERO, pressure)
        if lag is not None:
            lag = ABOVE_ZERO_OR_INF.check(f"lag of the {self.name}", lag)
        self.under, self.lag, self._against = under, lag, list(against)
        self._pressure = pressure
        self.direction = checked_vector(f"direction of the {self.name}", direction, unit=True)
        tool = tool or Tool(Plane((0, 0, 0), self.direction), name=self.name)
        super().__init__(tool, friction, self.name)
        if self.tool.force:
            raise InputError(
                f"{self.tool.name} presses without contact and is moved by force; allowed is a path"
            )

    def set_up(self, scene: SceneFacts) -> None:
        """As in `Term`."""
        if self.part.is_whole and any(part.thickness for part in scene.blank.parts.values()):
            raise InputError(
                "the blank holder would press each sheet of the stack; allowed is "
                '`.on("NAME")` with the one that it touches'
            )
        self.nodes = Nodes(scene.blank, self.part)
        for contact in self._against:
            bind(contact, scene)
        self._plies = PlyThickness(scene)
        self._accepted_areas = self._pressed()
        self.set_load(0.0)
        self.accept()
        self.start_friction()

    def set_load(self, load: float) -> None:
        """Set the pressure; InputError if it is not a number from 0 there."""
        self.now = at_load(PRESSURE, FROM_ZERO, self._pressure, load)
        self._areas = self._accepted_areas
        self._updates = 0
        if self.friction:  # as these forces follow from the load alone
            self.friction.press(self.normal_forces())

    def accept(self) -> None:
        """Count `work` from the present state, and press what is under the holder now."""
        self._from, self._before = self.nodes.displacement(), self.now
        self._accepted_force = self.nodes.total(self.pressing_forces())
        self._areas = self._accepted_areas = self._pressed()
        self.accept_friction()

    def update_lagged(self) -> bool:
        """Press the areas under the holder now, if they differ by more than `lag`, and have
        friction follow; whether any did."""
        updated = self._update_areas()
        rubbed = self.update_friction()
        return updated or rubbed

    def _update_areas(self):
        if self.lag is None or self._updates == UPDATES:
            return False
        now = self._pressed()
        changed, all_of_it = self.nodes.total(np.column_stack([abs(now - self._areas), now]))
        if changed <= self.lag * all_of_it:
            return False
        self._areas, self._updates = now, self._updates + 1
        return True

    def work(self) -> float:
        """Done on this rank's nodes since the last accepted state, by trapezoids [N mm]."""
        moved = (self._areas[:, None] * (self.nodes.displacement() - self._from)).sum(0)
        pressed = float(0.5 * (self._before + self.now) * (moved @ self.direction))
        return pressed + self.friction_work()

    def energies(self) -> dict[str | None, float]:
        """As in `StoresKinds`: minus the work of the pressure, and what friction took."""
        pressed = float((self.pressing_forces() * self.nodes.displacement()).sum())
        return {**super().energies(), None: -pressed}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """As in `Remembers`."""
        self.recall_friction(memory)

    def normal_forces(self) -> np.ndarray:
        """As in `PressingTerm`."""
        return self.now * self._areas

    def pressing_forces(self) -> np.ndarray:
        """As in `PressingTerm`."""
        return self.normal_forces()[:, None] * self.direction

    def normals(self) -> np.ndarray:
        """As in `PressingTerm`."""
        return np.tile(self.direction, (self.nodes.count, 1))

    def cell_fields(self) -> dict[str, Value]:
        """As `PlyThickness.fields`, of the face that the holder presses."""
        share = self._areas / np.maximum(self.nodes.areas, 1e-300)
        lost = self.blank.cell_means(share) * self._plies.lost_under(self.now)
        return self._plies.fields(lost)

    def force(self) -> np.ndarray:
        """Of the holder on the ply, of all ranks (3,) [N], in the last accepted state."""
        return self._accepted_force

    def _pressed(self):
        """Areas (nodes,) under the holder [mm^2]."""
        x = self.nodes.places + self.nodes.displacement()
        return self.shares(x.T) * self._covered()

    def shares(self, points: np.ndarray) -> np.ndarray:
        """Of each of `points` (3, n) [mm], how much is under the holder, 0 to 1 (n,)."""
        return np.clip(values_at(self.under, points, f"`under` of the {self.name}", float), 0, 1)

    def _covered(self):
        """Areas (nodes,) of the sheet over which all the others lie [mm^2]."""
        if not self._against:
            return self.nodes.areas
        covered = self._against[-1].points.covered()
        for contact in reversed(self._against[:-1]):
            covered = contact.points.covered(covered)
        return covered
