"""Directions of Newton's method: from a fresh tangent, or from the factors of the last one."""

from petsc4py import PETSc

from ..scene.scene import Scene
from .report import Report
from .tangent import Tangent


class Directions:
    """Solver of K d = -r.

    Near a state for which a looser tolerance is enough, the last tangent's factors are used as long
    as they reduce the residual fast. reused: whether they were, for the last correction; noise:
    force that the rounding of displacements makes through the tangent [N].
    """

    EPSILON = 2.0**-52  # rounding of displacements
    # residuals, over the tolerance and over the forces on the sheet, that need no new tangent
    NEAR, SMALL = 300.0, 3e-3
    # required reduction of the residual: after a fresh tangent, and with reused factors
    GAIN, GAIN_REUSED = 0.5, 0.2

    def __init__(self, scene: Scene, tangent: Tangent) -> None:
        self._scene, self._tangent = scene, tangent
        self.noise, self.reused = 0.0, False

    def find(
        self, x: PETSc.Vec, r: PETSc.Vec, d: PETSc.Vec, report: Report, loosened: float
    ) -> bool:
        """Make d the correction for the residual r at x; True if the tangent had to be shifted.
        loosened: tolerance if that is looser than the solver's, else 0. Raises SolveFailed."""
        shifts = report.shifts
        self.reused = self._factors_will_do(report, loosened)
        self.reused = self.reused and self._tangent.solve_with_last_factors(r, d)
        if not self.reused:
            self._scene.set(x)
            self._scene.anticipate()
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
