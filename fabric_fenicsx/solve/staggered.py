"""Solutions with what terms hold during a solve, repeated until it need not be taken anew."""

from petsc4py import PETSc

from .newton import Newton
from .report import Report

MOST = 30  # solutions of one step
# tolerance of solutions after which something may be taken anew: 1e-1 and 1e-2 leave more to the
# last one, 1e-3 more to those before it (double dome, 1344 cells: 589, 547, 568 iterations, 510
# with 3e-3, before `LONG`)
LOOSE = 3e-3
# tolerance of the first solution: forces of contact are then known well enough to be taken anew
# (double dome, 1344 cells: 304 tangents if it is `LOOSE`, 279 with this)
FIRST = 3e-2
# iterations in which rounding may grow to what an update notices: a solution found in more of them
# is made exact, so that ranks find the same (two plies, 12 cells: forces to 1e-4 with 15, 1e-10
# with 6)
LONG = 6


def solve_lagged(newton: Newton, x: PETSc.Vec, tolerance: float) -> tuple[Report, int]:
    """Solve for x, again and again until terms have nothing to take anew: at first to `FIRST`, to
    `LOOSE` meanwhile, in the end to `tolerance` or the solver's. Nothing is to be taken anew after
    that solution either. The last `Report`, with the iterations of the hardest solve, and the
    iterations of all.
    """
    scene, every = newton.scene, []
    asked = max(tolerance, newton.tolerance)
    now = max(asked, FIRST) if scene.is_lagged else asked
    for _ in range(MOST + 1):
        report = newton.solve_for(x, now, minimum=now == asked)
        every.append(report.iterations)
        if report.converged and now > asked and report.iterations > LONG:
            report = newton.solve_for(x, asked, minimum=False)
            every.append(report.iterations)
        report.iterations = max(every)
        if not report.converged:
            break
        updated = scene.update_lagged()
        if not updated and now == asked:
            break
        now = max(asked, LOOSE) if updated else asked
    else:
        report.object(f"contact did not settle in {MOST} solutions")
    return report, sum(every)
