"""Contact of a sheet with rigid tools: a penalty at its nodes, and pressing without a tool."""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import ufl
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from numpy.typing import ArrayLike
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..blank import Blank
from ..errors import InputError
from ..material import pointwise
from ..material.baseline import Fabric
from ..tools import Plane, Tool, _vector
from .work import Work

if TYPE_CHECKING:
    from .friction import Friction

STRAIN = 0.02  # of both yarns, whose pull over the tightest radius sets the default penalty
MORE = 4.0  # times the present pressure, up to which a node's pressure is anticipated
PERMITTED = 0.0125  # of the thickness, the penetration under it


def default_penalty(fabric: Fabric, radius: float, permitted: float | None = None) -> float:
    """Penalty [N/mm^3] under which yarns stretched by `STRAIN` over a tool's least `radius` [mm] press the sheet into it
    by `permitted` [mm], by default `PERMITTED` of the thickness. It is 0 for a radius of inf."""
    stretched = pointwise.evaluate(fabric, gradient=[(1 + STRAIN) * np.eye(3)[:, :2]], fibres=np.eye(2)[:, None])
    pull = float(np.trace(stretched.cauchy[0])) * fabric.thickness
    return pull / radius / (permitted or PERMITTED * fabric.thickness)


class Nodes:
    """This rank's owned nodes of a blank in space, where forces of tools go.

    count: how many; places (count, 3) [mm] and areas (count,) [mm^2], undeformed; rows, cols (9 count,): global degrees
    of freedom of each node's 3 x 3 block. Raises InputError for a blank in a plane, along turned axes or of other than
    linear cells.
    """

    def __init__(self, blank: Blank) -> None:
        mesh = blank.mesh
        if mesh.geometry.dim != 3 or not np.array_equal(blank.frame, np.eye(3)):
            raise InputError(
                f"contact of {blank.name} is asked in a plane or along turned axes; allowed is a sheet in space"
            )
        self.blank, self.comm = blank, mesh.comm
        self.count = blank.V.dofmap.index_map.size_local
        self.places = blank.coordinates()[: self.count]
        area = fem_petsc.assemble_vector(compat.form(ufl.TestFunction(blank.V)[0] * ufl.dx))
        area.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        self.areas = area.array[::3].copy()
        if self.comm.allreduce(self.areas.min(initial=np.inf), MPI.MIN) <= 0:
            raise InputError(f"contact of {blank.name} is asked on other than linear cells; allowed are P1 and Q1")
        first = blank.V.dofmap.index_map.local_range[0]
        dofs = 3 * (first + np.arange(self.count))[:, None] + np.arange(3)
        self.rows = np.repeat(dofs, 3, axis=1).ravel().astype(PETSc.IntType)
        self.cols = np.tile(dofs, 3).ravel().astype(PETSc.IntType)

    def displacement(self) -> np.ndarray:
        """(count, 3) [mm]."""
        return self.blank.u.x.array.reshape(-1, 3)[: self.count].copy()

    def common(self, rows: np.ndarray) -> np.ndarray:
        """The row (k,) that all nodes of all ranks have in `rows` (count, k)."""
        return next(row for row in self.comm.allgather(rows[0] if len(rows) else None) if row is not None)

    def total(self, values: np.ndarray) -> np.ndarray:
        """Sum over all ranks' nodes of values (count, ...)."""
        return self.comm.allreduce(values.sum(0), MPI.SUM)


class Touch(NamedTuple):
    """What a tool does to n nodes: gap (n,) [mm] between its surface and the ply's face, normal (n, 3), pressure (n,)
    [MPa], forces (n, 3) [N], the blocks (n, 3, 3) [N/mm] by which these fall as nodes move, and energy (n,) [N mm]."""

    gap: np.ndarray
    normal: np.ndarray
    pressure: np.ndarray
    forces: np.ndarray
    blocks: np.ndarray
    energy: np.ndarray


