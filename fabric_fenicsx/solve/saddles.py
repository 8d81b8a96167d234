"""Saddles of the energy."""

import numpy as np
from petsc4py import PETSc

from .line_search import ROUNDING, Objective
from .progress import Report, SolveFailed, Termination
from .tangent import Tangent


class Saddles:
    """Tells saddles from minima by the tangent's negative pivots, and leaves them along a direction
    of negative curvature that depends on neither ranks nor chance. smallest: as of `Newton`."""

    MOST = 5  # to be left in one solve
    EASY = 5  # iterations, within which a solve counts as easy
    INVERSE_ITERATIONS, HALVINGS = 50, 30
    FIRST = 1e10  # of the smallest displacement, the first step down

    def __init__(self, objective: Objective, tangent: Tangent, smallest: float) -> None:
        self._objective, self._tangent, self._smallest = objective, tangent, smallest
        self._scene = objective.scene
        self._d, self._trial = (objective.r.duplicate() for _ in range(2))

    def is_here(self, x: PETSc.Vec, report: Report, on_the_way: bool = False) -> bool:
        """True if the tangent at x, where a solve has converged, has negative pivots. It is not
        factored for that if the last one of the solve had none and the state is on the way, or the
        solve was easy and no earlier tangent had any."""
        easy = report.iterations <= self.EASY and not report.cuts
        unsuspected = on_the_way or (easy and not self._tangent.negative_pivots_met)
        if (unsuspected and report.negative_pivots == 0) or not self._tangent.counts_pivots:
            return False
        self._scene.set(x)
        self._tangent.assemble()
        report.negative_pivots = self._tangent.negative_pivots()
        return report.negative_pivots > 0

    def leave(self, x: PETSc.Vec, energy: float, report: Report) -> float:
        """Move x downhill from the saddle at x; the energy there [N mm]. Raises SolveFailed."""
        report.saddles += 1
        if report.saddles > self.MOST:
            raise SolveFailed(Termination.SADDLE)
        d, trial = self._softest_direction(report), self._trial
        for _ in range(self.HALVINGS):
            for sign in (1.0, -1.0):
                x.copy(trial)
                trial.axpy(sign, d)
                energy_there = self._objective(trial)
                change = energy_there - energy
                if abs(change) <= ROUNDING * abs(energy):  # noise; the slope tells
                    change = sign * self._objective.r.dot(d)
                if change < 0:
                    trial.copy(x)
                    return energy_there
            d.scale(0.5)
        raise SolveFailed(Termination.SADDLE)

    def _softest_direction(self, report):
        """A direction of negative curvature, by inverse iteration, as long as the first step."""
        d, trial = self._d, self._trial
        d.array[:] = self._scene.blank.generic_displacement().ravel()
        d.array[self._scene.fixed_dofs] = 0
        shift, curvature = 0.0, np.inf
        for _ in range(self.INVERSE_ITERATIONS):
            d.scale(1 / d.norm())
            d.copy(trial)
            shift += self._tangent.solve(trial, d, report)
            before, curvature = curvature, 1 / d.dot(trial) - shift
            if curvature < 0 and abs(before - curvature) <= 0.1 * abs(curvature):
                break
        d.scale(self.FIRST * self._smallest / d.norm(PETSc.NormType.NORM_INFINITY))
        return d
