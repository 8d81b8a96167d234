"""States of a fabric at the points of its membrane, quantities of them, and yarn friction."""

from functools import cached_property
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.core.expr import Expr

from .. import dolfinx_compat as compat
from ..io.field import Field
from ..material import kernel, stability
from ..material.energy import Energy
from ..material.friction import Response, ShearFriction
from ..material.laws import Law
from ..material.strains import SHORTENED, share_name
from ..sheet.part import Part
from . import membrane_energy
from .membrane_energy import Yarns
from .output import Value, joined, largest, last, least, on_part
from .term import Term

KIND = "yarn_friction"  # of energy: in springs, and dissipated up to now


class YarnFriction(Energy):
    """Friction of a fabric's `shear_friction`, integrated over a part by a rule of its own, with
    the sliding of each element at each point.

    It stands in the place of a law in `membrane_energy`: thickness and energy are of UFL constants.
    law: the fabric in such; yarns, rest: as the membrane's; degree: of quadrature.
    """

    law = "friction between yarns"

    def __init__(
        self, part: Part, friction: ShearFriction, law: Law, yarns: Yarns, rest: Expr, degree: int
    ) -> None:
        self.thickness, self._symbols = law.thickness, law.shear_friction
        self._part, self._friction = part, friction
        mesh, count = part.blank.mesh, len(friction.stiffness)
        self._state = fem.Function(compat.quadrature_space(mesh, degree, count + 1))
        # sliding of each element and dissipation at points, of which the part's are `_at`
        self._values = self._state.x.array.reshape(-1, count + 1)
        self._at = compat.dofmap(self._state.function_space)[part.cells]
        self.rules = [(1.0, part.dx(degree))]
        _, _, gamma = membrane_energy.strains(*membrane_energy.invariants(*yarns), rest)
        self._gamma = compat.PointEvaluation(gamma, mesh, degree, part.cells)
        self._energy = compat.form(membrane_energy.energy(yarns, rest, self, self.rules))
        start = np.repeat(self._gamma()[..., None], count + 1, -1)
        start[..., -1] = 0.0
        self._values[self._at] = start

    def energy(self, eps_a: Any, eps_b: Any, gamma: Any) -> tuple[Any, Any, Any]:
        """As of a law: of this step, and dissipated before."""
        *sliding, dissipated = ufl.split(self._state)
        assert self._symbols
        return 0.0, 0.0, self._symbols.energy(gamma, sliding) + dissipated

    def stored(self) -> float:
        """Energy of this rank's cells, elastic and dissipated up to now [N mm]."""
        return fem.assemble_scalar(self._energy)

    def response(self) -> Response:
        """At all points (cells, points), before `accept`."""
        return self._friction.respond(self._gamma(), self._values[self._at][..., :-1])

    def accept(self) -> None:
        now, known = self.response(), self._values[self._at]
        dissipated = known[..., -1:] + now.dissipated[..., None]
        self._values[self._at] = np.concatenate([now.sliding, dissipated], -1)

    def memory(self) -> np.ndarray:
        """Sliding and dissipation, in rows for `Term.cell_memory`."""
        known = self._values[self._at]
        return self._part.rows(known.reshape(-1, known.shape[-1]), known.shape[1])

    def recall(self, rows: np.ndarray) -> None:
        self._values[self._at] = rows[self._part.cells].reshape(*self._at.shape, -1)