class Contact:
    """Energy of a blank's nodes pressed into a `tool`, over their undeformed areas.

    The pressure is p = k e^2 / (2 s) where the tool reaches e deep into the ply's face, up to e = s, and grows by the
    `penalty` k [N/mm^3] beyond: its slope is continuous. The ply is on the side to which the tool's normal points, its
    faces `thickness` / 2 [mm] off the mesh. smoothing: s [mm], by default a third of the permitted penetration.
    permitted: if given [mm], the surface is shifted (augmented Lagrangian) until no node is deeper than that; what work
    the shift does is not counted, about the energy that contact would hold without it.
    A tool moved by force is where its contact balances the force, at any displacement of the blank.
    Raises InputError for a blank in a plane or of other than linear cells, and for numbers not above 0.
    """

    name, energy_kind = "contact", "contact"
    holds = ("move", "turn")
    prescribed = False  # are its forces

    def __init__(
        self,
        blank: Blank,
        tool: Tool,
        thickness: float,
        penalty: float,
        smoothing: float | None = None,
        permitted: float | None = None,
    ) -> None:
        smoothing = 0.3 * PERMITTED * thickness if smoothing is None else smoothing
        for name, value in (("thickness", thickness), ("penalty", penalty), ("smoothing", smoothing), ("permitted penetration", permitted)):  # fmt: skip
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"contact with {tool.name} has {name} {value}; allowed is a number above 0")
        self.blank, self.tool, self.thickness = blank, tool, thickness
        self.penalty, self.smoothing, self.permitted = penalty, smoothing, permitted
        self.nodes = Nodes(blank)
        self._shift = self._accepted_shift = np.zeros(self.nodes.count)
        self._accepted_way = tool.way
        self._depth = np.zeros(self.nodes.count)  # deepest penetration of each node in accepted states
        self.rubs: list[Friction] = []  # friction with the tool, which takes part in the balance of its force
        self._seen: tuple[np.ndarray, Touch] | None = None
        self._load, self._work = 0.0, Work()
        self.accept()

    # -- what a scene calls

    def at(self, load: float) -> None:
        """Move the tool, from where it was in the last accepted state, and forget shifts since."""
        self._load = load
        self.tool.at(load)
        self.tool.way, self._shift, self._seen = self._accepted_way, self._accepted_shift, None

    def accept(self) -> None:
        """Take the present place of the tool and shift of its surface as the last accepted ones."""
        self.touch()
        self._accepted_way, self._accepted_shift = self.tool.way, self._shift
        self._work.accept(self._load, self.force(), self.tool.displacement)
        self._depth = np.fmax(self._depth, -self.touch().gap)

    def work(self) -> float:
        """Work of the tool's motion since the last accepted state, on rank 0 [N mm]."""
        work = self._work.since(self._load, self.force(), self.tool.displacement)
        return work if self.nodes.comm.rank == 0 else 0.0

    def revise(self) -> bool:
        """Shift the surface by what is penetrated, if that is more than permitted; whether it was."""
        if self.permitted is None or self.penetration() <= self.permitted:
            return False
        self._shift, self._seen = np.maximum(0.0, self._shift - self.touch().gap), None
        return True

    def forget(self) -> None:
        """Have the tool's force balanced anew, as friction with it has changed."""
        self._seen = None

    def stored(self) -> float:
        """Energy of this rank's nodes [N mm]."""
        return float(self.touch().energy.sum())

    def potential(self) -> float:
        """That of the force which moves the tool, on rank 0 [N mm]."""
        self.touch()
        return -self.tool.push * self.tool.way if self.tool.force and self.nodes.comm.rank == 0 else 0.0

    def add_forces(self, f: np.ndarray) -> None:
        """Add the energy's derivative to f, of this rank's degrees of freedom [N]."""
        f[: 3 * self.nodes.count] -= self.touch().forces.ravel()

    def stiffness(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The energy's second derivative as triplets (rows, columns, values), (9 nodes,) each [N/mm]; rows and columns
        are global degrees of freedom."""
        return self.nodes.rows, self.nodes.cols, self.touch().blocks.ravel()

    def anticipate(self, f: np.ndarray) -> None:
        """Let `stiffness` be, until the blank moves, the law's slope up to the pressure that balances the other forces.

        f: energy's derivative at this rank's degrees of freedom [N]. A node that nothing presses any more then leaves the
        tool in one correction; with the tangent its depth is but halved, as the law starts with slope 0.
        """
        touch, n = self.touch(), self.nodes.count
        p = touch.pressure
        pressed = np.flatnonzero(p > 0)
        p, normal, areas = p[pressed], touch.normal[pressed], self.nodes.areas[pressed]
        balancing = p + (f[: 3 * n].reshape(-1, 3)[pressed] * normal).sum(1) / areas
        balancing = np.clip(balancing, 0.0, MORE * p)
        depths = _depth(p, self.penalty, self.smoothing), _depth(balancing, self.penalty, self.smoothing)
        changes = abs(balancing - p) > 1e-6 * p
        slope = _law(depths[0], self.penalty, self.smoothing)[2]
        chord = np.where(changes, (balancing - p) / np.where(changes, depths[1] - depths[0], 1.0), slope)
        blocks = touch.blocks.copy()
        blocks[pressed] += (areas * (chord - slope))[:, None, None] * normal[:, :, None] * normal[:, None]
        self._seen = self.nodes.displacement(), touch._replace(blocks=blocks)

    def compliance(self) -> tuple[np.ndarray, float] | None:
        """Of a tool moved by force: c (nodes, 3) [N/mm] and stiffness k [N/mm], by which it takes c c^T / k from the
        tangent; None of others."""
        if not self.tool.force:
            return None
        pushed = self._blocks(self.touch()) @ self.tool.direction
        return -pushed, float(self.nodes.total(pushed) @ self.tool.direction)

    def pushes(self) -> np.ndarray:
        """Nodal forces (nodes, 3) [N] that a residual is to be small beside."""
        return self.touch().forces

    def normals(self) -> np.ndarray:
        """Unit normals of the tool nearest to this rank's nodes, (nodes, 3)."""
        return self.touch().normal

    def memory(self) -> dict[str, np.ndarray]:
        """Of the last accepted state: shift of the surface, way of the tool and depths [mm], (nodes, 1) each, and what its
        work is reckoned from (nodes, 24)."""
        way, work = (np.tile(row, (self.nodes.count, 1)) for row in (self._accepted_way, self._work.memory().ravel()))
        return {"shift": self._accepted_shift[:, None], "way": way, "depth": self._depth[:, None], "work": work}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Take back what `memory` gave."""
        self._shift, self._depth = memory["shift"][:, 0], memory["depth"][:, 0]
        self.tool.way = float(self.nodes.common(memory["way"])[0])
        self._work.recall(self.nodes.common(memory["work"]).reshape(3, -1))
        u = self.nodes.displacement()  # not balanced, as what friction bore is forgotten
        self._seen = u, self._touch(self.nodes.places + u)

    # -- results

    def force(self) -> np.ndarray:
        """Force of the tool on the ply, of all ranks (3,) [N]."""
        return self.nodes.total(self.touch().forces)

    def tractions(self) -> np.ndarray:
        """Of the tool on this rank's nodes, (nodes, 3) [MPa]."""
        return self.touch().forces / self.nodes.areas[:, None]

    def penetration(self) -> float:
        """Largest depth of the tool in the ply's face, of all ranks [mm]."""
        return self.nodes.comm.allreduce(-self.touch().gap.min(initial=0.0), MPI.MAX)

    def deepest(self) -> float:
        """Largest penetration of all accepted states, of all ranks [mm]."""
        return self.nodes.comm.allreduce(float(self._depth.max(initial=0.0)), MPI.MAX)

    # --

    def touch(self) -> Touch:
        """The `Touch` at the blank's present displacement."""
        u = self.nodes.displacement()
        known = self._seen is not None and np.array_equal(u, self._seen[0])
        if self.tool.force:  # its balance asks all ranks, also those on which no node moved
            known = self.nodes.comm.allreduce(known, MPI.LAND)
        if self._seen is None or not known:
            x = self.nodes.places + u
            self._seen = u, self._balanced(x) if self.tool.force else self._touch(x)
        return self._seen[1]

    def _touch(self, x):
        nearest = self.tool.evaluate(x, reach=self.thickness)
        k, s, areas = self.penalty, self.smoothing, self.nodes.areas
        gap = nearest.gap - self.thickness / 2
        rest = _law(self._shift, k, s)[0] if self._shift.any() else 0.0
        energy, pressure, slope = _law(np.maximum(0.0, self._shift - gap), k, s)
        normal = nearest.normal
        blocks = (areas * slope)[:, None, None] * normal[:, :, None] * normal[:, None]
        blocks -= (areas * pressure)[:, None, None] * nearest.curvature
        forces = (areas * pressure)[:, None] * normal
        return Touch(gap, normal, pressure, forces, blocks, areas * (energy - rest))

    def _blocks(self, touch):
        """By which forces of contact and friction fall as nodes move, (nodes, 3, 3) [N/mm]."""
        return sum((rub.blocks() for rub in self.rubs), touch.blocks)

    def _balanced(self, x):
        """The `Touch` where the tool's force is in balance, sought from where the tool is and, as a trial state may have
        sent it past the sheet, from where it was accepted; of no number if there is none."""
        for start in (self.tool.way, self._accepted_way):
            self.tool.way = start
            touch = self._balanced_near(x)
            if touch:
                return touch
        self.tool.way = start
        touch = self._touch(x)
        return touch._replace(energy=np.full_like(touch.energy, np.nan), forces=np.full_like(touch.forces, np.nan))

    def _balanced_near(self, x):
        """The same by Newton's method on the tool's way, bracketed; None if it finds nothing."""
        tool, nodes, comm = self.tool, self.nodes, self.nodes.comm
        low, high, back = None, None, self.thickness / 4
        for _ in range(100):
            touch, way = self._touch(x), tool.way
            forces = sum((rub.forces() for rub in self.rubs), touch.forces)
            missing = tool.push - nodes.total(forces) @ tool.direction
            if abs(missing) <= 1e-12 * tool.push:
                return touch
            low, high = (way, high) if missing > 0 else (low, way)
            stiffness = nodes.total(self._blocks(touch) @ tool.direction) @ tool.direction
            free = max(comm.allreduce(touch.gap.min(initial=np.inf), MPI.MIN), 0.0)
            # without contact as far as no point is passed
            step = missing / stiffness if stiffness > 0 else free + self.smoothing
            new = way + float(np.clip(step, -back, free + self.thickness / 4))
            back = back if high is None or low is not None else 2 * back
            if low is not None and high is not None and not low < new < high:
                new = 0.5 * (low + high)
                if new in (low, high):
                    return touch
            tool.way = new
        return None


def _law(e, k, s):
    """Energy per area [N/mm], pressure [MPa] and its slope [N/mm^3] at depths e (n,) from 0 [mm]."""
    soft, beyond = np.minimum(e, s), np.maximum(e - s, 0.0)
    energy = k * (soft**3 / (6 * s) + beyond * (s + beyond) / 2)
    return energy, k * (soft**2 / (2 * s) + beyond), k * soft / s


def _depth(p, k, s):
    """Depths (n,) [mm] at pressures p (n,) from 0 [MPa]: the inverse of `_law`."""
    return np.where(p < k * s / 2, np.sqrt(2 * s * p / k), p / k + s / 2)


class Pressing:
    """Dead `pressure` [MPa] along `direction` (3,) on those parts of the blank that lie under a holder.

    under: function of positions (n, 3) [mm] to the share of the nodes' areas, 0 to 1, asked at accepted states and, if
    more than `lag` of the sum would change, for the present ones; lag None: only at accepted ones.
    pressure: a number, there from the start, or a function of the load factor. What takes the pressure is a `Contact`.
    tool: moves with the holder along a path, for its friction; by default one at rest. Raises InputError for a
    direction or pressure that is not finite or below 0, and as `Nodes` does.
    """

    name, energy_kind, prescribed = "blank holder", None, True

    def __init__(
        self,
        blank: Blank,
        pressure: float | Callable[[float], float],
        direction: ArrayLike,
        under: Callable[[np.ndarray], np.ndarray],
        tool: Tool | None = None,
        lag: float | None = None,
    ) -> None:
        self.blank, self.nodes, self.under, self.lag = blank, Nodes(blank), under, lag
        self._pressure = pressure if callable(pressure) else lambda load: pressure
        self.direction = _vector(f"direction of the {self.name}", direction, unit=True)
        self.tool = tool or Tool(self.name, Plane((0, 0, 0), self.direction))
        if self.tool.force:
            raise InputError(f"{self.tool.name} presses without contact and is moved by force; allowed is a path")
        self._accepted_areas = self._pressed()
        self.at(0.0)
        self.accept()

    def at(self, load: float) -> None:
        """Set the pressure; InputError if it is not a number from 0 there."""
        self.now, self._areas = float(self._pressure(load)), self._accepted_areas
        if not (np.isfinite(self.now) and self.now >= 0):
            raise InputError(f"pressure of the blank holder is {self.now} MPa; allowed is a number from 0")

    def accept(self) -> None:
        """Count `work` from the present state, and press the areas that are under the holder now."""
        self._from, self._before = self.nodes.displacement(), self.now
        self._settled = self.nodes.total(self.forces)
        self._areas = self._accepted_areas = self._pressed()

    def revise(self) -> bool:
        """Press the areas under the holder now, if they differ by more than allowed; whether they did."""
        if self.lag is None:
            return False
        now = self._pressed()
        changed, all_of_it = self.nodes.total(np.column_stack([abs(now - self._areas), now]))
        if changed <= self.lag * all_of_it:
            return False
        self._areas = now
        return True

    def _pressed(self):
        """Areas (nodes,) under the holder [mm^2]."""
        return self.nodes.areas * np.clip(self.under(self.nodes.places + self.nodes.displacement()), 0, 1)

    @property
    def forces(self) -> np.ndarray:
        """On this rank's nodes, (nodes, 3) [N]."""
        return self.now * self._areas[:, None] * self.direction

    def work(self) -> float:
        """Done on this rank's nodes since the last accepted state, by the trapezoidal rule [N mm]."""
        moved = (self._areas[:, None] * (self.nodes.displacement() - self._from)).sum(0)
        return float(0.5 * (self._before + self.now) * (moved @ self.direction))

    def potential(self) -> float:
        """Of this rank's nodes [N mm]."""
        return -float((self.forces * self.nodes.displacement()).sum())

    def add_forces(self, f: np.ndarray) -> None:
        """Add the potential's derivative to f, of this rank's degrees of freedom [N]."""
        f[: 3 * self.nodes.count] -= self.forces.ravel()

    def pushes(self) -> np.ndarray:
        """`forces`, that a residual is to be small beside."""
        return self.forces

    def normals(self) -> np.ndarray:
        """Directions of the pressure on this rank's nodes, (nodes, 3)."""
        return np.tile(self.direction, (self.nodes.count, 1))

    def force(self) -> np.ndarray:
        """Of the holder on the ply, of all ranks (3,) [N], in the last accepted state."""
        return self._settled
