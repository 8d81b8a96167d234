"""The membrane: in-plane strain energy of a blank."""

from itertools import combinations_with_replacement, count

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from .. import dolfinx_compat as compat
from ..blank import Blank
from ..errors import InputError
from ..material import pointwise
from ..material.baseline import Fabric
from ..material.energy import derivatives, energy_density, nominal_strain, shear_angle

# Points enough for the energy's leading terms; P1 triangles have one strain a cell. The degree that UFL estimates
# for this energy would take thousands of points.
QUADRATURE_DEGREE = {
    ("triangle", 1): 1, ("triangle", 2): 2, ("triangle", 3): 4, ("quadrilateral", 1): 2, ("quadrilateral", 2): 4,
}  # fmt: skip


INTEGRATION = "full", "reduced"
GRADIENTS = 0.0125  # of the yarns' stiffness, that holds their strain's gradients where it is taken at one point
STRAIN = 1e-3  # at which that stiffness is taken


class Membrane:
    """Strain energy W(I4, I6, I8) t of `fabric` over the undeformed `blank`, eq. (30) with eqs (5)-(7).

    Material values enter as constants of the form, so fabrics that differ only in numbers share one compiled form.
    quadrature_degree: by default that of `QUADRATURE_DEGREE`. `energy`: the UFL form [N mm].

    integration: `reduced`, on plane quadratic triangles with straight sides, takes the law at the centre of each: two yarns
    that hardly stretch then are two constraints on a cell's four degrees of freedom, so cells that do not follow the yarns
    do not lock (reduced integration as projected strains: Malkus and Hughes, Comput. Methods Appl. Mech. Eng. 15, 1978;
    locking of fibres: ten Thije and Akkerman, Composites A 39, 2008; Hamila and Boisse, Composites A 53, 2013). What the
    centre does not see, gradients of strains and shear angle, is held by `GRADIENTS` of the yarns' stiffness and by the
    shear stiffness at rest (as Liu, Ong and Uras, Comput. Methods Appl. Mech. Eng. 53, 1985, hold hourglasses), so that no
    mode of a cell is free. Points and states are then those at the centres.

    weave_angle: angle between the yarns of the weave without shear [rad], from which the shear angle counts; by default
    the initial one of the blank, as in eq. (8). With another the blank is not free of stress as it lies.

    Raises InputError for an element that is not listed in `QUADRATURE_DEGREE`, or that `reduced` is not for, and for a
    weave_angle that is not above 0 and below pi.
    """

    name = "membrane"
    energy_kind = "strain"

    def __init__(
        self,
        blank: Blank,
        fabric: Fabric,
        quadrature_degree: int | None = None,
        integration: str = "full",
        weave_angle: float | None = None,
    ) -> None:
        self.blank, self.fabric, self.integration = blank, fabric, integration
        mesh = blank.mesh
        cell = compat.cell_name(mesh)
        if (cell, blank.degree) not in QUADRATURE_DEGREE:
            allowed = ", ".join(f"{degree} on {kind}s" for kind, degree in QUADRATURE_DEGREE)
            raise InputError(f"{blank.name} is of degree {blank.degree} on {cell}s; allowed is {allowed}")
        self.degree = quadrature_degree or QUADRATURE_DEGREE[cell, blank.degree]
        law = self._law(mesh, fabric)
        self._a0, self._b0 = self._fibres()
        fa, fb = (f + df for f, df in zip((self._a0, self._b0), self._stretched(blank.u)))
        cosine = ufl.dot(self._a0, self._b0) if not blank.orthogonal else ufl.as_ufl(0.0)
        self.weave_angle, rest = weave_angle, cosine
        if weave_angle is not None:
            rest = fem.Constant(mesh, np.cos(pointwise.check_weave_angle(weave_angle)))
        self._invariants = ufl.dot(fa, fa), ufl.dot(fa, fb), ufl.dot(fb, fb)
        self._ufl = law, fa, fb, cosine, rest
        if integration != "full":
            self._check_reduced(cell)
            self.degree = 1
        self._dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": self.degree})
        self._gradients = self._held_gradients() * self._dx if integration == "reduced" else None
        self.energy = law.thickness * energy_density(*self._invariants, rest, law) * self._dx
        if self._gradients:
            self.energy += self._gradients
        self._points: compat.PointEvaluation | None = None

    def _check_reduced(self, cell):
        blank = self.blank
        if self.integration not in INTEGRATION:
            raise InputError(f"integration is {self.integration!r}; allowed are {', '.join(INTEGRATION)}")
        if (cell, blank.degree) != ("triangle", 2) or not compat.is_affine(blank.mesh) or blank.mesh.geometry.dim == 3:
            raise InputError(
                f"integration is reduced and {blank.name} of degree {blank.degree} on {cell}s; allowed is a plane sheet of quadratic displacements (P2) on triangles with straight sides"
            )

    def _held_gradients(self):
        """Energy density of the gradients of strains and shear angle, as stiffness times their variance in the cell."""
        mesh, (law, fa, fb, _, rest) = self.blank.mesh, self._ufl
        pulled = (1 + STRAIN) * np.eye(3)[:, :2]
        state = pointwise.evaluate(self.fabric.decoupled(), gradient=[pulled], fibres=np.eye(2)[:, None])
        yarns = GRADIENTS * state.energy_parts[0, :2] / STRAIN**2
        stiffness = fem.Constant(mesh, [*yarns, self.fabric.s1 / 2])
        curved = ufl.grad(ufl.grad(self.blank.displacement))
        i, j, k = ufl.indices(3)
        bent = [ufl.as_tensor(curved[i, j, k] * f[j], (i, k)) for f in (self._a0, self._b0)]  # gradients of fa and fb
        I4, I6, I8 = invariants = [ufl.variable(I) for I in self._invariants]
        slopes = 2 * ufl.dot(fa, bent[0]), ufl.dot(fa, bent[1]) + ufl.dot(fb, bent[0]), 2 * ufl.dot(fb, bent[1])
        J = ufl.Jacobian(mesh)
        spread = ufl.dot(J, ufl.dot(ufl.as_matrix([[2.0, -1.0], [-1.0, 2.0]]) / 36, J.T))  # mean of (x - x_c) (x - x_c)
        energy = 0
        for n, q in enumerate((nominal_strain(I4), nominal_strain(I8), shear_angle(I4, I6, I8, rest))):
            slope = sum(ufl.diff(q, I) * dI for I, dI in zip(invariants, slopes))
            energy += stiffness[n] * ufl.dot(slope, ufl.dot(spread, slope))
        return law.thickness * energy

    def variations(self, v: Expr, w: Expr) -> tuple[ufl.Form, ufl.Form]:
        """First variation of `energy` in `v` and second in `v` and `w` (UFL arguments in the space of `blank.u`)."""
        law, fa, fb, _, rest = self._ufl
        first, second = derivatives(*self._invariants, rest, law)
        (S4, S6, S8), *second = ([law.thickness * D for D in row] for row in (first, *second))
        gdim = len(fa)
        # how each component of fa and fb moves the invariants
        moved = [[2 * fa[i], fb[i], 0] for i in range(gdim)] + [[0, fa[i], 2 * fb[i]] for i in range(gdim)]
        forces = [sum(S * c for S, c in zip((S4, S6, S8), row)) for row in moved]
        pulled = [[sum(c * D for c, D in zip(row, column)) for column in second] for row in moved]
        stiffness = [[None] * 2 * gdim for _ in range(2 * gdim)]
        for i, j in combinations_with_replacement(range(2 * gdim), 2):
            geometric = [2 * S4, S6, 2 * S8][i // gdim + j // gdim] if i % gdim == j % gdim else 0
            stiffness[i][j] = stiffness[j][i] = sum(c * D for c, D in zip(moved[j], pulled[i])) + geometric
        dv, dw = ([yarn[i] for yarn in self._stretched(x) for i in range(gdim)] for x in (v, w))
        answers = (sum(k * y for k, y in zip(row, dw)) for row in stiffness)
        residual = sum(f * x for f, x in zip(forces, dv)) * self._dx
        tangent = sum(x * y for x, y in zip(dv, answers)) * self._dx
        if self._gradients:
            slope = ufl.derivative(self._gradients, self.blank.u, v)
            residual, tangent = residual + slope, tangent + ufl.derivative(slope, self.blank.u, w)
        return residual, tangent

    def _stretched(self, u):
        """What displacement `u` adds to the yarns' vectors a0, b0."""
        gradient = ufl.grad(self.blank.in_space(u))
        return ufl.dot(gradient, self._a0), ufl.dot(gradient, self._b0)

    @staticmethod
    def _law(mesh, fabric):
        """`fabric` in entries of one vector constant: many would be ordered, and the form compiled, by their names."""
        numbers: list[float] = []
        index = count()
        fabric.symbols(numbers.append)
        values = fem.Constant(mesh, numbers)
        return fabric.symbols(lambda _: values[next(index)])

    def _fibres(self):
        """a0, b0: constants where they are, on cells without one tangent plane projected anew at each point."""
        mesh = self.blank.mesh
        if self.blank.straight:
            return [fem.Constant(mesh, direction) for direction in self.blank.straight]
        fibres = self.blank.a0, self.blank.b0
        if mesh.geometry.dim == 2 or compat.is_affine(mesh):
            return fibres
        project = ufl.dot(ufl.Jacobian(mesh), ufl.JacobianInverse(mesh))
        tangent = [ufl.dot(project, f) for f in fibres]
        return [f / ufl.sqrt(ufl.dot(f, f)) for f in tangent]

    def at_points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F (cells, points, 3, 2) on the basis (a0, perpendicular), b0 (cells, points, 2) there and UFL's S as 11, 22,
        12 (cells, points, 3) [MPa] at each quadrature point of the owned cells."""
        if self._points is None:
            law, fa, fb, cosine, rest = self._ufl
            sine = ufl.sqrt(1 - cosine**2)
            f1, f2 = fa, (fb - cosine * fa) / sine
            C = ufl.variable(ufl.as_matrix([[ufl.dot(f1, f1), ufl.dot(f1, f2)], [ufl.dot(f2, f1), ufl.dot(f2, f2)]]))
            b = ufl.as_vector([cosine, sine])
            W = energy_density(C[0, 0], ufl.dot(ufl.sym(C), b)[0], ufl.dot(b, ufl.dot(C, b)), rest, law)
            S = 2 * ufl.diff(W, C)
            flat = [f1[i] for i in range(f1.ufl_shape[0])] + [f2[i] for i in range(f1.ufl_shape[0])]
            values = ufl.as_vector([*flat, cosine, S[0, 0], S[1, 1], S[0, 1]])
            self._points = compat.PointEvaluation(values, self.blank.mesh, self.degree)
        values = self._points()
        gdim = self.blank.mesh.geometry.dim
        F = np.zeros((*values.shape[:2], 3, 2))
        F[:, :, :gdim, 0], F[:, :, :gdim, 1] = values[:, :, :gdim], values[:, :, gdim : 2 * gdim]
        cosine = values[:, :, 2 * gdim]
        return F, np.stack([cosine, np.sqrt(1 - cosine**2)], -1), values[:, :, 2 * gdim + 1 :]

    def state(self) -> tuple[pointwise.State, np.ndarray, np.ndarray, float]:
        """`pointwise.State` at every quadrature point of the owned cells, arrays (cells, points, ...), with the
        deformed fibres fa, fb (cells, points, 3) and the kernel's mismatch on this rank.

        Mismatch: largest |S_UFL - S_kernel| over max(|S_kernel|, s1), the smallest stiffness of the law.
        """
        F, b, S_ufl = self.at_points()
        cells, points = F.shape[:2]
        b = b.reshape(-1, 2)
        state = pointwise.evaluate(
            self.fabric,
            gradient=F.reshape(-1, 3, 2),
            fibres=([1.0, 0.0], b),
            weave_angle=self.weave_angle,
        )
        S = np.stack([state.S[:, 0, 0], state.S[:, 1, 1], state.S[:, 0, 1]], -1)
        difference = np.linalg.norm(S_ufl.reshape(-1, 3) - S, axis=1)
        mismatch = (difference / np.maximum(np.linalg.norm(S, axis=1), self.fabric.s1)).max(initial=0.0)
        shaped = state._replace(
            **{k: v.reshape(cells, points, *v.shape[1:]) for k, v in state._asdict().items() if v is not None}
        )
        fa = F[:, :, :, 0]
        fb = np.einsum("cqij,cqj->cqi", F, b.reshape(cells, points, 2))
        return shaped, fa, fb, mismatch

    @property
    def weights(self) -> np.ndarray:
        """Quadrature weights over the points of a cell (points,), summing to one."""
        if not self._points:
            self.at_points()
        assert self._points
        return self._points.weights / self._points.weights.sum()
