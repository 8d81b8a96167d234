"""Line search along a correction, and the function that it lowers."""

from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from ..scene.scene import Scene
from .progress import Report, SolveFailed, Termination

ROUNDING = 1e-12  # of the energy, below which its differences are noise


class Objective:
    """Energy of a scene at fixed supports; `r`: its gradient, where asked last [N]."""

    INVERTED = Scene.INVERTED  # the energy where a cell is turned inside out

    def __init__(self, scene: Scene) -> None:
        self.scene, self.r = scene, scene.u.duplicate()

    def __call__(self, x: PETSc.Vec) -> float:
        """Energy at x [N mm]."""
        self.scene.set(x)
        self.scene.residual(self.r)
        return self.scene.energy()


class Point(NamedTuple):
    """A state along the correction: its length, in corrections; energy [N mm] and slope of the
    energy [N mm per correction] there."""

    length: float
    energy: float
    slope: float


class LineSearch:
    """Goes along a correction to where the energy is less, and its slope small.

    The energy is piecewise smooth with kinks in its slope, where a parabola through energies
    misleads. Its slope, the residual along the correction, is continuous, so the end is bracketed
    by the slope's sign. Where energies differ by rounding alone the slope decides.
    """

    def __init__(self, objective: Objective) -> None:
        self._objective, self._trial = objective, objective.r.duplicate()

    def __call__(self, x: PETSc.Vec, energy: float, d: PETSc.Vec, report: Report) -> float:
        """Move x along d; the energy there [N mm]. energy: at x, evaluated last. Counts cuts in the
        report. Raises SolveFailed where no state is good enough."""
        start = Point(0.0, energy, self._objective.r.dot(d))
        if not start.slope < 0:  # only solvers that do not count negative pivots get here
            raise SolveFailed(Termination.LINE_SEARCH)
        low, high, length, met_inverted = start, None, 1.0, False
        while True:
            here = self._evaluate(x, d, length)
            met_inverted |= here.energy == Objective.INVERTED
            fell = _fell(here, start)
            is_flat = abs(here.slope) <= -0.7 * start.slope
            if is_flat and (fell or _within_rounding(start)):
                break
            if not (fell and here.slope < 0):
                high = here
            elif high is not None:
                low = here
            elif length < 8:  # still downhill
                low, length = here, 2 * length
                continue
            else:
                break
            report.cuts += 1
            length = _between(low, high)
            if high.length - low.length <= 1e-9:
                raise SolveFailed(Termination.INVERTED if met_inverted else Termination.LINE_SEARCH)
        self._trial.copy(x)
        return here.energy

    def _evaluate(self, x, d, length):
        x.copy(self._trial)
        self._trial.axpy(length, d)
        energy = self._objective(self._trial)
        slope = self._objective.r.dot(d) if energy != Objective.INVERTED else np.nan
        return Point(length, energy, slope)


def _fell(here, start):
    """Less energy than at the start; within rounding, as the slope tells."""
    if _within_rounding(start):
        return here.energy != Objective.INVERTED and here.slope < 0
    return here.energy < start.energy


def _within_rounding(start):
    return -start.slope <= ROUNDING * abs(start.energy)


def _between(low, high):
    """A length between two points: where the slope would be 0 if it were linear, or the middle."""
    a, b, rise = low.length, high.length, high.slope - low.slope
    known = np.isfinite(high.slope) and high.slope > 0
    inside = a - low.slope * (b - a) / rise if known else 0.5 * (a + b)
    return float(np.clip(inside, a + 0.1 * (b - a), b - 0.1 * (b - a)))
