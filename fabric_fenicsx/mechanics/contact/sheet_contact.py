"""Contact of a sheet with another one: a penalty at points of one over the smooth face of the
other."""

from collections.abc import Mapping, Sequence
from typing import Any

import basix
import numpy as np
from mpi4py import MPI
from scipy import sparse

from ...material.metal import Metal
from ...runtime.errors import InputError
from ...tools.tool import Tool
from ..shell.morley import Where
from ..term import SceneFacts, Term, Triplets
from .aitken import Aitken
from .coulomb import Coulomb, as_coulomb
from .faces import Face
from .facing import Facing
from .friction import Friction
from .nodes import Nodes
from .pairs import Pairs
from .pressure_law import PERMITTED, SMOOTHING, LayeredLaw, PressureLaw, chord, stack_penalty
from .tool_contact import MORE

POINTS = {1: 1, 3: 2, 6: 4}  # of a cell: degree that they integrate exactly
LAG = 0.01  # of the contact's forces, by which those of the faces as they are may differ
PRESSING = 5.0  # MPa, at which a soft layer is pressed out
REACH = 1.0  # of the distance between the sheets, by which points may rise that are followed


class SheetContact(Term):
    """Energy of two sheets pressed into each other: `lower` and `upper`, parts of a stack.

    A sheet's face is half its thickness off its smooth `Face`. Pressure follows the `PressureLaw`
    of the depth to which both faces overlap. It acts at `points` (1, 3 or 6) in each cell of the
    sheet of smaller cells, the upper one if they are equal, over their undeformed areas. It reacts
    on the nodes that shape the `Face` below, so that forces balance exactly. Uniform pressure loads
    the nodes of the one sheet exactly, those of the other as well as the points integrate it: with
    cells in the ratio 1 : 1.37, 6 points are 0.8 % off, 3 points 1.9 %. In the first two rows of
    cells at free edges, see `Face`, both are some per cent off.

    Within a solve the gap is a paraboloid in the relative displacement, from places, normals and
    curvatures of the last accepted state, so it has no kinks. After it the faces are looked at
    again: if that changes the forces by more than `lag` of their sum, the paraboloid is taken anew
    and the solve repeated. Until that is settled, solves are `rough`.

    - penalty [N/mm^3]: by default `stack_penalty` of both sheets, and of all metal of the scene,
      with its tightest tool
    - layer [mm]: distance of the faces at which pressure begins, by default 0
    - pressing [MPa]: what presses the layer out, see `LayeredLaw`
    - symmetric: as in `Bending`
    - friction: its coefficient, or a `Coulomb` with its options; it acts at the same points, on the
      flat triangles of the last accepted state

    settled: force by which the lower sheet presses the upper one, and the sum of normal forces, in
    the last accepted state before faces were taken anew, of all ranks (4,) [N]. Raises InputError
    for one sheet given twice, another number of points, and values not above 0; as the scene is
    made, for parts that are not sheets of a stack, for other cells than linear triangles, and for
    sheets that overlap or of which none lies over the other.
    """

    energy_kind, rough = "contact", 1e-3
    friction: Friction | None = None
    units = {"sheet_pressure": "MPa", "sliding": "mm", "sliding_size": "mm"}

    def __init__(
        self,
        lower: str,
        upper: str,
        penalty: float | None = None,
        points: int = 3,
        lag: float = LAG,
        layer: float = 0.0,
        pressing: float = PRESSING,
        symmetric: Where | Sequence[Where] = (),
        friction: float | Coulomb = 0.0,
    ) -> None:
        self.sheets = lower, upper
        self.name = f"contact of {lower} and {upper}"
        for name, value in (("penalty", penalty), ("lag", lag), ("pressing", pressing)):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"{self.name} has {name} {value}; allowed is a number above 0")
        if not (np.isfinite(layer) and layer >= 0):
            raise InputError(f"{self.name} has layer {layer}; allowed is a number from 0")
        if points not in POINTS:
            allowed = ", ".join(map(str, POINTS))
            raise InputError(f"{self.name} has {points} points in a cell; allowed are {allowed}")
        if lower == upper:
            raise InputError(f"{self.name} is of one sheet; allowed are two different ones")
        self._given, self.lag, self._rule = penalty, lag, POINTS[points]
        self.layer, self._pressing = layer, pressing
        self._symmetric = [symmetric] if callable(symmetric) else list(symmetric)
        self.coulomb = as_coulomb(friction, self.name, LAG)
        if self.coulomb and isinstance(self.coulomb.coefficient, Mapping):
            raise InputError(
                f"{self.name} has friction of several sheets; allowed is one number from 0"
            )

    def set_up(self, scene: SceneFacts) -> None:
        """As in `Term`."""
        blank, comm = scene.blank, scene.blank.mesh.comm
        parts = [blank.part(name) for name in self.sheets]
        thickness = [self._thickness(part) for part in parts]
        self.distance, self.thickness = sum(thickness) / 2 + self.layer, min(thickness)
        areas = [blank.areas()[part.cells] for part in parts]
        sizes = [comm.allreduce(each.sum()) / comm.allreduce(len(each)) for each in areas]
        over = 1 if sizes[1] <= sizes[0] * (1 + 1e-6) else 0
        self._part = parts[over]
        self._side = 1.0 if over else -1.0  # the face below the points looks at them
        self._face = Face(parts[1 - over], self._side, self._symmetric)
        self._own = Face(parts[over], 1.0, self._symmetric)
        # other sheets may lie between them
        apart = abs(self._own.flat_height() - self._face.flat_height())
        self._reach = apart + REACH * self.distance
        places, weights = basix.make_quadrature(basix.CellType.triangle, self._rule)
        N = np.column_stack([1 - places.sum(1), places])
        self._per_cell = len(N)
        self._weights = self._own.own_weights(N)
        self._flat_weights = self._own.own_weights(N, flat=True)
        self._flat = self._own.flat(N)
        self.areas = (areas[over][:, None] * weights / weights.sum()).ravel()
        self.count = len(self.areas)
        penalty = self._given or self._default_penalty(scene, parts)
        face = PressureLaw(penalty, SMOOTHING * PERMITTED * self.thickness)
        self._law = LayeredLaw(self.layer, self._pressing, face) if self.layer else face
        self._nodes = Nodes(blank)
        self._below = np.full(self.count, -1)  # what was found last
        self._depth = np.zeros(self.count)  # greatest in accepted states
        self._cached: tuple[np.ndarray, Any] | None = None
        self._found: tuple[np.ndarray, Facing] | None = None
        self._load, self._accepted_place = 0.0, self.blank.u.x.array.copy()
        self._relaxed = Aitken(comm, 3 * self._nodes.count, self._accepted_place)
        self._accepted = self._now = self.facing()
        self.settled = self._totals()
        self._check_start()
        self._first = self._accepted
        if self.coulomb:
            given = self.coulomb.largest, self.normal_forces(), self._normals()
            self.friction = Friction(self.coulomb, *given, comm)

    def _thickness(self, part):
        if part.thickness is None:
            raise InputError(
                f"{self.name} is asked of {part.name}, a patch; allowed are sheets of a stack"
            )
        return part.thickness

    def _default_penalty(self, scene, parts):
        both = [scene.material_of(part) for part in parts]
        if not all(both):
            raise InputError(
                f"{self.name} is given no penalty, and not both sheets have a fabric or metal; "
                "allowed is a number above 0"
            )
        metals = [term.made_of for term in scene.terms if isinstance(term.made_of, Metal)]
        tools: list[Tool] = [tool for term in scene.terms for tool in term.tools()]
        radius = min((min(tool.surface.radii) for tool in tools), default=np.inf)
        return stack_penalty([each for each in [*both, *metals] if each], radius)

    def _check_start(self):
        comm, gap = self.blank.mesh.comm, self._accepted.gap
        if not comm.allreduce(len(gap)):
            raise InputError(
                f"{self.name} finds no place of one over the other; allowed are sheets that lie on "
                "one another"
            )
        deepest = -comm.allreduce(gap.min(initial=np.inf), MPI.MIN) - self.layer
        if deepest > self.thickness / 4:
            raise InputError(
                f"{self.name} begins with sheets that overlap by {deepest:.3g} mm; allowed are "
                "sheets laid on one another with their thicknesses"
            )

    # -- places

    def facing(self) -> Facing:
        """The points over the other sheet at the present displacement, on all ranks together."""
        u = self.blank.u.x.array
        known = self._found is not None and np.array_equal(u, self._found[0])
        if self._found is None or not self.blank.mesh.comm.allreduce(known, MPI.LAND):
            self._found = u.copy(), self._faced()
        return self._found[1]

    def _faced(self):
        face, own = self._face, self._own
        face.take()
        own.take()
        points = own.points(self._weights, self._flat)
        # a sheet that is folded over shows its back to points of the other one
        ahead = self._side * (self._flat_weights @ own.normals)
        over = face.below(points, self._below, self._reach, ahead)
        self._below = over.triangle
        at = np.flatnonzero(over.triangle >= 0)
        nodes = np.concatenate([own.nodes, face.nodes])

        def pairs_of(own, is_flat):
            below = face.weights(over.triangle[at], over.weights[at], is_flat)
            return Pairs(self.blank, nodes, sparse.hstack([own[at], -below]).tocsr())

        pairs, flat = pairs_of(self._weights, False), pairs_of(self._flat_weights, True)
        return Facing(
            at,
            self.areas[at],
            over.gap[at] - self.distance,
            over.normal[at],
            over.curvature[at],
            pairs,
            pairs.relative(),
            flat,
            flat.relative(),
        )

    def at(self, load: float) -> None:
        """Go back to the faces of the last accepted state."""
        self._load = load
        self._relaxed.start(self._accepted_place)
        self._take(self._accepted)
        if self.friction:
            self.friction.restore()

    def accept(self) -> None:
        """Take the faces as they are."""
        slid = self._slid()  # since the last accepted state
        now = self.facing()
        if now is not self._now:
            self.settled = self._totals()
        self._accepted, self._accepted_place = now, self.blank.u.x.array.copy()
        self._take(self._accepted)
        at = self._accepted.points
        self._depth *= self._load > 0  # states before the last one at load 0 are not in equilibrium
        self._depth[at] = np.maximum(self._depth[at], -self._accepted.gap - self.layer)
        if self.friction:
            self.friction.accept(slid, self.normal_forces(), self._normals())
            self.pattern += 1

    def update_lagged(self) -> bool:
        """Take the faces anew if needed, and have friction take the normal forces; whether any
        did."""
        moved = self._update_faces()
        rubbed = self.friction is not None and self.friction.update_lagged(self.normal_forces())
        return moved or rubbed

    def _update_faces(self):
        """Take the faces as they are, or part of the way there, if that changes forces by more than
        `lag` of their sum."""
        before, taken = self._forces_of_all(), (self._now, self.pattern)
        self._take(self.facing())
        after = self._forces_of_all()
        changed, total = self.blank.mesh.comm.allreduce(
            np.array(
                [np.linalg.norm(after - before, axis=1).sum(), np.linalg.norm(after, axis=1).sum()]
            )
        )
        if changed <= self.lag * total:
            (self._now, self.pattern), self._cached = taken, None
            return False
        u = self.blank.u.x.array
        found, place = u.copy(), self._relaxed.next(u)
        if self._relaxed.share < 1:
            u[:] = place
            self._take(self.facing())
            u[:] = found
        return True

    def _take(self, facing):
        if facing is not self._now:
            self._now, self._cached = facing, None
            self.pattern += 1

    def _forces_of_all(self):
        forces = np.zeros((self.count, 3))
        forces[self._now.points] = self._state()[1]
        return forces

    # -- energy, forces, stiffness

    def _state(self):
        """Pressures (n,), forces on the points (n, 3), stiffness blocks (n, 3, 3), energy."""
        u = self.blank.u.x.array
        known = self._cached is not None and np.array_equal(u, self._cached[0])
        # relative motion asks all ranks
        if self._cached is None or not self.blank.mesh.comm.allreduce(known, MPI.LAND):
            now = self._now
            moved = now.pairs.relative() - now.relative
            turned = np.einsum("nij,nj->ni", now.curvature, moved)
            gap = now.gap + ((now.normal + 0.5 * turned) * moved).sum(1)
            normal, areas = now.normal + turned, now.areas
            energy, pressure, slope = self._law(np.maximum(0.0, -gap))
            forces = (areas * pressure)[:, None] * normal
            blocks = (areas * slope)[:, None, None] * normal[:, :, None] * normal[:, None]
            blocks -= (areas * pressure)[:, None, None] * now.curvature
            self._cached = u.copy(), (pressure, forces, blocks, float(areas @ energy))
        return self._cached[1]

    def anticipate(self, f: np.ndarray) -> None:
        """As in `Contact`: until the sheets move, let `tangent` be the law's slope up to the
        pressure that balances the other forces on both of them."""
        pressure, forces, blocks, energy = self._state()
        pairs = self._now.pairs
        areas = self._nodes.areas
        apart = pairs.apart(f[: 3 * len(areas)].reshape(-1, 3) / areas[:, None])
        at = np.flatnonzero(pressure > 0)
        normal = forces[at] / (pressure[at] * self._now.areas[at])[:, None]
        p, areas = pressure[at], self._now.areas[at]
        balancing = np.clip(p + 0.5 * (apart[at] * normal).sum(1), 0.0, MORE * p)
        slope = self._law(self._law.depth(p))[2]
        change = areas * (chord(self._law, p, balancing) - slope)
        blocks = blocks.copy()
        blocks[at] += change[:, None, None] * normal[:, :, None] * normal[:, None]
        self._cached = self.blank.u.x.array.copy(), (pressure, forces, blocks, energy)

    def stored_by_kind(self) -> dict[str, float]:
        """As in `Term`: of contact, and what friction took."""
        kinds = {"contact": self._state()[3]}
        return kinds | {"friction": self.friction.energy(self._slid())} if self.friction else kinds

    def stored(self) -> float:
        """As in `Term`."""
        return sum(self.stored_by_kind().values())

    def add_forces(self, f: np.ndarray) -> None:
        """As in `Term`."""
        self._now.pairs.add(-self._state()[1], f)
        if self.friction:
            forces = self.friction.forces(self._slid())
            self._accepted.flat.add(-forces[self._accepted.points], f)

    def tangent(self) -> Triplets:
        """As in `Term`."""
        pairs, flat = self._now.pairs, self._accepted.flat
        pressed = pairs.rows, pairs.cols, pairs.values(self._state()[2])
        if not self.friction:
            return pressed
        blocks = self.friction.blocks(self._slid())[self._accepted.points]
        rubbed = flat.rows, flat.cols, flat.values(blocks)
        rows, cols, values = (np.concatenate(both) for both in zip(pressed, rubbed))
        return rows, cols, values

    def _slid(self):
        """How far the points moved on the other sheet since the last accepted state (count, 3)
        [mm]; 0 of those that lay over none."""
        slid = np.zeros((self.count, 3))
        slid[self._accepted.points] = self._accepted.moved()
        return slid

    def _normals(self):
        """Unit normals of the accepted faces at all points, (count, 3); 0 where there is none."""
        normals, gradient = np.zeros((self.count, 3)), self._accepted.normal
        normals[self._accepted.points] = gradient / np.linalg.norm(gradient, axis=1)[:, None]
        return normals

    def cell_memory(self) -> dict[str, np.ndarray]:
        """Largest overlap at each point in accepted states, (cells, points) [mm]; elastic slip
        (cells, 3 points) [mm] and energy taken by friction (cells, points) [N mm]."""
        known = {"depth": self._depth} | (self.friction.memory() if self.friction else {})
        return {name: self.among_cells(values) for name, values in known.items()}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """As in `Term`."""
        known = {name: self.of_points(rows) for name, rows in memory.items()}
        self._depth = known["depth"]
        if self.friction:
            self.friction.recall(known)
            self._accepted = self.facing()

    def among_cells(self, values: np.ndarray) -> np.ndarray:
        """Values of all points (count, ...) as rows of the blank's owned cells, 0 elsewhere."""
        wide = self._per_cell * int(np.prod(values.shape[1:]))
        rows = np.zeros((len(self.blank.areas()), wide))
        rows[self._part.cells] = values.reshape(-1, wide)
        return rows

    def of_points(self, rows: np.ndarray) -> np.ndarray:
        """The reverse of `among_cells`, (count, k), or (count,) of one number a point."""
        values = rows[self._part.cells]
        wide = values.shape[1] // self._per_cell
        return values.reshape((self.count, wide) if wide > 1 else self.count)

    def depth_under(self, pressure: float) -> float:
        """Overlap of the faces [mm] under a pressure [MPa]; below 0 where they do not meet."""
        return float(self._law.depth(np.array(pressure))) - self.layer

    def covered(self, above: np.ndarray | None = None) -> np.ndarray:
        """Areas of the lower sheet over which the upper one lies, at this rank's owned nodes (n,)
        [mm^2]. above (n,): such areas of the upper sheet, if only those count."""
        now, nodes = self.facing(), self._nodes
        areas, forces = now.areas, np.zeros(3 * nodes.count)
        lower, upper = (self.blank.part(name).nodes for name in self.sheets)
        if above is not None:
            share = np.where(upper, above / nodes.areas, 0.0)
            areas = areas * abs(now.flat.apart(np.tile(share[:, None], 3)))[:, 0]
        now.flat.add(np.tile(areas[:, None], 3), forces)
        return np.where(lower, abs(forces[::3]), 0.0)

    def normal_forces(self) -> np.ndarray:
        """On all points of this rank, whether over the other sheet or not, (count,) [N]."""
        forces = np.zeros(self.count)
        forces[self._now.points] = self._state()[0] * self._now.areas
        return forces

    # -- results

    def force(self) -> np.ndarray:
        """By which the lower sheet presses the upper one, of all ranks, (3,) [N]."""
        return self._totals()[:3]

    def _totals(self):
        """Force by which the lower sheet presses the upper one, and sum of normal forces, (4,)."""
        pressure, forces, _, _ = self._state()
        sign = 1.0 if self._part.name == self.sheets[1] else -1.0
        found = np.array([*sign * forces.sum(0), pressure @ self._now.areas])
        return self.blank.mesh.comm.allreduce(found)

    def deepest(self) -> float:
        """Largest overlap of the faces in accepted states, of all ranks [mm]."""
        return self.blank.mesh.comm.allreduce(float(self._depth.max(initial=0.0)), MPI.MAX)

    def penetration_of_thickness(self) -> float:
        """As in `Term`, of the thinner sheet."""
        return self.deepest() / self.thickness

    def sliding(self) -> np.ndarray:
        """How far each point has moved along the other sheet from the place that it lay over at the
        start, (count, 3) [mm]; NaN where it lay or lies over none."""
        moved, normal = np.full((2, self.count, 3), np.nan)
        first, now = self._first, self._now
        moved[first.points] = first.moved()
        normal[now.points] = now.normal
        return moved - (moved * normal).sum(1, keepdims=True) * normal

    def add_cell_fields(self, fields: dict[str, np.ndarray]) -> None:
        """Means over the cells of the sheet that has the points: pressure [MPa], and how far they
        have slid on the other sheet, as a vector and its size [mm]; of two other sheets the
        larger."""
        shape = len(self._part.cells), self._per_cell
        pressure = (self.normal_forces() / self.areas).reshape(shape)
        slid = np.nan_to_num(self.sliding()).reshape(*shape, 3)
        vector, cells = slid.mean(1), self._part.cells
        found = {"sheet_pressure": pressure.mean(1), "sliding_size": np.linalg.norm(vector, axis=1)}
        if "sliding" in fields:  # of two sheets that lie on this one, what is larger
            further = fields["sliding_size"][cells] > found["sliding_size"]
            vector = np.where(further[:, None], fields["sliding"][cells], vector)
            found = {name: np.fmax(fields[name][cells], now) for name, now in found.items()}
        for name, values in (found | {"sliding": vector}).items():
            self._part.put(fields, name, values)

    def add_summary(self, summary: dict[str, Any]) -> None:
        """Add force, penetration and largest sliding of the pair."""
        comm, sizes = self.blank.mesh.comm, np.linalg.norm(self.sliding(), axis=1)
        furthest = np.nanmax(sizes, initial=0.0)
        summary.setdefault("sheet_contacts", {})[f"{self.sheets[0]}, {self.sheets[1]}"] = {
            "force_N": float(np.linalg.norm(self.settled[:3])),
            "normal_force_N": float(self.settled[3]),
            "penetration_of_thickness": self.penetration_of_thickness(),
            "sliding_largest_mm": comm.allreduce(float(furthest), MPI.MAX),
        }
