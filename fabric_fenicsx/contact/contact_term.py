"""What a sheet does with what it touches: pressure at points, friction along them, thickness."""

from collections.abc import Callable, Mapping

import numpy as np
from mpi4py import MPI

from ..core.collective_errors import on_all
from ..energy.materials import fabric_of, sheets_of, stretching_stiffness, thickness_shares
from ..energy.nodes import Nodes
from ..energy.output import Value, joined, last, total
from ..energy.term import NO_TANGENT, SceneFacts, Term, Triplets
from ..io.field import Field
from ..material.laws.base import Law
from ..surfaces.tool import Tool
from .coulomb import Friction, friction_law
from .friction import FrictionState, SlipMap, ToolSlip
from .pressure_law import FaceLaw


class ContactTerm(Term):
    """A potential of points that are pressed and rub on a face: value (`energies`), gradient
    (`add_forces`) and Hessian (`tangent`) at the present displacement. `set_load` begins a step
    from the last accepted state, `accept` ends it.

    A subclass gives the pressing part: these methods, with friction's by `super`, `normal_forces`,
    and three hooks. `_sliding()` makes a `SlipMap` of the points from the present state on;
    `_stiffness_of_cells()` is that of the touching sheets in their planes over half a cell, times
    the share of it that a point stands for, of all points or of each [N/mm]; `_update_pressing()`
    updates the lagged part of what presses, if needed, and is true if it was. It calls
    `_start_friction` at the end of `set_up`.

    - coulomb, friction_state: the law of friction and its state; None without friction
    - energy_correction (points,): energy that contact gave as the pressed areas changed, without
      work of a force [N mm]
    - depth (points,): deepest overlap in accepted states [mm]
    - face: of the sheet at each point, or one of all
    """

    friction_state: FrictionState | None = None
    depth = energy_correction = np.zeros(0)
    face = FaceLaw()
    _sliding: Callable[[], SlipMap]
    _stiffness_of_cells: Callable[[], float | np.ndarray]
    _update_pressing: Callable[[], bool]

    AXES = "xy"  # of a friction that is a field

    def __init__(self, friction: Friction, owner: str) -> None:
        self.coulomb = friction_law(friction, owner, self.AXES)

    def normal_forces(self) -> np.ndarray:
        """Sizes of the forces that press this rank's points, (points,) [N]."""
        raise NotImplementedError

    def _stretching(self, part):
        scene = self.bound_to() if self.bound_to else None
        assert scene
        return stretching_stiffness(scene, part)

    def _coefficient(self, law):
        return law.coefficient

    def _of_place(self, field, x, sheet=""):
        """Coefficients (n,) by a field at places x (n, 3), noted as its values of a sheet."""
        values = on_all(self.blank.mesh.comm, lambda: field.at(x))
        name = f"friction of {sheet}" if sheet else "friction"
        self.fields = {name: (field, x, values)} | dict(self.fields)  # of the start
        return values

    def _start_friction(self):
        if self.coulomb:
            # 0.05 of the sheets': forces of a stuck one grow to their full size over three cells
            stiffness = 0.0 if self.coulomb.slip else 0.05 * self._stiffness_of_cells()
            self.friction_state = FrictionState(
                self.coulomb,
                self._coefficient(self.coulomb),
                self.normal_forces(),
                self._sliding(),
                self.blank.mesh.comm,
                stiffness,
            )

    def _note_depth(self, load, depth):
        """Keep the deepest overlap; at load 0 the last one, as others were not in equilibrium."""
        self.depth = np.fmax(self.depth if load else 0.0, depth)

    def largest_depth(self) -> float:
        """Largest overlap in accepted states, of all ranks [mm]."""
        return self._largest(self.depth)

    def largest_penetration(self) -> float:
        """Largest penetration of rigid faces in accepted states, of all ranks [mm]."""
        return self._largest(self._penetrated())

    def penetration_of_thickness(self) -> float:
        return self._largest(self._penetrated() / self.thickness)

    @property
    def thickness(self) -> np.ndarray:
        """Of the sheet at each point without pressure, or one of all [mm]."""
        return np.asarray(self.face.thickness)

    def _penetrated(self):
        return np.where(self.face.is_rigid, self.depth, 0.0)

    def _largest(self, values):
        return self.blank.mesh.comm.allreduce(float(values.max(initial=0.0)), MPI.MAX)

    def set_load(self, load: float) -> None:
        if self.friction_state:
            self.friction_state.begin()

    def update_lagged(self) -> bool:
        """See `Term`: of what presses, then of friction."""
        changed = self._update_pressing()
        return self._update_friction(self.normal_forces()) or changed

    def _update_friction(self, normal_forces):
        state = self.friction_state
        return state.update(normal_forces, self._sliding) if state else False

    def accept(self) -> None:
        if self.friction_state:
            self.friction_state.accept(self.normal_forces(), self._sliding())

    def friction_used(self) -> tuple[float, float]:
        """Means over the friction that points can bear now, of all ranks: of the largest share of
        it that was used in accepted states, and of those points that slid."""
        sums = np.zeros(3)
        if state := self.friction_state:
            ratio = state.slip_ratio
            shares = np.minimum(ratio, 1), ratio >= 1, np.ones(len(ratio))
            sums = np.stack(shares) @ state.friction_limit
        used, slid, total = self.blank.mesh.comm.allreduce(sums)
        return float(used / max(total, 1e-300)), float(slid / max(total, 1e-300))

    def summary(self) -> dict[str, Value]:
        used = {self._partner(): self.friction_used()[0]}
        return {"friction_used": joined(used)} if self.coulomb else {}

    def _partner(self):
        return self.tool.name if self.tool else self.name

    def warnings(self) -> list[str]:
        """See `Term`: if what friction holds never slid."""
        used, slid = self.friction_used()
        if not used > 0.01 > slid:  # the share that is worth a word
            return []
        return [
            f"friction of {self._partner()} never leaves its elastic branch ({used:.2g} of the "
            "limit): all contact sticks, with a stiffness that depends on `slip`"
        ]

    def energies(self) -> dict[str | None, float]:
        return {"friction": self.friction_state.energy()} if self.friction_state else {}

    def stored(self) -> float:
        return sum(self.energies().values())


