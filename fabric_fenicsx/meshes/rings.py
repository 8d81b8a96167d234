"""Closed rings of lines in a plane, and the sheet that they bound: an outline with holes."""

from collections.abc import Sequence

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ..runtime.errors import InputError
from ..runtime.formatting import coordinates, rounded
from ..runtime.graph import connected


def joined(lines: Sequence[np.ndarray], source: str) -> list[np.ndarray]:
    """Closed rings (n, 2) of lines (k, 2) [mm] whose ends meet, in any order and sense, each once;
    source: what errors call them. Raises InputError, by the place, for lines that do not close."""
    # of the lines' extent, up to which their ends meet
    gap = 1e-4 * np.ptp(np.concatenate(lines), axis=0).max()
    ends = np.array([line[[0, -1]] for line in lines]).reshape(-1, 2)
    _, place = connected(len(ends), cKDTree(ends).query_pairs(gap, output_type="ndarray").T)
    _, first, group = np.unique(place, return_index=True, return_inverse=True)
    ends = ends[first[group]].reshape(-1, 2, 2)
    pieces = [
        shapely.LineString([start, *line[1:-1], end]) for line, (start, end) in zip(lines, ends)
    ]
    pieces = [each for each in pieces if each.length > gap]
    once = {shapely.normalize(each).wkb: each for each in pieces}
    merged = shapely.get_parts(shapely.line_merge(shapely.multilinestrings([*once.values()])))
    rings = [shapely.get_coordinates(each) for each in merged]
    loose = [ring[[0, -1]] for ring in rings if (ring[0] != ring[-1]).any()]
    if loose:
        place, *others = np.concatenate(loose)
        off = np.linalg.norm(others - place, axis=1)
        nearest = off.argmin()
        where = coordinates(place)
        if off[nearest] == 0:
            fault = f"has more than two lines that meet at {where} mm"
        else:
            fault = (
                f"is open at {where} mm: the nearest other end is {rounded(off[nearest])} mm away, "
                f"at {coordinates(others[nearest])}"
            )
        raise InputError(
            f"{source} {fault}; allowed are closed rings, of lines whose ends are up to "
            f"{rounded(gap, 1)} mm apart"
        )
    return rings


def sheet_of(rings: Sequence[np.ndarray], source: str) -> shapely.Polygon:
    """The sheet that rings (n, 2) [mm] bound: the largest is its outline, the others are holes.
    Raises InputError, by the place, for rings of a `source` that do not bound one sheet."""
    for small in (ring for ring in rings if len(np.unique(ring, axis=0)) < 3):
        raise InputError(
            f"{source} has a ring of 2 points or less at {coordinates(small[0])} mm; allowed are 3"
        )
    areas = sorted((shapely.Polygon(ring) for ring in rings), key=lambda area: -area.area)
    outline, *holes = [area.exterior for area in areas] or [None]
    sheet = shapely.Polygon(outline, holes)
    fault, _, place = shapely.is_valid_reason(sheet).partition("[")
    if place:  # as of Self-intersection[5 10]
        where = coordinates(map(float, place.rstrip("]").split()))
        raise InputError(
            f"{source} bounds no sheet: {fault.lower()} at {where} mm; allowed is one outline, and "
            "holes inside it that are apart from each other"
        )
    return sheet
