"""The pressure of a blank holder, without contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import shapely
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.rules import ABOVE_ZERO_OR_INF, FROM_ZERO
from ..energy.load import at_load
from ..energy.materials import sheets_of
from ..energy.nodes import Nodes, shares_at
from ..energy.output import Value
from ..energy.term import SceneFacts, bind
from ..surfaces.primitives import Plane
from ..surfaces.surfaces import checked_vector
from ..surfaces.tool import Tool
from .contact_term import PlyThickness, ToolContactTerm
from .coulomb import Friction
from .sheet_contact import SheetContact
from .tool_contact import Contact


class _Bare:
    """The share (n,) of positions (3, n) that is `under` a holder where none of these triangles
    (m, 3, 3) lies, as seen along its direction."""

    def __init__(self, under: Callable, triangles: np.ndarray, direction: np.ndarray) -> None:
        self._under, self._across = under, np.linalg.svd(direction[None])[2][1:].T
        self._lying = shapely.STRtree(shapely.polygons(triangles @ self._across))

    def over(self, corners: np.ndarray) -> np.ndarray:
        """As `Flange.over`."""
        share = self._under.over(corners) if hasattr(self._under, "over") else np.nan
        return np.where(share == 0, np.zeros(len(corners)), np.nan)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        share = shares_at(self._under, x)
        at = np.flatnonzero(share)
        points = shapely.points(x[:, at].T @ self._across)
        share[at[self._lying.query(points, "intersects")[0]]] = 0.0
        return share


class BlankHolderPressure(ToolContactTerm):
    """Dead pressure of a blank holder on the parts of a sheet under it; of a stack, on the sheet
    that is nearest to the holder at each place.

    A `Contact` bears it on the other side of the sheet. The pressed areas are lagged.

    Parameters
    ----------
    pressure
        Number [MPa], there from the start, or function of the load factor.
    direction
        In which it presses (3,).
    under
        Function of positions (3, n) [mm] to the share (n,) of each, 0 to 1, that is under the
        holder: what is pressed of a triangle follows from its values within it.
    tool
        Moves with the holder along a path, for its friction; by default one at rest.
    lag
        The areas are updated within a step, at most three times, if more than this share of
        their sum has changed; with None never.
    against
        Of a term `.on` the sheet that the holder touches: contacts with and between those that lie
        on it, from it to the last. The pressure then acts only where all of them lie on one
        another, as a plate's that rests on the whole stack.
    friction
        Of the holder's side, as of `Contact`. Without it the holder does not hold the sheet in its
        plane.
    borne
        As `under`, by default the same: where the die bears the pressure. Corners of triangles
        beyond it are not pressed, as nothing is below them; those that are bear all of it. If it is
        a die's flange and neither side has friction, the pressure acts along the die's normals: it
        would push nodes that slide over the edge, before the areas are updated, along the die.

    Raises
    ------
    InputError
        For a direction or pressure that is not finite or below 0, a tool moved by force, `under` of
        another shape, and as `Contact` does for blanks.

    Examples
    --------
    >>> holder = ff.BlankHolderPressure(lambda load: 2 * load, (0, 0, -1), lambda x: x[0] > 50)
    >>> holder.shares(np.array([[40.0, 60.0], [0.0, 0.0], [0.0, 0.0]]))
    array([0., 1.])
    """

    name, energy_kind = "blank holder", "friction"
    MAX_UPDATES = 3  # of the areas in a step: at the flange's end they may alternate
    FIRST, AT_FIRST = 2, 1e-3  # so many updates need but this share of `lag`
    PRESSURE = "pressure of the blank holder [MPa]"

    def __init__(
        self,
        pressure: float | Callable[[float], float],
        direction: ArrayLike,
        under: Callable[[np.ndarray], np.ndarray],
        tool: Tool | None = None,
        lag: float | None = None,
        against: Sequence[SheetContact] = (),
        friction: Friction = 0.0,
        borne: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> None:
        at_load(self.PRESSURE, FROM_ZERO, pressure, 0.0)
        if lag is not None:
            lag = ABOVE_ZERO_OR_INF.check(f"lag of the {self.name}", lag)
        self.under, self.lag, self._against = under, lag, list(against)
        self._borne = borne or under
        self._pressure = pressure
        self.direction = checked_vector(f"direction of the {self.name}", direction, unit=True)
        tool = tool or Tool(Plane((0, 0, 0), self.direction), name=self.name)
        super().__init__(tool, friction, self.name)
        if self.tool.force:
            raise InputError(
                f"{self.tool.name} presses without contact and is moved by force; allowed is a path"
            )

    def set_up(self, scene: SceneFacts) -> None:
        sheets = [self.part]
        if self.part.is_whole and any(part.thickness for part in scene.blank.parts.values()):
            if self._against:
                raise InputError(
                    'the blank holder of a stack needs `.on("NAME")`, the sheet that it touches, '
                    "with `against`"
                )
            sheets = sheets_of(scene.blank)[:: 1 if self.direction[2] > 0 else -1]
        self.nodes = Nodes(scene.blank, self.part)
        self._sheets = [Nodes(scene.blank, each) for each in sheets]  # the nearest first
        for contact in self._against:
            bind(contact, scene)
        self.plies = PlyThickness(scene)
        self._die = self._contact_with_die(scene)
        self._next_areas = self._pressed()
        self.set_load(0.0)
        self.accept()
        self._start_friction()

    def _contact_with_die(self, scene):
        """The contact along whose normals the pressure acts, if neither side has friction."""
        die, up = getattr(self._borne, "die", None), getattr(self._borne, "up", 0.0)
        contacts = (t for t in scene.terms if isinstance(t, Contact) and t.tool is die)
        contact = next((each for each in contacts if not each.coulomb), None)
        if self.coulomb or not contact or self.direction[2] * up <= 0:
            return None
        bind(contact, scene)
        return contact

    def set_load(self, load: float) -> None:
        """Set the pressure; InputError if it is not a number from 0 there."""
        self.now = at_load(self.PRESSURE, FROM_ZERO, self._pressure, load)
        self.areas, self._updates = self._next_areas, 0
        if self.friction_state:  # as these forces follow from the load alone
            self.friction_state.begin(self.normal_forces())

    def accept(self) -> None:
        # the nodes' travel to the die [mm], pressure and pressed areas of the accepted state
        self._accepted = self._travels()[0].copy(), self.now, self.areas
        self._force = self.nodes.total(self._pressing_forces())
        self.areas = self._next_areas = self._pressed()
        super().accept()

    def _update_pressing(self):
        """Press the areas under the holder now, if they differ by more than `lag`."""
        if self.lag is None or self._updates == self.MAX_UPDATES:
            return False
        now = self._pressed()
        changed, all_of_it = self.nodes.total(np.column_stack([abs(now - self.areas), now]))
        # at first whatever has moved, so that areas depend neither on steps nor on rounding
        lag = self.lag if self._updates >= self.FIRST else self.AT_FIRST * self.lag
        if changed <= lag * all_of_it:
            return False
        self.areas, self._updates = now, self._updates + 1
        return True

    def work(self) -> float:
        """Done on this rank's nodes since the last accepted state, by trapezoids [N mm]."""
        travel, pressure, _ = self._accepted
        moved = self._travels()[0] - travel
        pressed = 0.5 * (pressure + self.now) * float(self.areas @ moved)
        return pressed + self._work_at_edge() + self._friction_work()

    def _work_at_edge(self):
        """Work where nodes have left the holder or come under it, beyond that of the present areas
        [N mm]: the ply's face takes it as its pressure changes."""
        if not (self._die and self.part.is_whole and len(self._sheets) == 1):
            return 0.0
        then, now = self.now * self._accepted[2], self.normal_forces()
        (depth, energy), (depth_now, energy_now) = map(self._die.pressed_by, (then, now))
        return float((energy_now - energy - now * (depth_now - depth)).sum())

    def memory(self) -> dict[str, np.ndarray]:
        """Areas pressed in the last accepted state (nodes, 1) [mm^2], if without friction."""
        return super().memory() | ({"areas": self._accepted[2][:, None]} if self._die else {})

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        super().recall(memory)
        if self._die:
            self.areas = memory["areas"][:, 0]
            self._accepted = *self._accepted[:2], self.areas

    def energies(self) -> dict[str | None, float]:
        return {**super().energies(), None: -float(self.normal_forces() @ self._travels()[0])}

    def normal_forces(self) -> np.ndarray:
        return self.now * self.areas

    def _pressing_forces(self):
        return self.normal_forces()[:, None] * self._travels()[1]

    def _blocks(self):
        rubbed = super()._blocks()
        if not self._die:
            return rubbed
        turned = -self.normal_forces()[:, None, None] * self._travels()[2]
        return turned if rubbed is None else turned + rubbed

    def _travels(self):
        """How far each node has gone along the direction, or the die's normals (nodes,) [mm], the
        gradient of that (nodes, 3) and its Hessian (nodes, 3, 3) [1/mm]."""
        u = self.nodes.view()
        if self._die:
            return tuple(-each for each in self._die.nearest(self.nodes.places + u, self.areas > 0))
        return u @ self.direction, self._normals(), np.zeros((len(u), 3, 3))

    def _normals(self):
        return np.tile(self.direction, (self.nodes.count, 1))

    def force(self) -> np.ndarray:
        return self._force

    def cell_fields(self) -> dict[str, Value]:
        share = self.areas / np.maximum(self.nodes.areas_now(), 1e-300)
        lost = self.blank.cell_means(share) * self.plies.lost_under(self.now)
        return self.plies.fields(lost)

    def shares(self, points: np.ndarray) -> np.ndarray:
        """Share of each of `points` (3, n) [mm] that is under the holder, 0 to 1 (n,)."""
        return shares_at(self.under, points)

    def _pressed(self):
        """Areas (nodes,) under the holder, of the nearest sheets, or where all the other sheets lie
        on this one [mm^2]."""
        covered: np.ndarray | None = None
        for contact in reversed(self._against):
            covered = contact.points.covered(covered)
        under, blank, lying = self.under, self.blank, list[np.ndarray]()
        areas = np.zeros(self.nodes.count)
        for nodes in self._sheets:
            of_sheet = nodes.areas_now() if covered is None else covered
            areas += nodes.shares_under(under, self._borne) * of_sheet
            if nodes is not self._sheets[-1]:
                x = blank.coordinates() + blank.nodal_displacement()
                lying += self.nodes.comm.allgather(
                    x[blank.triangles(nodes.part.cells)].reshape(-1, 3, 3)
                )
                under = _Bare(self.under, np.concatenate(lying), self.direction)
        return areas
