"""What speaks against the tools of a scene: cells too large for them, other units, holes, radii,
that nothing presses the sheet on them; after the run, that they touched nothing."""

import math
from collections.abc import Iterable

import numpy as np
from mpi4py import MPI

from ..mechanics.contact import output as contact_output
from ..mechanics.contact.interaction import ToolInteraction
from ..mechanics.contact.tool_contact import Contact
from ..runtime.formatting import rounded
from ..sheets.blank import Blank
from ..tools.surface_warnings import hole_warning, radii_warning, size_warning
from ..tools.tool import Tool
from . import output as reports
from .scene import Scene

FEW = 50  # nodes of a rank that tell on which side of the sheet a tool is
INNER = "strain", "bending", "metal"  # energies of terms that press a sheet on nothing
COEFFICIENT = 2.0  # of friction, above which it may be in per cent
# angle of the least radius that one cell spans [deg]: in the double dome the punch force is then
# 1.5 % off; with 38 deg 0.3 %, with 149 deg 6 %
TURN = 90.0


def tool_warnings(scene: Scene) -> list[str]:
    """Sentences on cells too large for the tools, coefficients of friction above `COEFFICIENT`,
    tools in other units than mm or with holes, own surfaces that are curved more than their `radii`
    say, and tools on one side of a sheet that nothing presses on them."""
    much: dict[float, list[str]] = {}
    for term in scene.terms:
        if (
            isinstance(term, ToolInteraction)
            and term.coulomb
            and term.coulomb.largest > COEFFICIENT
        ):
            much.setdefault(term.coulomb.largest, []).append(term.tool.name)
    told = [cell_size_warning(scene.blank, reports.tools(scene))]
    told += [
        f"friction on {', '.join(names)} has a coefficient of {mu:g}, which is much: 25 % is 0.25"
        for mu, names in much.items()
    ]
    blank = scene.blank
    nodes = blank.coordinates()[: blank.V.dofmap.index_map.size_local]
    low, high = blank.extent()
    for tool in reports.tools(scene):
        told += [size_warning(tool, float((high - low).max())), hole_warning(tool)]
        told += [radii_warning(tool, nodes, scene.comm)]
    return [each for each in [*told, _one_sided(scene, nodes)] if each]


def _one_sided(scene, nodes):
    """A sentence if tools on one side alone, at start and end of their paths, hold the sheet along
    its normal, else ""."""
    holding = [term for term in scene.terms if term.energy_kind not in INNER]
    if not all(isinstance(term, Contact) for term in holding) or not holding:
        return ""  # what is else there may press it
    held = bool((scene.held % scene.blank.mesh.geometry.dim == 2).any())
    x, sides = nodes[:: max(1, len(nodes) // FEW)], set()
    for tool in reports.tools(scene):
        for load in (0.0, 1.0):
            normal = tool.surface.evaluate(x - np.asarray(tool.path(load))).normal[:, 2]
            sides |= set(np.sign(normal[np.isfinite(normal)]))
    if scene.comm.allreduce(held, MPI.LOR) or len(set().union(*scene.comm.allgather(sides))) != 1:
        return ""
    names = ", ".join(tool.name for tool in reports.tools(scene))
    return (
        f"{scene.blank.name} has tools on one side alone ({names}), and no support holds it along "
        "z: nothing presses it on them; give it supports, a load, or a tool on its other side"
    )


def cell_size_warning(blank: Blank, tools: Iterable[Tool]) -> str:
    """A sentence if cells, or a quadratic one's halves, are too large to bend around the tools'
    least radius, else ""."""
    radii = {tool.name: min(tool.surface.radii) for tool in tools}
    least = min(radii.values(), default=math.inf)
    corners = blank.corners()
    longest = np.linalg.norm(np.roll(corners, -1, 1) - corners, axis=2).max(1) / blank.degree
    total, cells = blank.mesh.comm.allreduce(np.array([longest.sum(), len(longest)]), MPI.SUM)
    turn = math.degrees(total / cells / least)
    if turn <= TURN:
        return ""
    name = min(radii, key=lambda name: radii[name])
    named = "cells" if blank.degree == 1 else "halves of quadratic cells"
    return (
        f"{named} are {rounded(total / cells)} mm long where the {name} has a radius of "
        f"{rounded(least)} mm: forces may be off by some per cent and angles by some degrees; "
        f"take {named} below {rounded(math.radians(TURN) * least)} mm"
    )


def untouched_warning(scene: Scene) -> str:
    """A sentence that names the tools on paths which have moved, and in no accepted state touched
    the sheet, else ""."""
    told = []
    for tool in reports.tools(scene):
        its = [t for t in scene.terms if isinstance(t, Contact) and t.tool is tool]
        along_path = tool.displacement - tool.travel * tool.direction - tool.path(0.0)
        moved = float(np.linalg.norm(along_path))  # so far, as a run may have been stopped
        if its and moved and not any([contact_output.touched(contact) for contact in its]):
            gap = min(float(contact_output.gap(each).min(initial=math.inf)) for each in its)
            gap = round(scene.comm.allreduce(gap, MPI.MIN), 9)
            told.append(
                f"{tool.name} moved by {rounded(moved)} mm, and is still {rounded(gap)} mm off"
            )
    if not told:
        return ""
    return f"a tool never touched the sheet: {'; '.join(told)}; check its path and its surface"
