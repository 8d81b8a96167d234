"""The course of a solve, why it ended, and the state of load stepping with its regularisation."""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from petsc4py import PETSc


class Termination(Enum):
    """Reasons for which Newton's method ends."""

    RESIDUAL = "converged: residual below the tolerance"
    ROUNDING = "converged: the residual force is rounding"
    CORRECTION = "converged: the correction is below the rounding of positions"
    MOST = "ended: requested number of iterations"
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


@dataclass
class Viscosity:
    """Drag on every node [N/mm per step], relative to the mean `stiffness` of one [N/mm], and the
    energy that it took [N mm]. It is weakened after `easy_steps_asked` uncut steps in a row, a
    number that each failure doubles."""

    drag: float = 0.0
    energy: float = 0.0
    stiffness: float = 0.0
    easy_steps: int = 0
    easy_steps_asked: int = 1
    WEAK, STRONG = 1e-7, 1e-1  # drags, of the mean stiffness of a node

    def strengthen(self) -> bool:
        """Go one stage up; False if the drag is as strong as allowed."""
        if self.drag >= self.STRONG * self.stiffness:
            return False
        if self.drag:
            self.easy_steps_asked = min(2 * self.easy_steps_asked, 16)
        self.drag, self.easy_steps = max(self.WEAK * self.stiffness, 10 * self.drag), 0
        return True

    def note_accepted(self, uncut: bool, at_rest: bool) -> None:
        """Count an accepted step, and weaken the drag if it is due; at rest it always is."""
        if not self.drag:
            return
        self.easy_steps = self.easy_steps + 1 if uncut else 0
        if at_rest or self.easy_steps >= self.easy_steps_asked:
            self.drag = self.drag / 4 if self.drag > self.WEAK * self.stiffness else 0.0
            self.easy_steps = 0


@dataclass
class Progress:
    """The last accepted state, complete for stepping to go on from it.

    - x, previous: displacement and the one before it, own copies [mm]
    - load: factor; step: size of the next load step; last_step: of the one before, None before the
      first
    - work: of supports, loads and tools so far; stored: sum of the energies [N mm]
    - memory, solver: memories of scene and solver
    - accepted, rejected: steps; iterations: of all solves
    """

    x: PETSc.Vec
    previous: PETSc.Vec
    step: float
    load: float = 0.0
    last_step: float | None = None
    work: float = 0.0
    stored: float = 0.0
    viscosity: Viscosity = field(default_factory=Viscosity)
    memory: dict[str, np.ndarray] = field(default_factory=dict)
    solver: dict[str, float] = field(default_factory=dict)
    accepted: int = 0
    rejected: int = 0
    iterations: int = 0


@dataclass(frozen=True)
class Accepted:
    """An accepted state: load factor, energies by kind (with "viscous", what drag took so far) and
    external work [N mm], the report of its hardest solve, cuts of the step before it was accepted,
    seconds since the last accepted state."""

    load: float
    energies: dict[str, float]
    external_work: float
    report: Report
    cuts: int
    wall: float
    progress: Progress


@dataclass(frozen=True)
class Outcome:
    """End of load stepping: the load factor `reached` and, if that is below 1 or the state there is
    not at rest, the reason; steps and iterations, with those of the run that was resumed."""

    reached: float
    reason: str
    accepted: int
    rejected: int
    iterations: int
