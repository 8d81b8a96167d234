"""The scene's tangent matrix and its factors, and a narrow one, of which they cost less."""

import numpy as np
from petsc4py import PETSc

from ..core.timing import phase
from ..scene.scene import Scene
from . import linear
from .progress import Report, SolveFailed, Termination


class Tangent:
    """Second derivative of a scene's energy, A [N/mm], and the linear solver of that name.

    MUMPS keeps its symbolic factorisation. Only `mumps-cholesky` counts negative pivots: a matrix
    that has some is shifted along its diagonal until it has none. negative_pivots_met: True once
    any matrix had some; shift: the last one; the next solve begins with both. Raises InputError for
    an unknown solver.
    """

    SHIFTS = 20  # of one matrix, at most
    # share of the largest stiffness of a tool moved by force, up to which one is rounding
    ROUNDING = 1e-12
    # singular too: a membrane without tension has no stiffness across itself
    NOT_DEFINITE = [
        getattr(PETSc.KSP.ConvergedReason, "DIVERGED_" + name)
        for name in ("INDEFINITE_MAT", "INDEFINITE_PC", "PCSETUP_FAILED")
    ]

    def __init__(self, scene: Scene, linear_solver: str) -> None:
        linear.check_name(linear_solver)
        self._scene, self._name = scene, linear_solver
        self.counts_pivots = linear_solver == "mumps-cholesky"
        self.negative_pivots_met, self.shift = False, 0.0
        self.ksp = PETSc.KSP().create(scene.comm)
        self.ksp.setOptionsPrefix(linear.PREFIX)
        self._make()

    def _make(self):
        self.A = self._scene.create_matrix()
        linear.configure(self.ksp, self.A, self._name)

    def assemble(self, with_supports: bool = True) -> None:
        """Make A the tangent at the scene's present state, with unit rows and columns at the
        supports. It is a new matrix if contact of sheets has found other places."""
        if self._scene.places_changed():
            self.A.destroy()
            self.ksp.reset()
            self._make()
        self._scene.tangent(self.A, with_supports)

    def stiffness_norm(self) -> float:
        """Norm of the diagonal [N/mm]; raises SolveFailed if it is not a number."""
        norm = self.A.getDiagonal().norm()
        if not np.isfinite(norm):
            raise SolveFailed(Termination.NO_NUMBER)
        return norm

    @phase("linear_solve")
    def negative_pivots(self) -> int:
        """Number of negative pivots of A, which is factored if it is not yet."""
        self.ksp.setOperators(self.A)
        self.ksp.setUp()
        return linear.inertia(self.ksp.pc)[0]

    @phase("linear_solve")
    def solve_with_last_factors(self, rhs: PETSc.Vec, d: PETSc.Vec) -> bool:
        """Solve with the factors of the last solve; False if that fails."""
        self.ksp.solve(rhs, d)
        return self.ksp.getConvergedReason() > 0 and self._subtract_compliances(d)

    def solve(self, rhs: PETSc.Vec, d: PETSc.Vec, report: Report) -> float:
        """Solve A d = rhs, with A shifted until it is positive definite; the shift [N/mm]. Counts
        shifts and negative pivots of A itself in the report. Raises SolveFailed."""
        shift = 0.0
        for attempt in range(self.SHIFTS):
            reason = self._factor_and_solve(rhs, d)
            counts = self.counts_pivots and reason > 0
            negative, zero = linear.inertia(self.ksp.pc) if counts else (None, None)
            if attempt == 0:
                report.negative_pivots = negative
            is_definite = not negative and not zero
            if is_definite and reason > 0 and self._subtract_compliances(d):
                self.shift = shift or self.shift
                return shift
            if is_definite and reason < 0 and reason not in self.NOT_DEFINITE:
                raise SolveFailed(Termination.LINEAR_SOLVER, linear.reason_name(reason))
            report.shifts, self.negative_pivots_met = report.shifts + 1, True
            larger = 8 * shift if shift else self._first_shift()
            self.A.shift(larger - shift)
            shift = larger
        raise SolveFailed(Termination.SADDLE)

    @phase("linear_solve")
    def _factor_and_solve(self, rhs, d):
        while True:
            self.ksp.setOperators(self.A)
            self.ksp.solve(rhs, d)
            if linear.had_memory(self.ksp.pc):
                return self.ksp.getConvergedReason()

    def _first_shift(self):
        mean = self.A.getDiagonal().norm(PETSc.NormType.NORM_1) / self.A.size[0]
        # a power of 2, as the axes of supports change the mean by some per cent
        mean = 2.0 ** np.round(np.log2(mean)) if 0 < mean < np.inf else mean
        return max(1e-8 * mean, self.shift / 4) if self.shift else 1e-4 * mean

    def _subtract_compliances(self, d):
        """Make d, which `ksp` solved for, the solution with A less c c^T / k of each tool that a
        force moves (Woodbury's formula). False, d unchanged, if that is not definite."""
        compliances = self._scene.compliances()
        if not compliances:
            return True
        solved = [c.duplicate() for c, _ in compliances]
        for (c, _), y in zip(compliances, solved):
            self.ksp.solve(c, y)
        product = np.array([[c.dot(y) for y in solved] for c, _ in compliances])
        stiffness = np.array([k for _, k in compliances])
        left = np.diag(stiffness) - (product + product.T) / 2
        # none where sheet and tool can go together unresisted
        if np.linalg.eigvalsh(left)[0] <= self.ROUNDING * stiffness.max():
            return False
        for travel, y in zip(np.linalg.solve(left, [c.dot(d) for c, _ in compliances]), solved):
            d.axpy(travel, y)
        return True


