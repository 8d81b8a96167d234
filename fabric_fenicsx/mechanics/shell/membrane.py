"""The membrane: in-plane strain energy of a blank."""

from functools import cached_property, partial

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.core.expr import Expr

from ... import dolfinx_compat as compat
from ...material import kernel, stability
from ...material.laws import Law
from ...material.laws.base import numbers_of
from ...material.presets import checked_fabric
from ...material.strains import SHORTENED, nominal_strain, share_name, shear_angle
from ...readers.field import Field, of_place
from ...runtime.collective_errors import on_all
from ...runtime.errors import InputError
from ...runtime.rules import COUNT, FINITE, POSITIVE
from ...sheets.part import Part
from .. import membrane_energy
from ..output import Value, joined, largest, last, least, on_part
from ..term import SceneFacts, Term
from .yarn_friction import KIND, YarnsRubbing

# More points change forces by less than the element's own error, see docs/howto/meshes.md. The
# degree that UFL estimates for this energy would take thousands of points.
QUADRATURE_DEGREE = {
    ("triangle", 1): 1,
    ("triangle", 2): 4,
    ("triangle", 3): 6,
    ("quadrilateral", 1): 2,
    ("quadrilateral", 2): 4,
}
# of triangles that would lock more with more points, and of those in space
FEW_POINTS_DEGREE = {2: 2, 3: 4}
INTEGRATION = "full", "inner"
# Of `inner`: how far its points lie from a cell's centre, over how far those of `full` do; and the
# share of the energy that stays at those of `full`. If either is larger, strips with yarns at
# 20 deg are too stiff; if smaller, strips with yarns at 10 and 30 deg are too soft.
INNER_DISTANCE, OUTER_SHARE = 0.5, 0.01
UNITS = {"shear_angle": "rad", "I10": "rad"}  # of fields; of all others "-"
UNITS |= dict.fromkeys(("sigma_a", "sigma_b", "shear_friction"), "MPa")
UNITS |= dict.fromkeys(("energy_a", "energy_b", "energy_shear"), "N mm/mm^3")


def default_degree(part: Part) -> int:
    """Degree of quadrature for cells of a part, on all ranks together."""
    blank = part.blank
    degree = QUADRATURE_DEGREE[compat.cell_name(blank.mesh), blank.degree]
    if compat.cell_name(blank.mesh) != "triangle" or blank.degree not in FEW_POINTS_DEGREE:
        return degree
    in_space = blank.mesh.geometry.dim == 3
    return FEW_POINTS_DEGREE[blank.degree] if in_space or not part.follows_yarns() else degree


