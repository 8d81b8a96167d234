"""Options of the solver, each declared once with default, rule and help."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field

from ..core.fields import check_fields, choice, documented, flag, quantity
from ..core.rules import COUNT, POSITIVE, Rule
from .limits import Limits
from .linear import LINEAR_SOLVERS

LOAD_FACTOR = Rule("a load factor above 0 and up to 1", lambda v: 0 < v <= 1)
BELOW_ONE = Rule("a number above 0 and below 1", lambda v: 0 < v < 1)


@documented
@dataclass(frozen=True, kw_only=True)
class Settings:
    """Options of load stepping and Newton's method, for `Job`, the command line and stepping alike.

    - steps: the first load step is 1/steps. A step that fails is halved; one that passes uncut lets
      the next grow, up to max_step
    - viscosity: the drag is strengthened until a step passes, and weakened in those that follow, at
      full load in steps without load: the last state is in equilibrium without it
    - accuracy: for scenes that depend on the path; steps beyond twice that are cut
    - milestones: load factors to be hit exactly
    """

    steps: int = quantity(20, COUNT, "load steps", "solver")
    max_step: float | None = quantity(None, LOAD_FACTOR, "largest load step (1/steps)", "solver")
    tolerance: float = quantity(
        1e-8, BELOW_ONE, "residual of the last state, relative to the forces on the sheet", "solver"
    )
    path_tolerance: float | None = quantity(
        1e-4, BELOW_ONE, "residual of states before full load and milestones", "solver"
    )
    viscosity: str = choice(
        "auto", ("auto", "off"), "auto: viscous drag on the nodes for steps that fail", "solver"
    )
    accuracy: float | None = quantity(
        None,
        POSITIVE,
        "distance of a state from the linear extrapolation of the path, over the displacement",
        "solver",
    )
    balance: float | None = quantity(
        None,
        POSITIVE,
        "share of a step's work that may be missing from the energies; else it is halved",
        "solver",
    )
    linear_solver: str = choice(
        "mumps-cholesky", tuple(LINEAR_SOLVERS), "solver of the linear systems", "solver"
    )
    every: int = quantity(5, COUNT, "accepted steps between states written for ParaView", "output")
    stop_when_invalid: bool = flag(
        "end at the step where fabric is sheared, shortened or filled beyond its limits", "solver"
    )
    limits: Limits = field(default_factory=Limits)
    milestones: Sequence[float] = ()

    def __post_init__(self) -> None:
        check_fields(self)
        for each in self.milestones:
            LOAD_FACTOR.check("one of `milestones`", each)

    def coarser_settings(self, fewer: int = 2) -> "Settings":
        """Settings for a coarser mesh, with `fewer` times fewer steps, at least 2."""
        path, limits = self.path_tolerance, dataclasses.asdict(self.limits)
        looser = 4.0  # a mesh twice as coarse is off by as much
        own = {f.name: getattr(self, f.name) for f in dataclasses.fields(Settings)}
        return dataclasses.replace(
            Settings(**own),
            steps=max(2, -(-self.steps // fewer)),
            max_step=self.max_step and min(1.0, fewer * self.max_step),
            path_tolerance=path and min(1e-1, looser * path),
            accuracy=self.accuracy and 2 * self.accuracy,
            balance=self.balance and 2 * self.balance,
            limits=Limits(**{name: looser * limit for name, limit in limits.items()}),
        )

    @property
    def largest_step(self) -> float:
        """Load factor."""
        return self.max_step or 1.0 / self.steps
