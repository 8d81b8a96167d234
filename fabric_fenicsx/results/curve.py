"""Displacement and force of the curve of a run."""

import numpy as np

from ..runtime.formatting import TINY
from ..scene import output
from ..scene.scene import Scene


def default_measure(scene: Scene, load: float) -> tuple[float, float]:
    """Displacement [mm] and force [N], at a load factor, of the first tool of `scene` that moves,
    else of the support that moves furthest, along the motion of either; 0 and 0 without both."""
    for tool in output.tools(scene):
        motion = np.subtract(tool.path(1.0), tool.path(0.0))
        if size := np.linalg.norm(motion):
            along, way = motion / size, np.subtract(tool.path(load), tool.path(0.0))
            return float(along @ way), float(along @ output.tool_force(scene, tool))
    strokes = [(_stroke(scene, support, 1.0), support) for support in scene.supports]
    if not strokes:
        return 0.0, 0.0
    stroke, support = max(strokes, key=lambda each: float(np.linalg.norm(each[0])))
    along = stroke / max(float(np.linalg.norm(stroke)), TINY)
    return float(along @ _stroke(scene, support, load)), float(along @ scene.reaction(support.name))


def _stroke(scene, support, load):
    """Mean displacement of the nodes of a support, (gdim,) [mm]."""
    if not callable(support.value):
        return load * np.asarray(support.value, float)[: scene.blank.mesh.geometry.dim]
    x = scene.blank.coordinates()[: scene.blank.V.dofmap.index_map.size_local].T
    moved = support.value(x[:, support.where(x)], load)
    total, count = scene.comm.allreduce(moved.sum(1)), scene.comm.allreduce(moved.shape[1])
    return total / count
