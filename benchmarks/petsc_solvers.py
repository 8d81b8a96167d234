"""Newton's method of the package against SNES and TAO of PETSc, with the same steps, tangents,
factors (MUMPS, LDL^T) and tolerances: `petsc_solvers.py [SCENE ...]`."""

import sys
import time
from dataclasses import replace
from functools import partial

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

import fabric_fenicsx as ff
from fabric_fenicsx.sheet.specimen import specimen
from fabric_fenicsx.solve import linear
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.progress import SolveFailed, Termination
from fabric_fenicsx.solve.stepping import LoadStepping

# the last word: line search of SNES, KSP of TAO
PETSCS = ("newtonls bt", "newtonls l2", "newtonls cp", "newtontr bt", "nls preonly", "ntr stcg")


class PetscNewton(Newton):
    """Newton with the iterations of PETSc's `solver`, up to a `deadline` of CPU [s]."""

    def __init__(self, scene, solver, deadline):
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
        is_late = time.process_time() > self._deadline or count > self.max_iterations
        return 3 if norm <= enough or count > self._most else -5 * is_late

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


def press(name, *changes, steps=20):
    return ff.Press.read(name, changes).job(balance=None, steps=steps)


def sheet(moved, *terms, width=50, nx=10, rise=0.0):
    """A sheet of 100 mm, arched by `rise`, whose ends are held; one is `moved` along x and y."""
    x, cells, kind = specimen(100.0, width, nx, round(nx * width / 100))
    x = np.column_stack([x[:, :2], rise * np.sin(np.pi * x[:, 0] / 100)])
    blank = ff.Blank.from_arrays(MPI.COMM_WORLD, x, cells, kind, spatial=True)
    fixed = ff.Support("fixed", lambda x: x[0] < 1e-6, (0, 1, 2))
    end = ff.Support("moving", lambda x: x[0] > 100 - 1e-6, (0, 1, 2), moved)
    return ff.Job(ff.Scene(blank, terms, [fixed, end]), steps=10)


fabric, soft = partial(ff.Membrane, ff.load("komeili")), partial(ff.Bending, modulus=100.0)
steel = partial(ff.SheetMetal, replace(ff.load_metal("dc04"), thickness=0.5))
pressed = partial(ff.DeadPressure, direction=(0, 0, -1))
ball = partial(ff.Tool, ff.Sphere(30, (50, 25, -30.5)), name="ball")
square = partial(ff.Blank.rectangle, 50, 50, nx=16, element="P1")
SCENES = {
    "tensile strip": lambda: ff.Tensile().job(),
    "bias strip": lambda: ff.BiasExtension().job(),
    "dome, nx 12": lambda: press("double_dome", "blank.nx=12"),
    "dome, nx 24": lambda: press("double_dome", "blank.nx=24"),
    "two plies, nx 12": lambda: press("two_plies", "nx=12"),
    "wrinkles": lambda: sheet((-2, 20), fabric(), soft()),
    "snap-through": lambda: sheet((0, 0), steel(), pressed(0.15), width=20, nx=20, rise=6),
    "slack net": lambda: sheet((0, 0), fabric(), pressed(0.01)),
    "no friction": lambda: press("double_dome", "blank.nx=6", "contact.friction=0", steps=8),
    "pressed on a ball": lambda: sheet(
        (0, 0), fabric(), soft(), ff.Contact(ball(), friction=0.25), pressed(0.005)
    ),
    "metal buckles": lambda: sheet((-2, 0), steel(), width=20, nx=12),
    "sharp tool": lambda: press("hemisphere", "blank.nx=8", "tools.punch.radius=6"),
    "E_C = 1.3": lambda: ff.Job(ff.Scene(square(), [fabric()], ff.clamped_ends(-10)), steps=10),
}


def run(name, solver, limit):
    job, deadline = SCENES[name](), time.process_time() + limit
    newton = PetscNewton(job.scene, solver, deadline) if solver else Newton(job.scene)
    factors, began = PETSc.Log.Event("MatCholFctrNum"), time.process_time()
    before = factors.getPerfInfo()["count"]
    end = LoadStepping(newton, job, stop=lambda: "late" * (time.process_time() > deadline)).run()
    row = vars(end) | {"scene": name, "solver": solver, "cpu_s": time.process_time() - began}
    row["factorisations"] = factors.getPerfInfo()["count"] - before
    newton.stiffness(job.scene.u.copy())
    row["negative_pivots"] = newton.tangent.negative_pivots()
    return row | {"force_N": job.scene.force_scale(), "energy_Nmm": job.scene.energy()}


if __name__ == "__main__":
    PETSc.Log.begin()
    for scene in sys.argv[1:] or SCENES:
        run(scene, "", 0.0)  # reads compiled code
        first = run(scene, "", np.inf)
        rows = [first, *(run(scene, solver, 3 * first["cpu_s"]) for solver in PETSCS)]
        print(*rows, sep="\n", flush=True)
