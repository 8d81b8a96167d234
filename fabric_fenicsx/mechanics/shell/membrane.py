"""The membrane: in-plane strain energy of a blank."""

from itertools import combinations_with_replacement

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.core.expr import Expr

from ... import dolfinx_compat as compat
from ...material import kernel, stability
from ...material.expression import derivatives, energy_density
from ...material.laws import Law
from ...material.presets import checked_fabric
from ...material.strains import SHORTENED, nominal_strain, share_name
from ...runtime.errors import InputError
from ...runtime.rules import COUNT
from ..output import Value, joined, largest, last, least, on_part
from ..term import SceneFacts, Term
from .mesh_warnings import band_warning, locking_warning
from .range_warning import range_warnings

# Points enough for the energy's leading terms; P1 triangles have one strain a cell. The degree that
# UFL estimates for this energy would take thousands of points.
QUADRATURE_DEGREE = {
    ("triangle", 1): 1,
    ("triangle", 2): 2,
    ("triangle", 3): 4,
    ("quadrilateral", 1): 2,
    ("quadrilateral", 2): 4,
}
INTEGRATION = "full", "inner"
# Of `inner`: how far its points lie from a cell's centre, over how far those of `full` do; and the
# share of the energy that stays at those of `full`. If either is larger, strips with yarns at
# 20 deg are too stiff; if smaller, strips with yarns at 10 and 30 deg are too soft.
INNER, OUTER_SHARE = 0.5, 0.01
UNITS = {"shear_angle": "rad", "I10": "rad", "sigma_a": "MPa", "sigma_b": "MPa"} | dict.fromkeys(
    ("energy_a", "energy_b", "energy_shear"), "N mm/mm^3"
)  # of fields; of all others "-"


