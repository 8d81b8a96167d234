"""Checks of tools before anything runs: errors, and warnings, a sentence each."""

from itertools import islice

import numpy as np
from mpi4py import MPI

from ..core.errors import InputError
from ..core.formatting import coordinates, rounded
from ..core.graph import connected
from .projection import least_radii
from .surfaces import innermost
from .tool import Tool
from .triangulated import TriangulatedSurface

MIN_SHARE = 0.02  # of a sheet's size, below which a tool is refused as in another unit
FLANGE = 0.05  # share of the thickness by which a tool may be in the sheet at the start
MAX_ROUNDING = 1e-4  # of a surface's size: distance of its neighbouring numbers
MIRRORED = 0.25  # share of the thickness by which a tool and its mirror image may differ


def unit_doubt(size: float, sheet: float, least: float) -> str:
    """Words on a tool of this size [mm], below a `least` share of a sheet's, or ""."""
    units = {"metres": 1000.0, "inches": 25.4, "cm": 10.0}
    fitting = [unit for unit, factor in units.items() if 0.1 < size * factor / sheet < 10]
    if not fitting or size >= least * sheet:
        return ""
    return (
        f"has a size of {rounded(size, 4)} mm, and the sheet {rounded(sheet, 4)} mm; its unit may "
        f"be {' or '.join(fitting)}"
    )


def check_triangles(surface: TriangulatedSurface, name: str, thickness: float) -> list[str]:
    """What can only be doubted, a sentence each; InputError for a surface `name` that is no surface
    or too coarse for a ply of this thickness [mm]."""

    def middle(nodes):
        return coordinates(surface.points[nodes].mean(0))

    off = 0.75 * surface.curved.patches.bulge  # more than the patches themselves
    worst = int(off.argmax())
    if count := len(surface.forks):
        flaw = f"{count} edges with more than two triangles, one at {middle(surface.forks[0])}"
        raise InputError(f"{name} has {flaw}; expected at most two at an edge")
    if off[worst] > thickness:
        raise InputError(
            f"{name} has facets that are {rounded(off[worst])} mm off the curved surface through "
            f"their corners, at {middle(surface.triangles[worst])}; expected at most the ply's "
            f"thickness {thickness:g} mm"
        )
    x = surface.points
    rounding = float(np.spacing(np.abs(x).max().astype("f4"))) / np.ptp(x, axis=0).max()
    if rounding > MAX_ROUNDING and (x == x.astype("f4")).mean() > 0.9:
        flaw = f"numbers of single precision, which are {rounding:.2g} of its size apart"
        flaw += f" at {coordinates(x[0])} mm; expected a surface near the origin, or more digits"
        raise InputError(f"{name} has {flaw}")
    edges, turn = surface.curved.turns()
    if not len(turn) or (sharpest := np.degrees(turn.max())) <= 20.0:
        return []
    return [
        f"{name} is coarse: its facets turn by {sharpest:.0f} deg at "
        f"{middle(edges[turn.argmax()])} where it should be smooth; beyond 20 deg its curvature "
        "is unreliable"
    ]


def check_start(tool: Tool, places: np.ndarray, thickness: float, comm: MPI.Comm) -> None:
    """Raise InputError on all ranks for a tool in which nodes of a sheet are, at places (n, 3) of
    this rank [mm], or whose surface gives no number there."""
    gap = tool.evaluate(places, reach=thickness).gap
    deep = gap < -thickness / 2  # may be a bound
    exact = tool.evaluate(places[deep]).gap
    gap[deep] = np.where(np.isnan(exact), gap[deep], exact)
    gap[np.isnan(gap)] = -np.inf
    none: tuple[float, list[float]] = (np.inf, [])
    nearest = min(zip(gap.tolist(), places.tolist()), default=none)
    off, place = min(comm.allgather(nearest))
    if thickness / 2 - off > (0.5 + 1e-6) * thickness:
        depth = f"penetrates the sheet by {rounded(thickness / 2 - off)} mm"
        flaw = "has a gap that is not a number" if off == -np.inf else depth
        raise InputError(
            f"{tool.name} {flaw} at {coordinates(place)} before the first step; expected up to "
            f"{thickness / 2:g} mm, half the thickness: start its path further away, or use "
            "`Reversed` if its normals point away from the sheet"
        )


def _triangles(tool):
    surface = innermost(tool.surface)
    return surface if isinstance(surface, TriangulatedSurface) else None


def radius_over(tool: Tool, length: float) -> float:
    """Least radius of a tool's surface [mm], of triangles over a length [mm]."""
    least, surface = min(tool.surface.radii), _triangles(tool)
    if not surface or least > length:
        return least
    return max(least, min(least_radii(surface.curved, length)))


def triangle_warnings(tool: Tool, sheet: float) -> list[str]:
    """Sentences on a tool of triangles that is as small as if it were in another unit, beside a
    sheet of this size [mm], and on an opening below a tenth of it, so no die's."""
    if not (surface := _triangles(tool)):
        return []
    x, (p, q) = surface.points, surface.rim.T
    size, loop = float(np.ptp(x, axis=0).max()), connected(len(x), [p, q])[1][p]
    around = [x[surface.rim[loop == number]].reshape(-1, 3) for number in np.unique(loop)]
    doubt, what = unit_doubt(size, sheet, 0.2), f"the surface of {tool.name}"
    warnings = [f"{what} {doubt}; lengths are in mm"] if doubt else []
    small = ((width, ring) for ring in around if (width := np.ptp(ring, axis=0).max()) < 0.1 * size)
    return warnings + [
        f"{what} has a hole {rounded(width)} mm wide at {coordinates(ring.mean(0) + tool.home.at)} "
        "mm in its own coordinates, through which the sheet can pass"
        for width, ring in islice(small, 1)
    ]
