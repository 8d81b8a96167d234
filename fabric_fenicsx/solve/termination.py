"""Why a solve ended, in words."""

from enum import Enum


class End(Enum):
    """How Newton's method ends; the value says it in words."""

    RESIDUAL = "converged: residual below the tolerance"
    ROUNDING = "converged: what force is left is rounding"
    CORRECTION = "converged: the correction is below the rounding of positions"
    ITERATIONS = "no convergence within the allowed iterations"
    LINEAR_SOLVER = "the linear solver failed"
    LINE_SEARCH = "the line search found no state of lower energy"
    NO_NUMBER = "the energy, its forces or its tangent are not a number"
    INVERTED = "a cell is turned inside out"
    SADDLE = "the state is a saddle of the energy that could not be left"


class SolveFailed(Exception):
    """Carries an `End`, and what is known besides in words, out of the iteration."""

    def __init__(self, end: End, detail: str = "") -> None:
        super().__init__(f"{end.value} ({detail})" if detail else end.value)
