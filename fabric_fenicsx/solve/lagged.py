"""Solutions with what terms hold during a solve, repeated until it need not be taken anew."""

from petsc4py import PETSc

from .judges import upset_objection
from .newton import Newton
from .report import Report

MOST = 30  # solutions of one step


def solve_lagged(
    newton: Newton, x: PETSc.Vec, tolerance: float, moving: bool
) -> tuple[Report, int]:
    """Solve for x, again and again until terms have nothing to take anew: to the tolerance that
    they ask meanwhile, in the end to `tolerance` or the solver's.

    moving: whether the load changes; an update may then not upset the scene. The last `Report`,
    with the iterations of the hardest solve, and the iterations of all.
    """
    scene, every = newton.scene, []
    asked = max(tolerance, newton.tolerance)
    now = max(asked, scene.loose_tolerance)
    for _ in range(MOST + 1):
        report = newton.solve_for(x, now, minimum=now == asked)
        every.append(report.iterations)
        report.iterations = max(every)
        if not report.converged:
            break
        if not scene.update_lagged():
            if now == asked:
                break
            now = asked
        elif moving and (objection := upset_objection(scene, x)):
            report.object(objection)
            break
    else:
        report.object(f"contact was not settled by {MOST} solutions")
    return report, sum(every)
