"""Newton's method on a scene's energy, run as a PETSc SNES."""

import logging
from typing import Any

import numpy as np
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..runtime.errors import InputError
from ..runtime.timing import phase
from ..scene.scene import Scene
from .linear import (
    LINEAR_SOLVERS,
    NOT_DEFINITE,
    PREFIX,
    configure,
    factorisation_had_room,
    give_way,
    inertia,
    is_there,
)
from .python_snes import Callbacks, IterationEnded
from .report import KSP_WORDS, SNES_WORDS, Reason, Report

log = logging.getLogger(__name__)


class Newton:
    """Minimises the scene's energy at fixed supports, from a start at which the supports have their
    values.

    tolerance: of the residual's norm over that of the support forces. Each step is the tangent's,
    taken to where the energy is less and its slope at most `FLAT` of that at the start; where
    energies differ by rounding alone the slope decides, or a residual of half the size. A tangent
    with negative pivots is shifted along its diagonal until it has none, and a saddle, known to the
    full tolerance, is left along a direction of negative curvature that depends on neither the
    ranks nor chance. Forces or corrections at the rounding of displacements and positions end it
    too, as no tolerance can ask for more. Where a looser tolerance is asked, corrections near the
    state sought keep the last tangent's factors. MUMPS keeps its symbolic factorisation; only
    `mumps-cholesky` tells negative pivots. Each iteration is logged (`logging`, level DEBUG) on
    rank 0.
    """

    FLAT = 0.7  # slope left at the end of a line search, of the one at its start
    ROUNDING = 1e-12  # of the energy, below which its differences are noise
    DIGIT = 2.0**-52  # of the displacements: the forces that it makes through the tangent are noise
    RESOLUTION = 1e-14  # of the blank's size, below which displacements are noise
    FEW = 5  # iterations, within which a solve counts as easy
    # of the blank's size, to which a correction is cut: soft modes would send the sheet to infinity
    LONGEST = 0.1
    # residuals, over the tolerance and over the forces of supports, that take no new tangent
    NEAR, SMALL = 300.0, 3e-3
    SADDLES = 5  # to be left in one solve

    def __init__(
        self,
        scene: Scene,
        tolerance: float = 1e-8,
        max_iterations: int = 150,
        linear_solver: str = "mumps-cholesky",
    ) -> None:
        allowed = [name for name in LINEAR_SOLVERS if is_there(name)]
        if linear_solver not in allowed:
            why = ", and this PETSc has no hypre" if linear_solver in LINEAR_SOLVERS else ""
            raise InputError(
                f"linear solver is {linear_solver!r}{why}; allowed are {', '.join(allowed)}"
            )
        self.scene, self.tolerance, self.max_iterations = scene, tolerance, max_iterations
        self.tells_inertia = linear_solver == "mumps-cholesky"
        self._size = np.subtract(*scene.blank.extent()[::-1]).max()
        self._smallest = self.RESOLUTION * self._size
        self._noise, self._negative_pivots_met, self._shift = 0.0, False, 0.0
        self.x = scene.u.duplicate()
        self._r, self._d, self._trial = (self.x.duplicate() for _ in range(3))
        self._linear_solver = linear_solver
        self.snes = PETSc.SNES().create(scene.comm)
        self.snes.setOptionsPrefix(PREFIX)
        self.snes.setType(PETSc.SNES.Type.PYTHON)
        self._callbacks = Callbacks(self.solve, self._function, self._jacobian)
        self.snes.setPythonContext(self._callbacks)
        self.snes.setFunction(self._callbacks.function, self._r)
        self._make_matrix()
        configure(self.snes, linear_solver)

    def solve_for(self, x: PETSc.Vec, tolerance: float = 0.0, minimum: bool = True) -> Report:
        """Solve from x, overwritten by the solution, to the solver's tolerance or a looser one;
        returns a `Report`. minimum: whether the solution must not be a saddle."""
        self.report, self._allowed = Report(), max(self.tolerance, tolerance)
        self._minimum = minimum
        self._keep_matrix_fitting()
        self.snes.solve(None, x)
        reason = self.snes.getConvergedReason()
        self.report.converged = reason > 0
        self.report.reason = SNES_WORDS.get(reason, f"SNES reason {reason}")
        if reason == Reason.DIVERGED_LINEAR_SOLVE:
            self.report.reason += (
                f" ({KSP_WORDS.get(self.snes.ksp.getConvergedReason(), 'unknown reason')})"
            )
        return self.report

    def _make_matrix(self):
        self.A = self.scene.create_matrix()
        self.snes.setJacobian(self._callbacks.jacobian, self.A)

    def _keep_matrix_fitting(self):
        """Make the matrix anew if contact of sheets has found other places."""
        if not self.scene.fits():
            self.A.destroy()
            self._make_matrix()
            self.snes.ksp.reset()
            configure(self.snes, self._linear_solver)

    def memory(self) -> dict[str, Any]:
        """What this solver remembers of earlier solves, for `recall` by another one."""
        return {"negative_pivots_met": self._negative_pivots_met, "shift": self._shift}

    def recall(self, memory: dict[str, Any]) -> None:
        """Take over the `memory` of another solver."""
        self._negative_pivots_met, self._shift = memory["negative_pivots_met"], memory["shift"]

    def stiffness(self, x: PETSc.Vec) -> float:
        """Mean diagonal of the tangent at x [N/mm]."""
        self.scene.set(x)
        self._keep_matrix_fitting()
        self.scene.tangent(self.A)
        return self.A.getDiagonal().sum() / self.A.size[0]

    def is_at_rest(self, x: PETSc.Vec) -> bool:
        """Whether the scene is in equilibrium at x, but for forces that its stiffness turns into
        the rounding of positions."""
        self.scene.set(x)
        self.scene.residual(self._r)
        force = self._r.norm()
        return bool(force <= self._smallest * self.stiffness(x)) if force else True

    def tangent_predictor(self, x: PETSc.Vec, change: np.ndarray) -> None:
        """Linear response at x to a `change` (held dofs of this rank) [mm] of the support values,
        added to x."""
        scene, d, rhs = self.scene, self._d, self._trial
        scene.set(x)
        self._keep_matrix_fitting()
        d.set(0)
        d.array[scene.held] = change
        scene.tangent(self.A, held=False)
        self.A.mult(d, rhs)
        rhs.scale(-1)
        rhs.array[scene.held] = change
        scene.tangent(self.A)
        self.report = Report()
        try:
            if not np.isfinite(self.A.getDiagonal().norm()):
                raise IterationEnded(compat.DIVERGED_NAN)
            self._linear_solve(rhs, d)
        except IterationEnded:
            d.set(0)  # the supports alone move; the iterations that follow say what is wrong
        d.array[scene.held] = change
        x.axpy(1.0, d)

    # -- what SNES calls

    def _function(self, snes, x, f):
        self.scene.set(x)
        self.scene.residual(f)

    def _jacobian(self, snes, x, A, P):
        self.scene.tangent(A)

    def solve(self, snes: PETSc.SNES, b: PETSc.Vec | None, x: PETSc.Vec) -> None:
        """What SNES calls; use `solve_for`."""
        try:
            self._iterate(snes, x)
        except IterationEnded as end:
            snes.setConvergedReason(end.args[0])

    def _iterate(self, snes, x):
        report, r, d = self.report, self._r, self._d
        snes.computeFunction(x, r)
        energy, kept = self.scene.energy(), False
        if energy == self.scene.INVERTED:
            raise IterationEnded(Reason.DIVERGED_FUNCTION_DOMAIN)
        while True:
            reason = self._converged(snes, energy)
            shifts = report.shifts
            if not reason:
                if report.iterations == self.max_iterations:
                    raise IterationEnded(Reason.DIVERGED_MAX_IT)
                if kept := self._nearly_there(kept):
                    self._log("              with the last tangent's factors")
                    with phase("linear_solve"):
                        snes.ksp.solve(r, d)
                        kept = snes.ksp.getConvergedReason() > 0 and self._give_way(d)
                if not kept:
                    self.scene.set(x)
                    self.scene.anticipate()
                    snes.computeJacobian(x, self.A)
                    stiffness = self.A.getDiagonal().norm()
                    if not np.isfinite(stiffness):
                        raise IterationEnded(compat.DIVERGED_NAN)
                    self._noise = self.DIGIT * x.norm(PETSc.NormType.NORM_INFINITY) * stiffness
                    self._linear_solve(r, d)
                d.scale(-1)
                if (
                    report.shifts == shifts
                    and d.norm(PETSc.NormType.NORM_INFINITY) <= self._smallest
                ):
                    reason = Reason.CONVERGED_SNORM_RELATIVE
            if reason:
                if not (self._minimum and self._is_saddle(snes, x)):
                    raise IterationEnded(reason)
                if self._allowed > self.tolerance:  # a loose state tells nothing of what is near it
                    self._allowed = self.tolerance
                    continue
                report.saddles += 1
                if report.saddles > self.SADDLES:
                    raise IterationEnded(Reason.DIVERGED_LOCAL_MIN)
                energy = self._leave_saddle(x, energy)
            else:
                energy = self._line_search(x, energy, shifted=report.shifts > shifts)
            report.iterations += 1

    def _nearly_there(self, kept):
        """Whether a correction with the last tangent's factors will do: for a state on the way,
        when it is near, and as long as they gain digits; `kept`: the iteration before had no
        tangent of its own either."""
        report = self.report
        if (
            self._allowed <= self.tolerance
            or report.iterations == 0
            or report.shifts
            or report.cuts
        ):
            return False
        before, now = report.residuals[-2:]
        near = min(self.NEAR * self._allowed, self.SMALL) * report.scale
        return now <= near and now <= (0.2 if kept else 0.5) * before

    def _converged(self, snes, energy):
        """A reason to stop, from the residual at the present state; 0 to go on."""
        report, norm = self.report, self._r.norm()
        report.residuals.append(norm)
        report.scale = self.scene.force_scale()
        snes.monitor(report.iterations, norm)
        self._log(
            f"iteration {report.iterations:2d}  residual {norm:9.3e} N of "
            f"{report.scale:9.3e} N  energy {energy:.12e} N mm"
        )
        if not (np.isfinite(norm) and np.isfinite(energy)):
            raise IterationEnded(compat.DIVERGED_NAN)
        if norm <= self._noise:
            return Reason.CONVERGED_FNORM_ABS
        return Reason.CONVERGED_FNORM_RELATIVE if norm <= self._allowed * report.scale else 0

    def _line_search(self, x, energy, shifted):
        """Go along d from x to where the energy's slope is small, bracketed by its sign; returns
        the energy there.

        The energy is piecewise smooth with kinks in its slope, where a parabola through energies
        misleads; its slope, the residual along d, is continuous. Leaves residual and scene at the
        new x.
        """
        r, d, trial, snes, report = self._r, self._d, self._trial, self.snes, self.report
        longest = d.norm(PETSc.NormType.NORM_INFINITY)
        if longest > self.LONGEST * self._size:
            d.scale(self.LONGEST * self._size / longest)
        norm, slope = r.norm(), r.dot(d)
        self._log(
            f"              step of {np.sqrt(abs(slope)):9.3e} in the energy norm / sqrt(N mm)"
        )
        met_inverted_cell = False
        if slope >= 0:  # only solvers that do not tell inertia get here
            raise IterationEnded(Reason.DIVERGED_LINE_SEARCH)
        within_rounding = -slope <= self.ROUNDING * abs(energy)
        low, high, length = (0.0, slope), None, 1.0
        while True:
            x.copy(trial)
            trial.axpy(length, d)
            snes.computeFunction(trial, r)
            trial_energy = self.scene.energy()
            along = r.dot(d) if trial_energy != self.scene.INVERTED else np.nan
            met_inverted_cell |= trial_energy == self.scene.INVERTED
            flat = abs(along) <= -self.FLAT * slope
            if within_rounding:  # the slope tells, as energies do not
                upright = trial_energy != self.scene.INVERTED
                fell = upright and along < 0
                found = flat or (upright and not shifted and r.norm() <= 0.5 * norm)
            else:
                fell = trial_energy < energy
                found = fell and flat
            if found:
                break
            if high is None and fell and along < 0 and length < 8:  # still downhill
                low, length = (length, along), 2 * length
                continue
            if fell and along < 0:
                if high is None:
                    break
                low = length, along
            else:
                high = length, along
            report.cuts += 1
            (a, sa), (b, sb) = low, high
            inside = a - sa * (b - a) / (sb - sa) if np.isfinite(sb) and sb > 0 else 0.5 * (a + b)
            length = float(np.clip(inside, a + 0.1 * (b - a), b - 0.1 * (b - a)))
            if b - a <= 1e-9:
                raise IterationEnded(
                    Reason.DIVERGED_FUNCTION_DOMAIN
                    if met_inverted_cell
                    else Reason.DIVERGED_LINE_SEARCH
                )
        trial.copy(x)
        return trial_energy

    def _linear_solve(self, rhs, d):
        """Solve A d = rhs, with A shifted until it is positive definite; returns the shift, notes
        negative pivots of A itself."""
        report, ksp, shift = self.report, self.snes.ksp, 0.0
        for attempt in range(20):
            with phase("linear_solve"):
                ksp.setOperators(self.A)
                ksp.solve(rhs, d)
                while not factorisation_had_room(ksp.pc):
                    ksp.setOperators(self.A)
                    ksp.solve(rhs, d)
                reason = ksp.getConvergedReason()
                tells = self.tells_inertia and reason > 0
                negative, zero = inertia(ksp.pc) if tells else (None, None)
            if attempt == 0:
                report.negative_pivots = negative
            if not negative and not zero and reason > 0 and self._give_way(d):
                self._shift = shift or self._shift
                return shift
            reason = (
                reason
                if negative or zero or reason < 0
                else PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT
            )
            if not negative and not zero and reason not in NOT_DEFINITE:
                raise IterationEnded(Reason.DIVERGED_LINEAR_SOLVE)
            report.shifts, self._negative_pivots_met = report.shifts + 1, True
            if shift == 0:
                mean = self.A.getDiagonal().norm(PETSc.NormType.NORM_1) / self.A.size[0]
                larger = max(1e-8 * mean, self._shift / 4) if self._shift else 1e-4 * mean
            else:
                larger = 8 * shift
            self.A.shift(larger - shift)
            shift = larger
        raise IterationEnded(Reason.DIVERGED_LOCAL_MIN)

    def _give_way(self, d):
        return give_way(self.snes.ksp, self.scene.compliances(), d, self.ROUNDING)

    def _is_saddle(self, snes, x):
        """Whether the tangent at the converged x has negative pivots; the last one's word is taken
        after an easy solve where none was met yet."""
        report = self.report
        quick = (
            0 < report.iterations <= self.FEW and not report.cuts and not self._negative_pivots_met
        )
        if quick or not self.tells_inertia:
            return False
        snes.computeJacobian(x, self.A)
        with phase("linear_solve"):
            snes.ksp.setOperators(self.A)
            snes.ksp.setUp()
            report.negative_pivots = inertia(snes.ksp.pc)[0]
        return report.negative_pivots > 0

    def _leave_saddle(self, x, energy):
        """Go downhill from the saddle x along its softest direction, found by inverse iteration;
        returns the energy."""
        d, trial, r, negative = self._d, self._trial, self._r, self.report.negative_pivots
        d.array[:] = self.scene.blank.generic_displacement().ravel()
        d.array[self.scene.held] = 0
        shift, curvature = 0.0, np.inf
        for _ in range(50):
            d.scale(1 / d.norm())
            d.copy(trial)
            shift += self._linear_solve(trial, d)
            before, curvature = curvature, 1 / d.dot(trial) - shift
            if curvature < 0 and abs(before - curvature) <= 0.1 * abs(curvature):
                break
        d.scale(1e10 * self._smallest / d.norm(PETSc.NormType.NORM_INFINITY))
        for _ in range(30):
            for sign in (1.0, -1.0):
                x.copy(trial)
                trial.axpy(sign, d)
                self.snes.computeFunction(trial, r)
                trial_energy = self.scene.energy()
                within_rounding = abs(trial_energy - energy) <= self.ROUNDING * abs(energy)
                if sign * r.dot(d) < 0 if within_rounding else trial_energy < energy:
                    self._log(f"              left a saddle of {negative} negative pivots")
                    trial.copy(x)
                    return trial_energy
            d.scale(0.5)
        raise IterationEnded(Reason.DIVERGED_LOCAL_MIN)

    def _log(self, text):
        if self.scene.comm.rank == 0:
            log.debug("    %s", text)