class ToolContactTerm(ContactTerm):
    """An interaction of a `tool` with the sheet's `nodes`.

    A subclass also gives three hooks, of this rank's nodes. `_pressing_forces()` are the tool's
    without friction (nodes, 3) [N]; a tool moved by force is then where its force is balanced, on
    all ranks. `_normals()` are unit vectors along which nodes are or would be pressed (nodes, 3).
    `_offsets()`, of tools that are not flat, are those of the nodes from the tool across its
    surface (nodes, 3) [mm], NaN far from it, and the symmetric derivatives of a node's place less
    its offset (nodes, 3, 3).
    """

    tool: Tool
    nodes: Nodes
    # in the accepted state, before it was accepted and after it was
    _friction_force = _friction_at_start = np.zeros(3)
    _follows = False  # friction is a field
    _normals: Callable[[], np.ndarray]
    _pressing_forces: Callable[[], np.ndarray]

    AXES = "xyz"

    def __init__(self, tool: Tool, friction: Friction, owner: str) -> None:
        super().__init__(friction, owner)
        self.tool = tool
        if self.coulomb:
            self.resists = (*self.resists, "slide")

    def _offsets(self):
        n = self.nodes.count
        return np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1))

    def _stiffness_of_cells(self):
        at_nodes = np.zeros((self.nodes.count, 1))
        for part in sheets_of(self.blank):
            triangles = self.blank.triangles(part.cells).reshape(-1, 3)
            thirds = np.full((*triangles.shape, 1), self._stretching(part) / 3)
            at_nodes += self.blank.summed_at(triangles, thirds)[: self.nodes.count]
        return at_nodes[:, 0]

    def _coefficient(self, law):
        mu = law.coefficient
        each = mu if isinstance(mu, Mapping) else {"": mu}
        fields = [name for name in each if isinstance(each[name], Field)]
        if not fields and each is not mu:
            return mu
        coefficients, x = np.zeros(self.nodes.count), self._touched()
        for name, coefficient in each.items():
            at = self.blank.part(name).nodes
            value = self._of_place(coefficient, x[at], name) if name in fields else coefficient
            coefficients[at] = value
        self._follows = bool(fields)
        return coefficients

    def _touched(self):
        """Places of the tool at the nodes, as it stands at first (nodes, 3) [mm]."""
        x = self.nodes.places + self.nodes.view() - np.nan_to_num(self._offsets()[0])
        return x - self.tool.displacement + self.tool.path(0.0)

    def _sliding(self):
        return ToolSlip(self.nodes, self.tool, self._normals(), *self._offsets())

    def _friction_forces(self):
        """Forces on this rank's nodes that have the moment of friction at the face (nodes, 3) [N]:
        less than friction where the sheet lies round a bar, more where it lies in a hollow."""
        if not self.friction_state:
            return np.zeros((self.nodes.count, 3))
        return self.friction_state.sliding.on_nodes(self.friction_state.forces())

    def _blocks(self):
        """Decrease of friction as nodes move (nodes, 3, 3) [N/mm]; None without friction."""
        state = self.friction_state
        return state and state.sliding.on_node_blocks(state.blocks())

    def _friction_work(self):
        """Work against friction since the accepted state, by trapezoids, on rank 0 [N mm]."""
        if not self.friction_state:
            return 0.0
        ends = self._friction_at_start + self.nodes.total(self._friction_forces())
        work = 0.5 * ends @ self.friction_state.start.tool_moved()
        return float(work) if self.nodes.comm.rank == 0 else 0.0

    def accept(self) -> None:
        if self.friction_state:
            self._friction_force = self.nodes.total(self._friction_forces())
            if self._follows:  # what it touches is taken anew for the next step
                self.friction_state.coefficient = self._coefficient(self.coulomb)
            super().accept()
            self._friction_at_start = self.nodes.total(self._friction_forces())

    def add_forces(self, f: np.ndarray) -> None:
        f[: 3 * self.nodes.count] -= self.applied_forces()

    def applied_forces(self) -> np.ndarray:
        forces = self._pressing_forces()
        return (forces + self._friction_forces() if self.friction_state else forces).ravel()

    def tangent(self) -> Triplets:
        blocks = self._blocks()
        return NO_TANGENT if blocks is None else (self.nodes.rows, self.nodes.cols, blocks.ravel())

    def memory(self) -> dict[str, np.ndarray]:
        return self.friction_state.memory() if self.friction_state else {}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        if self.friction_state:
            self.friction_state.recall(memory, self._sliding())

    def rubbed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        state = self.friction_state
        limit = state.friction_limit if state else np.zeros(self.nodes.count)
        pressed = limit > 0
        return self.nodes.places[pressed], self._normals()[pressed], limit[pressed]

    def force(self) -> np.ndarray:
        """Force by which the tool presses the sheet, without friction, of all ranks, (3,) [N]."""
        return self.nodes.total(self._pressing_forces())

    def tool_force(self) -> np.ndarray:
        return self.force() + self._friction_force


