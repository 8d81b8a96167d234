"""Contact of two sheets: pressure at points of one over the smooth face of the other."""

from collections.abc import Mapping, Sequence

import numpy as np
from mpi4py import MPI

from ...runtime.errors import InputError
from ...runtime.formatting import rounded
from ...runtime.rules import POSITIVE, Rule
from ..materials import material_of
from ..output import Value, joined, largest, size_of
from ..protocols import Touching
from ..shell.morley import Where
from ..term import SceneFacts, Term, Triplets
from .coulomb import Coulomb, as_coulomb
from .face_sliding import FaceSliding
from .friction import Friction
from .held_faces import HeldFaces
from .pressing import Pressed, anticipate, press
from .pressure_law import PERMITTED, SMOOTHING, Rigid, between_faces, face_of
from .sheet_points import POINTS, Facing, SheetPoints
from .thickness import PlyThickness

LAG = 0.01  # of the contact's forces, by which those of the faces as they are may differ


class SheetContact(Term):
    """Energy of two sheets pressed into each other: `lower` and `upper`, parts of a stack.

    Without pressure a sheet's face is half its thickness off its smooth `Face`. Pressure follows
    from the depth to which both faces overlap, see `between_faces`: fabric is `Compacted`, metal is
    `Rigid`. It acts at `points` (1, 3 or 6) in each triangle of the sheet of smaller cells, the
    upper one if they are equal, over their undeformed areas. It reacts on the corners of the
    triangle below each point, so that forces balance exactly. Uniform pressure loads the nodes of
    the one sheet exactly, those of the other as well as the points integrate it: with cells in the
    ratio 1 : 1.37, 6 points are 0.8 % off, 3 points 1.9 %.

    Within a solve the gap is a paraboloid in the relative displacement, of `HeldFaces`: these are
    taken anew after it if that changes the forces by more than `lag` of their sum.

    - penalty [N/mm^3]: makes fabric rigid, too; by default metal has `default_penalty` with the
      scene's tightest tool
    - symmetric: as in `Bending`
    - friction: its coefficient, or a `Coulomb` with its options; it acts at the same points, at the
      faces (`FaceSliding`)

    totals: force by which the lower sheet presses the upper one, and the sum of normal forces, in
    the last accepted state before faces were taken anew, of all ranks (4,) [N]. Raises InputError
    for one sheet given twice, another number of points, and values not above 0; as the scene is
    made, for parts that are not sheets of a stack, for other cells than triangles, and for sheets
    that overlap or of which none lies over the other.
    """

    energy_kind = "contact"
    friction: Friction | None = None

    def __init__(
        self,
        lower: str,
        upper: str,
        penalty: float | None = None,
        points: int = 3,
        lag: float = LAG,
        symmetric: Where | Sequence[Where] = (),
        friction: float | Coulomb = 0.0,
    ) -> None:
        self.sheets = lower, upper
        self.name = f"contact of {lower} and {upper}"
        for name, value in (("penalty", penalty), ("lag", lag)):
            if value is not None:
                POSITIVE.check(f"{name} of the {self.name}", value)
        one_of = Rule(f"one of {', '.join(map(str, POINTS))}", lambda v: v in POINTS, int)
        points = one_of.check(f"points in a cell of the {self.name}", points)
        if lower == upper:
            raise InputError(f"{self.name} is of one sheet; allowed are two different ones")
        self._penalty, self._lag, self._points_of_cell = penalty, lag, points
        self._symmetric = [symmetric] if callable(symmetric) else list(symmetric)
        self.coulomb = as_coulomb(friction, self.name, LAG)
        if self.coulomb and isinstance(self.coulomb.coefficient, Mapping):
            raise InputError(
                f"{self.name} has friction of several sheets; allowed is one number from 0"
            )

    def set_up(self, scene: SceneFacts) -> None:
        """As in `Term`."""
        lower, upper = parts = [scene.blank.part(name) for name in self.sheets]
        faces = [self._face(scene, part) for part in parts]
        self.thickness = min(thickness for thickness, _ in faces)
        self._laws = [law for _, law in faces]
        self._law = between_faces(*self._laws)
        self._plies = PlyThickness(scene, rigid=bool(self._penalty))
        self.points = SheetPoints(
            lower,
            upper,
            self._points_of_cell,
            [thickness for thickness, _ in faces],
            self._symmetric,
        )
        self._held = HeldFaces(self.points, self._lag, 3 * self.points.nodes.count)
        self._depth = np.zeros(self.points.count)  # greatest in accepted states
        self._load = 0.0
        # the last displacement and faces, and what was found there
        self._found: tuple[np.ndarray, Facing, Pressed] | None = None
        self._first = self._held.accepted
        self.totals = self._totals()
        self._check_start()
        if self.coulomb:
            given = self.coulomb.largest, self.normal_forces(), self._normals()
            self.friction = Friction(self.coulomb, *given, scene.blank.mesh.comm)
            self._begin_sliding()

    def _face(self, scene, part):
        """A sheet's thickness without pressure [mm], and the law of its face."""
        if part.thickness is None:
            raise InputError(
                f"{self.name} is asked of {part.name}, a patch; allowed are sheets of a stack"
            )
        material, k = material_of(scene, part), self._penalty
        if k:
            return part.thickness, Rigid(k, SMOOTHING * PERMITTED * part.thickness)
        if not material:
            raise InputError(
                f"{self.name} is given no penalty, and not both sheets have a fabric or metal; "
                "allowed is a number above 0"
            )
        tools = [term.tool for term in scene.terms if isinstance(term, Touching)]
        radius = min((min(tool.surface.radii) for tool in tools), default=np.inf)
        return material.thickness_under(0.0), face_of(material, radius)

    def _check_start(self):
        comm, gap = self.blank.mesh.comm, self._first.gap
        if not comm.allreduce(len(gap)):
            raise InputError(
                f"{self.name} finds no place of one over the other; allowed are sheets that lie on "
                "one another"
            )
        deepest = -comm.allreduce(gap.min(initial=np.inf), MPI.MIN)
        if deepest > self.thickness / 4:
            raise InputError(
                f"{self.name} begins with sheets that overlap by {rounded(deepest)} mm; allowed "
                "are sheets laid on one another with their thicknesses"
            )

    # -- load steps

    @property
    def pattern(self) -> int:  # type: ignore[override]
        """As in `Term`."""
        return self._held.pattern

    def set_load(self, load: float) -> None:
        """Go back to the faces and normal forces of the last accepted state."""
        self._load = load
        self._held.restore()
        if self.friction:
            self.friction.restore()
            self._offset = 0.0

    def accept(self) -> None:
        """Take the faces as they are, and let friction follow."""
        start = self._held.accepted
        if self.points.facing() is not self._held.now:
            self.totals = self._totals()
        self._held.accept()
        now = self._held.accepted
        self._depth *= self._load > 0  # states before the last one at load 0 are not in equilibrium
        self._depth[now.points] = np.maximum(self._depth[now.points], -now.gap)
        if self.friction:
            exact = self._slid_exactly(start, now)
            self.friction.accept(exact, self.normal_forces(), self._normals())
            self._begin_sliding()

    def update_lagged(self) -> bool:
        """Take the faces anew if needed, and have friction take the normal forces; whether any
        did."""
        moved = self._held.update(
            lambda facing: self.points.of_all(facing, self._pressed(facing).forces)
        )
        if not self.friction:
            return moved
        held, exact = self._slid(), self._slid_exactly(self._held.accepted, self._held.now)
        if not self.friction.update_lagged(self.normal_forces(), held, exact):
            return moved
        self._offset = self._offset + exact - held
        return True

    def cell_memory(self) -> dict[str, np.ndarray]:
        """Largest overlap at each point in accepted states, (cells, points) [mm]; elastic slip
        (cells, 3 points) [mm] and energy taken by friction (cells, points) [N mm]."""
        known = {"depth": self._depth} | (self.friction.memory() if self.friction else {})
        return {name: self.points.among_cells(values) for name, values in known.items()}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """As in `Remembers`."""
        known = {name: self.points.of_cells(rows) for name, rows in memory.items()}
        self._depth = known["depth"]
        if self.friction:
            self.friction.recall(known)
            self._held.begin_here()
            self._begin_sliding()

    # -- energy, forces, stiffness

    def _pressed(self, facing: Facing | None = None) -> Pressed:
        """The points of a `Facing`, by default that of the present solve, as they are pressed at
        the present displacement."""
        facing, u = facing or self._held.now, self.blank.u.x.array
        found = self._found
        known = found is not None and found[1] is facing and np.array_equal(u, found[0])
        # relative motion asks all ranks
        if found is None or not self.blank.mesh.comm.allreduce(known, MPI.LAND):
            gap, normal = facing.paraboloid()
            now = press(self._law, facing.areas, gap, normal, facing.curvature)
            self._found = found = u.copy(), facing, now
        return found[2]

    def anticipate(self, f: np.ndarray) -> None:
        """Until the sheets move, let `tangent` be the law's slope up to the pressure that balances
        the other forces on both of them, see `pressing.anticipate`."""
        now, facing, nodes = self._pressed(), self._held.now, self.points.nodes
        forces = f[: 3 * nodes.count].reshape(-1, 3)
        apart = facing.pairs.apart(forces / nodes.areas[:, None])
        missing = 0.5 * (apart * now.normal).sum(1)
        now = anticipate(self._law, facing.areas, now, missing)
        self._found = self.blank.u.x.array.copy(), facing, now

    def energies(self) -> dict[str | None, float]:
        """As in `StoresKinds`: of contact, and what friction took."""
        kinds: dict[str | None, float] = {"contact": float(self._pressed().energy.sum())}
        return kinds | {"friction": self.friction.energy(self._slid())} if self.friction else kinds

    def stored(self) -> float:
        """As in `Term`."""
        return sum(self.energies().values())

    def add_forces(self, f: np.ndarray) -> None:
        """As in `Term`."""
        self._held.now.pairs.add(-self._pressed().forces, f)
        if self.friction:
            forces = self.friction.forces(self._slid())
            self._sliding.add(-forces[self._held.accepted.points], f)

    def tangent(self) -> Triplets:
        """As in `Term`."""
        pairs = self._held.now.pairs
        places, values = pairs.coupled, pairs.values(self._pressed().blocks)
        pressed = places.rows, places.cols, values
        if not self.friction:
            return pressed
        blocks = self.friction.blocks(self._slid())[self._held.accepted.points]
        places = self._sliding.coupled
        rubbed = places.rows, places.cols, self._sliding.values(blocks)
        rows, cols, values = (np.concatenate(both) for both in zip(pressed, rubbed))
        return rows, cols, values

    def _slid(self):
        """How far faces slid at the points since the last accepted state (count, 3) [mm], 0 at
        those that lay over nothing: as it is held during a solve, linear in the displacement."""
        return self._offset + self.points.of_all(self._held.accepted, self._sliding.slid())

    def _slid_exactly(self, start, now):
        """From one `Facing` to another: what points moved, less what their arms turned."""
        moved = self.points.of_all(start, start.moved())
        before, after = (self.points.of_all(each, each.arms(), np.nan) for each in (start, now))
        return moved - np.nan_to_num(after - before)

    def _begin_sliding(self):
        """Sliding counts from the accepted state."""
        start = self._held.accepted
        self._sliding = FaceSliding(self.blank, *start.corners, start.unit_normals())
        self._offset = 0.0  # of sliding, by which it is not linear

    def _normals(self):
        """Unit normals of the accepted faces at all points (count, 3), 0 where there is none."""
        start = self._held.accepted
        return self.points.of_all(start, start.unit_normals())

    def normal_forces(self) -> np.ndarray:
        """Normal forces on all points of this rank, 0 where one lies over nothing (count,) [N]."""
        now = self._held.now
        return self.points.of_all(now, self._pressed().pressure * now.areas)

    # -- results

    def depth_under(self, pressure: float) -> float:
        """Overlap of the faces [mm] under a pressure [MPa]."""
        return float(self._law.depth(np.array(pressure)))

    def force(self) -> np.ndarray:
        """By which the lower sheet presses the upper one, of all ranks, (3,) [N]."""
        return self._totals()[:3]

    def _totals(self):
        """Force by which the lower sheet presses the upper one, and sum of normal forces, (4,)."""
        now = self._pressed()
        found = [*self.points.side * now.forces.sum(0), now.pressure @ self._held.now.areas]
        return self.blank.mesh.comm.allreduce(np.array(found))

    def deepest(self) -> float:
        """Largest overlap of the faces in accepted states, of all ranks [mm]."""
        return self.blank.mesh.comm.allreduce(float(self._depth.max(initial=0.0)), MPI.MAX)

    def penetration_of_thickness(self) -> float:
        """As in `Penetrated`, of the thinner sheet where both are rigid."""
        return self.deepest() / self.thickness if isinstance(self._law, Rigid) else 0.0

    def where_deepest(self) -> str:
        """As in `Penetrated`."""
        return self.name

    def sliding(self) -> np.ndarray:
        """How far the face at each point has slid along that of the other sheet from the place that
        it lay on at the start, (count, 3) [mm]; NaN where it lay or lies over none."""
        first, now = self._first, self._held.now
        moved = self.points.of_all(first, first.moved(), np.nan)
        moved -= self.points.of_all(now, now.arms(), np.nan)
        moved += self.points.of_all(first, first.arms(), np.nan)
        normal = self.points.of_all(now, now.normal, np.nan)
        return moved - (moved * normal).sum(1, keepdims=True) * normal

    def cell_fields(self) -> dict[str, Value]:
        """Means over the cells of the sheet that has the points: pressure, and how far they have
        slid on the other sheet, as a vector and its size; of two other sheets the larger."""
        part = self.points.part
        shape = len(part.cells), self.points.per_cell
        pressure = (self.normal_forces() / self.points.areas).reshape(shape).mean(1)
        slid = np.nan_to_num(self.sliding()).reshape(*shape, 3).mean(1)
        return {
            "sheet_pressure": largest(part.spread(pressure), "MPa"),
            "sliding": largest(part.spread(slid), "mm"),
            "sliding_size": size_of("sliding", "mm"),
        } | self._plies.fields(self._lost())

    def _lost(self):
        """Thickness that both sheets lose on these faces, (owned cells,) [mm]."""
        points, pressure = self.points, self.normal_forces() / self.points.areas
        above, below = (
            np.zeros(points.count) if isinstance(law, Rigid) else law.depth(pressure)
            for law in (self._laws[::-1] if points.side > 0 else self._laws)
        )
        lost = self.blank.cell_means(points.below(self._held.now, below))
        lost[points.part.cells] += above.reshape(-1, points.per_cell).mean(1)
        return lost

    def summary(self) -> dict[str, Value]:
        """Force, penetration and largest sliding of the pair."""
        comm, sizes = self.blank.mesh.comm, np.linalg.norm(self.sliding(), axis=1)
        pair = {
            "force_N": float(np.linalg.norm(self.totals[:3])),
            "normal_force_N": float(self.totals[3]),
            "penetration_of_thickness": self.penetration_of_thickness(),
            "sliding_largest_mm": comm.allreduce(float(np.nanmax(sizes, initial=0.0)), MPI.MAX),
        }
        return {"sheet_contacts": joined({f"{self.sheets[0]}, {self.sheets[1]}": pair})}
