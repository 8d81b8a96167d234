"""Triangles with their curved patches, and the search for the flat ones closest to points."""

import math
from typing import NamedTuple

import numpy as np

from ..core.compiled import compiled
from ..core.graph import connected
from .facets import LAST, NEXT, corner_normals, divided_at_planes, facet_normals, topology, unit
from .patches import curved

LEAF = 4  # triangles in a box that is not split
ROUNDING = 1e-9  # mm, so that rounding leaves out none


class CurvedTriangles:
    """Triangles (m, 3) over points (n, 3) [mm], turned the same way round, with `patches` on them
    that go through their corners with common tangent planes across all edges but sharp ones: where
    facets turn by more than `crease` [rad]; given: normals (m, 3, 3) of a CAD model, 0 for none.

    - across: a `Topology`; vertices: the `SmoothVertices`; normals (n, 3): at the points
    - parts, part (m,): number of regions that sharp edges bound, and in which one each triangle is
    - flat (m,): whether a patch is its facet; bulge: its largest distance from it [mm]
    - corners_at: numbers 3 t + c of all corners, point by point, and where each point's begin
    """

    def __init__(
        self,
        points: np.ndarray,
        triangles: np.ndarray,
        crease: float,
        given: np.ndarray | None = None,
    ) -> None:
        # distance from a plane of what lies in it, over the largest coordinate
        tolerance = 1e-6 * abs(points - points.mean(0)).max()
        across = topology(triangles)
        vertices = corner_normals(points, triangles, across, crease, tolerance, given)
        if vertices.planar.any():
            points, triangles = divided_at_planes(points, triangles, across, vertices)
            across = topology(triangles)
            vertices = corner_normals(points, triangles, across, crease, tolerance)
        self.points, self.triangles = points, triangles
        self.across, self.vertices = across, vertices
        self.patches = curved(points, triangles, across, vertices)
        self.facets, self.areas = facet_normals(points, triangles)
        total = np.zeros_like(points)
        np.add.at(total, triangles, vertices.normals[vertices.name])
        self.normals = unit(total)
        self.corners = corners = points[triangles]
        edges = np.roll(corners, -1, 1) - corners
        longest = math.sqrt((edges**2).sum(2).max())
        order = np.argsort(triangles.ravel(), kind="stable")
        starts = np.searchsorted(triangles.ravel()[order], np.arange(len(points) + 1))
        self.corners_at = order, starts
        t, k = np.nonzero(~vertices.sharp)
        self.parts, self.part = connected(len(triangles), [t, across.triangle[t, k]])
        self.bulge = float(self.patches.bulge.max())
        self.on_rim = np.zeros(len(points), dtype=bool)
        self.on_rim[self.ends(across.triangle < 0)] = True
        own = vertices.normals[vertices.name]
        aligned = ((own * self.facets[:, None]).sum(2) >= 1 - 1e-15).all(1)
        self.flat = aligned | (own == self.facets[:, None]).all((1, 2))
        self.flat &= self.patches.bulge <= 1e-12 * longest

    @property
    def middles(self) -> np.ndarray:
        """Centroids (m, 3) of the triangles."""
        return self.corners.mean(1)

    def ends(self, which: np.ndarray) -> np.ndarray:
        """Points (k, 2) at the ends of the edges of which (m, 3) is true, each once."""
        return np.unique(np.sort(self._ends(*np.nonzero(which)), 1), axis=0)

    def _ends(self, triangle, edge):
        return np.stack([self.triangles[triangle, each[edge]] for each in (NEXT, LAST)], -1)

    def sides(
        self, points: np.ndarray, triangle: np.ndarray, weights: np.ndarray, rim: float
    ) -> np.ndarray:
        """Side (n,) of the surface on which points (n, 3) are, 1 in front and -1 behind, `rim`
        beside an open edge; their closest points lie on triangles (n,) at barycentric coordinates
        `weights` (n, 3)."""
        arm = points - np.einsum("nc,nci->ni", weights, self.corners[triangle])
        normal = np.einsum("nc,nci->ni", weights, self.normals[self.triangles[triangle]])
        facet = self.facets[triangle]
        beside = arm - row_dots(arm, facet)[:, None] * facet
        beyond = ((weights <= 0) & (self.across.triangle[triangle] < 0)).any(1)
        beyond &= row_dots(beside, beside) > 1e-18
        return np.where(beyond, rim, np.copysign(1.0, row_dots(arm, normal)))

    def smooth_edges(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Triangles (k,) on both sides of each edge that is not sharp, and its ends (2, k)."""
        t, k = np.nonzero(~self.vertices.sharp)
        other = self.across.triangle[t, k]
        once = t < other
        return t[once], other[once], self._ends(t[once], k[once]).T

    def turns(self) -> tuple[np.ndarray, np.ndarray]:
        """Ends (k, 2) of edges that are not sharp, and the turn of facets there (k,) [rad]."""
        t, other, ends = self.smooth_edges()
        sine = np.linalg.norm(np.cross(self.facets[t], self.facets[other]), axis=1)
        return ends.T, np.arctan2(sine, (self.facets[t] * self.facets[other]).sum(1))


def row_dots(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar products (n,) of rows (n, 3), faster than a sum over rows of three."""
    return np.einsum("ni,ni->n", a, b)


class Boxes(NamedTuple):
    """A binary tree of boxes around triangles. Box i, between `low` and `high` (2 k, 3) [mm], is
    split into boxes 2 i and 2 i + 1; the k last ones hold triangles `members` (k, LEAF). slopes
    (m, 3, 3): gradients of the triangles' barycentric coordinates."""

    low: np.ndarray
    high: np.ndarray
    members: np.ndarray
    corners: np.ndarray
    middles: np.ndarray
    slopes: np.ndarray
    region: np.ndarray
    bulge: np.ndarray


def boxes_around(surface: CurvedTriangles) -> Boxes:
    """The tree of a surface's flat triangles."""
    corners, middles = surface.corners, surface.middles
    edges = np.roll(corners, -1, 1) - corners
    area = np.cross(edges[:, 0], edges[:, 1])
    slopes = np.cross(area[:, None], np.roll(edges, -1, 1)) / (area**2).sum(1)[:, None, None]
    levels = max(0, math.ceil(math.log2(len(corners) / LEAF)))
    members = np.resize(np.arange(len(corners)), LEAF << levels)  # some twice
    for level in range(levels):  # halve each box across its longest side
        members = members.reshape(1 << level, -1)
        places = middles[members]
        axis = np.ptp(places, axis=1).argmax(1)
        along = np.take_along_axis(places, axis[:, None, None], 2)[..., 0]
        members = np.take_along_axis(members, along.argsort(1, kind="stable"), 1)
    members = members.reshape(-1, LEAF)
    inside = corners[members].reshape(len(members), -1, 3)
    low, high = [inside.min(1)], [inside.max(1)]
    while len(low[0]) > 1:
        low.insert(0, low[0].reshape(-1, 2, 3).min(1))
        high.insert(0, high[0].reshape(-1, 2, 3).max(1))
    none = np.zeros((1, 3))  # boxes are numbered from 1
    low, high = np.concatenate([none, *low]), np.concatenate([none, *high])
    bulge = surface.patches.bulge
    return Boxes(low, high, members, corners, middles, slopes, surface.part, bulge)


def closest(
    boxes: Boxes, points: np.ndarray, start: np.ndarray, regions: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rows (k,) of points (n, 3), triangles (k,) closest to them, barycentric coordinates (k, 3)
    and distances (k,) [mm]. A point has further rows before its own where one of several `regions`
    may be as near on its patches. A near triangle to start from (n,) saves time."""
    # most regions between sharp edges whose triangles count at one point
    slots = min(regions, 8)
    triangle = np.zeros((len(points), slots), dtype=np.int64)
    weights, square = np.empty((len(points), slots, 3)), np.full((len(points), slots), np.inf)
    slack = ROUNDING + (2 * boxes.bulge.max() if regions > 1 else 0.0)
    _search(boxes, points, start, slack, triangle, weights, square)
    distance = np.sqrt(square)
    if slots == 1:
        return np.arange(len(points)), triangle[:, 0], weights[:, 0], distance[:, 0]
    bulge, order = boxes.bulge[triangle], np.argsort(-distance, 1)
    best = order[:, -1:]
    room = 2 * np.maximum(bulge, np.take_along_axis(bulge, best, 1)) + ROUNDING
    near = distance <= np.take_along_axis(distance, best, 1) + room
    row, slot = np.nonzero(np.take_along_axis(near, order, 1))
    slot = order[row, slot]
    return row, triangle[row, slot], weights[row, slot], distance[row, slot]


@compiled
def _search(boxes, points, start, slack, triangle, weights, square):
    """Fill in triangle, weights and square (n, regions) for `closest`; triangles up to `slack` [mm]
    further than the closest count."""
    leaves, stack = len(boxes.members), np.empty(64, dtype=np.int64)
    for n in range(len(points)):
        x, least = points[n], _foot(boxes, points[n], start[n])[0]
        limit = (math.sqrt(least) + slack) ** 2
        stack[0], count = 1, 1
        while count:
            count -= 1
            i = stack[count]
            if _apart(boxes, i, x) > limit:
                continue
            if i < leaves:
                far = _apart(boxes, 2 * i, x) > _apart(boxes, 2 * i + 1, x)
                stack[count], stack[count + 1] = 2 * i + 1 - far, 2 * i + far
                count += 2
                continue
            for k in range(LEAF):
                t = boxes.members[i - leaves, k]
                foot = _foot(boxes, x, t)
                if foot[0] <= limit:
                    _put(boxes.region, foot, n, t, triangle, weights, square)
                    least = min(least, foot[0])
            limit = (math.sqrt(least) + slack) ** 2


@compiled
def _apart(boxes, i, x):
    """Squared distance of x (3,) from box i."""
    square = 0.0
    for k in range(3):
        square += max(boxes.low[i, k] - x[k], x[k] - boxes.high[i, k], 0.0) ** 2
    return square


@compiled
def _put(region, foot, n, t, triangle, weights, square):
    """Put triangle t into row n, in its region's place, if it is the closest there."""
    slot, last = 0, triangle.shape[1] - 1
    while slot < last and square[n, slot] < math.inf and region[triangle[n, slot]] != region[t]:
        slot += 1
    # of triangles that share the closest point the first, whichever is tried first
    if foot[0] < square[n, slot] or (foot[0] == square[n, slot] and t < triangle[n, slot]):
        triangle[n, slot], square[n, slot] = t, foot[0]
        weights[n, slot, 0], weights[n, slot, 1], weights[n, slot, 2] = foot[1], foot[2], foot[3]


@compiled
def _foot(boxes, x, t):
    """Squared distance of x (3,) from triangle t, and barycentric coordinates of the foot."""
    corner, slope, least = boxes.corners, boxes.slopes, math.inf
    middle = (boxes.middles[t, 0], boxes.middles[t, 1], boxes.middles[t, 2])
    u, v, w = x[0] - middle[0], x[1] - middle[1], x[2] - middle[2]
    b0 = 1 / 3 + slope[t, 0, 0] * u + slope[t, 0, 1] * v + slope[t, 0, 2] * w
    b1 = 1 / 3 + slope[t, 1, 0] * u + slope[t, 1, 1] * v + slope[t, 1, 2] * w
    b2 = 1 / 3 + slope[t, 2, 0] * u + slope[t, 2, 1] * v + slope[t, 2, 2] * w
    if b0 < 0 or b1 < 0 or b2 < 0:  # on the nearest edge
        for i in range(3):
            j = (i + 1) % 3
            along = length = 0.0
            for k in range(3):
                edge = corner[t, j, k] - corner[t, i, k]
                along += (x[k] - corner[t, i, k]) * edge
                length += edge * edge
            s = min(max(along / length, 0.0), 1.0)
            square = 0.0
            for k in range(3):
                square += (x[k] - corner[t, i, k] - s * (corner[t, j, k] - corner[t, i, k])) ** 2
            if square < least:
                least = square
                b0 = (1 - s) * (i == 0) + s * (j == 0)
                b1 = (1 - s) * (i == 1) + s * (j == 1)
                b2 = (1 - s) * (i == 2) + s * (j == 2)
    square = 0.0
    for k in range(3):
        place = b0 * corner[t, 0, k] + b1 * corner[t, 1, k] + b2 * corner[t, 2, k]
        square += (x[k] - place) ** 2
    return square, b0, b1, b2
