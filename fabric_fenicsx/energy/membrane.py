"""The membrane: in-plane strain energy of a blank."""

from functools import partial

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from .. import dolfinx_compat as compat
from ..core.collective_errors import on_all
from ..core.errors import InputError
from ..core.rules import COUNT, FINITE, POSITIVE
from ..io.field import Field, of_place
from ..material import kernel
from ..material.laws import Law
from ..material.laws.base import numbers_of
from ..material.presets import checked_fabric
from ..sheet.part import Part
from . import membrane_energy
from .fabric_states import KIND, FabricStates, YarnFriction
from .term import SceneFacts

# More points change forces by less than the element's own error, see docs/howto/meshes.md. The
# degree that UFL estimates for this energy would take thousands of points.
QUADRATURE_DEGREE = {
    ("triangle", 1): 1,
    ("triangle", 2): 4,
    ("triangle", 3): 6,
    ("quadrilateral", 1): 2,
    ("quadrilateral", 2): 4,
}
# Of `inner`: how far its points lie from a cell's centre, over how far those of `full` do; and the
# share of the energy that stays at those of `full`. If either is larger, strips with yarns at
# 20 deg are too stiff; if smaller, strips with yarns at 10 and 30 deg are too soft.
INNER_DISTANCE, OUTER_SHARE = 0.5, 0.01


def default_degree(part: Part) -> int:
    """Degree of quadrature for cells of a part, on all ranks together: of triangles of degree 2 and
    3 fewer points where they would lock more with more, and in space."""
    kind = compat.cell_name(part.blank.mesh), part.blank.degree
    few = {("triangle", 2): 2, ("triangle", 3): 4}
    if kind in few and (part.blank.mesh.geometry.dim == 3 or not part.follows_yarns()):
        return few[kind]
    return QUADRATURE_DEGREE[kind]


