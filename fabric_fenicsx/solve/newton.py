"""Newton's method on a scene's energy, run as a PETSc SNES."""

from dataclasses import dataclass, field

import numpy as np
from petsc4py import PETSc

from ..errors import InputError
from ..timing import phase

Reason = PETSc.SNES.ConvergedReason
SNES_WORDS = {
    Reason.CONVERGED_FNORM_ABS: "converged: no force is left",
    Reason.CONVERGED_FNORM_RELATIVE: "converged: residual below the tolerance",
    Reason.CONVERGED_SNORM_RELATIVE: "converged: the correction is below the rounding of positions",
    Reason.DIVERGED_MAX_IT: "no convergence within the allowed iterations",
    Reason.DIVERGED_LINEAR_SOLVE: "the linear solver failed",
    Reason.DIVERGED_LINE_SEARCH: "the line search found no state of lower energy",
    Reason.DIVERGED_FNORM_NAN: "the energy or its forces are not a number",
    Reason.DIVERGED_LOCAL_MIN: "the tangent stays indefinite under any shift",
}
KSP_WORDS = {
    value: name.lower().replace("_", " ").replace("diverged ", "") for name, value in vars(PETSc.KSP.ConvergedReason).items()
    if isinstance(value, int)
}  # fmt: skip

LINEAR_SOLVERS = {
    "mumps-cholesky": {"ksp_type": "preonly", "pc_type": "cholesky", "mat_mumps_icntl_24": 1},
    "mumps-lu": {"ksp_type": "preonly", "pc_type": "lu"},
    "cg-gamg": {"ksp_type": "cg", "pc_type": "gamg", "ksp_rtol": 1e-8, "ksp_max_it": 1000},
    "cg-hypre": {"ksp_type": "cg", "pc_type": "hypre", "ksp_rtol": 1e-8, "ksp_max_it": 1000},
}


@dataclass
class Report:
    """How a solve ended: `residuals` are norms over the free degrees of freedom [N], one before each iteration and
    one at the end, `scale` the force [N] they are measured by; `negative_pivots` those of the last tangent (None
    for solvers that do not tell)."""

    converged: bool = False
    reason: str = ""
    iterations: int = 0
    shifts: int = 0
    cuts: int = 0
    negative_pivots: int | None = None
    scale: float = 0.0
    residuals: list = field(default_factory=list)


