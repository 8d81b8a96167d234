"""Triangles with their curved patches: what the search and the projection know of a surface."""

import math

import numpy as np

from ..core.graph import connected
from .facets import LAST, NEXT, corner_normals, facet_normals, topology, unit
from .patches import curved


class CurvedTriangles:
    """Triangles (m, 3) over points (n, 3) [mm], turned the same way round, with `patches` on them
    that go through their corners with common tangent planes across all edges but sharp ones: where
    facets turn by more than `crease` [rad]; given: normals (m, 3, 3) of a CAD model, 0 for none.

    - across: a `Topology`; vertices: smooth vertices, a `Corners`; normals (n, 3): at the points
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
        self.points, self.triangles = points, triangles
        scale = abs(points - points.mean(0)).max()
        self.across = across = topology(triangles)
        # distance from a plane of what lies in it, over the largest coordinate
        self.vertices = vertices = corner_normals(
            points, triangles, across, crease, 1e-6 * scale, given
        )
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
