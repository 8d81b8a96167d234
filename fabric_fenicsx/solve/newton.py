"""Newton's method on a scene's energy."""

import logging
from typing import Any

import numpy as np
from petsc4py import PETSc

from ..scene.scene import Scene
from .directions import Directions
from .line_search import LineSearch
from .objective import Objective
from .report import Report, SolveFailed, Termination
from .saddles import Saddles
from .tangent import Tangent

log = logging.getLogger(__name__)
MAXIMUM = PETSc.NormType.NORM_INFINITY


class Newton:
    """Minimises the scene's energy at fixed supports.

    tolerance: of the residual's norm over that of the forces on the sheet. A solve also ends where
    forces or corrections are at the rounding of displacements. `directions`, `line_search` and
    `saddles` can be replaced. Iterations are logged (`logging`, level DEBUG) on rank 0. Raises
    InputError for an unknown linear solver.
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
        self.report = Report()  # of the solve under way, or of the last one

    def solve(self, x: PETSc.Vec, tolerance: float = 0.0, minimum: bool = True) -> Report:
        """Solve from x, at which supports have their values, and overwrite it by the solution.
        tolerance: counts if it is looser than the solver's; minimum: leave saddles."""
        self.report = Report()
        try:
            end = self._iterate(x, max(self.tolerance, tolerance), minimum)
            self.report.converged, self.report.reason = True, end.value
        except SolveFailed as failure:
            self.report.reject(str(failure))
        return self.report

    def _iterate(self, x, tolerance, minimum):
        energy = self.objective(x)
        if energy == Objective.INVERTED:
            raise SolveFailed(Termination.INVERTED)
        while True:
            end = self._converged(energy, tolerance) or self._find_direction(x, tolerance)
            is_loose = tolerance > self.tolerance
            if end is None:
                energy = self.line_search(x, energy, self._d, self._shifted, self.report)
            elif not (minimum and self.saddles.is_here(x, self.report, is_loose)):
                return end
            elif is_loose:  # such a state tells nothing of what is near it
                tolerance = self.tolerance
                continue
            else:
                energy = self.saddles.leave(x, energy, self.report)
            self.report.iterations += 1

    def _converged(self, energy, tolerance):
        """Termination by the residual, None to go on."""
        report, norm = self.report, self.objective.r.norm()
        report.residuals.append(norm)
        report.scale = self.scene.force_scale()
        self._log(
            f"iteration {report.iterations:2d}  residual {norm:9.3e} N of "
            f"{report.scale:9.3e} N  energy {energy:.12e} N mm"
        )
        if not (np.isfinite(norm) and np.isfinite(energy)):
            raise SolveFailed(Termination.NO_NUMBER)
        if norm <= self.directions.noise:
            return Termination.ROUNDING
        return Termination.RESIDUAL if norm <= tolerance * report.scale else None

    def _find_direction(self, x, tolerance):
        """Find the next correction d; termination if it is too small to count, else None."""
        report, r, d = self.report, self.objective.r, self._d
        if report.iterations == self.max_iterations:
            raise SolveFailed(Termination.ITERATIONS)
        loosened = tolerance if tolerance > self.tolerance else 0.0
        self._shifted = self.directions.find(x, r, d, report, loosened)
        length, longest = d.norm(MAXIMUM), self.LONGEST * self._size
        if not (self._shifted or length > self.smallest):
            return Termination.CORRECTION
        if length > longest:
            d.scale(longest / length)
        reused = ", with the last tangent's factors" if self.directions.reused else ""
        size = np.sqrt(abs(r.dot(d)))
        self._log(f"              step of {size:9.3e} in the energy norm / sqrt(N mm){reused}")
        return None

    def _log(self, text):
        if self.scene.comm.rank == 0:
            log.debug("    %s", text)

    # -- for load stepping

    def memory(self) -> dict[str, Any]:
        """State for `recall` by a later solver."""
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
        """True if x is in equilibrium but for forces that move positions by rounding alone."""
        self.objective(x)
        force = self.objective.r.norm()
        return bool(force <= self.smallest * self.stiffness(x)) if force else True
