"""Contact of two sheets: pressure at points of one over the smooth face of the other."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from mpi4py import MPI

from ..core.errors import InputError
from ..core.formatting import rounded
from ..core.rules import POSITIVE, Rule
from ..energy.materials import materials_of, thickness_shares_at_nodes
from ..energy.morley import Where
from ..energy.output import Value, joined, largest
from ..energy.term import SceneFacts, Triplets, overrides
from ..io.field import Field
from .contact_points import POINTS, ContactPairs, ContactPoints, LaggedFaces, RelativeMotion
from .contact_term import ContactTerm, PlyThickness
from .coulomb import Coulomb
from .friction import FaceSlip
from .pressure_law import (
    ContactResponse,
    between_faces,
    contact_response,
    face_of,
    rigid_face,
    with_secant_stiffness,
)

LAG = 0.01  # of the contact's forces, by which those of the faces as they are may differ


class FaceContact(ContactTerm):
    """Contact of faces of sheets at points of one over the smooth `Face` of the other, whose depth
    in one another gives the pressure. A subclass names the sheets and gives their `points` to
    `_begin`. penalty, points, lag, friction: as in `SheetContact`."""

    energy_kind = "contact"
    _lost: Callable[[np.ndarray], np.ndarray]

    def __init__(
        self,
        name: str,
        penalty: float | None,
        points: int,
        lag: float,
        symmetric: Where | Sequence[Where],
        friction: float | Field | Coulomb,
    ) -> None:
        self.name = name
        self._given = {"penalty": penalty, "lag": lag}
        for what, value in self._given.items():
            if value is not None:
                POSITIVE.check(f"{what} of the {name}", value)
        one_of = Rule(f"one of {', '.join(map(str, POINTS))}", lambda v: v in POINTS, int)
        self._points_of_cell = one_of.check(f"points in a cell of the {name}", points)
        self.symmetric = [symmetric] if callable(symmetric) else list(symmetric)
        super().__init__(friction, name)
        if self.coulomb and isinstance(self.coulomb.coefficient, Mapping):
            raise InputError(f"{name} has friction of several sheets; expected one number from 0")

    def _begin(self, scene, points):
        """Let the faces press at the points; InputError if they overlap at the start."""
        if any(term.thickness_field for term in scene.terms):
            points.vary(thickness_shares_at_nodes(scene))
        self.points, thickness = points, min(face.thickness for face in points.faces)
        self.face = between_faces(*points.faces)._replace(thickness=thickness)
        self.plies = PlyThickness(scene, rigid=bool(self._given["penalty"]))
        self.faces = LaggedFaces(points, self._given["lag"] or LAG, 3 * points.nodes.count)
        self.depth, self._load = np.zeros(points.count), 0.0
        self.energy_correction = self._accepted_correction = np.zeros(points.count)
        # the last displacement and faces, and what was found there
        self._response: tuple[np.ndarray, ContactPairs, ContactResponse] | None = None
        # in the last accepted state, before faces were updated
        self.totals, self.first = self._totals(), self.faces.accepted
        deepest = -self.blank.mesh.comm.allreduce(self.first.gap.min(initial=np.inf), MPI.MIN)
        if deepest > self.thickness / 4:
            raise InputError(
                f"{self.name} begins with sheets that overlap by {rounded(deepest)} mm; expected "
                "sheets placed on each other with their thicknesses"
            )
        self._start_friction()

    def _face_of(self, scene, part, t):
        """The `FaceLaw` of a sheet, of t [mm] if its face is rigid by a penalty."""
        k, material = self._given["penalty"], next(materials_of(scene, part), None)
        t = t or (material.thickness_under(0.0) if material else None)
        if k and t:
            return rigid_face(t, k)
        if k or not material:
            raise InputError(
                f"{self.name} needs a {'thickness' if k else 'penalty'}, a number above 0, as no "
                f"term has a fabric or metal for {part.name or self.blank.name}"
            )
        tools = [term.tool for term in scene.terms if overrides(term, "may_press")]
        radius = min((min(tool.surface.radii) for tool in tools if tool), default=np.inf)
        return face_of(material, radius)

    def _coefficient(self, law):
        mu = law.coefficient
        return self._of_place(mu, self.points.flat_places()) if isinstance(mu, Field) else mu

    def where_deepest(self) -> str:
        return self.name

    def state(self, pairs: ContactPairs | None = None) -> ContactResponse:
        """The points of `pairs`, by default those of this solve, as they are pressed now."""
        pairs, u = pairs or self.faces.now, self.blank.u.x.array
        last = self._response
        known = last is not None and last[1] is pairs and np.array_equal(u, last[0])
        # relative motion asks all ranks
        if last is None or not self.blank.mesh.comm.allreduce(known, MPI.LAND):
            gap, normal = pairs.paraboloid()
            law = self.face._replace(growth=pairs.growth)
            now = contact_response(law, pairs.areas, gap, normal, pairs.curvature)
            self._response = last = u.copy(), pairs, now
        return last[2]

    def normal_forces(self) -> np.ndarray:
        now = self.faces.now
        return self.points.of_all(now, self.state().pressure * now.areas)

    def depth_under(self, pressure: float) -> float:
        """Overlap of the faces [mm] under a pressure [MPa]."""
        return float(self.face.depth(np.array(pressure)))

    def _totals(self):
        """Force by which the lower sheet presses the upper one, and sum of normal forces, (4,)."""
        now = self.state()
        sums = [*self.points.side * now.forces.sum(0), now.pressure @ self.faces.now.areas]
        return self.blank.mesh.comm.allreduce(np.array(sums))

    def _sliding(self):
        return FaceSlip(self.points, self.faces.now)

    def _stiffness_of_cells(self):
        sheets = [self._stretching(part) for part in self.points.parts]
        series = sheets[0] * sheets[1] / max(sum(sheets), 1e-300)
        return series / len(self.points.places)

    @property
    def pattern(self) -> list[RelativeMotion]:  # type: ignore[override]
        both = self.faces.now, self.friction_state and self.friction_state.sliding.start
        return [each.motion for each in both if each and len(each.points)]

    def energies(self) -> dict[str | None, float]:
        stored = float(self.state().energy.sum() + self.energy_correction.sum())
        return {"contact": stored, **super().energies()}

    def add_forces(self, f: np.ndarray) -> None:
        self.faces.now.motion.add(-self.state().forces, f)
        if self.friction_state:
            self.friction_state.sliding.add(-self.friction_state.forces(), f)

    def tangent(self) -> Triplets:
        pressed = self.faces.now.motion.triplets(self.state().blocks)
        if not self.friction_state:
            return pressed
        rubbed = self.friction_state.sliding.triplets(self.friction_state.blocks())
        rows, cols, values = (np.concatenate(both) for both in zip(pressed, rubbed))
        return rows, cols, values

    def use_secant_stiffness(self, f: np.ndarray) -> None:
        """See `Term` and `with_secant_stiffness`, with forces on both sheets, until they move."""
        now, pairs, nodes = self.state(), self.faces.now, self.points.nodes
        forces = f[: 3 * nodes.count].reshape(-1, 3)
        apart = pairs.motion.apart(forces / nodes.areas[:, None])
        missing = 0.5 * (apart * now.normal).sum(1)
        law = self.face._replace(growth=pairs.growth)
        now = with_secant_stiffness(law, pairs.areas, now, missing)
        self._response = self.blank.u.x.array.copy(), pairs, now

    def set_load(self, load: float) -> None:
        """Go back to the faces and normal forces of the last accepted state."""
        self._load, self.energy_correction = load, self._accepted_correction
        self.faces.restore()
        super().set_load(load)

    def on_prediction(self) -> None:
        self.faces.on_prediction()

    def update_lagged(self) -> bool:
        """See `Term`. Friction follows the forces in balance, which new faces do not have yet."""
        normal_forces = self.normal_forces()
        changed = self._update_pressing()
        return self._update_friction(normal_forces) or changed

    def _update_pressing(self):
        before = self.faces.now
        if not self.faces.update(lambda pairs: self.points.of_all(pairs, self.state(pairs).forces)):
            return False
        self._follow_areas(before)
        return True

    def _follow_areas(self, before):
        """Correct the energy by what contact gave as areas changed from those of `before`."""
        now = self.faces.now
        if now is not before:
            areas = self.points.of_all(before, before.areas, 1.0)
            grown = 1 - areas[now.points] / now.areas
            grown[~np.isin(now.points, before.points)] = 0.0
            gain = self.points.of_all(now, self.state().energy * grown)
            self.energy_correction = self.energy_correction - gain

    def accept(self) -> None:
        """Take the faces as they are, and let friction follow."""
        before = self.faces.now
        if self.points.pairs() is not self.faces.accepted:
            self.totals = self._totals()
        self.faces.accept()
        self._follow_areas(before)
        self._accepted_correction = self.energy_correction
        now = self.faces.accepted
        self._note_depth(self._load, self.points.of_all(now, -now.gap))
        super().accept()

    def cell_memory(self) -> dict[str, np.ndarray]:
        """Of each point in the accepted state, (cells, points) each: largest overlap [mm], energy
        correction and that of friction [N mm]; elastic slip (cells, 3 points) [mm]."""
        arrays = {"depth": self.depth, "energy_correction": self.energy_correction} | (
            self.friction_state.memory() if self.friction_state else {}
        )
        points = self.points
        return {name: points.part.rows(each, points.per_cell) for name, each in arrays.items()}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        arrays = {name: self.points.of_cells(rows) for name, rows in memory.items()}
        self.depth = arrays["depth"]
        self.energy_correction = self._accepted_correction = arrays["energy_correction"]
        self.faces.accept()
        if self.friction_state:
            self.friction_state.recall(arrays, self._sliding())

    def cell_fields(self) -> dict[str, Value]:
        """Mean pressure of the face of each cell that is pressed more, and what `PlyThickness` has.
        A subclass gives `_lost(pressure)`, the thickness lost on these faces in each cell [mm]."""
        points = self.points
        pressure = points.of_all(self.faces.now, self.state().pressure)
        field = largest(points.part.spread(points.means(pressure).max(1)), "MPa")
        return {"sheet_pressure": field} | self.plies.fields(self._lost(pressure))

    def _depths(self, law, pressure, sheet):
        """Thickness that a face loses at all points, (count,) [mm]; sheet: 0 has the points."""
        growth = self.points.of_all(self.faces.now, self.faces.now.growths[sheet], 1.0)
        return growth * (0.0 if law.is_rigid else law.depth(pressure))


class SheetContact(FaceContact):
    """Contact of two sheets of a stack, by an energy of points of one over the other.

    Without pressure a sheet's face is half its thickness away from its smooth `Face`. The pressure
    depends on the overlap of both faces, see `between_faces`: fabric is compacted,
    metal is rigid. It acts at points of the sheet of smaller cells, the upper one if they are
    equal, over their areas, and reacts on the corners of the triangle below each point,
    so that forces balance exactly. Uniform pressure loads the nodes of the one sheet exactly, those
    of the other as well as the points integrate it: with cells in the ratio 1 : 1.37, 6 points are
    0.8 % off, 3 points 1.9 %. Within a solve the gap is a paraboloid in the relative displacement,
    of `LaggedFaces`.

    Parameters
    ----------
    lower, upper
        Names of the sheets.
    penalty
        [N/mm^3]; makes fabric rigid, too. By default metal has `default_penalty` with the scene's
        tightest tool.
    points
        1, 3 or 6 in each triangle.
    lag
        Faces are updated after a solve, and it is repeated, if that changes the contact's forces
        by more than this share of their sum.
    symmetric
        As in `Bending`.
    friction
        Its coefficient, or a `Coulomb`. It acts at the same points, at the faces (`FaceSlip`).

    Raises
    ------
    InputError
        For one sheet given twice, another number of points, and values not above 0; as the scene is
        made, for parts that are not sheets of a stack, for other cells than triangles, and for
        sheets that overlap or of which none lies over the other.

    Examples
    --------
    >>> contact = ff.SheetContact("lower", "upper", friction=0.3)
    >>> contact.name, contact.coulomb.lag
    ('contact of lower and upper', 0.0005)
    """

    def __init__(
        self,
        lower: str,
        upper: str,
        penalty: float | None = None,
        points: int = 3,
        lag: float = LAG,
        symmetric: Where | Sequence[Where] = (),
        friction: float | Field | Coulomb = 0.0,
    ) -> None:
        self.sheets = lower, upper
        name = f"contact of {lower} and {upper}"
        super().__init__(name, penalty, points, lag, symmetric, friction)

    def set_up(self, scene: SceneFacts) -> None:
        lower, upper = parts = [scene.blank.part(name) for name in self.sheets]
        for part in parts:
            if part.thickness is None:
                raise InputError(
                    f"{self.name} is asked of {part.name}, a patch; expected sheets of a stack"
                )
        faces = [self._face_of(scene, part, part.thickness) for part in parts]
        rule = self._points_of_cell
        self._begin(scene, ContactPoints(lower, upper, rule, faces, self.symmetric))

    def force(self) -> np.ndarray:
        """Force by which the lower sheet presses the upper one, of all ranks, (3,) [N]."""
        return self._totals()[:3]

    def sliding(self) -> np.ndarray:
        """Distance by which the face at each point has slid along that of the other sheet from the
        place that it lay on at the start, (points, 3) [mm]; NaN where it lay or lies over none."""
        points, first, now = self.points, self.first, self.faces.now
        moved = points.of_all(first, first.moved() + first.offsets(), np.nan)
        moved -= points.of_all(now, now.offsets(), np.nan)
        normal = points.of_all(now, now.normal, np.nan)
        return moved - (moved * normal).sum(1, keepdims=True) * normal

    def cell_fields(self) -> dict[str, Value]:
        """Means over the cells of the sheet that has the points: pressure, and the sliding on the
        other sheet, as a vector and its size; of two other sheets the larger."""
        slid = self.points.means(np.nan_to_num(self.sliding()))[:, 0]
        sliding = {"sliding": slid, "sliding_size": np.linalg.norm(slid, axis=1)}
        spread = self.points.part.spread
        return super().cell_fields() | {k: largest(spread(v), "mm") for k, v in sliding.items()}

    def _lost(self, pressure):
        points = self.points
        faces = points.faces[::-1] if points.side > 0 else points.faces
        above, below = (self._depths(face, pressure, k) for k, face in enumerate(faces))
        lost = self.blank.cell_means(points.below(self.faces.now, below))
        lost[points.part.cells] += points.means(above)[:, 0]
        return lost

    def summary(self) -> dict[str, Value]:
        comm, sizes = self.blank.mesh.comm, np.linalg.norm(self.sliding(), axis=1)
        pair = {
            "force_N": float(np.linalg.norm(self.totals[:3])),
            "normal_force_N": float(self.totals[3]),
            "penetration_of_thickness": self.penetration_of_thickness(),
            "sliding_largest_mm": comm.allreduce(float(np.nanmax(sizes, initial=0.0)), MPI.MAX),
        }
        pairs = {f"{self.sheets[0]}, {self.sheets[1]}": pair}
        return {"sheet_contacts": joined(pairs), **super().summary()}
