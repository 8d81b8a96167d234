"""Newton's method on a scene's energy."""

import logging
from typing import Any

import numpy as np
from petsc4py import PETSc

from ..scene.scene import Scene
from .directions import Directions
from .line_search import LineSearch
from .objective import Objective
from .report import Report
from .saddles import Saddles
from .tangent import Tangent
from .termination import End, SolveFailed

log = logging.getLogger(__name__)


class Newton:
    """Minimises the scene's energy at fixed supports, from a start at which the supports have their
    values: converged? direction, line search.

    `directions`, `line_search` and `saddles` do one of these each and can be replaced. tolerance:
    of the residual's norm over that of the support forces. Forces or corrections at the rounding of
    displacements and positions end a solve too, as no tolerance can ask for more. Each iteration is
    logged (`logging`, level DEBUG) on rank 0. Raises InputError for an unknown linear solver.
    """

    RESOLUTION = 1e-14  # of the blank's size, below which displacements are noise
    # of the blank's size, to which a correction is cut: soft modes would send the sheet to infinity
    LONGEST = 0.1

    def __init__(
        self,
        scene: Scene,
        tolerance: float = 1e-8,
        max_iterations: int = 150,
        linear_solver: str = "mumps-cholesky",
    ) -> None:
        self.scene, self.tolerance, self.max_iterations = scene, tolerance, max_iterations
        self._size = np.subtract(*scene.blank.extent()[::-1]).max()
        self.smallest = self.RESOLUTION * self._size
        self.x, self._d = scene.u.duplicate(), scene.u.duplicate()
        self.objective = Objective(scene)
        self.tangent = Tangent(scene, linear_solver)
        self.directions = Directions(scene, self.tangent)
        self.line_search = LineSearch(self.objective)
        self.saddles = Saddles(self.objective, self.tangent, self.smallest)

    def solve_for(self, x: PETSc.Vec, tolerance: float = 0.0, minimum: bool = True) -> Report:
        """Solve from x, overwritten by the solution, to the solver's tolerance or a looser one;
        returns a `Report`. minimum: whether the solution must not be a saddle."""
        self.report = Report()
        try:
            end = self._iterate(x, max(self.tolerance, tolerance), minimum)
            self.report.converged, self.report.reason = True, end.value
        except SolveFailed as failure:
            self.report.object(str(failure))
        return self.report

    def _iterate(self, x, tolerance, minimum):
        report, d = self.report, self._d
        energy = self.objective(x)
        if energy == Objective.INVERTED:
            raise SolveFailed(End.INVERTED)
        while True:
            end = self._converged(energy, tolerance)
            if not end:
                if report.iterations == self.max_iterations:
                    raise SolveFailed(End.ITERATIONS)
                loosened = tolerance if tolerance > self.tolerance else 0.0
                shifted = self.directions.find(x, self.objective.r, d, report, loosened)
                if shifted or d.norm(PETSc.NormType.NORM_INFINITY) > self.smallest:
                    self._shorten(d)
                    self._log_direction(d)
                    energy = self.line_search(x, energy, d, shifted, report)
                    report.iterations += 1
                    continue
                end = End.CORRECTION
            on_the_way = tolerance > self.tolerance
            if not (minimum and self.saddles.is_here(x, report, on_the_way)):
                return end
            if on_the_way:  # a loose state tells nothing of what is near it
                tolerance = self.tolerance
                continue
            energy = self.saddles.leave(x, energy, report)
            report.iterations += 1
            self._log(f"              left a saddle of {report.negative_pivots} negative pivots")

    def _converged(self, energy, tolerance):
        """How the present state ends the solve, by its residual; None to go on."""
        report, norm = self.report, self.objective.r.norm()
        report.residuals.append(norm)
        report.scale = self.scene.force_scale()
        self._log(
            f"iteration {report.iterations:2d}  residual {norm:9.3e} N of "
            f"{report.scale:9.3e} N  energy {energy:.12e} N mm"
        )
        if not (np.isfinite(norm) and np.isfinite(energy)):
            raise SolveFailed(End.NO_NUMBER)
        if norm <= self.directions.noise:
            return End.ROUNDING
        return End.RESIDUAL if norm <= tolerance * report.scale else None

    def _shorten(self, d):
        length, longest = d.norm(PETSc.NormType.NORM_INFINITY), self.LONGEST * self._size
        if length > longest:
            d.scale(longest / length)

    # -- what load stepping asks

    def memory(self) -> dict[str, Any]:
        """What this solver remembers of earlier solves, for `recall` by another one."""
        tangent = self.tangent
        return {"negative_pivots_met": tangent.negative_pivots_met, "shift": tangent.shift}

    def recall(self, memory: dict[str, Any]) -> None:
        """Take over the `memory` of another solver."""
        self.tangent.negative_pivots_met = memory["negative_pivots_met"]
        self.tangent.shift = memory["shift"]

    def stiffness(self, x: PETSc.Vec) -> float:
        """Mean diagonal of the tangent at x [N/mm]."""
        self.scene.set(x)
        self.tangent.assemble()
        return self.tangent.mean_stiffness()

    def is_at_rest(self, x: PETSc.Vec) -> bool:
        """Whether the scene is in equilibrium at x, but for forces that its stiffness turns into
        the rounding of positions."""
        self.objective(x)
        force = self.objective.r.norm()
        return bool(force <= self.smallest * self.stiffness(x)) if force else True

    def follow_supports(self, x: PETSc.Vec, change: np.ndarray) -> None:
        """Add to x the linear response there to a `change` (held dofs of this rank) [mm] of the
        support values."""
        scene, d, rhs = self.scene, self._d, self.objective.r
        scene.set(x)
        d.set(0)
        d.array[scene.held] = change
        self.tangent.assemble(held=False)
        self.tangent.A.mult(d, rhs)
        rhs.scale(-1)
        rhs.array[scene.held] = change
        self.tangent.assemble()
        try:
            self.tangent.stiffness_norm()
            self.tangent.solve(rhs, d, Report())
        except SolveFailed:
            d.set(0)  # the supports alone move; the iterations that follow say what is wrong
        d.array[scene.held] = change
        x.axpy(1.0, d)

    def _log_direction(self, d):
        size = np.sqrt(abs(self.objective.r.dot(d)))
        kept = ", with the last tangent's factors" if self.directions.kept else ""
        self._log(f"              step of {size:9.3e} in the energy norm / sqrt(N mm){kept}")

    def _log(self, text):
        if self.scene.comm.rank == 0:
            log.debug("    %s", text)
