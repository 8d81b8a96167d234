"""What a solve cost and how it ended."""

from dataclasses import dataclass, field


@dataclass
class Report:
    """How a solve ended: `residuals` are norms over the free degrees of freedom [N], one before
    each iteration and one at the end, `scale` the force [N] they are measured by; `negative_pivots`
    those of the last tangent (None for solvers that do not tell); `saddles` those that were left:
    there the path branches."""

    converged: bool = False
    reason: str = ""
    iterations: int = 0
    shifts: int = 0
    cuts: int = 0
    negative_pivots: int | None = None
    saddles: int = 0
    scale: float = 0.0
    residuals: list[float] = field(default_factory=list)

    def object(self, objection: str) -> None:
        """Note why the solution is not accepted after all; "" is no objection."""
        if objection:
            self.converged, self.reason = False, objection
