"""Closed rings of lines in a plane, and the sheet that they bound: an outline with holes."""

from collections.abc import Sequence

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ..core.errors import InputError
from ..core.formatting import coordinates, rounded
from ..core.graph import connected

MIRROR_TOLERANCE = 1e-3  # of its extent, by which a sheet may differ from its mirror image


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
    if loose := [ring[[0, -1]] for ring in rings if (ring[0] != ring[-1]).any()]:
        place, *others = np.concatenate(loose)
        off = np.linalg.norm(others - place, axis=1)
        k = off.argmin()  # at 0 mm where more than two lines meet
        raise InputError(
            f"{source} is open at {coordinates(place)} mm: the nearest other end is "
            f"{rounded(off[k])} mm away, at {coordinates(others[k])}; allowed are closed rings, of "
            f"two lines at each place, whose ends are up to {rounded(gap, 1)} mm apart"
        )
    return rings


def sheet_of(rings: Sequence[np.ndarray], source: str) -> shapely.Polygon:
    """The sheet that rings (n, 2) [mm] bound: the largest is its outline, the others are holes.
    Raises InputError, by the place, for rings of a `source` that do not bound one sheet."""
    # rings of fewer points are too few for GEOS, not for its constructor
    areas = [shapely.Polygon(np.resize(ring, (max(3, len(ring)), 2))) for ring in rings]
    areas.sort(key=lambda area: -area.area)
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


def centred(sheet: shapely.Polygon) -> shapely.Polygon:
    """The sheet with the middle of its extent at the origin."""
    middle = np.reshape(sheet.bounds, (2, 2)).mean(0)
    return shapely.transform(sheet, lambda x: x - middle)


def mirrored_half(
    sheet: shapely.Polygon, axis: int, source: str, at: float = 0.0
) -> shapely.Polygon:
    """The half of a sheet on the positive side of the plane x = `at` or y = `at` (`axis` 0 or 1)
    [mm], which mirrors it; a sheet that begins at the plane as it is. Raises InputError, by the
    size of what differs, for a sheet that is not its own mirror image, and for one in two parts."""
    low, high = np.reshape(sheet.bounds, (2, 2))[:, axis]
    if low - at > -MIRROR_TOLERANCE * (high - low):
        return sheet
    image = shapely.transform(sheet, lambda x: np.where(np.arange(2) == axis, 2 * at - x, x))
    apart = shapely.symmetric_difference(sheet, image)
    name, far = "xy"[axis], shapely.buffer(apart, -MIRROR_TOLERANCE * (high - low))
    if not far.is_empty:
        place = coordinates(far.representative_point().coords[0])
        raise InputError(
            f"{source} is not its own mirror image in {name} = {at:g}: {rounded(far.area, 3)} mm2 "
            f"differ, as at {place} mm; allowed is a symmetric outline, or its half"
        )
    reach = 2 * np.abs(sheet.bounds).max()
    start = [at if k == axis else -reach for k in (0, 1)]
    half = shapely.intersection(sheet, shapely.box(*start, reach, reach))
    if half.geom_type != "Polygon":
        raise InputError(
            f"{source} is cut into {shapely.get_num_geometries(half)} parts by the plane of "
            f"symmetry {name} = {at:g}; allowed is an outline that stays in one piece"
        )
    return half