class Membrane(Term):
    """Strain energy W(I4, I6, I8) t of `fabric` over the undeformed sheet: eqs (5)-(7), (30).

    Material values enter as constants of the form, so fabrics that differ only in numbers share one
    compiled form. quadrature_degree: by default that of `QUADRATURE_DEGREE`.

    integration: `inner`, on quadratic triangles with straight sides, takes nearly all of the energy
    at three points that are nearer to a cell's centre than those of `full`, by the factor `INNER`.
    They see the gradients of strains times that factor, so yarns in tension resist these less, and
    cells that do not follow the yarns do not lock (reduced integration as projected strains: Malkus
    and Hughes, Comput. Methods Appl. Mech. Eng. 15, 1978; locking of fibres: ten Thije and
    Akkerman, Composites A 39, 2008; Hamila and Boisse, Composites A 53, 2013). `OUTER_SHARE` of the
    energy stays at the points of `full`, so that no corner of a cell turns over unseen. Where
    stretched yarns end at a free edge it is too soft by a part of a row of cells.

    weave_angle: angle between the yarns of the weave without shear [rad], from which the shear
    angle counts. The default is the initial angle of the blank, as in eq. (8). With any other the
    blank has stress as it lies.

    Raises InputError for a weave_angle that is not above 0 and below pi, and in a scene for an
    element that is not listed in `QUADRATURE_DEGREE`, or that `inner` is not for, and for a law
    with energy or stress at rest.
    """

    name, energy_kind = "membrane", "strain"

    def __init__(
        self,
        fabric: Law,
        quadrature_degree: int | None = None,
        integration: str = "full",
        weave_angle: float | None = None,
    ) -> None:
        if integration not in INTEGRATION:
            raise InputError(
                f"integration is {integration!r}; allowed are {', '.join(INTEGRATION)}"
            )
        self.fabric, self.integration = checked_fabric("fabric of a membrane", fabric), integration
        self.weave_angle = None if weave_angle is None else kernel.check_weave_angle(weave_angle)
        self.prestressed = weave_angle is not None
        if quadrature_degree is not None:
            quadrature_degree = COUNT.check("`quadrature_degree`", quadrature_degree)
        self._quadrature_degree = quadrature_degree
        self._points: compat.PointEvaluation | None = None
        # displacements, values at points
        self._evaluated: tuple[np.ndarray, np.ndarray] | None = None

    def set_up(self, scene: SceneFacts) -> None:
        """As in `Term`."""
        blank, mesh = scene.blank, scene.blank.mesh
        self.fabric.check_rest()
        cell = compat.cell_name(mesh)
        if (cell, blank.degree) not in QUADRATURE_DEGREE:
            allowed = ", ".join(f"{degree} on {kind}s" for kind, degree in QUADRATURE_DEGREE)
            raise InputError(
                f"{blank.name} is of degree {blank.degree} on {cell}s; allowed is {allowed}"
            )
        self.degree = self._quadrature_degree or QUADRATURE_DEGREE[cell, blank.degree]
        if self.integration == "inner" and not (blank.degree == 2 and blank.triangulated):
            raise InputError(
                f"integration is inner and {blank.name} of degree {blank.degree} on {cell}s; "
                "allowed is a sheet of quadratic triangles (P2) with straight sides"
            )
        law, straight, rest = self._constants(mesh)
        self._a0, self._b0 = straight or self._fibres()
        fa, fb = (f + df for f, df in zip((self._a0, self._b0), self._stretched(blank.u)))
        cosine = ufl.dot(self._a0, self._b0) if not self.part.orthogonal else ufl.as_ufl(0.0)
        rest = cosine if rest is None else rest
        self._invariants = ufl.dot(fa, fa), ufl.dot(fa, fb), ufl.dot(fb, fb)
        self._ufl = law, fa, fb, cosine, rest
        self._drawn = INNER if self.integration == "inner" else 1.0
        dx = self.part.dx(self.degree, self._drawn)
        # shares of the energy, and how they are integrated
        self._rules = [(1.0, dx)]
        if self.integration == "inner":
            self._rules = [(1 - OUTER_SHARE, dx), (OUTER_SHARE, self.part.dx(self.degree))]
        density = law.thickness * energy_density(*self._invariants, rest, law)
        self.energy = sum(share * density * dx for share, dx in self._rules)

    @property
    def made_of(self) -> Law:
        """The fabric."""
        return self.fabric

    def variations(self, v: Expr, w: Expr) -> tuple[ufl.Form, ufl.Form]:
        """As in `Varied`, with fewer operations than UFL's own derivatives take."""
        law, fa, fb, _, rest = self._ufl
        first, second = derivatives(*self._invariants, rest, law)
        (S4, S6, S8), *second = ([law.thickness * D for D in row] for row in (first, *second))
        gdim = len(fa)
        # how each component of fa and fb moves the invariants
        moved = [[2 * fa[i], fb[i], 0] for i in range(gdim)] + [
            [0, fa[i], 2 * fb[i]] for i in range(gdim)
        ]
        forces = [sum(S * c for S, c in zip((S4, S6, S8), row)) for row in moved]
        pulled = [[sum(c * D for c, D in zip(row, column)) for column in second] for row in moved]
        stiffness = [[None] * 2 * gdim for _ in range(2 * gdim)]
        for i, j in combinations_with_replacement(range(2 * gdim), 2):
            geometric = [2 * S4, S6, 2 * S8][i // gdim + j // gdim] if i % gdim == j % gdim else 0
            stiffness[i][j] = stiffness[j][i] = (
                sum(c * D for c, D in zip(moved[j], pulled[i])) + geometric
            )
        dv, dw = ([yarn[i] for yarn in self._stretched(x) for i in range(gdim)] for x in (v, w))
        answers = [sum(k * y for k, y in zip(row, dw)) for row in stiffness]
        once, twice = (sum(x * y for x, y in zip(dv, each)) for each in (forces, answers))
        return (
            sum(share * once * dx for share, dx in self._rules),
            sum(share * twice * dx for share, dx in self._rules),
        )

    def _stretched(self, u):
        """What displacement `u` adds to the yarns' vectors a0, b0."""
        gradient = ufl.grad(self.blank.in_space(u))
        return ufl.dot(gradient, self._a0), ufl.dot(gradient, self._b0)

    def _constants(self, mesh):
        """The fabric, a0 and b0 where they are constant and the cosine of a weave angle that is
        given: entries of one vector, as several would be ordered, and the form compiled anew, by
        their names."""
        straight, fabric = self.part.straight, self.fabric
        numbers: list[float] = []
        fabric.symbols(numbers.append)
        known = [*numbers, *np.ravel(straight or ())]
        known += [] if self.weave_angle is None else [np.cos(self.weave_angle)]
        entries = iter(fem.Constant(mesh, known))
        law = fabric.symbols(lambda _: next(entries))
        directions = [ufl.as_vector([next(entries) for _ in each]) for each in straight or ()]
        return law, directions, next(entries, None)

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

    def at_points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F (cells, points, 3, 2) on the basis (a0, perpendicular), b0 (cells, points, 2) there and
        UFL's S as 11, 22, 12 (cells, points, 3) [MPa] at each quadrature point of the part's
        cells."""
        if self._points is None:
            law, fa, fb, cosine, rest = self._ufl
            sine = ufl.sqrt(1 - cosine**2)
            f1, f2 = fa, (fb - cosine * fa) / sine
            C = ufl.as_matrix(
                [[ufl.dot(f1, f1), ufl.dot(f1, f2)], [ufl.dot(f2, f1), ufl.dot(f2, f2)]]
            )
            # FFCx from 0.9 names code by the variable's number, and would compile each one anew
            C = ufl.classes.Variable(C, ufl.classes.Label(0))
            b = ufl.as_vector([cosine, sine])
            W = energy_density(
                C[0, 0], ufl.dot(ufl.sym(C), b)[0], ufl.dot(b, ufl.dot(C, b)), rest, law
            )
            S = 2 * ufl.diff(W, C)
            flat = [f1[i] for i in range(f1.ufl_shape[0])] + [f2[i] for i in range(f1.ufl_shape[0])]
            values = ufl.as_vector([*flat, cosine, S[0, 0], S[1, 1], S[0, 1]])
            self._points = compat.PointEvaluation(
                values, self.blank.mesh, self.degree, self.part.cells, self._drawn
            )
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
        """`kernel.State` at every quadrature point of the part's cells, arrays (cells, points,
        ...), with the deformed fibres fa, fb (cells, points, 3) and the kernel's mismatch on this
        rank.

        Mismatch: largest |S_UFL - S_kernel| over max(|S_kernel|, s1), the smallest stiffness of the
        law, or 1 MPa if it does not resist shear.
        """
        F, b, S_ufl = self.at_points()
        cells, points = F.shape[:2]
        b = b.reshape(-1, 2)
        state = kernel.evaluate(
            self.fabric,
            gradient=F.reshape(-1, 3, 2),
            fibres=([1.0, 0.0], b),
            weave_angle=self.weave_angle,
        )
        S = np.stack([state.S[:, 0, 0], state.S[:, 1, 1], state.S[:, 0, 1]], -1)
        difference = np.linalg.norm(S_ufl.reshape(-1, 3) - S, axis=1)
        least = self.fabric.shear_stiffness or 1.0
        mismatch = (difference / np.maximum(np.linalg.norm(S, axis=1), least)).max(initial=0.0)
        shaped = state._replace(
            **{
                k: v.reshape(cells, points, *v.shape[1:])
                for k, v in state._asdict().items()
                if v is not None
            }
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

    # -- results

    def cell_fields(self) -> dict[str, Value]:
        """Means over the part's cells, (cells,) or (cells, 3).

        a, b: deformed fibres; eps_a, eps_b: nominal, log_eps_11, log_eps_22: logarithmic fibre
        strains; shortening_a, shortening_b: of yarns under compression; shear_angle; I4, I6, I8,
        I10; energy_a, energy_b, energy_shear; strain_state 1..4, eq. (13); sigma_a, sigma_b: Cauchy
        stress along the deformed fibres; stability_convexity, stability_ellipticity: the smallest
        indicators of a cell's points, 1 at rest and negative where the law itself allows a band,
        see `material.stability`.
        """
        state, fa, fb, _ = self.state()

        def mean(values):
            return np.einsum("q,cq...->c...", self.weights, values)

        I4, I6, I8, I10 = np.moveaxis(state.invariants, -1, 0)
        parts = mean(state.energy_parts)
        found = {"a": mean(fa), "b": mean(fb)}
        found |= {"eps_a": mean(np.sqrt(I4) - 1), "eps_b": mean(np.sqrt(I8) - 1)}
        found |= dict(zip(("shortening_a", "shortening_b"), self.shortening().T))
        found |= {
            "log_eps_11": mean(np.log(I4)) / 2,
            "log_eps_22": mean(np.log(I8)) / 2,
            "shear_angle": mean(I10),
        }
        found |= {"I4": mean(I4), "I6": mean(I6), "I8": mean(I8), "I10": found["shear_angle"]}
        found |= {"energy_a": parts[:, 0], "energy_b": parts[:, 1], "energy_shear": parts[:, 2]}
        found["strain_state"] = (1 + (found["eps_b"] <= 0) + 2 * (found["eps_a"] <= 0)).astype(
            np.int32
        )
        for name, f, I in (("sigma_a", fa, I4), ("sigma_b", fb, I8)):
            found[name] = mean(np.einsum("cqi,cqij,cqj->cq", f, state.cauchy, f) / I)
        stable = stability.evaluate(self.fabric, state.invariants)
        found["stability_convexity"] = stable.convexity.min(1)
        found["stability_ellipticity"] = stable.ellipticity.min(1)
        return {
            name: on_part(self.part, values, UNITS.get(name, "-")) for name, values in found.items()
        }

    def _invariants_at_points(self):
        """I4, I6, I8 (cells, points) and shear angle, at a third of the cost of `state`."""
        F, b, _ = self.at_points()
        fa, fb = F[..., 0], F[..., 0] * b[..., :1] + F[..., 1] * b[..., 1:]
        I4, I6, I8 = (np.einsum("cqi,cqi->cq", x, y) for x, y in ((fa, fa), (fa, fb), (fb, fb)))
        gamma = np.arctan2(I6, np.sqrt(I4 * I8 - I6 * I6))
        if self.weave_angle is None:
            gamma -= np.arctan2(b[..., 0], b[..., 1])
        else:
            gamma -= np.pi / 2 - self.weave_angle
        return np.stack([I4, I6, I8, gamma], -1)

    def history(self) -> dict[str, Value]:
        """`min_stability`, the least ellipticity indicator of all points: a band is the material's
        only where it is negative, see `material.stability`. In space, where shortening hides
        wrinkles, also the largest shortening of yarns in a cell, and the share of the part's area
        in which it is more than `SHORTENED`."""
        comm = self.blank.mesh.comm
        stable = stability.least_ellipticity(self.fabric, self._invariants_at_points())
        found = {"min_stability": least(comm.allreduce(stable, MPI.MIN))}
        if self.blank.mesh.geometry.dim == 3:
            most = self.shortening().max(1)
            found["shortening_max"] = largest(comm.allreduce(float(most.max(initial=0.0)), MPI.MAX))
            found[share_name(SHORTENED)] = largest(self._share(most > SHORTENED))
        return found

    def summary(self) -> dict[str, Value]:
        """What the sheet is made of and how it is integrated, and the kernel's mismatch."""
        mismatch = self.blank.mesh.comm.allreduce(self.state()[3], MPI.MAX)
        known = {"couplings": sorted(self.fabric.couplings), "material": self.fabric.name}
        by_part = {"parts": joined({self.part.name: known})}
        return {
            "integration": last(self.integration),
            **({k: last(v) for k, v in known.items()} if self.part.is_whole else by_part),
            "kernel_mismatch": largest(mismatch),
            "assumed": joined({self.fabric.name: list(self.fabric.assumed_values())}),
        }

    def overstretched(self, strain: float) -> float:
        """As in `Strained`, by the larger mean of a cell's two yarns."""
        stretches = np.sqrt(self._invariants_at_points()[..., [0, 2]])
        return self._share(np.einsum("q,cqk->ck", self.weights, stretches).max(1) - 1 > strain)

    def shortened(self, strain: float) -> float:
        """As in `Strained`, by the larger mean of a cell's two yarns."""
        return self._share(self.shortening().max(1) > strain)

    def shortening(self) -> np.ndarray:
        """How much both yarns are shortened under compression, means over the part's cells (cells,
        2): the nominal strain, as far as the yarn's stress is what that strain alone gives. What
        yarns contract beside stretched ones, free of stress, is not in it."""
        invariants = self._invariants_at_points()
        I4, _, I8, gamma = invariants.reshape(-1, 4).T
        eps_a, eps_b, none = nominal_strain(I4), nominal_strain(I8), 0 * I4

        def stress(a, b, gamma):
            return self.fabric.derivatives(a, b, gamma, second=False).first

        now, alone = stress(eps_a, eps_b, gamma), stress(eps_a, none, none)[:1]
        alone = np.concatenate([alone, stress(none, eps_b, none)[1:2]])
        share = np.clip(now[:2] / np.minimum(alone, -1e-300), 0.0, 1.0)
        share[(alone == 0) & (now[:2] <= 0)] = 1.0  # laws that do not resist compression
        found = np.maximum(0.0, -np.stack([eps_a, eps_b])) * share
        return np.einsum("q,kcq->ck", self.weights, found.reshape(2, *invariants.shape[:2]))

    def _share(self, cells):
        """Share of the part's area that lies in `cells` (cells,) of bool, of all ranks."""
        areas = self.blank.areas()[self.part.cells]
        inside, whole = self.blank.mesh.comm.allreduce(np.array([areas[cells].sum(), areas.sum()]))
        return float(inside / whole)

    def warnings(self) -> list[str]:
        """As in `GivesOutput`: cells that lock, bands, and strains beyond the law's ranges."""
        found = locking_warning(self), band_warning(self), *range_warnings(self)
        return [text for text in found if text]

    def strains_at_points(self) -> np.ndarray:
        """Nominal strains along a and b [-] and the shear angle [rad] at each quadrature point of
        the part's cells, (3, cells, points)."""
        I4, _, I8, gamma = np.moveaxis(self._invariants_at_points(), -1, 0)
        return np.stack([nominal_strain(I4), nominal_strain(I8), gamma])

    def least_ellipticity(self) -> np.ndarray:
        """The least ellipticity indicator of each of the part's cells, (cells,) [-]."""
        found = stability.evaluate(self.fabric, self._invariants_at_points())
        return found.ellipticity.min(1)
