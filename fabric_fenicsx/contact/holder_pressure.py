"""The pressure of a blank holder, and the restraint of a bead, without contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import shapely
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.rules import ABOVE_ZERO_OR_INF, FROM_ZERO, POSITIVE, repr_short
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
from .tool_contact import Contact


def lying(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Mask (n,) of points (n, 2) that lie in one of the cells with these corners (m, k, 2), or up
    to 1e-6 mm beside it."""
    tree, at = shapely.STRtree(shapely.polygons(corners)), shapely.points(points)
    return np.isin(np.arange(len(points)), tree.query(at, "dwithin", distance=1e-6)[0])


def _seen(under, across, cells, are_there, x):
    """The share of positions x (3, n) `under` a holder where all of some sheets lie, or none (n,):
    the `cells` of each, corners (m, 3, 2), as seen `across` the direction (3, 2)."""
    share = shares_at(under, x)
    for each in cells:
        at = np.flatnonzero(share)
        share[at[lying(each, x[:, at].T @ across) != are_there]] = 0.0
    return share


class BlankHolderPressure(ToolContactTerm):
    """Dead pressure of a blank holder on the parts of a sheet under it; of a stack, on the sheet
    that is nearest to the holder at each place.

    A `Contact` on the other side of the sheet carries it. The pressed areas are lagged.

    - pressure: constant [MPa], or function of the load factor
    - direction: in which it presses (3,)
    - under: function of positions (3, n) [mm] to the share (n,) of each, 0 to 1, that is under the
      holder: what is pressed of a triangle follows from its values within it
    - tool: moves with the holder along a path, for its friction; by default one at rest
    - lag: areas are updated within a step, at most three times, if more than this share of their
      sum has changed; with None never
    - full_stack: press the nearest sheet only where all others lie, too, as a plate that rests on
      all
    - friction: on the holder's side, as in `Contact`; without it the holder does not hold the sheet
      in its plane
    - borne: as `under`, by default the same: where the die carries the pressure. Corners of
      triangles beyond it are not pressed; the others carry all of the pressure. If it is a
      die's flange and neither side has friction, the pressure acts along the die's normals: it
      would push nodes that slide over the edge, before the areas are updated, along the die

    Raises InputError for a direction or pressure that is not finite or below 0, a tool moved by
    force, `under` of another shape, and as `Contact` does for blanks.

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
        full_stack: bool = False,
        friction: Friction = 0.0,
        borne: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> None:
        at_load(self.PRESSURE, FROM_ZERO, pressure, 0.0)
        if lag is not None:
            lag = ABOVE_ZERO_OR_INF.check(f"lag of the {self.name}", lag)
        self.under, self.lag, self._full = under, lag, full_stack
        self._borne = borne or under
        self._pressure = pressure
        self.direction = checked_vector(f"direction of the {self.name}", direction, unit=True)
        tool = tool or Tool(Plane((0, 0, 0), self.direction), name=self.name)
        super().__init__(tool, friction, self.name)
        if self.tool.force:
            raise InputError(
                f"{self.tool.name} presses without contact and is moved by force; expected a path"
            )

    def set_up(self, scene: SceneFacts) -> None:
        is_stack = self.part.is_whole and any(p.thickness for p in scene.blank.parts.values())
        sheets = sheets_of(scene.blank) if is_stack else [self.part]
        self.nodes = Nodes(scene.blank, self.part)
        self._sheets = [Nodes(scene.blank, each) for each in sheets]  # the nearest first
        if self.direction[2] < 0:
            self._sheets.reverse()
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
        self.areas, self._trial = self._next_areas, (0, None)
        if self.friction_state:  # as these forces follow from the load alone
            self.friction_state.begin(self.normal_forces())

    def accept(self) -> None:
        # the nodes' travel to the die [mm], pressure, pressed areas and force accepted last
        force = self.nodes.total(self._pressing_forces())
        self._accepted = self._travels()[0].copy(), self.now, self.areas, force
        found = self._trial[1]
        self.areas = self._next_areas = self._pressed() if found is None else found
        super().accept()

    def on_prediction(self) -> None:
        if self._die and self.lag is not None:  # friction's limits would hang on the prediction
            self.areas = self._pressed()

    def _update_pressing(self):
        """Press the areas under the holder now, if they differ by more than `lag`."""
        updates, _ = self._trial  # of the areas in this step, and what the present state presses
        self._trial = updates, None
        if self.lag is None or updates == self.MAX_UPDATES:
            return False
        now = self._pressed()
        changed, all_of_it = self.nodes.total(np.column_stack([abs(now - self.areas), now]))
        # at first whatever has moved, so that areas depend neither on steps nor on rounding
        lag = self.lag if updates >= self.FIRST else self.AT_FIRST * self.lag
        if changed > lag * all_of_it:
            self.areas, updates = now, updates + 1
        is_new, self._trial = updates > self._trial[0], (updates, now)
        return is_new

    def work(self) -> float:
        """Done on this rank's nodes since the last accepted state, by trapezoids [N mm]."""
        travel, pressure, *_ = self._accepted
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
            self._accepted = *self._accepted[:2], self.areas, self._accepted[3]

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
        if not self._die:
            return u @ self.direction, self._normals(), np.zeros((len(u), 3, 3))
        return tuple(-each for each in self._die.closest.anywhere(self.areas > 0))

    def _normals(self):
        return np.tile(self.direction, (self.nodes.count, 1))

    def force(self) -> np.ndarray:
        return self._accepted[3]

    def cell_fields(self) -> dict[str, Value]:
        share = self.areas / np.maximum(self.nodes.areas_now(), 1e-300)
        lost = self.blank.cell_means(share) * self.plies.lost_under(self.now)
        return self.plies.fields(lost)

    def shares(self, points: np.ndarray) -> np.ndarray:
        """Share of each of `points` (3, n) [mm] that is under the holder, 0 to 1 (n,)."""
        return shares_at(self.under, points)

    def _pressed(self):
        """Areas (nodes,) under the holder of the nearest sheets [mm^2]."""
        areas, cells = np.zeros(self.nodes.count), list[np.ndarray]()
        across = np.linalg.svd(self.direction[None])[2][1:].T
        for nodes in self._sheets if self._sheets[1:] else ():
            local = _triangles(self.blank, nodes.part)[1] @ across
            cells.append(np.concatenate(self.nodes.comm.allgather(local)))
        for k, nodes in enumerate(self._sheets[: 1 if self._full else None]):
            others = cells[1:] if self._full else cells[:k]
            under = partial(_seen, self.under, across, others, self._full) if others else self.under
            areas += nodes.shares_under(under, self._borne) * nodes.areas_now()
        return areas


