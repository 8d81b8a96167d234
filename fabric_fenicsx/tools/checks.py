"""Checks of tools before anything runs: errors, and warnings, a sentence each."""

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from ..runtime.errors import InputError
from ..runtime.formatting import coordinates, rounded
from ..runtime.graph import connected
from .radii import least_radii
from .surfaces import innermost
from .tool import Tool
from .triangulated import TriangulatedSurface

MIN_SHARE = 0.02  # of a sheet's size, below which a tool is refused as in another unit
FLANGE = 0.05  # share of the thickness by which a tool may be in the sheet at the start
MIRRORED = 0.25  # share of the thickness by which a tool and its mirror image may differ


def unit_doubt(size: float, sheet: float, least: float) -> str:
    """Words on a tool of this size [mm], below a `least` share of a sheet's, or ""."""
    units = {"metres": 1000.0, "inches": 25.4, "cm": 10.0}
    fitting = [unit for unit, factor in units.items() if 0.1 < size * factor / sheet < 10]
    if not fitting or size >= least * sheet:
        return ""
    return (
        f"is {rounded(size, 4)} mm large beside a sheet of {rounded(sheet, 4)} mm, as if it were "
        f"in {' or '.join(fitting)}"
    )


def check_triangles(
    surface: TriangulatedSurface, name: str, thickness: float, warn: Callable[[str], None]
) -> None:
    """Raise InputError for a surface `name` that is no surface or too coarse for a ply of this
    thickness [mm]; call `warn` with a sentence for what can only be doubted."""

    def middle(nodes):
        return coordinates(surface.points[nodes].mean(0))

    if count := len(surface.forks):
        flaw = f"has {count} edges with more than two triangles, one at {middle(surface.forks[0])}"
        raise InputError(f"{name} {flaw}; allowed are at most two at an edge")
    off = 0.75 * surface.curved.patches.bulge  # more than the patches themselves
    worst = int(off.argmax())
    if off[worst] > thickness:
        flaw = f"has facets that are {rounded(off[worst])} mm off the curved surface through their"
        raise InputError(
            f"{name} {flaw} corners, at {middle(surface.triangles[worst])}; allowed is up to the "
            f"ply's thickness {thickness:g} mm"
        )
    edges, turn = surface.curved.turns()
    if len(turn) and np.degrees(turn.max()) > 20.0:
        sharpest = f"{np.degrees(turn.max()):.0f} deg at {middle(edges[turn.argmax()])}"
        warn(
            f"{name} is coarse: its facets turn by {sharpest} where it is to be smooth; beyond "
            "20 deg its curvature is a guess"
        )


def check_start(tool: Tool, places: np.ndarray, thickness: float, comm: MPI.Comm) -> None:
    """Raise InputError on all ranks for a tool in which nodes of a sheet are, at places (n, 3) of
    this rank [mm], or whose surface gives no number there."""
    gap = tool.evaluate(places, reach=thickness).gap
    lost = places[np.isnan(gap)][:1].tolist()
    if lost := sum(comm.allgather(lost), []):
        name = f"surface {type(tool.surface).__name__} of {tool.name}"
        where = f"at {coordinates(lost[0])}, where the sheet is before anything moves"
        raise InputError(f"the gap of {name} is not a number {where}; allowed is a finite one")
    deep = gap < -thickness / 2  # may be a bound
    exact = tool.evaluate(places[deep]).gap
    gap[deep] = np.where(np.isnan(exact), gap[deep], exact)
    none: tuple[float, list[float]] = (np.inf, [])
    nearest = min(zip(gap.tolist(), places.tolist()), default=none)
    off, place = min(comm.allgather(nearest))
    deep_in = thickness / 2 - off
    if deep_in > (0.5 + 1e-6) * thickness:
        raise InputError(
            f"{tool.name} is {rounded(deep_in)} mm deep in the sheet's face at {coordinates(place)}"
            f" before anything moves; allowed is up to {thickness / 2:g} mm, half the thickness: "
            "begin its path further off, or turn it round with `Reversed`"
        )


# -- warnings


def _triangles(tool):
    surface, _ = innermost(tool.surface, np.empty((0, 3)))
    return surface if isinstance(surface, TriangulatedSurface) else None


def radius_over(tool: Tool, length: float) -> float:
    """Least radius of a tool's surface [mm], of triangles over a length [mm]."""
    least, surface = min(tool.surface.radii), _triangles(tool)
    if not surface or least > length:
        return least
    return max(least, min(least_radii(surface.curved, length)))


def size_warning(tool: Tool, sheet: float) -> str:
    """A sentence if a tool of triangles is as small as if it were in another unit, else ""."""
    surface = _triangles(tool)
    doubt = surface and unit_doubt(float(np.ptp(surface.points, axis=0).max()), sheet, 0.2)
    return f"the surface of {tool.name} {doubt}; lengths are in mm" if doubt else ""


def hole_warning(tool: Tool) -> str:
    """A sentence if triangles of a tool leave an opening below a tenth of them, so no die's, else
    ""."""
    surface = _triangles(tool)
    if not surface or not len(surface.rim):
        return ""
    x, (p, q) = surface.points, surface.rim.T
    loop = connected(len(x), [p, q])[1][p]
    for number in np.unique(loop):
        around = x[surface.rim[loop == number]].reshape(-1, 3)
        width = float(np.ptp(around, axis=0).max())
        if width < 0.1 * np.ptp(x, axis=0).max():
            hole = f"a hole {rounded(width)} mm wide at {coordinates(around.mean(0))} mm"
            where = "in its own coordinates, where nothing stops the sheet"
            return f"the surface of {tool.name} has {hole} {where}"
    return ""
