"""The narrow tangent: a preconditioner of which the factors cost less than those of the tangent."""

from petsc4py import PETSc

from ..runtime.timing import phase
from ..scene.scene import Scene
from . import linear
from .report import Report
from .tangent import Tangent


class NarrowTangent:
    """Solver of A d = rhs by conjugate gradients, with the factors of a tangent with fewer places.

    A itself is not assembled. It is taken as positive definite, so that a state found with it is to
    be verified by A's own factors.
    """

    UNKNOWNS = 2000  # of fewer, factors cost too little (double dome: nx 24 has 2217)
    FEWER = 0.7  # share of A's places, from which on its factors do not pay
    REDUCTION = 1e-2  # of the error in the energy norm
    MOST = 12  # conjugate gradients, which cost as much as the factors that they spare

    def __init__(self, scene: Scene, tangent: Tangent) -> None:
        self._scene, self._tangent = scene, tangent
        self._ksp: PETSc.KSP = None
        self._pays = False

    def solve(self, rhs: PETSc.Vec, d: PETSc.Vec, report: Report) -> bool:
        """Solve at the scene's present state; False if that does not pay, or fails."""
        is_small = self._tangent.A.size[0] < self.UNKNOWNS
        if is_small or not self._tangent.counts_pivots or self._scene.compliances():
            return False
        if self._ksp is None or self._scene.places_changed(narrow=True):
            self._make()
        if not self._pays:
            return False
        self._scene.tangent(self._P, narrow=True)
        report.negative_pivots = None  # of A are not known
        self._ksp.setOperators(self._A, self._P)
        solved = self.solve_with_last_factors(rhs, d)
        had_memory = linear.had_memory(self._ksp.pc)
        return had_memory and solved and not any(linear.inertia(self._ksp.pc))

    @phase("linear_solve")
    def solve_with_last_factors(self, rhs: PETSc.Vec, d: PETSc.Vec) -> bool:
        """Solve with the tangent and the factors of the last solve; False if that fails."""
        self._ksp.solve(rhs, d)
        return self._ksp.getConvergedReason() > 0

    def _make(self):
        self._P = self._scene.create_matrix(narrow=True)
        sizes = self._P.getSizes()
        self._A = PETSc.Mat().createPython([sizes[0], sizes[1]], self, comm=self._P.comm)
        self._A.setUp()
        self._ksp = linear.conjugate_gradients(self._A, self._P, self.REDUCTION, self.MOST)
        kind = PETSc.Mat.InfoType.GLOBAL_SUM
        few, all_of_them = (A.getInfo(kind)["nz_used"] for A in (self._P, self._tangent.A))
        self._pays = few <= self.FEWER * all_of_them

    def mult(self, _: PETSc.Mat, v: PETSc.Vec, f: PETSc.Vec) -> None:
        """Make f = A v, as PETSc asks for it."""
        self._P.mult(v, f)
        self._scene.add_beyond(v, f)
