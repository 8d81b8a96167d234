"""A surface through triangles, curved where they are to be curved."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from copy import copy
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike

from ..core.collective_errors import on_root
from ..core.errors import InputError
from ..core.graph import connected
from ..core.rules import BELOW_180, POSITIVE
from .curved_triangles import CurvedTriangles, boxes_around, closest, row_dots
from .facets import repaired
from .files import read_triangles
from .projection import least_radii, nearest, net_of
from .surfaces import Drawn, Nearest, Surface

CREASE = 35.0  # deg
CUT_TOLERANCE = 1e-3  # mm off a plane of symmetry, up to which a tool is cut there


class SearchCache(NamedTuple):
    """n points at their last search: `place` (n, 3), least distance `clear` (n,) from the surface
    [mm] and `side` (n,) of those beyond the reach, closest `triangle` (n,)."""

    place: np.ndarray
    clear: np.ndarray
    side: np.ndarray
    triangle: np.ndarray


class TriangulatedSurface(Surface):
    """Surface through triangles, curved where they approximate a curved surface.

    Curved patches go through the triangles' corners, with common tangent planes across edges; where
    facets lie in one plane the surface is that plane, up to where an arc to the next points begins.
    With edges of length h the errors are h^3 to h^4 in the gap and h^2 to h^3 in the normal where
    the curvature is smooth, h^2 and h across other jumps of it. Gap, normal and curvature are exact
    at the nearest point of the patches. Beyond the rim of an open surface the gap is the distance
    to the rim and positive on both sides. Raises InputError if no triangle has an area, for points
    that are not finite, and for a crease not between 0 and 180.

    Parameters
    ----------
    points : (n, 3)
        [mm]
    triangles : (m, 3)
        Numbers of their points. The side from which the first one of a connected part turns
        anticlockwise is outside; the others are turned to agree with it.
    normals : (m, 3, 3)
        At the corners of the triangles, as a CAD model has them; by default those which make arcs
        of the edges.
    crease : float
        Angle across which an edge between facets is sharp [deg].

    Attributes
    ----------
    points, triangles, facets, areas, normals
        Without doubles and triangles without area, divided where planes end; unit normals (m, 3)
        and areas (m,) [mm2] of the facets; normals (n, 3) at the points, averaged where edges are
        sharp.
    rim, forks, sharp : (k, 2)
        Points at the ends of edges of one triangle, of more than two, and of sharp ones.

    References
    ----------
    D. J. Walton, D. S. Meek, A triangular G1 patch from boundary curves, Computer-Aided Design 28
    (1996) 113.

    Examples
    --------
    >>> roof = ff.TriangulatedSurface([[0, 0, 0], [9, 0, 0], [0, 9, 0]], [[0, 1, 2]])
    >>> roof.evaluate([[2, 2, 1]]).gap
    array([1.])
    """

    _rim_side = 1.0  # sign of the gap beyond the rim

    def __init__(
        self,
        points: ArrayLike,
        triangles: ArrayLike,
        normals: ArrayLike | None = None,
        crease: float = CREASE,
    ) -> None:
        self.crease = BELOW_180.check("crease", crease)
        x, cells, self._given = repaired(points, triangles, normals)
        self.curved = curved = CurvedTriangles(x, cells, math.radians(self.crease), self._given)
        self.points: np.ndarray = curved.points
        self.triangles: np.ndarray = curved.triangles
        self.facets, self.areas, self.normals = curved.facets, curved.areas, curved.normals
        across, sharp = curved.across, curved.vertices.sharp
        self.rim, self.forks = curved.ends(across.sharing == 1), curved.ends(across.sharing > 2)
        self.sharp = curved.ends(sharp & (across.triangle >= 0))
        self.radii = least_radii(curved)
        self._boxes, self._net = boxes_around(curved), net_of(curved)
        self._caches: dict[int, SearchCache] = {}

    @classmethod
    def read(
        cls,
        path: Path | str,
        chord: float = 0.1,
        crease: float = CREASE,
        comm: MPI.Comm = MPI.COMM_SELF,
        body: Sequence[int] = (),
    ) -> Self:
        """The surface in a file, in mm: STL, VTP, MSH, or any other that gmsh, PyVista or meshio
        reads, where larger cells are cut; or STEP, IGES or BREP, whose faces gmsh meshes. chord:
        distance of that mesh from the faces [mm]; crease: as for the surface [deg]; comm: its rank
        0 reads, as gmsh meshes the same faces a little differently each time; body: numbers of the
        model's solids, from 1, needed of several. Raises InputError if
        the file cannot be read or has no triangle, or for a chord not above 0."""
        path, chord = Path(path), POSITIVE.check("chord", chord)
        points, triangles, normals = on_root(comm, lambda: read_triangles(path, chord, body))
        try:
            return cls(points, triangles, normals, crease)
        except InputError as error:
            raise InputError(f"surface file {path}: {error}") from None

    def face(self, towards: ArrayLike) -> TriangulatedSurface:
        """What looks `towards` (3,), with the walls that lie within it."""
        side, across = self.facets @ np.asarray(towards, dtype=float), self.curved.across.triangle
        steep = 0.02  # sine of the angle to the direction, below which a facet is a wall along it
        wall = abs(side) < steep
        t, k = np.nonzero((across >= 0) & wall[:, None])
        joined = wall[across[t, k]]
        _, part = connected(len(wall), [t[joined], across[t, k][joined]])
        outer = np.isin(part, part[t[side[across[t, k]] <= -steep]])  # beside the back
        keep = (side >= steep) | (wall & ~outer)
        vertices = self.curved.vertices
        own = vertices.normals[vertices.name]
        return TriangulatedSurface(self.points, self.triangles[keep], own[keep], self.crease)

    def moved(self, way: np.ndarray, planes: Iterable[np.ndarray] = ()) -> TriangulatedSurface:
        """The surface moved by `way` (3,) [mm], with its images in planes that cut it then, by unit
        normals and distances from the origin (4,) [mm], and without triangles in them."""
        x, cells, given = self.points + way, self.triangles, self._given
        for plane in planes:
            off = x @ plane[:3] - plane[3]
            off[abs(off) < CUT_TOLERANCE] = 0.0
            kept, image = off[cells].any(1), np.eye(3) - 2 * np.outer(plane[:3], plane[:3])
            if given is not None:
                given = np.concatenate([given[kept], given[kept][:, ::-1] @ image])
            cells = np.vstack([cells[kept], cells[kept][:, ::-1] + len(x)])
            x = np.vstack([x, x - 2 * np.outer(off, plane[:3])])
        return TriangulatedSurface(x, cells, given, self.crease)

    def mesh(self, low: ArrayLike, high: ArrayLike, size: float) -> Drawn:
        # a point for each smooth vertex, so that sharp edges look sharp
        vertices = self.curved.vertices
        points = np.empty_like(vertices.normals)
        points[vertices.name] = self.points[self.triangles]
        return points, vertices.normals, vertices.name

    def from_behind(self) -> TriangulatedSurface:
        """The same, but the gap beyond the rim has the other sign."""
        seen = copy(self)
        seen._rim_side, seen._caches = -self._rim_side, {}
        return seen

    def fingerprint(self) -> dict[str, ArrayLike]:
        """The crease alone: triangles of a CAD file differ a little each time."""
        return {"crease": self.crease}

    def __eq__(self, other: object) -> bool:
        """Equality of crease and triangles."""
        if not isinstance(other, TriangulatedSurface) or self.crease != other.crease:
            return False
        return np.array_equal(self.points[self.triangles], other.points[other.triangles])

    __hash__ = Surface.__hash__

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        curved, (last, moved) = self.curved, self._cache_of(points)
        sought = np.flatnonzero(last.clear - moved <= reach)
        row, triangle, weights, distance = closest(
            self._boxes, points[sought], last.triangle[sought], curved.parts
        )
        row, far = sought[row], distance - curved.bulge > reach
        moved[row], last.place[row], last.triangle[row] = 0.0, points[row], triangle
        last.clear[row] = np.where(far, distance - curved.bulge, -np.inf)
        last.side[row[far]] = curved.sides(
            points[row[far]], triangle[far], weights[far], self._rim_side
        )
        far_gap, n = np.copysign(last.clear - moved, last.side), len(points)
        feet = Nearest(far_gap, self.facets[last.triangle], np.zeros((n, 3, 3)))
        near = ~far
        self._project(points, row[near], triangle[near], weights[near], feet)
        return feet

    def _project(self, points, row, triangle, weights, feet):
        """Put what belongs to points (n, 3) into `row` (k,) of what is found, sought from places on
        triangles (k,): at once over flat ones, where a facet is the surface."""
        curved, least = self.curved, np.full(len(points), np.inf)
        over = np.flatnonzero(curved.flat[triangle])
        places = np.einsum("nc,nci->ni", weights[over], curved.corners[triangle[over]])
        arm, facet = points[row[over]] - places, self.facets[triangle[over]]
        high = row_dots(arm, facet)
        beside = arm - high[:, None] * facet
        inside = row_dots(beside, beside) <= 1e-22
        at = row[over[inside]]
        feet.gap[at], feet.normal[at] = high[inside], facet[inside]
        least[at] = abs(high[inside])
        rest = np.ones(len(row), dtype=bool)
        rest[over[inside]] = False
        at = row[rest]
        gap, normal, curvature = nearest(
            self._net, self._rim_side, points[at], triangle[rest], weights[rest]
        )
        if curved.parts > 1:  # the nearest one counts
            order = np.argsort(-abs(gap), kind="stable")
            order = order[abs(gap[order]) < least[at[order]]]
            at, gap, normal, curvature = at[order], gap[order], normal[order], curvature[order]
        feet.gap[at], feet.normal[at], feet.curvature[at] = gap, normal, curvature

    def _cache_of(self, points):
        """The `SearchCache` of as many points (n, 3), and how far each has moved since [mm]."""
        n = len(points)
        last = self._caches.pop(n, None) or SearchCache(
            np.zeros((n, 3)), np.full(n, -np.inf), np.ones(n), np.zeros(n, dtype=np.int64)
        )
        self._caches[n] = last
        if len(self._caches) > 4:  # sets of points of different numbers
            del self._caches[next(iter(self._caches))]  # that which was used least lately
        return last, np.linalg.norm(points - last.place, axis=1)
