"""Closed rings of lines in a plane, and the sheet that they bound: an outline with holes."""

import re
from collections.abc import Sequence

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ..runtime.errors import InputError
from ..runtime.formatting import coordinates, rounded
from ..runtime.graph import connected

GAP = 1e-4  # of the lines' extent, up to which their ends meet


def joined(lines: Sequence[np.ndarray], source: str) -> list[np.ndarray]:
    """Closed rings (n, 2) of lines (k, 2) [mm] whose ends meet, given in any order and sense; those
    given twice count once. source: what errors call them. Raises InputError for lines that do not
    close, by the place."""
    gap = GAP * np.ptp(np.concatenate(lines), axis=0).max()
    ends = np.array([line[[0, -1]] for line in lines]).reshape(-1, 2)
    _, place = connected(len(ends), cKDTree(ends).query_pairs(gap, output_type="ndarray").T)
    _, first, group = np.unique(place, return_index=True, return_inverse=True)
    ends = ends[first[group]].reshape(-1, 2, 2)
    pieces = [
        shapely.LineString([start, *line[1:-1], end]) for line, (start, end) in zip(lines, ends)
    ]
    pieces = [each for each in pieces if each.length > gap]
    once = {shapely.normalize(each).wkb: each for each in pieces}
    found = shapely.get_parts(shapely.line_merge(shapely.multilinestrings([*once.values()])))
    rings = [shapely.get_coordinates(each) for each in found]
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
    source: what errors call the rings. Raises InputError, by the place, for a ring that crosses
    itself or has fewer than three points, for one outside the outline, and for one that crosses,
    touches or lies in another."""
    shapes = [_area(ring, source) for ring in rings]
    if not shapes:
        raise InputError(f"{source} holds no ring; allowed is an outline, and holes in it")
    outline, *holes = sorted(shapes, key=lambda shape: -shape.area)
    for hole in holes:
        if not shapely.contains_properly(outline, hole):
            how = "outside it" if outline.disjoint(hole) else "across it, or touching it"
            raise InputError(
                f"{source} has a ring at {_place(hole)} mm that lies {how}; allowed is one "
                "outline, and holes inside it"
            )
    tree = shapely.STRtree(np.array(holes, dtype=object))
    pairs = tree.query(tree.geometries, predicate="intersects").T
    for hole, other in ((holes[i], holes[j]) for i, j in pairs if i > j):
        how = "lies in" if other.contains(hole) else "meets"
        raise InputError(
            f"{source} has a ring at {_place(hole)} mm that {how} the hole at {_place(other)} mm; "
            "allowed are holes apart from each other"
        )
    return shapely.Polygon(outline.exterior, [hole.exterior for hole in holes])


def _area(ring, source):
    points = len(np.unique(ring, axis=0))
    if points < 3:
        raise InputError(
            f"{source} has a ring of {points} points at {coordinates(ring[0])} mm; allowed are 3 "
            "or more"
        )
    area = shapely.Polygon(ring)
    reason = shapely.is_valid_reason(area)
    if reason != "Valid Geometry":
        found = re.search(r"\[(.*)\]", reason)
        place = map(float, found[1].split()) if found else ring[0]
        raise InputError(
            f"{source} crosses or touches itself at {coordinates(place)} mm; allowed are rings "
            "that do not"
        )
    return area


def _place(shape):
    """Text of the first point of an area's ring."""
    return coordinates(shape.exterior.coords[0])
