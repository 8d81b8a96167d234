"""Solution of a step: its prediction, and solves until what terms lag is settled."""

import numpy as np
from petsc4py import PETSc

from ..scene.scene import Scene
from .newton import Newton
from .progress import Progress, Report, SolveFailed

MAX_SOLVES = 30  # solves of one step
# tolerance of solves after which something may be updated: 3e-3, 1e-3 and 2e-4 take 300, 313, 381
# iterations over the double dome at 0/90, and 695, 633, 748 at +-45 deg (without that tenth)
LOOSE_TOLERANCE = 1e-3
# tolerance of the first solve: forces of contact are then known well enough to be updated (double
# dome, 1344 cells: 304 tangents if it is `LOOSE_TOLERANCE`, 279 with this)
FIRST_TOLERANCE = 3e-2
# iterations in which rounding may grow to what an update notices: a solution found in more of them
# is made exact, so that ranks find the same (two plies, 12 cells: forces to 1e-4 with 15, 1e-7
# with 8), if twice as many are enough and there is friction, by which states hang on the path
MAX_ROUGH_ITERATIONS = 8


def predict(newton: Newton, progress: Progress, size: float, values: np.ndarray) -> None:
    """Make `newton.x` the start of a step of load factor `size`, with the supports' `values` (fixed
    dofs,) [mm]: the last step continued, or the linear response if that turns cells inside out."""
    scene, x = newton.scene, newton.x
    progress.x.copy(x)
    if size and progress.last_step:
        share = size / progress.last_step
        x.axpby(-share, 1 + share, progress.previous)
        x.array[scene.fixed_dofs] = values
        scene.set(x)
        if scene.energy() != scene.INVERTED:
            return
        progress.x.copy(x)
    if size:
        _follow_supports(newton, x, values - x.array[scene.fixed_dofs])


def keep_contact(scene: Scene, x: PETSc.Vec) -> bool:
    """Move nodes of the prediction x out of tools; False if that does not lower the energy."""
    scene.set(x)
    energy, motion = scene.energy(), scene.contact_prediction()
    x.array[:] += motion
    scene.set(x)
    return scene.energy() < energy


def _follow_supports(newton, x, change):
    """Add to x its linear response to a `change` (fixed dofs,) [mm] of the supports."""
    scene, tangent, d, rhs = newton.scene, newton.tangent, x.duplicate(), x.duplicate()
    scene.set(x)
    d.set(0)
    d.array[scene.fixed_dofs] = change
    tangent.assemble(with_supports=False)
    tangent.A.mult(d, rhs)
    rhs.scale(-1)
    rhs.array[scene.fixed_dofs] = change
    tangent.assemble()
    try:
        tangent.stiffness_norm()
        tangent.solve(rhs, d, Report())
    except SolveFailed:
        d.set(0)  # the supports alone move; the iterations that follow say what is wrong
    d.array[scene.fixed_dofs] = change
    x.axpy(1.0, d)


def solve_staggered(
    newton: Newton, x: PETSc.Vec, tolerance: float, near: bool = False
) -> tuple[Report, int]:
    """Solve for x until terms have nothing to update: first to `FIRST_TOLERANCE`, then to
    `LOOSE_TOLERANCE` or a tenth of the residual that an update left, in the end to `tolerance` or
    the solver's, and nothing is to be updated after that either. near: x is all but the solution,
    so that the first solve is exact: a loose one would end at once, or not, by rounding. Returns
    the last `Report`, with the iterations of the hardest solve, and those of all."""
    scene, every = newton.scene, []
    asked = max(tolerance, newton.tolerance)
    now = max(asked, FIRST_TOLERANCE) if scene.has_lagged_terms and not near else asked
    fall, rubs = 0.0, any(getattr(term, "coulomb", None) for term in scene.terms)
    for _ in range(MAX_SOLVES + 1):
        report = newton.solve(x, now, fall, minimum=now == asked)
        every.append(report.iterations)
        if rubs and report.converged and now > asked and report.iterations > MAX_ROUGH_ITERATIONS:
            report = newton.solve(x, asked, minimum=False, most=2 * report.iterations)
            every.append(report.iterations)
        report.iterations = max(every)
        if not report.converged:
            break
        updated = scene.update_lagged()
        if not (updated or fall) and now == asked:
            break
        now, fall = (max(asked, LOOSE_TOLERANCE), 0.1) if updated else (asked, 0.0)
    else:
        report.reject(f"contact did not converge in {MAX_SOLVES} solves")
    return report, sum(every)
