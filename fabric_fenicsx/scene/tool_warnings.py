"""Warnings of a scene's tools, before a run and after it."""

import math
from collections.abc import Iterable

import numpy as np
from mpi4py import MPI

from ..contact.contact_term import ToolContactTerm
from ..contact.tool_contact import Contact
from ..core.formatting import rounded
from ..sheet.blank import Blank
from ..surfaces.checks import radius_over, triangle_warnings
from ..surfaces.tool import Tool
from . import output
from .rigid_motions import planes_of_symmetry
from .scene import Scene

MAX_FRICTION = 2.0  # [-], above which a coefficient may be in per cent
# angle of the least radius that one cell spans [deg]: in the double dome the punch force is then
# 1.5 % off, with 149 deg 6 %; in trays of four sizes with 40 to 80 deg up to 4 %, above 28 and 72 %
MAX_TURN = 90.0
# minimum of cells along a sheet's longest side: with 1, 2, 4, 6 and 8 the
# hemisphere's punch force is 100 % too low, 32 % too low, 43 % too high, 13 % too low, 4 % too high
MIN_CELLS = 5


def tool_warnings(scene: Scene, formed: bool = False) -> list[str]:
    """Sentences on too few cells, or too large ones for the tools, on friction that may be in per
    cent, and on tools in other units than mm or with holes. formed: ask only tools that touched for
    radii."""
    tools = output.tools(scene)
    asked = _touched(scene) if formed else tools
    sentences = [few_cells_warning(scene) or _cell_size_warning(scene.blank, asked)]
    for term in scene.terms:
        if isinstance(term, ToolContactTerm) and term.coulomb:
            mu, name = term.coulomb.largest, term.tool.name
            much = f"friction on {name} has a coefficient of {mu:g}, which is large: 25 % is 0.25"
            sentences += [much] if MAX_FRICTION < mu < np.inf else []
    size = float(scene.blank.sides().max())
    for tool in tools:
        sentences += triangle_warnings(tool, size)
    return list(dict.fromkeys(filter(None, sentences)))


def _touched(scene):
    """Tools that pressed the sheet in any accepted state; called on all ranks."""
    contacts = [term for term in scene.terms if isinstance(term, Contact)]
    pressed = [term.tool for term in contacts if term.largest_depth() > 0]
    return [tool for tool in output.tools(scene) if tool in pressed]


def few_cells_warning(scene: Scene) -> str:
    """A sentence if a sheet on tools has fewer than `MIN_CELLS` cells, or halves of quadratic ones,
    along its longest side, else ""; a quarter stands for the whole sheet."""
    blank, sides = scene.blank, scene.blank.sides()
    sides[list(planes_of_symmetry(blank, scene.supports))] *= 2
    along = float(sides.max()) / _cell_length(blank)
    if along >= MIN_CELLS or not output.tools(scene):
        return ""
    few = f"{rounded(along)} cells cover the whole length of {blank.name}"
    return f"{few}, too few for forces and shape; use {2 * MIN_CELLS} or more"


def _cell_length(blank):
    """Mean of the cells' longest sides, or of a quadratic one's halves [mm]."""
    corners = blank.corners()
    longest = np.linalg.norm(np.roll(corners, -1, 1) - corners, axis=2).max(1) / blank.degree
    total, cells = blank.mesh.comm.allreduce(np.array([longest.sum(), len(longest)]), MPI.SUM)
    return total / cells


def cells_on_tools(blank: Blank, tools: Iterable[Tool]) -> tuple[float, float, str]:
    """Length of cells, or their halves, over tools' least radius, length [mm], that tool's name."""
    length = _cell_length(blank)
    # over a quarter of a cell its tool's curvature counts
    radii = [(radius_over(tool, 0.25 * length), tool.name) for tool in tools]
    radius, name = min(radii, default=(math.inf, ""))
    return length / radius, length, name


def cells_over_radius(scene: Scene) -> float:
    """Length of cells over the least radius of the tools that a sheet has touched."""
    return cells_on_tools(scene.blank, _touched(scene))[0]


def _cell_size_warning(blank, tools):
    angle, length, name = cells_on_tools(blank, tools)
    if math.degrees(angle) <= MAX_TURN:
        return ""
    named = "cells" if blank.degree == 1 else "halves of quadratic cells"
    return (
        f"{named} are {rounded(length)} mm long where the {name} has a radius of "
        f"{rounded(length / angle)} mm: forces may be off by 1 to 70 % and angles by 4 to 12 "
        f"deg; take {named} below {rounded(math.radians(MAX_TURN) * length / angle)} mm"
    )


def untouched_warning(scene: Scene) -> str:
    """A sentence on tools that moved on a path but never touched the sheet, else ""."""
    texts, touched = [], _touched(scene)
    for tool in output.tools(scene):
        along_path = tool.displacement - tool.travel * tool.direction - tool.path(0.0)
        moved = float(np.linalg.norm(along_path))  # so far, as a run may have been stopped
        contacts = [each for each in scene.terms if isinstance(each, Contact) and each.tool is tool]
        if contacts and moved and tool not in touched:
            gap = min(float(each.gap().min(initial=math.inf)) for each in contacts)
            away = rounded(round(scene.comm.allreduce(gap, MPI.MIN), 9))
            texts.append(f"{tool.name} moved by {rounded(moved)} mm, and is still {away} mm away")
    words = "; ".join([*texts, "check its path and surface"])
    return f"a tool never touched the sheet: {words}" if texts else ""
