"""The scene's tangent matrix and its factors."""

import numpy as np
from petsc4py import PETSc

from ..runtime.timing import phase
from ..scene.scene import Scene
from .linear import (
    KSP_WORDS,
    NOT_DEFINITE,
    PREFIX,
    check_name,
    configure,
    factorisation_had_room,
    inertia,
    subtract_compliances,
)
from .report import Report
from .termination import End, SolveFailed


class Tangent:
    """The second derivative of a scene's energy, A [N/mm], and the linear solver of that name.

    MUMPS keeps its symbolic factorisation. Only `mumps-cholesky` tells negative pivots: a matrix
    that has some is shifted along its diagonal until it has none. PETSc's own options of linear
    solvers, as -fabric_ksp_view, have the prefix `fabric_`.

    negative_pivots_met: whether any matrix so far had some; shift: the last one. Both are kept in
    checkpoints, as the next solve begins with them. Raises InputError for an unknown solver.
    """

    ATTEMPTS = 20  # shifts of one matrix, at most
    # share of the largest stiffness of a tool moved by force, what rounding leaves of nothing
    ROUNDING = 1e-12

    def __init__(self, scene: Scene, linear_solver: str) -> None:
        check_name(linear_solver)
        self._scene, self._name = scene, linear_solver
        self.tells_inertia = linear_solver == "mumps-cholesky"
        self.negative_pivots_met, self.shift = False, 0.0
        self.ksp = PETSc.KSP().create(scene.comm)
        self.ksp.setOptionsPrefix(PREFIX)
        self._make()

    def _make(self):
        self.A = self._scene.create_matrix()
        configure(self.ksp, self.A, self._name)

    def assemble(self, held: bool = True) -> None:
        """Make A the tangent at the scene's present state, anew if contact of sheets has found
        other places; held: with unit rows and columns at the supports."""
        if self._scene.places_changed():
            self.A.destroy()
            self.ksp.reset()
            self._make()
        self._scene.tangent(self.A, held)

    def mean_stiffness(self) -> float:
        """Mean of the diagonal [N/mm]."""
        return self.A.getDiagonal().sum() / self.A.size[0]

    def stiffness_norm(self) -> float:
        """Norm of the diagonal [N/mm]; raises SolveFailed if it is not a number."""
        norm = self.A.getDiagonal().norm()
        if not np.isfinite(norm):
            raise SolveFailed(End.NO_NUMBER)
        return norm

    def negative_pivots(self) -> int:
        """How many A has; factors it if it is not factored yet."""
        with phase("linear_solve"):
            self.ksp.setOperators(self.A)
            self.ksp.setUp()
        return inertia(self.ksp.pc)[0]

    def solve_with_last_factors(self, rhs: PETSc.Vec, d: PETSc.Vec) -> bool:
        """Solve with the factors of the last solve; whether that succeeded."""
        with phase("linear_solve"):
            self.ksp.solve(rhs, d)
            return self.ksp.getConvergedReason() > 0 and self._subtract_compliances(d)

    def solve(self, rhs: PETSc.Vec, d: PETSc.Vec, report: Report) -> float:
        """Solve A d = rhs, with A shifted until it is positive definite; the shift [N/mm]. Notes
        shifts and negative pivots of A itself in the report. Raises SolveFailed."""
        shift = 0.0
        for attempt in range(self.ATTEMPTS):
            reason = self._factor_and_solve(rhs, d)
            negative, zero = None, None
            if self.tells_inertia and reason > 0:
                negative, zero = inertia(self.ksp.pc)
            if attempt == 0:
                report.negative_pivots = negative
            is_definite = not negative and not zero
            if is_definite and reason > 0 and self._subtract_compliances(d):
                self.shift = shift or self.shift
                return shift
            if is_definite and reason < 0 and reason not in NOT_DEFINITE:
                raise SolveFailed(End.LINEAR_SOLVER, KSP_WORDS.get(reason, "unknown reason"))
            report.shifts, self.negative_pivots_met = report.shifts + 1, True
            larger = 8 * shift if shift else self._first_shift()
            self.A.shift(larger - shift)
            shift = larger
        raise SolveFailed(End.SADDLE)

    def _factor_and_solve(self, rhs, d):
        with phase("linear_solve"):
            self.ksp.setOperators(self.A)
            self.ksp.solve(rhs, d)
            while not factorisation_had_room(self.ksp.pc):
                self.ksp.setOperators(self.A)
                self.ksp.solve(rhs, d)
            return self.ksp.getConvergedReason()

    def _first_shift(self):
        mean = self.A.getDiagonal().norm(PETSc.NormType.NORM_1) / self.A.size[0]
        return max(1e-8 * mean, self.shift / 4) if self.shift else 1e-4 * mean

    def _subtract_compliances(self, d):
        return subtract_compliances(self.ksp, self._scene.compliances(), d, self.ROUNDING)