class Preconditioner:
    """Solver of A d = rhs by conjugate gradients, with the factors of a tangent with fewer places.

    A itself is not assembled. It is taken as positive definite, so that a state found with it is to
    be verified by A's own factors.
    """

    UNKNOWNS = 2000  # of fewer, factors cost too little (double dome: nx 24 has 2217)
    FEWER = 0.7  # share of A's places, from which on its factors do not pay
    REDUCTION = 1e-2  # of the error in the energy norm
    MOST = 12  # conjugate gradients, which cost as much as the factors that they spare

    def __init__(self, scene: Scene, tangent: Tangent) -> None:
        self._scene, self._tangent = scene, tangent
        self._ksp: PETSc.KSP = None
        self._pays = False

    def solve(self, rhs: PETSc.Vec, d: PETSc.Vec, report: Report) -> bool:
        """Solve at the scene's present state; False if that does not pay, or fails."""
        is_small = self._tangent.A.size[0] < self.UNKNOWNS
        if is_small or not self._tangent.counts_pivots or self._scene.compliances():
            return False
        if self._ksp is None or self._scene.places_changed(narrow=True):
            self._make()
        if not self._pays:
            return False
        self._scene.tangent(self._P, narrow=True)
        report.negative_pivots = None  # of A are not known
        self._ksp.setOperators(self._A, self._P)
        solved = self.solve_with_last_factors(rhs, d)
        had_memory = linear.had_memory(self._ksp.pc)
        return had_memory and solved and not any(linear.inertia(self._ksp.pc))

    @phase("linear_solve")
    def solve_with_last_factors(self, rhs: PETSc.Vec, d: PETSc.Vec) -> bool:
        """Solve with the tangent and the factors of the last solve; False if that fails."""
        self._ksp.solve(rhs, d)
        return self._ksp.getConvergedReason() > 0

    def _make(self):
        self._P = self._scene.create_matrix(narrow=True)
        sizes = self._P.getSizes()
        self._A = PETSc.Mat().createPython([sizes[0], sizes[1]], self, comm=self._P.comm)
        self._A.setUp()
        self._ksp = linear.conjugate_gradients(self._A, self._P, self.REDUCTION, self.MOST)
        self._pays = linear.places(self._P) <= self.FEWER * linear.places(self._tangent.A)

    def mult(self, _: PETSc.Mat, v: PETSc.Vec, f: PETSc.Vec) -> None:
        """Make f = A v, as PETSc asks for it."""
        self._P.mult(v, f)
        self._scene.add_remainder(v, f)
