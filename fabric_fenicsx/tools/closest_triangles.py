"""The triangles closest to points: found exactly, and remembered while points move little."""

import math
from copy import copy
from typing import NamedTuple, Self

import numpy as np
from scipy.spatial import cKDTree

from ..runtime.compiled import compiled
from .curved_triangles import CurvedTriangles, row_dots

ROOM = 0.2  # distance for which candidates are kept, over a usual triangle's size
COVER = 1 / math.sqrt(3)  # times the longest edge: a triangle's points lie nearer to a corner
KEPT = 4  # sets of candidates, of so many different numbers of points


class Candidates(NamedTuple):
    """Which triangles may be closest to n points near the `place` (n, 3) where they were sought.

    A point has either `triangle` (k,) in the entries whose `row` (k,) is its number, which hold up
    to `valid` (n,) mm from its place; seen from there each is `further` (k,) mm away than the
    closest one. Or, where all of these lie in one plane, it has one of them in `plane` (n,),
    otherwise -1; or none, being `clear` (n,) mm off the surface, on a `side` (n,) of it, with a
    `normal` (n, 3).
    """

    place: np.ndarray
    valid: np.ndarray
    clear: np.ndarray
    side: np.ndarray
    normal: np.ndarray
    plane: np.ndarray
    row: np.ndarray
    triangle: np.ndarray
    further: np.ndarray

    @classmethod
    def empty(cls, n: int) -> Self:
        """The candidates of n points that were not sought yet."""
        none = np.empty(0, dtype=np.int64)
        far, zeros = np.full(n, -np.inf), np.zeros((n, 3))
        unsure, ones, no_plane = np.full(n, -1.0), np.ones(n), np.full(n, -1)
        return cls(zeros, unsure, far, ones, zeros, no_plane, none, none, np.empty(0))