class LineBead(ToolContactTerm):
    """Equivalent drawbead: a force per length of a line that stands still in plan, against the
    sliding of the sheets that lie there, in any direction; these share it. It does not depend on
    the rate, and begins with an elastic slip as friction. It acts on the nodes around by their
    shape functions, updated in each accepted state.

    line: two points (x, y) [mm] or more; restraint: above 0 [N/mm]; law: 1.0, or a `Coulomb` of it.
    Raises InputError for others.
    """

    energy_kind = "friction"
    SPACING = 0.01  # of points along the line, over the size of a mean cell

    def __init__(
        self, line: Sequence, restraint: float, name: str = "bead", law: Friction = 1.0
    ) -> None:
        points = [checked_vector(f"line of {name}", each, size="two") for each in line]
        self.line, self.name = shapely.LineString(points if points[1:] else None), name
        if not self.line.length:
            flaw = f"line of {name} is {repr_short(line)}"
            raise InputError(f"{flaw}; expected two points or more")
        self.restraint = POSITIVE.check(f"restraint of {name} [N/mm]", restraint)
        super().__init__(Tool(Plane((0, 0, 0), (0, 0, 1)), name=name), law, name)

    def points(self, spacing: float = 1.0) -> np.ndarray:
        """Middles (n, 2) of equal pieces of the line, at most `spacing` long [mm]."""
        count = int(np.ceil(self.line.length / spacing))
        at = (np.arange(count) + 0.5) / count
        return shapely.get_coordinates(self.line.interpolate(at, normalized=True))

    def set_up(self, scene: SceneFacts) -> None:
        self.nodes, areas = Nodes(scene.blank, self.part), scene.blank.areas()
        size, count = scene.blank.mesh.comm.allreduce(np.array([areas.sum(), len(areas)]))
        self._points = self.points(self.SPACING * float(np.sqrt(size / count)))
        self.accept()
        self._start_friction()

    def accept(self) -> None:
        triangles, x = _triangles(self.blank, self.part)
        tree, n = shapely.STRtree(shapely.polygons(x[..., :2])), len(self._points)
        point, cell = tree.query(shapely.points(self._points), "intersects")
        sharing = self.nodes.comm.allreduce(np.bincount(point, minlength=n))
        sides = np.moveaxis(x[cell, 1:, :2] - x[cell, :1, :2], 1, 2)
        # of a triangle that stands upright the inverse is none, but its pseudoinverse
        N = np.linalg.pinv(sides) @ (self._points[point] - x[cell, 0, :2])[..., None]
        N = np.concatenate([1 - N.sum(1, keepdims=True), N], 1)  # shape functions (k, 3, 1)
        N *= (self.line.length / n / sharing[point])[:, None, None]
        self._lengths = self.blank.summed_at(triangles[cell], N)[: self.nodes.count, 0]
        super().accept()

    def normal_forces(self) -> np.ndarray:
        return self.restraint * self._lengths

    def restrained(self) -> float:
        """Sum of the sizes of its forces, of all ranks [N]."""
        return float(self.nodes.total(np.linalg.norm(self._friction_forces(), axis=1)))

    def _update_pressing(self):
        return False

    def _pressing_forces(self):
        return np.zeros((self.nodes.count, 3))

    def _normals(self):
        return np.tile([0.0, 0.0, 1.0], (self.nodes.count, 1))


def _triangles(blank, part):
    """Nodes of a part's triangles (n, 3), and where their corners are now (n, 3, 3) [mm]."""
    triangles = blank.triangles(part.cells).reshape(-1, 3)
    return triangles, (blank.coordinates() + blank.nodal_displacement())[triangles]
