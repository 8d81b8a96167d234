"""Warnings about a tool's surface before anything runs, a sentence each."""

import numpy as np
from mpi4py import MPI

from ..runtime.formatting import coordinates, rounded
from ..runtime.graph import connected
from .checks import SMALL, unit_doubt
from .radii import least_radii
from .surfaces import innermost
from .tool import Tool
from .triangulated import TriangulatedSurface

HOLE = 0.1  # size of an opening, over the surface's, below which it is a hole and not a die's
PROBED = 1000  # nodes of a rank whose nearest points tell how a surface is curved
CURVED = 1.05  # times as much as `radii` say, from which they are wrong
KINKS = 0.02  # share of the points at which it may be curved more


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
    """A sentence if a tool of triangles is as small beside a sheet of this length [mm] as if it
    were in metres, inches or cm, else ""."""
    surface = _triangles(tool)
    doubt = surface and unit_doubt(float(np.ptp(surface.points, axis=0).max()), sheet, SMALL)
    return f"the surface of {tool.name} {doubt}; lengths are in mm" if doubt else ""


def hole_warning(tool: Tool) -> str:
    """A sentence if triangles of a tool leave an opening below `HOLE` of their extent, else ""."""
    surface = _triangles(tool)
    if not surface or not len(surface.rim):
        return ""
    x, (p, q) = surface.points, surface.rim.T
    loop = connected(len(x), [p, q])[1][p]
    for number in np.unique(loop):
        around = x[surface.rim[loop == number]].reshape(-1, 3)
        width = float(np.ptp(around, axis=0).max())
        if width < HOLE * np.ptp(x, axis=0).max():
            return (
                f"the surface of {tool.name} has a hole {rounded(width)} mm wide at "
                f"{coordinates(around.mean(0))} mm in its own coordinates, where nothing stops "
                "the sheet"
            )
    return ""


def radii_warning(tool: Tool, places: np.ndarray, comm: MPI.Comm) -> str:
    """A sentence if an own surface is curved more than its `radii` say at the points nearest to the
    places (n, 3) [mm] of all ranks when the tool is at the end of its path, else ""."""
    surface = tool.surface
    if _triangles(tool):  # which finds them itself
        return ""
    x = places[:: max(1, len(places) // PROBED)] - np.asarray(tool.path(1.0), dtype=float)
    gap, normal, _ = surface.evaluate(x)
    feet = (x - gap[:, None] * normal)[np.isfinite(gap)]
    curvature = surface.evaluate(feet).curvature
    known = np.isfinite(curvature).all((1, 2))
    feet = np.vstack(comm.allgather(feet[known]))
    bent = np.linalg.eigvalsh(np.concatenate(comm.allgather(curvature[known])))
    if not len(feet):
        return ""
    inside, outside = 1 / np.asarray(surface.radii, dtype=float)
    over = np.fmax(bent[:, 2] - CURVED * inside, -bent[:, 0] - CURVED * outside)
    i = np.argsort(over)[int((1 - KINKS) * (len(over) - 1))]
    if over[i] <= 1e-6:
        return ""
    told = ", ".join(f"{radius:g}" for radius in surface.radii)
    return (
        f"surface {type(surface).__name__} of {tool.name} is curved with a radius of "
        f"{rounded(1 / abs(bent[i]).max())} mm at {coordinates(feet[i])} mm in its own "
        f"coordinates, but its `radii` are ({told}): penalty and check of the cells rest on them"
    )
