"""What speaks against the tools of a scene before it runs: other units, holes, radii, and
that nothing presses the sheet on them."""

from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from ..tools.surface_warnings import hole_warning, radii_warning, size_warning
from .bending import Bending
from .contact import Contact
from .friction import Friction
from .membrane import Membrane

if TYPE_CHECKING:
    from ..scene import Scene

FEW = 50  # nodes of a rank that tell on which side of the sheet a tool is
COEFFICIENT = 2.0  # of friction, above which it may be in per cent


def tool_warnings(scene: "Scene") -> list[str]:
    """Sentences on coefficients of friction above `COEFFICIENT`, tools in other units than mm or
    with holes, own surfaces that are curved more than their `radii` say, and tools on one side of a
    sheet that nothing presses on them."""
    much: dict[float, list[str]] = {}
    for term in scene.terms:
        if isinstance(term, Friction) and (most := term.largest) > COEFFICIENT:
            much.setdefault(most, []).append(term.tool.name)
    told = [
        f"friction on {', '.join(names)} has a coefficient of {mu:g}, which is much: 25 % is 0.25"
        for mu, names in much.items()
    ]
    blank = scene.blank
    nodes = blank.coordinates()[: blank.V.dofmap.index_map.size_local]
    low, high = blank.extent()
    for tool in scene.tools():
        told += [size_warning(tool, float((high - low).max())), hole_warning(tool)]
        told += [radii_warning(tool, nodes, scene.comm)]
    return [each for each in [*told, _one_sided(scene, nodes)] if each]


def _one_sided(scene, nodes):
    """A sentence if tools on one side alone, at start and end of their paths, hold the sheet along
    its normal, else ""."""
    holding = [t for t in scene.terms if not isinstance(t, (Bending, Friction, Membrane))]
    if not all(isinstance(term, Contact) for term in holding) or not holding:
        return ""  # what is else there may press it
    held = bool((scene.held % scene.blank.mesh.geometry.dim == 2).any())
    x, sides = nodes[:: max(1, len(nodes) // FEW)], set()
    for tool in scene.tools():
        for load in (0.0, 1.0):
            normal = tool.surface.evaluate(x - np.asarray(tool.path(load))).normal[:, 2]
            sides |= set(np.sign(normal[np.isfinite(normal)]))
    if scene.comm.allreduce(held, MPI.LOR) or len(set().union(*scene.comm.allgather(sides))) != 1:
        return ""
    names = ", ".join(tool.name for tool in scene.tools())
    return (
        f"{scene.blank.name} has tools on one side alone ({names}), and no support holds it along "
        "z: nothing presses it on them; give it supports, a load, or a tool on its other side"
    )