class PlyThickness:
    """Fields in cells of fabric, NaN in others, to which each contact of a scene adds the thickness
    lost on its own faces.

    thickness [mm]: instead of the fabrics'; rigid: whether the contact's faces are, also those of
    fabric that has a `Compaction`, which contradicts the fabric, so that there are no fields.
    """

    def __init__(
        self, scene: SceneFacts, thickness: float | None = None, rigid: bool = False
    ) -> None:
        self._blank = blank = scene.blank
        self._flat, self._fibres = np.full((2, len(blank.areas())), np.nan)
        self._thickening, self._shares = np.zeros((2, len(self._flat)))
        self._fabrics: list[tuple[np.ndarray, Law]] = []
        for part in sheets_of(blank):
            if (fabric := fabric_of(scene, part)) and not (rigid and fabric.compaction):
                shares = thickness_shares(scene, part, blank.centres()[part.cells])
                self._shares[part.cells] = 1.0 if thickness else shares
                fabric = fabric.replace(thickness=thickness or fabric.thickness)
                self._fabrics.append((part.cells, fabric))
                self._flat[part.cells] = fabric.thickness_under(0.0)
                if fabric.compaction:
                    self._thickening[part.cells] = fabric.compaction.thickening
                if fabric.fibre_density is not None:
                    self._fibres[part.cells] = fabric.fibre_volume_fraction(1.0)

    def lost_under(self, pressure: float) -> np.ndarray:
        """Thickness that one face loses under a pressure [MPa] in each cell, (cells,) [mm]."""
        lost = np.zeros(len(self._fibres))
        for cells, fabric in self._fabrics:
            lost[cells] = (fabric.thickness_under(0.0) - fabric.thickness_under(pressure)) / 2
        return lost * self._shares * self._growth()

    def fields(self, lost: np.ndarray) -> dict[str, Value]:
        """Compaction and thickness [mm] and, where fibre densities are known, fibre volume fraction
        in cells. lost (cells,): thickness lost on the faces of one term [mm]."""
        if not self._fabrics:
            return {}
        values = {
            "compaction": total(np.where(np.isnan(self._flat), np.nan, lost), "mm"),
            "thickness_under_pressure": last(self._thickness, "mm"),
        }
        if any(fabric.fibre_density is not None for _, fabric in self._fabrics):
            values["fibre_volume_fraction"] = last(self._share_of_fibres, "-")
        return values

    def _thickness(self, fields):
        return self._flat * self._shares * self._growth() - fields["compaction"]

    def _growth(self):
        return self._blank.area_ratios() ** -self._thickening

    def _share_of_fibres(self, fields):
        fibres = self._fibres * self._shares
        return fibres / (self._thickness(fields) * self._blank.area_ratios())
