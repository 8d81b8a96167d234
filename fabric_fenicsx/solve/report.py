"""The course of a solve and why it ended."""

from dataclasses import dataclass, field
from enum import Enum


class Termination(Enum):
    """Reasons for which Newton's method ends."""

    RESIDUAL = "converged: residual below the tolerance"
    ROUNDING = "converged: what force is left is rounding"
    CORRECTION = "converged: the correction is below the rounding of positions"
    MOST = "ended: as many iterations as were asked for"
    ITERATIONS = "no convergence within the allowed iterations"
    LINEAR_SOLVER = "the linear solver failed"
    LINE_SEARCH = "the line search found no state of lower energy"
    NO_NUMBER = "the energy, its forces or its tangent are not a number"
    INVERTED = "a cell is turned inside out"
    SADDLE = "the state is a saddle of the energy that could not be left"


class SolveFailed(Exception):
    """A `Termination` without a solution, raised within the iteration."""

    def __init__(self, end: Termination, detail: str = "") -> None:
        super().__init__(f"{end.value} ({detail})" if detail else end.value)


@dataclass
class Report:
    """Result of a solve.

    - cuts: of the line search; shifts: of tangents that were not positive definite
    - negative_pivots: of the last tangent, None from solvers that do not count them
    - saddles: those that were left, where the path branches
    - residuals: norms over the free degrees of freedom [N], before each iteration and at the end;
      scale: the force [N] that they are compared with
    """

    converged: bool = False
    reason: str = ""
    iterations: int = 0
    shifts: int = 0
    cuts: int = 0
    negative_pivots: int | None = None
    saddles: int = 0
    scale: float = 0.0
    residuals: list[float] = field(default_factory=list)

    def reject(self, reason: str) -> None:
        """Refuse the solution for this reason, "" for none."""
        if reason:
            self.converged, self.reason = False, reason