class FabricStates(Term):
    """A term of a fabric, and its states at the points at which the energy is integrated.

    - degree: of quadrature; integration, weave_angle: as in `Membrane`

    A subclass also gives `_ufl`, law, fibres, deformed fibres, cosine between fibres and of the
    weave as UFL; `_distance` of points from the cells' centres, over those of the usual rule;
    `_warm` and `_numbers`, if cells have laws of their own; and `_rubbing`, friction between the
    yarns.
    """

    fabric: Law
    integration: str
    weave_angle: float | None
    degree: int
    _ufl: tuple
    _distance: float
    _warm: tuple[Law, Field] | None
    _numbers: np.ndarray | None
    _rubbing: YarnFriction | None = None
    _evaluated: tuple[np.ndarray, np.ndarray] | None = None  # displacements, values at points

    @cached_property
    def law_of_points(self) -> Law:
        """The fabric, or the law of all quadrature points, each with its own numbers."""
        if self._warm is None or self._numbers is None:
            return self.fabric
        many = len(compat.quadrature(self.blank.mesh, self.degree)[1])
        return self.fabric.by_points(np.repeat(self._numbers, many, axis=0))

    @cached_property
    def _points(self):
        """F by columns, cosine of the yarns, S of energy and forces, invariants, strains."""
        law, _, (fa, fb), cosine, rest = self._ufl
        sine = ufl.sqrt(1 - cosine**2)
        f1, f2 = fa, (fb - cosine * fa) / sine
        C = ufl.as_matrix([[ufl.dot(x, y) for y in (f1, f2)] for x in (f1, f2)])
        # FFCx from 0.9 names code by the variable's number, and would recompile each one
        C = ufl.classes.Variable(C, ufl.classes.Label(0))
        a, b = ufl.as_vector([1.0, 0.0]), ufl.as_vector([cosine, sine])
        invariants = C[0, 0], ufl.dot(ufl.sym(C), b)[0], ufl.dot(b, ufl.dot(C, b))
        by_energy = 2 * ufl.diff(membrane_energy.energy_density(*invariants, rest, law), C)
        (W4, W6, W8), _ = membrane_energy.slopes(invariants, rest, law)
        in_forces = 2 * (W4 * ufl.outer(a, a) + W8 * ufl.outer(b, b))
        in_forces += W6 * (ufl.outer(a, b) + ufl.outer(b, a))
        S = [S[place] for S in (by_energy, in_forces) for place in ((0, 0), (1, 1), (0, 1))]
        I = membrane_energy.invariants(fa, fb)
        strains = membrane_energy.strains(*I, rest)
        values = ufl.as_vector([*f1, *f2, cosine, *S, *I, *strains[::-1]])
        return compat.PointEvaluation(
            values, self.blank.mesh, self.degree, self.part.cells, self._distance
        )

    def _values(self):
        """`_points` of the present displacements."""
        u = self.blank.u.x.array
        if self._evaluated is None or not np.array_equal(u, self._evaluated[0]):
            self._evaluated = u.copy(), self._points()
        return self._evaluated[1]

    def at_points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F (cells, points, 3, 2) on the basis (a0, perpendicular), b0 (cells, points, 2) there and
        UFL's S as 11, 22, 12 (cells, points, 2, 3) [MPa] at all quadrature points, by the energy
        and as in the forces."""
        values, gdim = self._values(), self.blank.mesh.geometry.dim
        F = np.zeros((*values.shape[:2], 3, 2))
        F[:, :, :gdim, 0], F[:, :, :gdim, 1] = values[:, :, :gdim], values[:, :, gdim : 2 * gdim]
        cosine, S = values[:, :, 2 * gdim], values[:, :, 2 * gdim + 1 : -6]
        return F, np.stack([cosine, np.sqrt(1 - cosine**2)], -1), S.reshape(*S.shape[:2], 2, 3)

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
        S = state.S[:, [0, 1, 0], [0, 1, 1]]
        difference = np.linalg.norm(S_ufl.reshape(-1, 2, 3) - S[:, None], axis=2).max(1)
        least = self.fabric.shear_stiffness or 1.0
        mismatch = (difference / np.maximum(np.linalg.norm(S, axis=1), least)).max(initial=0.0)
        arrays = {name: v for name, v in state._asdict().items() if v is not None}
        shaped = {name: v.reshape(cells, points, *v.shape[1:]) for name, v in arrays.items()}
        fb = np.einsum("cqij,cqj->cqi", F, b.reshape(cells, points, 2))
        return state._replace(**shaped), F[..., 0], fb, mismatch

    @property
    def weights(self) -> np.ndarray:
        """Quadrature weights over the points of a cell (points,), summing to one."""
        return self._points.weights / self._points.weights.sum()

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
        eps_a, eps_b = mean(np.sqrt(I4) - 1), mean(np.sqrt(I8) - 1)
        stable = stability.evaluate(self.law_of_points, state.invariants)
        fields = {
            "-": {
                **{"a": mean(fa), "b": mean(fb), "eps_a": eps_a, "eps_b": eps_b},
                **{"shortening_a": short[:, 0], "shortening_b": short[:, 1]},
                **{"log_eps_11": mean(np.log(I4)) / 2, "log_eps_22": mean(np.log(I8)) / 2},
                **{"I4": mean(I4), "I6": mean(I6), "I8": mean(I8)},
                "strain_state": (1 + (eps_b <= 0) + 2 * (eps_a <= 0)).astype(np.int32),
                "stability_convexity": stable.convexity.min(1),
                "stability_ellipticity": stable.ellipticity.min(1),
            },
            "rad": {"shear_angle": gamma, "I10": gamma},
            "N mm/mm^3": dict(zip(("energy_a", "energy_b", "energy_shear"), parts.T)),
            "MPa": {
                f"sigma_{name}": mean(np.einsum("cqi,cqij,cqj->cq", f, state.cauchy, f) / I)
                for name, f, I in (("a", fa, I4), ("b", fb, I8))
            },
        }
        if self._rubbing:
            fields["MPa"]["shear_friction"] = mean(self._rubbing.response().stress)
        return {
            name: on_part(self.part, values, unit)
            for unit, group in fields.items()
            for name, values in group.items()
        }

    def invariants_at_points(self) -> np.ndarray:
        """I4, I6, I8 and shear angle (cells, points, 4), at a third of the cost of `state`."""
        return self._values()[..., -6:-2]

    def strains_at_points(self) -> np.ndarray:
        """eps_a, eps_b and shear angle (3, cells, points)."""
        return np.moveaxis(self._values()[..., :-4:-1], -1, 0)

    def history(self) -> dict[str, Value]:
        """`min_stability`, the least ellipticity indicator of all points, negative where the law
        itself allows a band. In space also the largest shortening of yarns in a cell, and the share
        of the area in which it is above `SHORTENED`: there it hides wrinkles."""
        comm = self.blank.mesh.comm
        stable = stability.least_ellipticity(self.law_of_points, self.invariants_at_points())
        columns = {"min_stability": least(comm.allreduce(stable, MPI.MIN))}
        if self.blank.mesh.geometry.dim == 3:
            most = self.shortening().max(1)
            of_all = comm.allreduce(float(most.max(initial=0.0)), MPI.MAX)
            columns["shortening_max"] = largest(of_all)
            columns[share_name(SHORTENED)] = largest(self.share_of(most > SHORTENED))
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
        """Share of the area, 0 to 1, in whose cells a yarn is stretched by more than `strain`."""
        strains = self.strains_at_points()[:2] @ self.weights
        return self.share_of(strains.max(0) > strain)

    def shortening(self) -> np.ndarray:
        """Shortening of both yarns under compression, means over cells (cells, 2): the nominal
        strain, as far as the yarn's stress is what that strain alone gives. Contraction beside
        stretched yarns, free of stress, is not in it."""
        strains = self.strains_at_points()
        eps_a, eps_b, gamma, none = *strains.reshape(3, -1), np.zeros(strains[0].size)

        def stress(a, b, gamma):
            return self.law_of_points.derivatives(a, b, gamma, second=False).first

        now = stress(eps_a, eps_b, gamma)
        alone = np.stack([stress(eps_a, none, none)[0], stress(none, eps_b, none)[1]])
        share = np.clip(now[:2] / np.minimum(alone, -1e-300), 0.0, 1.0)
        share[(alone == 0) & (now[:2] <= 0)] = 1.0  # laws that do not resist compression
        short = np.maximum(0.0, -np.stack([eps_a, eps_b])) * share
        return (short.reshape(strains[:2].shape) @ self.weights).T

    def share_of(self, cells: np.ndarray) -> float:
        """Share of the part's area that lies in `cells` (cells,) of bool, of all ranks."""
        areas = self.blank.areas()[self.part.cells]
        inside, whole = self.blank.mesh.comm.allreduce(np.array([areas[cells].sum(), areas.sum()]))
        return float(inside / whole)
