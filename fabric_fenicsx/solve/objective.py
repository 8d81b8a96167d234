"""The function that Newton's method minimises."""

from petsc4py import PETSc

from ..scene.scene import Scene


class Objective:
    """Energy of a scene at fixed supports; `r`: its gradient, the residual, at the displacement
    evaluated last [N]."""

    INVERTED = Scene.INVERTED  # the energy where a cell is turned inside out

    def __init__(self, scene: Scene) -> None:
        self.scene, self.r = scene, scene.u.duplicate()

    def __call__(self, x: PETSc.Vec) -> float:
        """Energy at x [N mm]."""
        self.scene.set(x)
        self.scene.residual(self.r)
        return self.scene.energy()
