"""Contact of a sheet with rigid tools: pressure at its nodes."""

from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from ..core.errors import InputError
from ..core.formatting import of_sheet
from ..core.rules import POSITIVE
from ..energy.materials import materials_of, sheets_of, thickness_shares_at_nodes
from ..energy.morley import Where
from ..energy.nodes import Nodes
from ..energy.output import Value, largest, least, total
from ..energy.term import SceneFacts
from ..energy.work import Work
from ..surfaces.checks import check_start
from ..surfaces.tool import Tool
from .closest_on_tool import ClosestOnTool
from .contact_term import PlyThickness, ToolContactTerm
from .coulomb import LAG, Friction
from .pressure_law import (
    PENETRATION,
    SMOOTHING,
    ContactResponse,
    FaceLaw,
    contact_response,
    face_of,
    find_balance,
    rigid_face,
    with_secant_stiffness,
)


class _Accepted(NamedTuple):
    """The last accepted state: travel of the tool [mm], gaps (nodes,) [mm], areas that were pressed
    (nodes,) [mm^2] and energy correction (nodes,) [N mm]."""

    travel: float
    gap: np.ndarray
    areas: np.ndarray
    correction: np.ndarray


class Contact(ToolContactTerm):
    """Contact of a sheet with a rigid tool, with an energy at its nodes.

    The pressure depends on the depth of the tool in the face of the sheet: fabric is compacted, by
    half on each face, and metal is rigid (`FaceLaw`). It acts over the node's area, which
    follows the sheet but is lagged during a solve. The sheet is on the side to which the tool's
    normal points. Without pressure its faces are half a thickness off the mesh. A tool moved by
    force is always where contact and friction balance the force.

    Parameters
    ----------
    tool
        With its surface and its path or force.
    thickness
        Of the sheet [mm]; by default that of the scene's fabric or metal.
    penalty
        k of a rigid face [N/mm^3]; also makes fabric rigid. By default `default_penalty` of the
        material and the tool's least radius.
    friction
        Its coefficient, on a stack also one for each sheet {name: coefficient}, or a `Coulomb`.
    where
        Function of undeformed points (3, n) to a mask (n,) of the nodes that the tool may touch, by
        default all.

    Raises
    ------
    InputError
        For numbers not above 0; as the scene is made, for a blank in a plane or of other cells, for
        a second contact with the tool, and where a default needs a material that no term has.

    Examples
    --------
    >>> ball = ff.Tool(ff.Sphere(30.0, (0.0, 0.0, -30.5)), path=(0.0, 0.0, 8.0), name="ball")
    >>> contact = ff.Contact(ball, friction=0.25)
    >>> contact.coulomb.coefficient
    0.25
    """

    name, energy_kind = "contact", "contact"
    resists = ("lift",)

    def __init__(
        self,
        tool: Tool,
        thickness: float | None = None,
        penalty: float | None = None,
        friction: Friction = 0.0,
        where: Where | None = None,
    ) -> None:
        super().__init__(tool, friction, f"contact with {tool.name}")
        self._given, self.where = {"thickness": thickness, "penalty": penalty}, where
        for name, value in self._given.items():
            if value is not None:
                POSITIVE.check(f"{name} of the contact with {tool.name}", value)
        # the last displacement, and what was found at it
        self._response: tuple[np.ndarray, ContactResponse] | None = None
        self._load, self._work = 0.0, Work()

    def set_up(self, scene: SceneFacts) -> None:
        on = self.tool, self.part_name
        same = [t for t in scene.terms if isinstance(t, Contact) and (t.tool, t.part_name) == on]
        if len(same) > 1:
            raise InputError(f"{len(same)} contacts with {self.tool.name} given; expected one")
        self.nodes = Nodes(scene.blank, self.part, self.where)
        self.closest = ClosestOnTool(self.tool, self.nodes)
        self._flat = self._face_at_nodes(scene)
        if any(term.thickness_field for term in scene.terms) and not self._given["thickness"]:
            self._flat = self._flat.grown(thickness_shares_at_nodes(scene))
        self.plies = PlyThickness(scene, self._given["thickness"], bool(self._given["penalty"]))
        self.depth = np.zeros(self.nodes.count)
        self._accepted = _Accepted(self.tool.travel, self.depth, self.nodes.areas, self.depth)
        self._press_on(self.nodes.areas, self.depth)
        self.accept()
        self._start_friction()

    def _face_at_nodes(self, scene):
        (t, k), parts = self._given.values(), sheets_of(self.blank)
        radius, which = min(self.tool.surface.radii), np.zeros(self.nodes.count, int)
        faces = []
        for number, part in enumerate(parts):
            which[part.nodes] = number
            if material := next(materials_of(scene, part), None):
                material = material.replace(thickness=t or material.thickness)
                faces.append(face_of(material, radius, k))
        if len(faces) < len(parts):
            if not (t and k):
                raise InputError(
                    f"contact with {self.tool.name} needs a {'penalty' if t else 'thickness'}, a "
                    "number above 0, as no term of the scene has a fabric or metal for each sheet"
                )
            faces, which = [rigid_face(t, k)], 0 * which
        return FaceLaw.of_points(faces, which)

    def _press_on(self, areas, correction):
        """Press on areas (nodes,) [mm^2], where a sheet may be thicker as they shrink."""
        self.areas, self.energy_correction, self._response = areas, correction, None
        self.face = self._flat
        if np.any(self._flat.thickening):
            ratios = np.where(areas > 0, areas / np.maximum(self.nodes.areas, 1e-300), 1.0)
            self.face = self._flat.grown(ratios**-self._flat.thickening)
        # twice what counts: the sheet may become thicker
        self.closest.reach = float(self.thickness.max(initial=0.0))

    def state(self) -> ContactResponse:
        """This rank's nodes as they are pressed at the sheet's present displacement."""
        u = self.nodes.view()
        is_current = self._response is not None and bool((u == self._response[0]).all())
        if self.tool.force:  # its balance asks all ranks, also those on which no node moved
            is_current = self.nodes.comm.allreduce(is_current, MPI.LAND)
        if self._response is None or not is_current:
            self._response = u.copy(), self._balanced() if self.tool.force else self._state_now()
        return self._response[1]

    def _state_now(self):
        nearest = self.closest.now()
        gap = nearest.gap - self.thickness / 2
        gap[~self.nodes.mask] = np.inf
        return contact_response(self.face, self.areas, gap, nearest.normal, nearest.curvature)

    def _balanced(self):
        """The nodes as they are pressed where the tool's force is in balance, sought from
        where the tool is and, as a trial state may have sent it past the sheet, from where it was
        accepted; forces and energy are no numbers if there is none."""
        tool, nodes, now = self.tool, self.nodes, None

        def look(travel):
            nonlocal now
            tool.travel = travel
            now = self._state_now()
            forces = now.forces + self._friction_forces()
            free = nodes.comm.allreduce(now.gap.min(initial=np.inf), MPI.MIN)
            return (
                float(nodes.total(forces) @ tool.direction),
                float(nodes.total(self._blocks(now) @ tool.direction) @ tool.direction),
                max(free, 0.0),
            )

        least = float(self.thickness.min(initial=np.inf))
        reach, soft = least / 4, SMOOTHING * PENETRATION * least
        for start in (tool.travel, self._accepted.travel):
            if find_balance(tool.push, look, start, reach, soft):
                return now
        tool.travel = start
        now = self._state_now()
        return now._replace(energy=np.nan * now.energy, forces=np.nan * now.forces)

    def _blocks(self, now=None):
        pressed, rubbed = (now or self.state()).blocks, super()._blocks()
        return pressed + (0.0 if rubbed is None else rubbed)

    def _normals(self):
        return self.state().normal

    def _pressing_forces(self):
        return self.state().forces

    def _offsets(self):
        now, half = self.state(), self.thickness / 2
        length = np.where(now.gap < half, now.gap + half, np.nan)[:, None]
        turned = np.nan_to_num(length)[:, None] * now.curvature
        return length * now.normal, np.eye(3) - turned

    def normal_forces(self) -> np.ndarray:
        return self.areas * self.state().pressure

    def depth_under(self, pressure: float) -> np.ndarray:
        """Depth of the tool in the face at each node under a pressure [MPa], (nodes,) [mm]."""
        return np.broadcast_to(self.face.depth(np.array(pressure)), self.nodes.count)

    def pressed_by(self, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Depths in the face [mm] and energies [N mm] under forces on the nodes [N], (nodes,)."""
        depth = np.array(self.face.depth(forces / np.maximum(self.areas, 1e-300)))
        return depth, self.areas * self.face(depth)[0]

    def energies(self) -> dict[str | None, float]:
        """See `Term`; on rank 0 also minus the work of the force that moves the tool."""
        stored = float((self.state().energy + self.energy_correction).sum())
        kinds = {"contact": stored, **super().energies()}
        by_force = self.tool.force and self.nodes.comm.rank == 0
        return kinds | {None: -self.tool.push * self.tool.travel if by_force else 0.0}

    def use_secant_stiffness(self, f: np.ndarray) -> None:
        """See `Term` and `with_secant_stiffness`, until the sheet moves."""
        now, others = self.state(), f[: 3 * self.nodes.count].reshape(-1, 3)
        missing = (others * now.normal).sum(1) / np.maximum(self.areas, 1e-300)
        now = with_secant_stiffness(self.face, self.areas, now, missing)
        self._response = self.nodes.displacement(), now

    def compliance(self) -> tuple[np.ndarray, float] | None:
        if not self.tool.force:
            return None
        pushed = self._blocks() @ self.tool.direction
        return -pushed.ravel(), float(self.nodes.total(pushed) @ self.tool.direction)

    def set_load(self, load: float) -> None:
        self._press_on(self._accepted.areas, self._accepted.correction)
        self._load = load
        self.tool.at(load)
        self.tool.travel = self._accepted.travel
        super().set_load(load)

    def accept(self) -> None:
        now = self.state()
        self.closest.accept()
        travel, correction = self.tool.travel, self.energy_correction
        self._accepted = _Accepted(travel, now.gap, self.areas, correction)
        self._work.accept(self._load, self.force(), self.tool.displacement)
        self._note_depth(self._load, -now.gap)
        super().accept()

    def reject(self) -> None:
        self._work.reject()

    def _update_friction(self, normal_forces):
        changed = super()._update_friction(normal_forces)
        if changed and self.tool.force:  # to be balanced anew
            self._response = None
        return changed

    def _update_pressing(self):
        now, areas, u = self.state(), self.nodes.areas_now(), self.nodes.displacement()
        pressed = np.column_stack([abs(areas - self.areas), areas]) * now.pressure[:, None]
        changed, total = self.nodes.total(pressed)
        if changed <= min(self.coulomb.lag if self.coulomb else LAG, 0.01) * total:
            return False
        self._press_on(areas, self.energy_correction)
        then = self._state_now()
        self.energy_correction = self.energy_correction + now.energy - then.energy
        self._response = None if self.tool.force else (u, then)
        return True

    def work(self) -> float:
        """Work of the tool's motion since the last accepted state, on rank 0 [N mm]."""
        work = self._work.since(self._load, self.force(), self.tool.displacement)
        return (work if self.nodes.comm.rank == 0 else 0.0) + self._friction_work()

    def contact_prediction(self) -> np.ndarray:
        """See `Term`, by a thickness at most."""
        if self.tool.force:  # which moves with the sheet
            return np.zeros(3 * self.nodes.count)
        now, before = self.state(), self._accepted.gap
        gap = np.where(np.isfinite(now.gap), now.gap, 0.0)
        off = np.where(before < 0, before, np.maximum(gap, 0.0)) - gap
        off = np.clip(off, -self.thickness, self.thickness)
        return np.nan_to_num(off[:, None] * now.normal).ravel()

    def memory(self) -> dict[str, np.ndarray]:
        """Of the last accepted state and of friction; what work is counted from (nodes, 24)."""
        travel, _, areas, correction = self._accepted
        rows = {"travel": np.array(travel), "work": self._work.memory().ravel()}
        at_nodes = {"depth": self.depth, "areas": areas, "energy_correction": correction}
        memory = {name: np.tile(row, (self.nodes.count, 1)) for name, row in rows.items()}
        memory |= {name: values[:, None] for name, values in at_nodes.items()}
        return super().memory() | memory | {"outside": self.closest.outside}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        self.depth = memory["depth"][:, 0]
        areas, correction = memory["areas"][:, 0], memory["energy_correction"][:, 0]
        self.tool.travel = travel = float(self.nodes.common(memory["travel"])[0])
        self._accepted = _Accepted(travel, self._accepted.gap, areas, correction)
        self._press_on(areas, correction)
        self.closest.recall(memory["outside"])
        self._work.recall(self.nodes.common(memory["work"]).reshape(3, -1))
        u = self.nodes.displacement()  # not balanced, as what friction bore is not known
        self._response = u, self._state_now()
        super().recall(memory)

    def gap(self) -> np.ndarray:
        """Gap from the sheet's face to the tool at the nodes, below 0 inside, (nodes,) [mm]."""
        gap = self.closest.anywhere(self.nodes.mask).gap
        gap[~self.nodes.mask] = np.inf
        return gap - self.thickness / 2

    def penetration(self) -> float:
        """Largest depth of the tool in rigid faces in the present state, of all ranks [mm]."""
        return self._largest(np.where(self.face.is_rigid, -self.state().gap, 0.0))

    def behind_walls(self) -> tuple[int, float]:
        """Number of nodes that went through a wall of the tool and are still behind the face where
        they went in, and how far at most [mm], of all ranks."""
        deep = -self.closest.now().gap[self.closest.passed]
        return self.nodes.comm.allreduce(len(deep)), self._largest(deep)

    def where_deepest(self) -> str:
        depth, places = self._penetrated(), self.nodes.places
        deepest = [(depth[i], *places[i]) for i in np.argsort(depth)[-1:]]
        _, *place = max(each for rank in self.nodes.comm.allgather(deepest) for each in rank)
        return f"{self.tool.name} at {of_sheet(place[:2] if self.blank.is_flat() else place)}"

    def cell_fields(self) -> dict[str, Value]:
        lost = np.where(self.face.is_rigid, 0.0, np.maximum(0.0, -self.state().gap))
        return self.plies.fields(self.blank.cell_means(lost))

    def nodal_fields(self) -> dict[str, Value]:
        """Traction (nodes, 3) of all tools together, which is 0 where two press a ply from both
        sides; the pressure, of several tools the largest; and the gap to the nearest tool."""
        traction = self.state().forces / np.maximum(self.areas, 1e-300)[:, None]
        return {
            "contact_traction": total(traction, "MPa"),
            "contact_pressure": largest(np.linalg.norm(traction, axis=1), "MPa"),
            "contact_gap": least(self.gap(), "mm"),
        }

    def warnings(self) -> list[str]:
        """See `Term`: if the tool's surface gave no number, which may be why steps failed."""
        place = next(filter(None, self.nodes.comm.allgather(self.closest.undefined_at)), "")
        words = (
            f"the surface {type(self.tool.surface).__name__} of {self.tool.name} returns no number "
            f"at {place}; `check_derivatives` finds errors in a surface of your own"
        )
        return [*super().warnings(), *[words] * bool(place)]

    def check_start(self) -> None:
        """See `Term`: also for a tool's path or surface that can't be."""
        self.tool.at(1.0)
        self.tool.at(0.0)
        x = (self.nodes.places + self.nodes.displacement())[self.nodes.mask]
        check_start(self.tool, x, self.closest.reach, self.nodes.comm)

    def may_press(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """See `Term`, at up to twice 1000 nodes of a rank: triangles take 1 ms each."""
        at_loads, x = [], self.nodes.places[self.nodes.mask]
        x = x[:: max(1, len(x) // 1000)]
        for load in (0.0, 1.0):
            self.tool.at(load)
            normals = self.tool.evaluate(x).normal
            near = np.isfinite(normals).all(1)
            at_loads.append((x[near], normals[near]))
        self.tool.at(self._load)
        return at_loads