class Membrane(FabricStates):
    """Strain energy W(I4, I6, I8) t of a fabric over the undeformed sheet, eqs (5) to (9), (30).

    The formulas are in `energy.membrane_energy`, W itself in the law. A fabric's
    `shear_friction` acts in parallel, as the kind of energy "yarn_friction"; stresses in fields are
    of the law alone.

    Parameters
    ----------
    fabric : Law
        The law and its parameters. Fabrics that differ only in these share one compiled form.
    quadrature_degree : int, optional
        By default `default_degree`.
    integration : {"full", "inner"}
        `inner`, on quadratic triangles with straight sides, evaluates nearly all energy at three
        points closer to the cell's centre, by the factor `INNER_DISTANCE`. There the gradients of
        strains act times that factor, so cells off the yarns do not lock [1]_, [2]_, [3]_.
        `OUTER_SHARE` of the energy stays at the points of `full`, so that no corner of a cell turns
        over unseen. Where stretched yarns end at a free edge it is too soft by a part of a row of
        cells.
    weave_angle : float, optional
        Angle between the yarns of the weave without shear [rad], from which the shear angle counts.
        By default the initial angle of the blank, as in eq. (8). With any other the blank has
        stress as it lies.
    temperature : float or Field, optional
        Of a fabric that has numbers at temperatures [deg C]: one, or of x and y of the flat sheet,
        taken in the middle of each cell.
    thickness : Field, optional
        In place of the fabric's [mm], of x and y of the flat sheet. It scales membrane, bending
        (with its cube, but not a measured one) and the faces that touch others.

    Raises
    ------
    InputError
        For a weave_angle that is not above 0 and below pi; in a scene for an element that is not in
        `QUADRATURE_DEGREE`, or that `inner` is not for, and for a law with energy or stress at
        rest.

    References
    ----------
    - Malkus and Hughes, Comput. Methods Appl. Mech. Eng. 15, 1978: reduced integration as projected
      strains.
    - ten Thije and Akkerman, Composites A 39, 2008: locking of fibres.
    - Hamila and Boisse, Composites A 53, 2013.

    Examples
    --------
    A strip that is stretched by 1 % with its width held:

    >>> strip = ff.Blank.rectangle(20, 10, nx=2)
    >>> scene = ff.Scene(strip, [ff.Membrane(ff.load("komeili"))])
    >>> strip.u.interpolate(lambda x: (0.01 * x[0], 0 * x[1]))
    >>> round(scene.energy(), 3)  # (a eps^3 + b eps^2) t A [N mm]
    14.176
    """

    name, energy_kind = "membrane", "strain"

    def __init__(
        self,
        fabric: Law,
        quadrature_degree: int | None = None,
        integration: str = "full",
        weave_angle: float | None = None,
        temperature: float | Field | None = None,
        thickness: Field | None = None,
    ) -> None:
        if integration not in ("full", "inner"):
            raise InputError(f"integration is {integration!r}; expected full, inner")
        checked_fabric("fabric of a membrane", fabric)
        degree, temperature, thickness = (
            value if value is None else rule.check(name, value)
            for name, rule, value in (
                ("`quadrature_degree`", COUNT, quadrature_degree),
                ("`temperature`", of_place(FINITE), temperature),
                ("`thickness`", of_place(POSITIVE), thickness),
            )
        )
        if thickness and not isinstance(thickness, Field):
            thickness, fabric = None, fabric.replace(thickness=thickness)
        self.thickness_field, self.integration = thickness, integration
        self._warm: tuple[Law, Field] | None = None
        if isinstance(temperature, Field):  # the coldest stands for all where one law is asked for
            self._warm = fabric, temperature
            temperature = min(fabric.at_temperatures, default=0.0)
        self.fabric = fabric.at(temperature)
        self.weave_angle = None if weave_angle is None else kernel.check_weave_angle(weave_angle)
        self.prestressed, self._quadrature_degree = weave_angle is not None, degree

    def set_up(self, scene: SceneFacts) -> None:
        self._numbers = self._numbers_of_cells()
        blank, mesh = scene.blank, scene.blank.mesh
        self.fabric.check_rest()
        kind, inner = (compat.cell_name(mesh), blank.degree), self.integration == "inner"
        may_be_inner = blank.degree == 2 and blank.triangulated
        if kind not in QUADRATURE_DEGREE or (inner and not may_be_inner):
            allowed = ", ".join(f"{degree} on {cell}s" for cell, degree in QUADRATURE_DEGREE)
            allowed = "2 on triangles (P2) with straight sides" if inner else allowed
            raise InputError(
                f"{blank.name}, with integration `{self.integration}`, is of degree {blank.degree} "
                f"on {kind[0]}s; expected {allowed}"
            )
        self.degree = self._quadrature_degree or default_degree(self.part)
        law, straight, rest = self._constants(mesh)
        a0, b0 = straight or self._fibres()
        yarns = membrane_energy.deformed(blank.displacement, a0, b0)
        cosine = ufl.dot(a0, b0) if not self.part.orthogonal else ufl.as_ufl(0.0)
        rest = cosine if rest is None else rest
        self._ufl = law, (a0, b0), yarns, cosine, rest
        self._distance = INNER_DISTANCE if inner else 1.0
        dx = self.part.dx(self.degree, self._distance)
        # shares of the energy, and how they are integrated
        self._rules = [(1.0, dx)]
        if inner:
            self._rules = [(1 - OUTER_SHARE, dx), (OUTER_SHARE, self.part.dx(self.degree))]
        self.energy = membrane_energy.energy(yarns, rest, law, self._rules)
        friction, self._rubbing = self.fabric.shear_friction, None
        if friction:
            self._rubbing = YarnFriction(self.part, friction, law, yarns, rest, self.degree)

    @property
    def material(self) -> Law:
        return self.fabric

    def variations(self, v: Expr, w: Expr) -> list[ufl.Form]:
        """As in `Term`, by hand: see `membrane_energy`."""
        law, fibres, yarns, _, rest = self._ufl
        dv, dw = (membrane_energy.added(self.blank.in_space(x), *fibres) for x in (v, w))
        forms = membrane_energy.variations(yarns, dv, dw, rest, law, self._rules)
        if rubbing := self._rubbing:
            friction = membrane_energy.variations(yarns, dv, dw, rest, rubbing, rubbing.rules)
            forms = [each + other for each, other in zip(forms, friction)]
        return forms

    def energies(self) -> dict[str | None, float]:
        return super().energies() | ({KIND: self._rubbing.stored()} if self._rubbing else {})

    def accept(self) -> None:
        if self._rubbing:
            self._rubbing.accept()

    def cell_memory(self) -> dict[str, np.ndarray]:
        """Sliding and dissipation at the points of each cell."""
        return {"sliding": self._rubbing.memory()} if self._rubbing else {}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        if self._rubbing:
            self._rubbing.recall(memory["sliding"])

    def _constants(self, mesh):
        """The fabric, a0 and b0 where they are constant and the cosine of a weave angle that is
        given: entries of one vector, as several would be ordered, and the form recompiled, by
        their names."""
        straight, fabric, numbers = self.part.straight, self.fabric, self._numbers
        values = numbers_of(fabric) if numbers is None else []
        values += np.ravel(straight or ()).tolist()
        values += [] if self.weave_angle is None else [np.cos(self.weave_angle)]
        of_law = entries = iter(fem.Constant(mesh, values) if values else ())
        if numbers is not None:
            function = fem.Function(compat.vector_space(mesh, "DG", 0, numbers.shape[1]))
            function.x.array.reshape(-1, numbers.shape[1])[self.part.cells] = numbers
            of_law = iter(function)
        law = fabric.symbols(lambda _: next(of_law))
        directions = [ufl.as_vector([next(entries) for _ in each]) for each in straight or ()]
        return law, directions, next(entries, None)

    def _numbers_of_cells(self):
        """The numbers of the law in the cells (cells, numbers), None if all have the same."""
        if not (self._warm or self.thickness_field):
            return None
        x, comm = self.blank.centres()[self.part.cells], self.blank.mesh.comm
        numbers = np.tile(numbers_of(self.fabric), (len(x), 1))
        if self._warm:
            law, field = self._warm
            at = on_all(comm, lambda: field.at(x))
            self.fields = {"temperature": (field, x, at)}
            on_all(comm, lambda: law.check_temperatures(at) if len(at) else None)
            numbers = law.numbers_at(at)
        if thickness := self.thickness_field:
            numbers[:, -1] = on_all(comm, partial(thickness.at, x))
            self.fields = {**self.fields, "thickness": (thickness, x, numbers[:, -1])}
        return numbers

    def _fibres(self):
        """a0, b0 where they vary, on cells without one tangent plane projected at each point."""
        mesh, fibres = self.blank.mesh, (self.blank.a0, self.blank.b0)
        if mesh.geometry.dim == 2 or compat.is_affine(mesh):
            return fibres
        project = ufl.dot(ufl.Jacobian(mesh), ufl.JacobianInverse(mesh))
        return [f / ufl.sqrt(ufl.dot(f, f)) for f in (ufl.dot(project, f) for f in fibres)]