class Membrane(Term):
    """Strain energy W(I4, I6, I8) t of a fabric over the undeformed sheet, eqs (5) to (9), (30).

    The formulas are in `mechanics.membrane_energy`, W itself in the law. A fabric's
    `shear_friction` acts beside it, as the kind of energy "yarn_friction"; stresses in fields are
    of the law alone.

    Parameters
    ----------
    fabric : Law
        The law and its numbers. Fabrics that differ only in numbers share one compiled form.
    quadrature_degree : int, optional
        By default that of `QUADRATURE_DEGREE`; in space and off the yarns `FEW_POINTS_DEGREE`.
    integration : {"full", "inner"}
        `inner`, on quadratic triangles with straight sides, takes nearly all of the energy at three
        points nearer to a cell's centre, by the factor `INNER_DISTANCE`. They see the gradients of
        strains times that factor, so cells off the yarns do not lock [1]_, [2]_, [3]_.
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
        if integration not in INTEGRATION:
            raise InputError(
                f"integration is {integration!r}; allowed are {', '.join(INTEGRATION)}"
            )
        checked_fabric("fabric of a membrane", fabric)
        if temperature is not None:
            temperature = of_place(FINITE).check("`temperature`", temperature)
        if thickness is not None:
            thickness = of_place(POSITIVE).check("`thickness`", thickness)
            if not isinstance(thickness, Field):
                thickness, fabric = None, fabric.replace(thickness=thickness)
        self.thickness_field, self.integration = thickness, integration
        self._warm: tuple[Law, Field] | None = None
        if isinstance(temperature, Field):  # the coldest stands for all where one law is asked for
            self._warm = fabric, temperature
            temperature = min(fabric.at_temperatures, default=0.0)
        self.fabric = fabric.at(temperature)
        self.weave_angle = None if weave_angle is None else kernel.check_weave_angle(weave_angle)
        self.prestressed = weave_angle is not None
        if quadrature_degree is not None:
            quadrature_degree = COUNT.check("`quadrature_degree`", quadrature_degree)
        self._quadrature_degree = quadrature_degree
        # displacements, values at points
        self._evaluated: tuple[np.ndarray, np.ndarray] | None = None

    def set_up(self, scene: SceneFacts) -> None:
        self._numbers = self._numbers_of_cells()
        blank, mesh = scene.blank, scene.blank.mesh
        self.fabric.check_rest()
        cell = compat.cell_name(mesh)
        if (cell, blank.degree) not in QUADRATURE_DEGREE:
            allowed = ", ".join(f"{degree} on {kind}s" for kind, degree in QUADRATURE_DEGREE)
            raise InputError(
                f"{blank.name} is of degree {blank.degree} on {cell}s; allowed is {allowed}"
            )
        self.degree = self._quadrature_degree or default_degree(self.part)
        if self.integration == "inner" and not (blank.degree == 2 and blank.triangulated):
            raise InputError(
                f"integration `inner` needs quadratic triangles (P2) with straight sides; "
                f"{blank.name} is of degree {blank.degree} on {cell}s"
            )
        law, straight, rest = self._constants(mesh)
        self._a0, self._b0 = straight or self._fibres()
        yarns = membrane_energy.deformed(blank.displacement, self._a0, self._b0)
        cosine = ufl.dot(self._a0, self._b0) if not self.part.orthogonal else ufl.as_ufl(0.0)
        rest = cosine if rest is None else rest
        self._ufl = law, yarns, cosine, rest
        self._drawn = INNER_DISTANCE if self.integration == "inner" else 1.0
        dx = self.part.dx(self.degree, self._drawn)
        # shares of the energy, and how they are integrated
        self._rules = [(1.0, dx)]
        if self.integration == "inner":
            self._rules = [(1 - OUTER_SHARE, dx), (OUTER_SHARE, self.part.dx(self.degree))]
        self.energy = membrane_energy.energy(yarns, rest, law, self._rules)
        friction, self._rubbing = self.fabric.shear_friction, None
        if friction:
            self._rubbing = YarnsRubbing(self.part, friction, law, yarns, rest, self.degree)

    @property
    def material(self) -> Law:
        """The fabric."""
        return self.fabric

    def variations(self, v: Expr, w: Expr) -> list[ufl.Form]:
        """As in `Term`, by hand: see `membrane_energy`."""
        law, yarns, _, rest = self._ufl
        dv, dw = (membrane_energy.added(self.blank.in_space(x), self._a0, self._b0) for x in (v, w))
        forms = membrane_energy.variations(yarns, dv, dw, rest, law, self._rules)
        if rubbing := self._rubbing:
            friction = membrane_energy.variations(yarns, dv, dw, rest, rubbing, rubbing.rules)
            forms = [each + other for each, other in zip(forms, friction)]
        return forms

    # -- friction between the yarns, if there is any

    def energies(self) -> dict[str | None, float]:
        """As in `Term`: of friction between the yarns."""
        return super().energies() | ({KIND: self._rubbing.stored()} if self._rubbing else {})

    def accept(self) -> None:
        """Keep how far the yarns slid."""
        if self._rubbing:
            self._rubbing.accept()

    def cell_memory(self) -> dict[str, np.ndarray]:
        """Sliding and dissipation at the points of each cell."""
        return {"sliding": self._rubbing.memory()} if self._rubbing else {}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        if self._rubbing:
            self._rubbing.recall(memory["sliding"])

    # --

    def _constants(self, mesh):
        """The fabric, a0 and b0 where they are constant and the cosine of a weave angle that is
        given: entries of one vector, as several would be ordered, and the form compiled anew, by
        their names."""
        straight, fabric, numbers = self.part.straight, self.fabric, self._numbers
        values = [] if numbers is not None else numbers_of(fabric)
        values += [*np.ravel(straight or ())]
        values += [] if self.weave_angle is None else [np.cos(self.weave_angle)]
        entries = iter(fem.Constant(mesh, values) if values else ())
        of_law = entries
        if numbers is not None:
            many = numbers.shape[1]
            function = fem.Function(compat.vector_space(mesh, "DG", 0, many))
            function.x.array.reshape(-1, many)[self.part.cells] = numbers
            of_law = iter(function)
        law = fabric.symbols(lambda _: next(of_law))
        directions = [ufl.as_vector([next(entries) for _ in each]) for each in straight or ()]
        return law, directions, next(entries, None)

    def _numbers_of_cells(self):
        """The numbers of the law in the part's cells (cells, numbers), None if they are the same in
        all."""
        if not (self._warm or self.thickness_field):
            return None
        x, comm = self.blank.centres()[self.part.cells], self.blank.mesh.comm
        numbers = np.tile(numbers_of(self.fabric), (len(x), 1))
        fields: dict[str, Field] = {"temperature": self._warm[1]} if self._warm else {}
        fields |= {"thickness": self.thickness_field} if self.thickness_field else {}
        values = {name: on_all(comm, partial(each.at, x)) for name, each in fields.items()}
        self.fields = {name: (each, x, values[name]) for name, each in fields.items()}
        if self._warm:
            law, at = self._warm[0], values["temperature"]
            on_all(comm, lambda: law.check_temperatures(at) if len(at) else None)
            numbers = law.numbers_at(at)
        numbers[:, -1] = values.get("thickness", numbers[:, -1])
        return numbers

    @cached_property
    def law_of_points(self) -> Law:
        """The fabric, or the law of all quadrature points of the part's cells, each with its own
        numbers."""
        if not self._warm:
            return self.fabric
        many = len(compat.quadrature(self.blank.mesh, self.degree)[1])
        return self.fabric.by_points(np.repeat(self._numbers, many, axis=0))

    def _fibres(self):
        """a0, b0: where they vary, on cells without one tangent plane projected anew at each
        point."""
        mesh = self.blank.mesh
        fibres = self.blank.a0, self.blank.b0
        if mesh.geometry.dim == 2 or compat.is_affine(mesh):
            return fibres
        project = ufl.dot(ufl.Jacobian(mesh), ufl.JacobianInverse(mesh))
        tangent = [ufl.dot(project, f) for f in fibres]
        return [f / ufl.sqrt(ufl.dot(f, f)) for f in tangent]

    @cached_property
    def _points(self):
        """F by columns, the cosine between the yarns, and UFL's S, at all points."""
        law, (fa, fb), cosine, rest = self._ufl
        sine = ufl.sqrt(1 - cosine**2)
        f1, f2 = fa, (fb - cosine * fa) / sine
        C = ufl.as_matrix([[ufl.dot(x, y) for y in (f1, f2)] for x in (f1, f2)])
        # FFCx from 0.9 names code by the variable's number, and would compile each one anew
        C = ufl.classes.Variable(C, ufl.classes.Label(0))
        b = ufl.as_vector([cosine, sine])
        I6, I8 = ufl.dot(ufl.sym(C), b)[0], ufl.dot(b, ufl.dot(C, b))
        S = 2 * ufl.diff(membrane_energy.energy_density(C[0, 0], I6, I8, rest, law), C)
        values = ufl.as_vector([*f1, *f2, cosine, S[0, 0], S[1, 1], S[0, 1]])
        return compat.PointEvaluation(
            values, self.blank.mesh, self.degree, self.part.cells, self._drawn
        )

    def at_points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F (cells, points, 3, 2) on the basis (a0, perpendicular), b0 (cells, points, 2) there and
        UFL's S as 11, 22, 12 (cells, points, 3) [MPa] at each quadrature point of the part's
        cells."""
        u = self.blank.u.x.array
        if self._evaluated is None or not np.array_equal(u, self._evaluated[0]):
            self._evaluated = u.copy(), self._points()
        values = self._evaluated[1]
        gdim = self.blank.mesh.geometry.dim
        F = np.zeros((*values.shape[:2], 3, 2))
        F[:, :, :gdim, 0], F[:, :, :gdim, 1] = values[:, :, :gdim], values[:, :, gdim : 2 * gdim]
        cosine = values[:, :, 2 * gdim]
        return F, np.stack([cosine, np.sqrt(1 - cosine**2)], -1), values[:, :, 2 * gdim + 1 :]

    def state(self) -> tuple[kernel.State, np.ndarray, np.ndarray, float]:
        """`kernel.State` at every quadrature point, arrays (cells, points, ...), the deformed
        fibres fa, fb (cells, points, 3), and the kernel's mismatch on this rank: the largest
        |S_UFL - S_kernel| over max(|S_kernel|, s1), or over 1 MPa for a law without shear."""
        F, b, S_ufl = self.at_points()
        cells, points = F.shape[:2]
        b = b.reshape(-1, 2)
        state = kernel.evaluate(
            self.law_of_points,
            gradient=F.reshape(-1, 3, 2),
            fibres=([1.0, 0.0], b),
            weave_angle=self.weave_angle,
        )
        S = np.stack([state.S[:, 0, 0], state.S[:, 1, 1], state.S[:, 0, 1]], -1)
        difference = np.linalg.norm(S_ufl.reshape(-1, 3) - S, axis=1)
        least = self.fabric.shear_stiffness or 1.0
        mismatch = (difference / np.maximum(np.linalg.norm(S, axis=1), least)).max(initial=0.0)
        arrays = {name: values for name, values in state._asdict().items() if values is not None}
        shaped = {name: v.reshape(cells, points, *v.shape[1:]) for name, v in arrays.items()}
        fb = np.einsum("cqij,cqj->cqi", F, b.reshape(cells, points, 2))
        return state._replace(**shaped), F[..., 0], fb, mismatch

    @property
    def weights(self) -> np.ndarray:
        """Quadrature weights over the points of a cell (points,), summing to one."""
        return self._points.weights / self._points.weights.sum()

    # -- results

    def cell_fields(self) -> dict[str, Value]:
        """Means over the part's cells, (cells,) or (cells, 3).

        a, b: deformed fibres; eps_a, eps_b: nominal, log_eps_11, log_eps_22: logarithmic fibre
        strains; shortening_a, shortening_b: of yarns under compression; shear_angle; I4, I6, I8,
        I10; energy_a, energy_b, energy_shear; strain_state 1..4, eq. (13); sigma_a, sigma_b: Cauchy
        stress along the deformed fibres; shear_friction: shear stress of friction between yarns, if
        there is any; stability_convexity, stability_ellipticity: the smallest indicators of a
        cell's points, 1 at rest and negative where the law itself allows a band, see
        `material.stability`.
        """
        state, fa, fb, _ = self.state()

        def mean(values):
            return np.einsum("q,cq...->c...", self.weights, values)

        I4, I6, I8, I10 = np.moveaxis(state.invariants, -1, 0)
        parts, gamma, short = mean(state.energy_parts), mean(I10), self.shortening()
        fields = {"a": mean(fa), "b": mean(fb)}
        fields |= {"eps_a": mean(np.sqrt(I4) - 1), "eps_b": mean(np.sqrt(I8) - 1)}
        fields |= {"shortening_a": short[:, 0], "shortening_b": short[:, 1]}
        fields |= {"log_eps_11": mean(np.log(I4)) / 2, "log_eps_22": mean(np.log(I8)) / 2}
        fields |= {"shear_angle": gamma, "I4": mean(I4), "I6": mean(I6), "I8": mean(I8)}
        fields |= {"I10": gamma, "energy_a": parts[:, 0], "energy_b": parts[:, 1]}
        fields["energy_shear"] = parts[:, 2]
        fields["strain_state"] = (1 + (fields["eps_b"] <= 0) + 2 * (fields["eps_a"] <= 0)).astype(
            np.int32
        )
        for name, f, I in (("sigma_a", fa, I4), ("sigma_b", fb, I8)):
            fields[name] = mean(np.einsum("cqi,cqij,cqj->cq", f, state.cauchy, f) / I)
        stable = stability.evaluate(self.law_of_points, state.invariants)
        if self._rubbing:
            fields["shear_friction"] = mean(self._rubbing.response().stress)
        fields["stability_convexity"] = stable.convexity.min(1)
        fields["stability_ellipticity"] = stable.ellipticity.min(1)
        return {
            name: on_part(self.part, values, UNITS.get(name, "-"))
            for name, values in fields.items()
        }

    def invariants_at_points(self) -> np.ndarray:
        """I4, I6, I8 and shear angle (cells, points, 4), at a third of the cost of `state`."""
        F, b, _ = self.at_points()
        fa, fb = F[..., 0], F[..., 0] * b[..., :1] + F[..., 1] * b[..., 1:]
        I4, I6, I8 = (np.einsum("cqi,cqi->cq", x, y) for x, y in ((fa, fa), (fa, fb), (fb, fb)))
        weave, cosine, sine = self.weave_angle, b[..., 0], b[..., 1]
        if weave is not None:
            cosine, sine = np.cos(weave), np.sin(weave)
        gamma = shear_angle(I6, np.sqrt(I4 * I8 - I6 * I6), cosine, sine)
        return np.stack([I4, I6, I8, gamma], -1)

    def history(self) -> dict[str, Value]:
        """`min_stability`, the least ellipticity indicator of all points, negative where the law
        itself allows a band. In space also the largest shortening of yarns in a cell, and the share
        of the area in which it is above `SHORTENED`: there it hides wrinkles."""
        comm = self.blank.mesh.comm
        stable = stability.least_ellipticity(self.law_of_points, self.invariants_at_points())
        columns = {"min_stability": least(comm.allreduce(stable, MPI.MIN))}
        if self.blank.mesh.geometry.dim == 3:
            most = self.shortening().max(1)
            columns["shortening_max"] = largest(
                comm.allreduce(float(most.max(initial=0.0)), MPI.MAX)
            )
            columns[share_name(SHORTENED)] = largest(self._share(most > SHORTENED))
        return columns

    def summary(self) -> dict[str, Value]:
        """Material, integration and the kernel's mismatch."""
        mismatch = self.blank.mesh.comm.allreduce(self.state()[3], MPI.MAX)
        facts = {"couplings": sorted(self.fabric.couplings), "material": self.fabric.name}
        by_part = {"parts": joined({self.part.name: facts})}
        return {
            "integration": last(self.integration),
            **({k: last(v) for k, v in facts.items()} if self.part.is_whole else by_part),
            "kernel_mismatch": largest(mismatch),
            "assumed": joined({self.fabric.name: list(self.fabric.assumed_values())}),
        }

    def overstretched(self, strain: float) -> float:
        """Share of the area, 0 to 1, of all ranks, in which the larger mean of a cell's two yarns
        is stretched by more than the nominal `strain`."""
        stretches = np.sqrt(self.invariants_at_points()[..., [0, 2]])
        return self._share(np.einsum("q,cqk->ck", self.weights, stretches).max(1) - 1 > strain)

    def shortening(self) -> np.ndarray:
        """Shortening of both yarns under compression, means over cells (cells, 2): the nominal
        strain, as far as the yarn's stress is what that strain alone gives. Contraction beside
        stretched yarns, free of stress, is not in it."""
        invariants = self.invariants_at_points()
        I4, _, I8, gamma = invariants.reshape(-1, 4).T
        eps_a, eps_b, none = nominal_strain(I4), nominal_strain(I8), 0 * I4

        def stress(a, b, gamma):
            return self.law_of_points.derivatives(a, b, gamma, second=False).first

        now, alone = stress(eps_a, eps_b, gamma), stress(eps_a, none, none)[:1]
        alone = np.concatenate([alone, stress(none, eps_b, none)[1:2]])
        share = np.clip(now[:2] / np.minimum(alone, -1e-300), 0.0, 1.0)
        share[(alone == 0) & (now[:2] <= 0)] = 1.0  # laws that do not resist compression
        short = np.maximum(0.0, -np.stack([eps_a, eps_b])) * share
        return np.einsum("q,kcq->ck", self.weights, short.reshape(2, *invariants.shape[:2]))

    def _share(self, cells):
        """Share of the part's area that lies in `cells` (cells,) of bool, of all ranks."""
        areas = self.blank.areas()[self.part.cells]
        inside, whole = self.blank.mesh.comm.allreduce(np.array([areas[cells].sum(), areas.sum()]))
        return float(inside / whole)