class ClosestTriangles:
    """Finds the flat triangles of a surface that are closest to points; a far point costs little.

    surface: the `CurvedTriangles`; side: 1.0 or -1.0, of the gap beyond the rim of an open surface.
    """

    def __init__(self, surface: CurvedTriangles, side: float = 1.0) -> None:
        self.surface, self.side = surface, side
        corners, middles = surface.corners, surface.middles
        edges = np.roll(corners, -1, 1) - corners
        area = np.cross(edges[:, 0], edges[:, 1])
        # gradients of the barycentric coordinates
        self._slopes = np.cross(area[:, None], np.roll(edges, -1, 1))
        self._slopes = self._slopes / (area**2).sum(1)[:, None, None]
        self._vertices = cKDTree(surface.points)
        radius = np.linalg.norm(corners - middles[:, None], axis=2).max(1)
        size = np.floor(np.log2(radius.max() / radius))
        self._radius = radius * (1 + 1e-9)
        self._room = ROOM * math.sqrt(np.median(surface.areas))
        # how much further what lies beyond a sharp edge may be and yet be as near on its patch
        self._slack = 1e-9 + (2 * surface.bulge if surface.parts > 1 else 0.0)
        self._kept: dict[int, Candidates] = {}
        self._off_plane: dict[int, tuple[cKDTree, float]] = {}
        self._by_size = []
        for each in np.unique(size):
            members = np.flatnonzero(size == each)
            reach = radius[members].max() * (1 + 1e-9)
            self._by_size.append((cKDTree(middles[members]), members, reach))

    def from_behind(self) -> "ClosestTriangles":
        """The same, for the body on the other side."""
        other = copy(self)
        other.side, other._kept = -self.side, {}
        return other

    def candidates(self, points: np.ndarray, reach: float) -> tuple[Candidates, np.ndarray]:
        """The `Candidates` for points (n, 3) [mm], sought anew for those that have left the places
        where theirs hold, and the gap (n,) that those without surely have."""
        n = len(points)
        old = self._kept.pop(n, None) or Candidates.empty(n)
        moved = np.linalg.norm(points - old.place, axis=1)
        renew = np.flatnonzero(~((moved <= old.valid) | (old.clear - moved > reach)))
        if len(renew):
            # and those that soon will
            renew = np.flatnonzero(~((moved <= old.valid / 2) | (old.clear - moved > reach)))
            old = self._renewed(old, points, reach, renew)
            moved[renew] = 0
        self._kept[n] = old
        if len(self._kept) > KEPT:
            del self._kept[next(iter(self._kept))]  # that which was used least lately
        # nearer by at most what the point moved, while the closest went as far off
        near = old.further <= 2 * moved[old.row] + self._slack
        found = old._replace(
            row=old.row[near], triangle=old.triangle[near], further=old.further[near]
        )
        return found, np.copysign(old.clear - moved, old.side)

    def _renewed(self, old, points, reach, renew):
        surface, facets = self.surface, self.surface.facets
        place, valid, clear = old.place.copy(), old.valid.copy(), old.clear.copy()
        side, normal, plane = old.side.copy(), old.normal.copy(), old.plane.copy()
        x = points[renew]
        apart, vertex = self._vertices.query(x)
        ring, triangle, weights, bound = self._around(x, vertex)
        place[renew], normal[renew], valid[renew], plane[renew] = x, facets[triangle], -1.0, -1
        side[renew] = self.sides(x, triangle, weights)
        clear[renew] = apart - COVER * surface.longest - surface.bulge
        # the side is not sure where the closest point lies at the end of the triangles at a vertex
        near = np.flatnonzero((clear[renew] - self._room <= reach) | ~ring)
        row, triangle, further = Candidates.empty(0)[-3:]
        if len(near):
            row, triangle, further, least, sides = self._closest_few(x[near], bound[near])
            near = renew[near]
            side[near], clear[near] = sides, least - surface.bulge
            close = least - surface.bulge - self._room <= reach
            kept = close[row]
            row, triangle, further = near[row[kept]], triangle[kept], further[kept]
            near, least = near[close], least[close]
            valid[near], clear[near] = self._room, -1.0
            low, high = np.full(len(points), len(facets)), np.full(len(points), -1)
            np.minimum.at(low, row, surface.plane[triangle])
            np.maximum.at(high, row, surface.plane[triangle])
            plane[near] = np.where(low == high, low, -1)[near]
            for each in np.unique(plane[near[plane[near] >= 0]]):
                at = near[plane[near] == each]
                tree, cover = self._beside(each)
                apart = tree.query(points[at])[0] - cover - least[np.searchsorted(near, at)]
                valid[at] = np.maximum(valid[at], apart / 2)
        changed = np.zeros(len(points), dtype=bool)
        changed[renew] = True
        row, triangle, further = (
            np.append(a[~changed[old.row]], b) for a, b in zip(old[-3:], (row, triangle, further))
        )
        hold = np.flatnonzero(plane[row] < 0)
        hold = hold[np.argsort(row[hold], kind="stable")]
        return Candidates(
            place, valid, clear, side, normal, plane, row[hold], triangle[hold], further[hold]
        )

    def _beside(self, plane):
        """Vertices and middles of edges of all triangles but a plane's, as a tree, and how far from
        these their points are at most."""
        if plane not in self._off_plane:
            corners = self.surface.corners[self.surface.plane != plane]
            onwards = np.roll(corners, -1, 1)
            longest = math.sqrt(((onwards - corners) ** 2).sum(2).max(initial=0))
            places = np.concatenate([corners, (corners + onwards) / 2]).reshape(-1, 3)
            self._off_plane[plane] = cKDTree(np.unique(places, axis=0)), COVER * longest / 2
        return self._off_plane[plane]

    def _around(self, points, vertex):
        """The closest of the triangles at one vertex for each point (n,): whether the closest point
        lies off the edges across from the vertex, the triangle, the barycentric coordinates and the
        distance, (n,) or (n, 3)."""
        row, corner, first = self.surface.rings(vertex)
        weights, square = self._on_triangle(points[row], corner // 3)
        best = np.lexsort((square, row))[first]
        corner, weights = corner[best], weights[best]
        own = np.take_along_axis(weights, corner[:, None] % 3, 1)[:, 0]
        return own > 0, corner // 3, weights, np.sqrt(square[best])

    def _closest_few(self, points, distance):
        """Rows (k,) of points, all triangles (k,) that may be the closest ones within `_room` of
        them, and by how much they are further than the closest (k,); distances (n,) of the points,
        and on which side they are (n,). distance: not below theirs (n,) [mm]."""
        room = 2 * self._room + self._slack
        rows_of, triangles = [], []
        for tree, members, radius in self._by_size:
            rows, first, last = np.arange(len(points)), 0, 8
            while len(rows) and first < len(members):
                last = min(last, len(members))
                # no point of a triangle is nearer than its centre less its radius
                bound = distance[rows] + (radius + room)
                to_centre, near = tree.query(
                    points[rows], range(first + 1, last + 1), distance_upper_bound=bound.max()
                )
                maybe = to_centre < bound[:, None]
                row, column = np.nonzero(maybe)
                triangle = members[near[row, column]]
                within = distance[rows[row]] + self._radius[triangle] + room
                own = to_centre[row, column] < within
                rows_of.append(rows[row[own]])
                triangles.append(triangle[own])
                rows = rows[maybe[:, -1]]
                first, last = last, 4 * last
        row, triangle = np.concatenate(rows_of), np.concatenate(triangles)
        weights, square = self._on_triangle(points[row], triangle)
        apart = np.sqrt(square)
        order = np.lexsort((apart, row))
        row, triangle, weights, apart = row[order], triangle[order], weights[order], apart[order]
        closest = np.searchsorted(row, np.arange(len(points)))
        distance = apart[closest]
        side = self.sides(points, triangle[closest], weights[closest])
        further = apart - distance[row]
        keep = further <= room
        return row[keep], triangle[keep], further[keep], distance, side

    def sides(self, points: np.ndarray, triangle: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """On which side (n,) of the surface points (n, 3) are, 1 in front and -1 behind, whose
        closest points lie on triangles (n,) at barycentric coordinates `weights` (n, 3)."""
        surface = self.surface
        arm = points - np.einsum("nc,nci->ni", weights, surface.corners[triangle])
        normal = np.einsum("nc,nci->ni", weights, surface.normals[surface.triangles[triangle]])
        facet = surface.facets[triangle]
        beside = arm - row_dots(arm, facet)[:, None] * facet
        beyond = ((weights <= 0) & (surface.across.triangle[triangle] < 0)).any(1) & (
            row_dots(beside, beside) > 1e-18
        )
        return np.where(beyond, self.side, np.copysign(1.0, row_dots(arm, normal)))

    def closest(
        self, points: np.ndarray, row: np.ndarray, triangle: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The closest of candidates, `triangle` (k,) for the points (n, 3) in `row` (k,): rows of
        points, triangles, barycentric coordinates of the closest points and their distances [mm].
        A point has one row, and more where regions beyond sharp edges may be as near."""
        parts, part = self.surface.parts, self.surface.part
        weights, square = self._on_triangle(points[row], triangle)
        apart = np.sqrt(square)
        key = row if parts == 1 else row * parts + part[triangle]
        order = np.lexsort((apart, key))
        first = np.ones(len(key), dtype=bool)
        first[1:] = key[order][1:] != key[order][:-1]
        best = order[first]
        if parts > 1:
            least = np.full(len(points), np.inf)
            np.minimum.at(least, row[best], apart[best])
            bulge = np.zeros(len(points))
            np.maximum.at(bulge, row[best], self.surface.patches.bulge[triangle[best]])
            best = best[apart[best] <= least[row[best]] + 2 * bulge[row[best]] + 1e-12]
        return row[best], triangle[best], weights[best], apart[best]

    def _on_triangle(self, points, triangle):
        """Barycentric coordinates (n, 3) of the closest points on one triangle each, and the
        squared distances (n,)."""
        weights, square = np.empty((len(points), 3)), np.empty(len(points))
        surface = self.surface
        _close_in(points, triangle, self._slopes, surface.middles, surface.corners, weights, square)
        return weights, square


@compiled
def _close_in(points, triangle, slopes, middles, corners, weights, square):
    """Put what `_on_triangle` gives into weights and square."""
    for n in range(len(points)):
        x, t = points[n], triangle[n]
        corner, b = corners[t], weights[n]
        for c in range(3):
            b[c] = 1 / 3
            for i in range(3):
                b[c] += slopes[t, c, i] * (x[i] - middles[t, i])
        if b[0] < 0 or b[1] < 0 or b[2] < 0:
            least = math.inf
            for start in range(3):
                end = (start + 1) % 3
                along, length = 0.0, 0.0
                for i in range(3):
                    edge = corner[end, i] - corner[start, i]
                    along += (x[i] - corner[start, i]) * edge
                    length += edge * edge
                s = min(max(along / length, 0.0), 1.0)
                apart = 0.0
                for i in range(3):
                    place = corner[start, i] + s * (corner[end, i] - corner[start, i])
                    apart += (x[i] - place) ** 2
                if apart < least:
                    least = apart
                    b[start], b[end], b[(start + 2) % 3] = 1 - s, s, 0.0
        square[n] = 0.0
        for i in range(3):
            place = b[0] * corner[0, i] + b[1] * corner[1, i] + b[2] * corner[2, i]
            square[n] += (x[i] - place) ** 2
