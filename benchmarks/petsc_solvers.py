"""Newton's method of the package against SNES and TAO of PETSc, with the same steps, tangents,
factors (MUMPS, LDL^T) and tolerances: `petsc_solvers.py [CASE ...]`, hard ones and presses."""

import sys
import time
from functools import partial

import numpy as np
from bench.hard import Case, Run, Setting, line
from bench.hard_table import CASES
from mpi4py import MPI
from petsc4py import PETSc

import fabric_fenicsx as ff
from fabric_fenicsx.solve import linear
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.progress import SolveFailed, Termination

# the last word: line search of SNES, KSP of TAO
PETSCS = ("newtonls bt", "newtonls l2", "newtonls cp", "newtontr bt", "nls preonly", "ntr stcg")


class PetscNewton(Newton):
    """Newton with iterations of PETSc's `solver`; TimeoutError after a `deadline` of CPU [s]."""

    def __init__(self, scene, solver, deadline=np.inf):
        super().__init__(scene)
        self._kind, self._how = solver.split()
        self._deadline, self._matrix, self._last = deadline, None, self.x.duplicate()

    def _evaluate(self, _, x, r=None):
        if not self.report.residuals or not np.array_equal(x.array_r, self._last.array_r):
            self._energy = self.objective(x)
            x.copy(self._last)
        if r:
            self.objective.r.copy(r)
        return self._energy

    def _tangent(self, _, x, A, P):
        self._evaluate(_, x)
        if self.report.residuals[-1] > self.directions.CLOSE * self.report.scale:
            self.scene.use_secant_stiffness()
        self.scene.tangent(A)
        rounding = self.directions.EPSILON * x.norm(PETSc.NormType.NORM_INFINITY)
        self.directions.noise = rounding * A.getDiagonal().norm()

    def _end(self, norm):
        """Reason to end, which SNES and TAO number alike, by the package's criteria."""
        report, scale = self.report, self.scene.force_scale()
        report.residuals.append(norm)
        report.scale, count = scale, len(report.residuals)
        enough = max(self._enough * scale, self._fall * report.residuals[0], self.directions.noise)
        return 3 if norm <= enough or count > self._most else -5 * (count > self.max_iterations)

    def _make(self, A):
        is_tao = self._kind in ("nls", "ntr")
        self._matrix, self._solver = A, (PETSc.TAO if is_tao else PETSc.SNES)().create()
        self._solver.setType(self._kind)
        if is_tao:
            self._solver.setObjectiveGradient(self._evaluate, self.x.duplicate())
            self._solver.setHessian(self._tangent, A, A)
            test = lambda t: t.setConvergedReason(self._end(t.getSolutionStatus()[2]))  # noqa: E731
            self._solver.setConvergenceTest(test)
        else:
            self._solver.setObjective(self._evaluate)
            self._solver.setFunction(self._evaluate, self.x.duplicate())
            self._solver.setJacobian(self._tangent, A, A)
            self._solver.setConvergenceTest(lambda _, i, norms: self._end(norms[2]))
            PETSc.Options()["snes_linesearch_type"] = self._how
        self._solver.setFromOptions()
        ksp = self._solver.getKSP()
        ksp.setOptionsPrefix(linear.PREFIX)
        linear.configure(ksp, A, "mumps-cholesky")
        if is_tao:
            ksp.setType(self._how)

    def _iterate(self, x, tolerance, minimum):
        self._enough = tolerance
        if time.process_time() > self._deadline:
            raise TimeoutError
        if self.scene.places_changed():
            self.tangent.assemble()
        if self._matrix is not self.tangent.A:
            self._make(self.tangent.A)
        self._solver.solve(*(x,) if self._kind in ("nls", "ntr") else (None, x))
        self.report.iterations = self._solver.getIterationNumber()
        self.objective(x)
        if (reason := self._solver.getConvergedReason()) < 0:
            raise SolveFailed(Termination.LINE_SEARCH, str(reason))
        return Termination.RESIDUAL


def press(words):
    """A case of a shipped press with changes, in 20 steps."""

    def case(setting):
        name, *changes = words.split()
        return [setting.press(ff.Press.read(name, changes), balance=None, steps=20)[0]], []

    case.__doc__ = words
    return Case(words, case, 1_000)


PRESSES = "double_dome blank.nx=12", "double_dome blank.nx=24", "two_plies nx=12"
CASES |= {words: press(words) for words in (*PRESSES, "hemisphere blank.nx=8 tools.punch.radius=6")}


if __name__ == "__main__":
    setting = Setting(MPI.COMM_WORLD, ff.load("komeili"))
    for name in sys.argv[1:] or CASES:
        Run.Solver = Newton
        CASES[name].judge(setting)  # reads compiled code
        print(line(own := CASES[name].judge(setting)), flush=True)
        for solver in PETSCS:
            deadline = time.process_time() + 3 * own["cpu_s"]
            Run.Solver = partial(PetscNewton, solver=solver, deadline=deadline)
            try:
                print(solver, line(CASES[name].judge(setting)), sep="\n", flush=True)
            except TimeoutError:
                print(solver, "takes more than three times as long", flush=True)
