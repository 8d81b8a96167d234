"""A scene's energy as Newton's method sees it: a function of the displacement."""

from petsc4py import PETSc

from ..scene.scene import Scene


class Objective:
    """The energy of a scene at fixed supports. `r`: the residual at the displacement asked for
    last [N]."""

    INVERTED = Scene.INVERTED  # the energy told where a cell is turned inside out

    def __init__(self, scene: Scene) -> None:
        self.scene, self.r = scene, scene.u.duplicate()

    def __call__(self, x: PETSc.Vec) -> float:
        """Energy at x [N mm]."""
        self.scene.set(x)
        self.scene.residual(self.r)
        return self.scene.energy()
