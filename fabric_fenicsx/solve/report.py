"""How a solve ended, in numbers and words."""

from dataclasses import dataclass, field

from petsc4py import PETSc

from .. import dolfinx_compat as compat

Reason = PETSc.SNES.ConvergedReason
SNES_WORDS = {
    Reason.CONVERGED_FNORM_ABS: "converged: what force is left is rounding",
    Reason.CONVERGED_FNORM_RELATIVE: "converged: residual below the tolerance",
    Reason.CONVERGED_SNORM_RELATIVE: "converged: the correction is below the rounding of positions",
    Reason.DIVERGED_MAX_IT: "no convergence within the allowed iterations",
    Reason.DIVERGED_LINEAR_SOLVE: "the linear solver failed",
    Reason.DIVERGED_LINE_SEARCH: "the line search found no state of lower energy",
    compat.DIVERGED_NAN: "the energy, its forces or its tangent are not a number",
    Reason.DIVERGED_FUNCTION_DOMAIN: "a cell is turned inside out",
    Reason.DIVERGED_LOCAL_MIN: "the state is a saddle of the energy that could not be left",
}
KSP_WORDS = {
    value: name.lower().replace("_", " ").replace("diverged ", "")
    for name, value in vars(PETSc.KSP.ConvergedReason).items()
    if isinstance(value, int)
}


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
