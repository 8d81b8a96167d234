"""Newton's method on a scene's energy."""

import logging

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..scene.scene import Scene
from .line_search import LineSearch, Objective
from .progress import Report, SolveFailed, Termination
from .saddles import Saddles
from .tangent import Preconditioner, Tangent

log = logging.getLogger(__name__)


class Directions:
    """Solver of K d = -r.

    Where a looser tolerance is enough, the narrow tangent is solved with if that pays, and near the
    end the last factors are used as long as they reduce the residual fast. reused: whether they
    were, for the last correction; noise: force that the rounding of displacements makes through the
    tangent [N].
    """

    EPSILON = 2.0**-52  # rounding of displacements
    # residuals, over the tolerance and over the forces on the sheet, that need no new tangent
    NEAR, SMALL = 300.0, 3e-3
    # residual over the forces on the sheet, below which tangents are exact and the end is quadratic
    CLOSE = 1e-3
    # required reduction of the residual: after a fresh tangent, and with reused factors
    GAIN, GAIN_REUSED = 0.5, 0.2

    def __init__(self, scene: Scene, tangent: Tangent) -> None:
        self._scene, self._tangent = scene, tangent
        self._narrow = Preconditioner(scene, tangent)
        self._last: Tangent | Preconditioner = tangent
        self.noise, self.reused = 0.0, False

    def find(
        self, x: PETSc.Vec, r: PETSc.Vec, d: PETSc.Vec, report: Report, loosened: float
    ) -> bool:
        """Make d the correction for the residual r at x; True if the tangent had to be shifted.
        loosened: tolerance if that is looser than the solver's, else 0. Raises SolveFailed."""
        shifts = report.shifts
        self.reused = self._factors_will_do(report, loosened)
        self.reused = self.reused and self._last.solve_with_last_factors(r, d)
        if not self.reused:
            self._scene.set(x)
            if report.residuals[-1] > self.CLOSE * report.scale:
                self._scene.use_secant_stiffness()
            self._last = self._narrow if loosened else self._tangent
            if self._last is self._narrow and not self._narrow.solve(r, d, report):
                self._last = self._tangent
            if self._last is self._tangent:
                self._tangent.assemble()
                largest = x.norm(PETSc.NormType.NORM_INFINITY)
                self.noise = self.EPSILON * largest * self._tangent.stiffness_norm()
                self._tangent.solve(r, d, report)
        d.scale(-1)
        return report.shifts > shifts

    def _factors_will_do(self, report, loosened):
        if not loosened or report.iterations == 0 or report.shifts or report.cuts:
            return False
        before, now = report.residuals[-2:]
        near = min(self.NEAR * loosened, self.SMALL) * report.scale
        return now <= near and now <= (self.GAIN_REUSED if self.reused else self.GAIN) * before


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
        self._size = scene.blank.diameter()
        self.x, self._d = scene.u.duplicate(), scene.u.duplicate()
        self.objective = Objective(scene)
        self.tangent = Tangent(scene, linear_solver)
        self.directions = Directions(scene, self.tangent)
        self.line_search = LineSearch(self.objective)
        self.saddles = Saddles(self.objective, self.tangent, self.smallest)
        # of the solve under way, or of the last one
        self.report, self._fall, self._most = Report(), 0.0, np.inf

    @property
    def smallest(self) -> float:
        """Displacement that counts as 0 [mm]."""
        return self.RESOLUTION * self._size

    def solve(
        self,
        x: PETSc.Vec,
        tolerance: float = 0.0,
        fall: float = 0.0,
        minimum: bool = True,
        most: float = np.inf,
    ) -> Report:
        """Solve from x, at which supports have their values, and overwrite it by the solution.
        tolerance: counts if it is looser than the solver's; fall: share of the first residual that
        is enough; minimum: leave saddles; most: iterations after which any state is enough."""
        self.report, self._fall, self._most = Report(), fall, most
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
                energy = self.line_search(x, energy, self._d, self.report)
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
        enough = max(tolerance * report.scale, self._fall * report.residuals[0])
        if norm <= enough:
            return Termination.RESIDUAL
        return Termination.MOST if report.iterations >= self._most else None

    def _find_direction(self, x, tolerance):
        """Find the next correction d; termination if it is too small to count, else None."""
        report, r, d = self.report, self.objective.r, self._d
        if report.iterations == self.max_iterations:
            raise SolveFailed(Termination.ITERATIONS)
        loosened = tolerance if tolerance > self.tolerance else 0.0
        shifted = self.directions.find(x, r, d, report, loosened)
        length, longest = self._longest(d), self.LONGEST * self._size
        if not (shifted or length > self.smallest):
            return Termination.CORRECTION
        if length > longest:
            d.scale(longest / length)
        reused = ", with the last tangent's factors" if self.directions.reused else ""
        size = np.sqrt(abs(r.dot(d)))
        self._log(f"              step of {size:9.3e} in the energy norm / sqrt(N mm){reused}")
        return None

    def _longest(self, d):
        moved = d.array_r.reshape(-1, self.scene.blank.mesh.geometry.dim)
        squares = np.einsum("ij,ij->i", moved, moved)
        return self.scene.comm.allreduce(np.sqrt(squares.max(initial=0.0)), MPI.MAX)

    def _log(self, text):
        if self.scene.comm.rank == 0:
            log.debug("    %s", text)

    def memory(self) -> dict[str, float]:
        """State for `recall` by a later solver."""
        tangent = self.tangent
        return {"negative_pivots_met": tangent.negative_pivots_met, "shift": tangent.shift}

    def recall(self, memory: dict[str, float]) -> None:
        """Take over the `memory` of another solver."""
        self.tangent.negative_pivots_met = bool(memory["negative_pivots_met"])
        self.tangent.shift = memory["shift"]

    def stiffness(self, x: PETSc.Vec) -> float:
        """Mean diagonal of the tangent at x [N/mm]."""
        self.scene.set(x)
        self.tangent.assemble()
        return self.tangent.A.getDiagonal().sum() / self.tangent.A.size[0]

    def is_at_rest(self, x: PETSc.Vec) -> bool:
        """True if x is in equilibrium but for forces that move positions by rounding alone."""
        self.objective(x)
        force = self.objective.r.norm()
        return bool(force <= self.smallest * self.stiffness(x)) if force else True
