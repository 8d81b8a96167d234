"""A parameter of a fit: determined by data, or assumed."""

from dataclasses import dataclass

from .problem import unit_of


@dataclass(frozen=True)
class Determined:
    """A fitted parameter: value, standard error and 95 % interval (t-distribution, from the
    linearised joint fit, bounds not applied; upwards that of c is at least as wide in its
    logarithm), all in `unit`; two_stage: its value before the joint fit; weak: the interval is
    wider than +-100 %; at_bound: a bound from physics holds it, so the interval is a rough guide.
    """

    value: float
    standard_error: float
    interval: tuple[float, float]
    unit: str
    two_stage: float
    weak: bool
    at_bound: bool


@dataclass(frozen=True)
class Assumed:
    """A parameter that was not fitted: value in `unit`, where that is from, and why the data don't
    determine it.

    moves: changes of fitted parameters, in their units, if this one were 10 % larger. Only those
    beyond half the width of their intervals are listed: the intervals hold for the assumed values.
    """

    value: float
    unit: str
    source: str
    reason: str
    moves: dict[str, float]

    def __str__(self) -> str:
        moves = [f"{n} by {v:+.3g} {unit_of(n)}".removesuffix(" -") for n, v in self.moves.items()]
        more = f"; 10 % more of it moves {', '.join(moves)}" if moves else ""
        return f"assumed ({self.source}): {self.reason}{more}"
