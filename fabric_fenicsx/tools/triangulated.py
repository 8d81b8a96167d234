"""A surface through triangles, curved where they are to be curved."""

from __future__ import annotations

import math
from copy import copy
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike

from ..runtime.errors import InputError
from ..runtime.rules import BELOW_180, POSITIVE
from .closest_triangles import boxes_around, closest
from .curved_triangles import CurvedTriangles, row_dots
from .files import read_triangles
from .projection import Projection, least_radii
from .surfaces import Nearest, Surface
from .triangles import repaired

CREASE = 35.0  # deg
KEPT = 4  # sets of points that are remembered, of so many different numbers


class TriangulatedSurface(Surface):
    """Surface through triangles (m, 3) over points (n, 3) [mm], closed or open; normals point to
    the side from which the first triangle (of each connected part) turns anticlockwise, and the
    others are turned to agree with it.

    The triangles carry curved patches (`patches`) that go through their corners with common tangent
    planes across edges. Edges across which facets turn by more than `crease` [deg] are sharp. Where
    facets lie in one plane the surface is that plane; slivers take its normal. Normals at the
    vertices are those which make arcs of the edges, or `normals` (m, 3, 3), one for each corner of
    each triangle, as a CAD model gives them. With edges of length h the errors are h^3 to h^4 in
    the gap and h^2 to h^3 in the normal where the curvature is smooth; triangles that lie across a
    jump of the curvature err by h^2 and h there.
    The gap is the distance to the nearest point of that surface, found by Newton's method, negative
    behind it; normal and curvature are its derivatives. Beyond the rim of an open surface it is the
    distance to the rim and positive on both sides, as there is no body. The nearest point is sought
    from the closest point of the flat triangles, whose search is exact.

    - points (n, 3) [mm] and triangles (m, 3), without doubles and triangles without area; facets
      (m, 3): unit normals of these, areas (m,) [mm^2]
    - normals (n, 3) at the points, averaged where edges are sharp; curved: the patches, as
      `CurvedTriangles`
    - rim (k, 2): points at the ends of edges of one triangle; forks (k, 2): of more than two;
      sharp (k, 2): of sharp edges
    - turned: how many triangles had to be; one_sided: False where none of the ways to turn them
      agrees

    Raises InputError if no triangle has an area, for points, triangles or normals of a wrong shape
    or not finite, and for a crease that is not above 0 and below 180.
    """

    def __init__(
        self,
        points: ArrayLike,
        triangles: ArrayLike,
        normals: ArrayLike | None = None,
        crease: float = CREASE,
    ) -> None:
        self.crease = BELOW_180.check("crease", crease)
        found = repaired(points, triangles, normals)
        self.turned, self.one_sided = found.turned, found.one_sided
        self.curved = curved = CurvedTriangles(
            found.points, found.triangles, math.radians(self.crease), found.normals
        )
        self.points: np.ndarray = curved.points
        self.triangles: np.ndarray = curved.triangles
        self.facets, self.areas, self.normals = curved.facets, curved.areas, curved.normals
        across, sharp = curved.across, curved.vertices.sharp
        self.rim, self.forks, self.sharp = (
            curved.ends(which)
            for which in (across.sharing == 1, across.sharing > 2, sharp & (across.triangle >= 0))
        )
        self.radii = least_radii(curved)
        self._boxes, self._projection = boxes_around(curved), Projection(curved)
        self._rim_side, self._known = 1.0, {}

    @classmethod
    def read(
        cls,
        path: Path | str,
        chord: float = 0.1,
        crease: float = CREASE,
        comm: MPI.Comm = MPI.COMM_SELF,
    ) -> Self:
        """The surface in a file [mm]: STL, VTP, MSH, or any other that meshio, gmsh or PyVista
        reads, where larger cells are cut; or STEP, IGES or BREP, whose faces gmsh meshes up to
        `chord` [mm] off them. Rank 0 of comm reads: gmsh meshes the same faces a little
        differently each time, and all ranks need one tool.

        Raises InputError if it cannot be read or has no triangle, or for a chord that is not above
        0.
        """
        path, chord = Path(path), POSITIVE.check("chord", chord)
        found, wrong = comm.bcast(_read(path, chord) if comm.rank == 0 else None)
        if wrong:
            raise InputError(wrong)
        points, triangles, normals = found
        try:
            return cls(points, triangles, normals, crease)
        except InputError as error:
            raise InputError(f"surface file {path}: {error}") from None

    def turned_round(self) -> TriangulatedSurface:
        """The same surface with the body on its other side, the normals reversed."""
        vertices = self.curved.vertices
        own = vertices.normals[vertices.name][:, [0, 2, 1]]
        return TriangulatedSurface(self.points, self.triangles[:, [0, 2, 1]], -own, self.crease)

    @property
    def turns(self) -> tuple[np.ndarray, np.ndarray]:
        """Edges that are not sharp (k, 2), by the points at their ends, and by how much facets turn
        there (k,) [rad]."""
        return self.curved.turns()

    @property
    def bulges(self) -> np.ndarray:
        """How far the patches' control points lie off the facets, (m,) [mm]: more than the patches
        themselves."""
        return self.curved.patches.bulge

    def mesh(
        self, low: ArrayLike, high: ArrayLike, size: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As in `Surface`: all of its own triangles."""
        # a point of the drawing for each smooth vertex, so that sharp edges look sharp
        vertices = self.curved.vertices
        points = np.empty_like(vertices.normals)
        points[vertices.name] = self.points[self.triangles]
        return points, vertices.normals, vertices.name

    def from_behind(self) -> TriangulatedSurface:
        """As in `Surface`: the gap beyond the rim has the other sign."""
        seen = copy(self)
        seen._rim_side, seen._known = -self._rim_side, {}
        seen._projection = self._projection.from_behind()
        return seen

    def given(self) -> dict[str, Any]:
        """The crease alone: triangles of a CAD file differ a little each time."""
        return {"crease": self.crease}

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As in `Surface`."""
        curved, (known, moved) = self.curved, self._known_near(points)
        sought = np.flatnonzero(known.clear - moved <= reach)
        row, triangle, weights, distance = closest(
            self._boxes, points[sought], known.triangle[sought], curved.parts
        )
        row = sought[row]
        far = distance - curved.bulge > reach
        moved[row], known.place[row], known.triangle[row] = 0.0, points[row], triangle
        known.side[row[far]] = curved.sides(
            points[row[far]], triangle[far], weights[far], self._rim_side
        )
        known.clear[row[far]] = distance[far] - curved.bulge
        known.clear[row[~far]] = -np.inf
        found = Nearest(
            np.copysign(known.clear - moved, known.side),
            self.facets[known.triangle],
            np.zeros((len(points), 3, 3)),
        )
        rest = ~far
        over = np.flatnonzero(rest & curved.flat[triangle])
        arm = points[row[over]] - np.einsum(
            "nc,nci->ni", weights[over], curved.corners[triangle[over]]
        )
        facet = self.facets[triangle[over]]
        high = row_dots(arm, facet)
        beside = arm - high[:, None] * facet
        inside = row_dots(beside, beside) <= 1e-22
        flat, high = over[inside], high[inside]
        found.gap[row[flat]], found.normal[row[flat]] = high, facet[inside]
        rest[flat] = False
        at = row[rest]
        gap, normal, curvature = self._projection.nearest(points[at], triangle[rest], weights[rest])
        if curved.parts > 1:  # the nearest one counts
            least = np.full(len(points), np.inf)
            least[row[flat]] = abs(high)
            order = np.argsort(-abs(gap), kind="stable")
            order = order[abs(gap[order]) < least[at[order]]]
            at, gap, normal, curvature = at[order], gap[order], normal[order], curvature[order]
        found.gap[at], found.normal[at], found.curvature[at] = gap, normal, curvature
        return found

    def _known_near(self, points):
        """What is known of as many points as these (n, 3), and how far each has moved since [mm]."""
        n = len(points)
        known = self._known.pop(n, None)
        if known is None:
            known = Known(np.zeros((n, 3)), np.full(n, -np.inf), np.ones(n), np.zeros(n, int))
        self._known[n] = known
        if len(self._known) > KEPT:
            del self._known[next(iter(self._known))]  # that which was used least lately
        return known, np.linalg.norm(points - known.place, axis=1)


class Known(NamedTuple):
    """Of n points when they were sought last: their `place` (n, 3), by how much they are surely
    `clear` (n,) of the surface [mm], on which `side` (n,), and the closest `triangle` (n,)."""

    place: np.ndarray
    clear: np.ndarray
    side: np.ndarray
    triangle: np.ndarray


def _read(path, chord):
    """What `read_triangles` finds, or what is wrong with the file."""
    try:
        return read_triangles(path, chord), ""
    except InputError as error:
        return None, str(error)
