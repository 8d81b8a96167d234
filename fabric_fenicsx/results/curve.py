"""Displacement and force of the curve of a run."""

from collections.abc import Callable, Mapping

import numpy as np

from ..runtime.formatting import TINY
from ..scene import output
from ..scene.scene import Scene

# of a scene and its load factor: displacement [mm] and force [N]
Measure = Callable[[Scene, float], tuple[float, float]]
# {label: (displacements [mm], forces [N])}, each (n,)
Curves = Mapping[str, tuple[np.ndarray, np.ndarray]]


def default_measure(scene: Scene) -> Measure:
    """Displacement [mm] and force [N] of the first tool of `scene` that moves, else of the support
    that moves furthest, along the motion of either; 0 and 0 of a scene without both."""
    for tool in output.tools(scene):
        start = tool.path(0.0)
        motion = np.subtract(tool.path(1.0), start)
        if size := np.linalg.norm(motion):
            along = motion / size
            return lambda scene, load: (
                float(along @ np.subtract(tool.path(load), start)),
                float(along @ output.tool_force(scene, tool)),
            )
    strokes = [(_stroke(scene, support, 1.0), support) for support in scene.supports]
    if not strokes:
        return lambda scene, load: (0.0, 0.0)
    stroke, support = max(strokes, key=lambda each: float(np.linalg.norm(each[0])))
    along = stroke / max(float(np.linalg.norm(stroke)), TINY)
    return lambda scene, load: (
        float(along @ _stroke(scene, support, load)),
        float(along @ scene.reaction(support.name)),
    )


def _stroke(scene, support, load):
    """Mean displacement of the nodes of a support, (gdim,) [mm]."""
    if not callable(support.value):
        return load * np.asarray(support.value, float)[: scene.blank.mesh.geometry.dim]
    x = scene.blank.coordinates()[: scene.blank.V.dofmap.index_map.size_local].T
    moved = support.value(x[:, support.where(x)], load)
    total, count = scene.comm.allreduce(moved.sum(1)), scene.comm.allreduce(moved.shape[1])
    return total / count
