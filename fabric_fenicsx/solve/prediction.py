"""Prediction of the state at the next load, from which its solve begins."""

import numpy as np
from petsc4py import PETSc

from ..scene.scene import Scene
from .newton import Newton
from .progress import Progress
from .report import Report, SolveFailed


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
