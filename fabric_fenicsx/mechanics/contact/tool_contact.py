"""Contact of a sheet with rigid tools: pressure at its nodes."""

from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from ...runtime.errors import InputError
from ...runtime.formatting import coordinates, of_sheet
from ...runtime.rules import POSITIVE
from ...tools.checks import check_start
from ...tools.tool import Tool, checked_tool
from ..materials import materials_at_nodes
from ..output import Value, least, size_of, total
from ..shell.morley import Where
from ..term import SceneFacts, Triplets
from ..work import Work
from .balance import Resistance, find_balance
from .coulomb import Coulomb
from .nodes import Nodes
from .pressing import Pressed, anticipate, press
from .pressing_term import PressingTerm
from .pressure_law import PERMITTED, SMOOTHING, ByPlace, Rigid, default_penalty, face_of
from .thickness import PlyThickness

PROBED = 1000  # nodes of a rank that tell how a tool may hold the sheet; triangles cost 1 ms each


class Contact(PressingTerm):
    """Energy of a sheet's nodes pressed into a `tool`, over their undeformed areas.

    The pressure follows from the depth to which the tool reaches into the sheet's face: fabric is
    compacted, by half on each face (`Compacted`), and metal is `Rigid`. The sheet is on the side to
    which the tool's normal points. Without pressure its faces are half a thickness off the mesh.

    - thickness [mm]: by default that of the scene's fabric or metal
    - penalty k [N/mm^3]: makes fabric rigid, too; by default `default_penalty` of the material and
      the tool's least radius
    - smoothing s [mm] of a rigid face: by default a third of the permitted penetration
    - permitted [mm]: makes fabric rigid, too; the surface is shifted (augmented Lagrangian) until
      no node is deeper than that. The work of the shift is not counted; it is about the energy that
      contact would hold without it
    - friction: its coefficient, on a stack also one for each sheet {name: coefficient}, or a
      `Coulomb` with its options
    - where: function of undeformed points (3, n) to a mask (n,) of the nodes that the tool may
      touch, by default all

    A tool moved by force stands where contact and friction balance the force, at any displacement
    of the sheet.

    Raises InputError for a blank in a plane or of other cells, for numbers not above 0,
    and where a default asks for a material that no term of the scene has.
    """

    name, energy_kind = "contact", "contact"
    resists = ("lift",)

    def __init__(
        self,
        tool: Tool,
        thickness: float | None = None,
        penalty: float | None = None,
        smoothing: float | None = None,
        permitted: float | None = None,
        friction: float | Mapping[str, float] | Coulomb = 0.0,
        where: Where | None = None,
    ) -> None:
        tool = checked_tool("contact", tool)
        super().__init__(tool, friction, f"contact with {tool.name}")
        given = {"thickness": thickness, "penalty": penalty, "smoothing": smoothing}
        for name, value in (given | {"permitted penetration": permitted}).items():
            if value is not None:
                POSITIVE.check(f"{name} of the contact with {tool.name}", value)
        self._given, self.permitted, self._where = given, permitted, where
        # the last displacement, and what was found at it
        self._found: tuple[np.ndarray, Pressed] | None = None
        self._load, self._work = 0.0, Work()

    def set_up(self, scene: SceneFacts) -> None:
        """As in `Term`."""
        on = self.tool, self.part_name
        same = [t for t in scene.terms if isinstance(t, Contact) and (t.tool, t.part_name) == on]
        if len(same) > 1:
            raise InputError(f"{len(same)} contacts with {self.tool.name} given; allowed is one")
        self.nodes = Nodes(scene.blank, self.part, self._where)
        self.thickness, self._law, self._is_rigid = self._faces(scene)
        rigid = bool(self.permitted or self._given["penalty"] or self._given["smoothing"])
        self._plies = PlyThickness(scene, self._given["thickness"], rigid)
        self._shift = self._accepted_shift = np.zeros(self.nodes.count)
        self._accepted_travel = self.tool.travel
        # deepest penetration of each node in accepted states
        self._depth = np.zeros(self.nodes.count)
        self._lost = ""  # where the tool's surface gave no number
        self.accept()
        self.start_friction()

    def _faces(self, scene):
        """Thickness without pressure [mm], the law of the face, and whether it is rigid, at each
        node."""
        t, k, s = (self._given[name] for name in ("thickness", "penalty", "smoothing"))
        materials, which = materials_at_nodes(scene) or ([], np.zeros(self.nodes.count, dtype=int))
        if t and k and not materials:
            faces = [(t, Rigid(k, SMOOTHING * PERMITTED * t))]
        elif not materials:
            raise InputError(
                f"contact with {self.tool.name} is given no {'penalty' if t else 'thickness'}, and "
                "no term of the scene has a fabric or metal for each sheet; allowed is a number "
                "above 0"
            )
        else:
            known = [each.replace(thickness=t or each.thickness) for each in materials]
            faces = [self._face(each, k, bool(s or self.permitted)) for each in known]
        if s:
            faces = [(t, law._replace(smoothing=s)) for t, law in faces]
        thickness = np.array([t for t, _ in faces])[which]
        is_rigid = np.array([isinstance(law, Rigid) for _, law in faces])[which]
        laws = [law for _, law in faces]
        return thickness, ByPlace(laws, which) if laws[1:] else laws[0], is_rigid

    def _face(self, material, penalty, is_rigid):
        radius = min(self.tool.surface.radii)
        if is_rigid:
            penalty = penalty or default_penalty(material, radius)
        law = face_of(material, radius, penalty)
        t = material.thickness if isinstance(law, Rigid) else material.thickness_under(0.0)
        return t, law

    # -- what a scene calls

    def check_start(self) -> None:
        """As in `Touching`: for a tool whose body the sheet's nodes are in, and one whose path or
        surface can't be."""
        self.tool.at(1.0)
        self.tool.at(0.0)
        x = (self.nodes.places + self.nodes.displacement())[self.nodes.own]
        check_start(self.tool, x, float(self.thickness.max(initial=0.0)), self.nodes.comm)

    def may_press(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """As in `Touching`, at up to twice `PROBED` nodes that find a nearest point."""
        found, x = [], self.nodes.places[self.nodes.own]
        x = x[:: max(1, len(x) // PROBED)]
        for load in (0.0, 1.0):
            self.tool.at(load)
            normals = self.tool.evaluate(x).normal
            known = np.isfinite(normals).all(1)
            found.append((x[known], normals[known]))
        self.tool.at(self._load)
        return found

    def set_load(self, load: float) -> None:
        """Move the tool, from where it was in the last accepted state, and drop shifts since."""
        self._load = load
        self.tool.at(load)
        self.tool.travel, self._shift, self._found = (
            self._accepted_travel,
            self._accepted_shift,
            None,
        )
        self.restore_friction()

    def accept(self) -> None:
        """Take the present place of the tool and shift of its surface as the last accepted ones."""
        self.state()
        self._accepted_travel, self._accepted_shift = self.tool.travel, self._shift
        self._work.accept(self._load, self.force(), self.tool.displacement)
        # at load 0 the last state counts: those before it were not in equilibrium
        self._depth = np.fmax(self._depth if self._load else 0.0, -self.state().gap)
        self._accepted_gap = self.state().gap
        self.accept_friction()

    def work(self) -> float:
        """Work of the tool's motion since the last accepted state, on rank 0 [N mm]."""
        work = self._work.since(self._load, self.force(), self.tool.displacement)
        return (work if self.nodes.comm.rank == 0 else 0.0) + self.friction_work()

    def update_lagged(self) -> bool:
        """Shift the surface by what is penetrated, if more than permitted, and have friction take
        the normal forces; whether any did."""
        shifted = self._shift_surface()
        rubbed = self.update_friction()
        if rubbed and self.tool.force:
            self.rebalance()
        return shifted or rubbed

    def _shift_surface(self):
        if self.permitted is None or self.penetration() <= self.permitted:
            return False
        self._shift, self._found = np.maximum(0.0, self._shift - self.state().gap), None
        return True

    def rebalance(self) -> None:
        """Have the state found anew, and a tool moved by force its place, as friction changed."""
        self._found = None

    def energies(self) -> dict[str | None, float]:
        """As in `StoresKinds`: of contact, what friction took, and on rank 0 minus the work of the
        force that moves the tool."""
        kinds = {"contact": float(self.state().energy.sum()), **super().energies()}
        by_force = self.tool.force and self.nodes.comm.rank == 0
        return kinds | {None: -self.tool.push * self.tool.travel if by_force else 0.0}

    def tangent(self) -> Triplets:
        """As in `Term`, (9 nodes,) each [N/mm]."""
        return self.nodes.rows, self.nodes.cols, self._blocks(self.state()).ravel()

    def anticipate(self, f: np.ndarray) -> None:
        """Until the sheet moves, let `tangent` be the law's slope up to the pressure that balances
        the other forces, see `pressing.anticipate`."""
        now, areas = self.state(), self.nodes.areas
        others = (f[: 3 * self.nodes.count].reshape(-1, 3) * now.normal).sum(1)
        now = anticipate(self._law, areas, now, others / np.maximum(areas, 1e-300))
        self._found = self.nodes.displacement(), now

    def motion_to_gaps(self) -> np.ndarray:
        """As in `KeepsGaps`, by a thickness at most; none at a tool that a force moves, as this
        moves with the sheet."""
        if self.tool.force:
            return np.zeros(3 * self.nodes.count)
        now, before = self.state(), self._accepted_gap
        gap = np.where(np.isfinite(now.gap), now.gap, 0.0)
        off = np.where(before < self._accepted_shift, before, np.maximum(gap, 0.0)) - gap
        off = np.clip(off, -self.thickness, self.thickness)
        return np.nan_to_num(off[:, None] * now.normal).ravel()

    def compliance(self) -> tuple[np.ndarray, float] | None:
        """As in `DrivenByForce`."""
        if not self.tool.force:
            return None
        pushed = self._blocks(self.state()) @ self.tool.direction
        return -pushed.ravel(), float(self.nodes.total(pushed) @ self.tool.direction)

    def normal_forces(self) -> np.ndarray:
        """As in `PressingTerm`."""
        return self.nodes.areas * self.state().pressure

    def normals(self) -> np.ndarray:
        """Of the tool nearest to this rank's nodes, (nodes, 3)."""
        return self.state().normal

    def arms(self) -> np.ndarray:
        """As in `PressingTerm`."""
        return self._arm_lengths()[:, None] * self.state().normal

    def levers(self) -> np.ndarray:
        """As in `PressingTerm`."""
        curvature = np.nan_to_num(self._arm_lengths())[:, None, None] * self.state().curvature
        return np.eye(3) - curvature

    def _arm_lengths(self):
        now, half = self.state(), self.thickness / 2
        return np.where(now.gap < half, now.gap + half, np.nan)

    def pressing_forces(self) -> np.ndarray:
        """As in `PressingTerm`."""
        return self.state().forces

    def memory(self) -> dict[str, np.ndarray]:
        """Of the last accepted state: shift of the surface, travel of the tool and depths [mm],
        (nodes, 1) each, and what its work is reckoned from (nodes, 24)."""
        rows = self._accepted_travel, self._work.memory().ravel()
        travel, work = (np.tile(row, (self.nodes.count, 1)) for row in rows)
        return {
            "shift": self._accepted_shift[:, None],
            "travel": travel,
            "depth": self._depth[:, None],
            "work": work,
            **super().memory(),
        }

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """As in `Remembers`."""
        self._shift = self._accepted_shift = memory["shift"][:, 0]
        self._depth = memory["depth"][:, 0]
        self.tool.travel = self._accepted_travel = float(self.nodes.common(memory["travel"])[0])
        self._work.recall(self.nodes.common(memory["work"]).reshape(3, -1))
        u = self.nodes.displacement()  # not balanced, as what friction bore is not known
        self._found = u, self._state_at(self.nodes.places + u)
        self.recall_friction(memory)

    # -- results

    def force(self) -> np.ndarray:
        """Force of the tool on the ply, of all ranks (3,) [N]."""
        return self.nodes.total(self.state().forces)

    def tractions(self) -> np.ndarray:
        """Of the tool on this rank's nodes, (nodes, 3) [MPa]."""
        return self.state().forces / np.maximum(self.nodes.areas, 1e-300)[:, None]

    def depth_under(self, pressure: float) -> np.ndarray:
        """Depth of the tool in the ply's face at each node under a pressure, (nodes,) [mm]."""
        return np.broadcast_to(self._law.depth(np.array(pressure)), self.nodes.count)

    def penetration(self) -> float:
        """Largest depth of the tool in rigid faces, of all ranks [mm]."""
        depth = 0.0 - self.state().gap[self._is_rigid].min(initial=0.0)
        return self.nodes.comm.allreduce(depth, MPI.MAX)

    def touched(self) -> bool:
        """Whether the tool pressed the sheet in any accepted state."""
        return self.nodes.comm.allreduce(bool((self._depth > 0).any()), MPI.LOR)

    def deepest(self) -> float:
        """Largest penetration of all accepted states, of all ranks [mm]."""
        deepest = float(self._penetrated.max(initial=0.0))
        return self.nodes.comm.allreduce(deepest, MPI.MAX)

    def penetration_of_thickness(self) -> float:
        """As in `Penetrated`."""
        deepest = float((self._penetrated / self.thickness).max(initial=0.0))
        return self.nodes.comm.allreduce(deepest, MPI.MAX)

    @property
    def _penetrated(self):
        """Largest depth in rigid faces (nodes,) [mm]."""
        return np.where(self._is_rigid, self._depth, 0.0)

    def where_deepest(self) -> str:
        """As in `Penetrated`, with the place in the undeformed sheet."""
        depth = self._penetrated
        i = int(depth.argmax()) if depth.size else None
        mine = (0.0, ()) if i is None else (depth[i], tuple(self.nodes.places[i]))
        _, place = max(self.nodes.comm.allgather(mine))
        return f"{self.tool.name} at {of_sheet(place[:2] if self.blank.is_flat() else place)}"

    def gap(self) -> np.ndarray:
        """From the ply's face to the tool at this rank's nodes, (nodes,) [mm]; below 0
        where it is in."""
        x = self.nodes.places + self.nodes.displacement()
        gap = self.tool.evaluate(x).gap
        for reach in (0.0, float(self.thickness.max(initial=0.0))):
            lost = np.isnan(gap)  # so far off that no nearest point is found: a bound will do
            gap[lost] = self.tool.evaluate(x[lost], reach).gap
        gap[~self.nodes.own] = np.inf
        return gap - self.thickness / 2

    def cell_fields(self) -> dict[str, Value]:
        """As `PlyThickness.fields`."""
        lost = np.where(self._is_rigid, 0.0, np.maximum(0.0, -self.state().gap))
        return self._plies.fields(self.blank.cell_means(lost))

    def nodal_fields(self) -> dict[str, Value]:
        """Traction (nodes, 3) and its size, pressure, of all contacts together, and the gap to the
        nearest tool."""
        return {
            "contact_traction": total(self.tractions(), "MPa"),
            "contact_pressure": size_of("contact_traction", "MPa"),
            "contact_gap": least(self.gap(), "mm"),
        }

    def warnings(self) -> list[str]:
        """As in `Warns`: if the tool's surface gave no number, which may be why steps failed."""
        lost = next(filter(None, self.nodes.comm.allgather(self._lost)), "")
        surface = type(self.tool.surface).__name__
        return (
            []
            if not lost
            else [
                f"the surface {surface} of {self.tool.name} gives no number at {lost}; "
                "`check_derivatives` tells what is wrong with a surface of your own"
            ]
        )

    # --

    def state(self) -> Pressed:
        """This rank's nodes as they are pressed at the sheet's present displacement."""
        u = self.nodes.view()
        known = self._found is not None and bool((u == self._found[0]).all())
        if self.tool.force:  # its balance asks all ranks, also those on which no node moved
            known = self.nodes.comm.allreduce(known, MPI.LAND)
        if self._found is None or not known:
            x = self.nodes.places + u
            self._found = u.copy(), self._balanced(x) if self.tool.force else self._state_at(x)
        return self._found[1]

    def _state_at(self, x):
        reach = float(self.thickness.max(initial=0.0))
        nearest = self.tool.evaluate(x, reach)
        deep = np.flatnonzero(nearest.gap < -0.9 * reach)
        if len(deep):  # their gaps may be bounds, of which forces are no derivatives
            for value, exact in zip(nearest, self.tool.evaluate(x[deep])):
                value[deep] = exact
        lost = np.flatnonzero(np.isnan(nearest.gap) & np.isfinite(x).all(1))
        if len(lost):
            self._lost = f"{coordinates(x[lost[0]])} mm"
        gap = nearest.gap - self.thickness / 2
        gap[~self.nodes.own] = np.inf
        return press(
            self._law, self.nodes.areas, gap, nearest.normal, nearest.curvature, self._shift
        )

    def _blocks(self, now):
        """By which forces of contact and friction fall as nodes move, (nodes, 3, 3) [N/mm]."""
        return now.blocks + self.rubbing_blocks()

    def _balanced(self, x):
        """The nodes at x as they are pressed where the tool's force is in balance, sought from
        where the tool is and, as a trial state may have sent it past the sheet, from where it was
        accepted; forces and energy are no numbers if there is none."""
        tool, nodes, now = self.tool, self.nodes, None

        def look(travel):
            nonlocal now
            tool.travel = travel
            now = self._state_at(x)
            forces = now.forces + self.rubbing_forces()
            free = nodes.comm.allreduce(now.gap.min(initial=np.inf), MPI.MIN)
            return Resistance(
                float(nodes.total(forces) @ tool.direction),
                float(nodes.total(self._blocks(now) @ tool.direction) @ tool.direction),
                max(free, 0.0),
            )

        least = float(self.thickness.min(initial=np.inf))
        reach, soft = least / 4, SMOOTHING * PERMITTED * least
        for start in (tool.travel, self._accepted_travel):
            if find_balance(tool.push, look, start, reach, soft):
                return now
        tool.travel = start
        now = self._state_at(x)
        return now._replace(
            energy=np.full_like(now.energy, np.nan), forces=np.full_like(now.forces, np.nan)
        )