class Newton:
    """Minimises the scene's energy at fixed supports, from a start at which the supports have their values.

    tolerance: of the residual's norm over that of the support forces. Each step is the tangent's, shortened until
    the energy falls; below the energy's rounding, until the residual falls. A correction below the rounding of
    positions ends it too, as no tolerance can ask for more. A tangent with negative pivots is
    shifted along its diagonal until it has none. MUMPS keeps its symbolic factorisation.
    """

    SUFFICIENT = 1e-4  # of the decrease that the slope promises (Armijo)
    ROUNDING = 1e-12  # of the energy, below which its differences are noise
    RESOLUTION = 1e-14  # of the blank's size, below which displacements are noise

    def __init__(self, scene, tolerance=1e-8, max_iterations=25, linear_solver="mumps-cholesky", verbose=False):
        if linear_solver not in LINEAR_SOLVERS:
            raise InputError(f"linear solver is {linear_solver!r}; allowed are {', '.join(LINEAR_SOLVERS)}")
        self.scene, self.tolerance, self.max_iterations, self.verbose = scene, tolerance, max_iterations, verbose
        self.tells_inertia = linear_solver == "mumps-cholesky"
        self._smallest = self.RESOLUTION * np.subtract(*scene.blank.extent()[::-1]).max()
        self.x = scene.u.duplicate()
        self._r, self._d, self._trial = (self.x.duplicate() for _ in range(3))
        self.A = scene.create_matrix()
        self.snes = PETSc.SNES().create(scene.comm)
        self.snes.setOptionsPrefix("fabric_")
        self.snes.setType(PETSc.SNES.Type.PYTHON)
        self.snes.setPythonContext(self)
        self.snes.setFunction(self._function, self._r)
        self.snes.setJacobian(self._jacobian, self.A)
        options = PETSc.Options()
        for key, value in LINEAR_SOLVERS[linear_solver].items():
            options[f"fabric_{key}"] = value
        if linear_solver.startswith("mumps"):
            self.snes.ksp.pc.setType(LINEAR_SOLVERS[linear_solver]["pc_type"])
            self.snes.ksp.pc.setFactorSolverType("mumps")
        self.snes.setFromOptions()
        self.snes.ksp.setErrorIfNotConverged(False)

    def solve_for(self, x):
        """Solve from x, overwritten by the solution; returns a `Report`."""
        self.report = Report()
        self.snes.solve(None, x)
        reason = self.snes.getConvergedReason()
        self.report.converged = reason > 0
        self.report.reason = SNES_WORDS.get(reason, f"SNES reason {reason}")
        if reason == Reason.DIVERGED_LINEAR_SOLVE:
            self.report.reason += f" ({KSP_WORDS.get(self.snes.ksp.getConvergedReason(), 'unknown reason')})"
        return self.report

    def tangent_predictor(self, x, change):
        """Linear response at x to a `change` (held dofs of this rank) [mm] of the support values, added to x."""
        self.scene.set(x)
        d, rhs = self._d, self._trial
        d.set(0)
        d.array[self.scene.held] = change
        self.scene.tangent(self.A, held=False)
        self.A.mult(d, rhs)
        rhs.scale(-1)
        rhs.array[self.scene.held] = change
        self.scene.tangent(self.A)
        self._linear_solve(rhs, d, Report())
        d.array[self.scene.held] = change
        x.axpy(1.0, d)

    # -- what SNES calls

    def _function(self, snes, x, f):
        self.scene.set(x)
        self.scene.residual(f)

    def _jacobian(self, snes, x, A, P):
        self.scene.tangent(A)

    def solve(self, snes, b, x):
        report, scene, r, d, trial = self.report, self.scene, self._r, self._d, self._trial
        snes.computeFunction(x, r)
        energy = scene.energy()
        for report.iterations in range(self.max_iterations + 1):
            norm = r.norm()
            report.residuals.append(norm)
            report.scale = scene.force_scale()
            snes.monitor(report.iterations, norm)
            self._tell(f"iteration {report.iterations:2d}  residual {norm:9.3e} N of {report.scale:9.3e} N  energy {energy:.12e} N mm")
            if not (np.isfinite(norm) and np.isfinite(energy)):
                return snes.setConvergedReason(Reason.DIVERGED_FNORM_NAN)
            if norm == 0:
                return snes.setConvergedReason(Reason.CONVERGED_FNORM_ABS)
            if norm <= self.tolerance * report.scale:
                return snes.setConvergedReason(Reason.CONVERGED_FNORM_RELATIVE)
            if report.iterations == self.max_iterations:
                return snes.setConvergedReason(Reason.DIVERGED_MAX_IT)
            snes.computeJacobian(x, self.A)
            shifts = report.shifts
            failure = self._linear_solve(r, d, report)
            if failure:
                return snes.setConvergedReason(failure)
            if report.shifts == shifts and d.norm(PETSc.NormType.NORM_INFINITY) <= self._smallest:
                return snes.setConvergedReason(Reason.CONVERGED_SNORM_RELATIVE)
            slope = -r.dot(d)
            self._tell(f"              step of {np.sqrt(abs(slope)):9.3e} in the energy norm / sqrt(N mm)")
            length = 1.0
            while True:
                x.copy(trial)
                trial.axpy(-length, d)
                snes.computeFunction(trial, r)
                new_energy, change = scene.energy(), 0.0
                change = new_energy - energy
                if -slope * length > self.ROUNDING * abs(energy):
                    good = change <= self.SUFFICIENT * length * slope
                else:
                    good = r.norm() < norm
                if good:
                    break
                report.cuts += 1
                parabola = -slope * length / (2 * (change / length - slope)) if np.isfinite(change) and change / length > slope else 0
                length = float(np.clip(parabola, 0.1 * length, 0.5 * length))
                if length < 1e-8:
                    return snes.setConvergedReason(Reason.DIVERGED_LINE_SEARCH)
            trial.copy(x)
            energy = new_energy
        raise AssertionError("unreachable")

    def _tell(self, text):
        if self.verbose and self.scene.comm.rank == 0:
            print("    " + text, flush=True)

    def _linear_solve(self, rhs, d, report):
        """Solve A d = rhs, shifting A until it is positive definite; a SNES reason if that fails, else None."""
        ksp, shift = self.snes.ksp, 0.0
        for attempt in range(20):
            with phase("linear_solve"):
                ksp.setOperators(self.A)
                ksp.solve(rhs, d)
                failed = ksp.getConvergedReason() < 0
                negative = self._negative_pivots() if not failed else None
            indefinite = bool(negative) or ksp.getConvergedReason() == PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT
            if attempt == 0:
                report.negative_pivots = negative
            if failed and not indefinite:
                return Reason.DIVERGED_LINEAR_SOLVE
            if not indefinite:
                return None
            report.shifts += 1
            mean = self.A.getDiagonal().norm(PETSc.NormType.NORM_1) / self.A.size[0]
            increase = 1e-3 * mean if shift == 0 else 3 * shift
            self.A.shift(increase)
            shift += increase
        return Reason.DIVERGED_LOCAL_MIN

    def _negative_pivots(self):
        if not self.tells_inertia:
            return None
        return self.snes.ksp.pc.getFactorMatrix().getInertia()[0]
