"""Newton's corrections: from a fresh tangent, or from the last one's factors."""

from petsc4py import PETSc

from ..scene.scene import Scene
from .report import Report
from .tangent import Tangent


class Directions:
    """Finds the correction for a residual.

    Near a state for which a looser tolerance is asked, the last tangent's factors will do as long
    as they gain digits. kept: whether the last correction was of these; noise: force that the
    rounding of displacements makes through the tangent [N].
    """

    DIGIT = 2.0**-52  # of the displacements: what rounding leaves of them
    # residuals, over the tolerance and over the forces of supports, that take no new tangent
    NEAR, SMALL = 300.0, 3e-3
    # share of the last residual that is left: by a fresh tangent, and by kept factors
    GAIN, GAIN_KEPT = 0.5, 0.2

    def __init__(self, scene: Scene, tangent: Tangent) -> None:
        self._scene, self._tangent = scene, tangent
        self.noise, self.kept = 0.0, False

    def find(
        self, x: PETSc.Vec, r: PETSc.Vec, d: PETSc.Vec, report: Report, loosened: float
    ) -> bool:
        """Make d the correction for the residual r at x; whether the tangent was shifted for it.
        loosened: tolerance of a state on the way, 0 of others. Raises SolveFailed."""
        shifts = report.shifts
        self.kept = self._factors_will_do(report, loosened)
        self.kept = self.kept and self._tangent.solve_with_last_factors(r, d)
        if not self.kept:
            self._scene.set(x)
            self._scene.anticipate()
            self._tangent.assemble()
            largest = x.norm(PETSc.NormType.NORM_INFINITY)
            self.noise = self.DIGIT * largest * self._tangent.stiffness_norm()
            self._tangent.solve(r, d, report)
        d.scale(-1)
        return report.shifts > shifts

    def _factors_will_do(self, report, loosened):
        if not loosened or report.iterations == 0 or report.shifts or report.cuts:
            return False
        before, now = report.residuals[-2:]
        near = min(self.NEAR * loosened, self.SMALL) * report.scale
        return now <= near and now <= (self.GAIN_KEPT if self.kept else self.GAIN) * before
