"""A surface through triangles, curved where they are to be curved."""

import math
from copy import copy
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..errors import InputError
from . import patches
from .files import FORMATS, read_triangles
from .patches import LAST, NEXT
from .surfaces import Nearest, Surface
from .values import _number

CREASE = 35.0  # deg
SAME, FLAT = (
    2e-7,
    1e-6,
)  # of the largest coordinate: points that are one, and what may lie off a plane (files of single precision)
ROOM = 0.4  # of a usual triangle's size, as far as candidates are kept for
COVER = 1 / math.sqrt(3)  # of a triangle's longest edge, no point of it is further from all its corners
KEPT = 4  # lists of candidates, of so many different numbers of points
BENT = 0.99  # of the turning of a surface has a larger radius than what counts as its least


class _Lists(NamedTuple):
    """What was found for n points: the `place` (n, 3) where they were, the triangles (k,) that may be closest and the points'
    rows (k,), or if these lie in one plane one of them in `plane` (n,), otherwise -1, which hold as far as `valid` (n,) from
    there; or for those without, from what they are `clear` (n,), on which side (n,), and a normal (n, 3)."""

    place: np.ndarray
    valid: np.ndarray
    clear: np.ndarray
    side: np.ndarray
    normal: np.ndarray
    plane: np.ndarray
    row: np.ndarray
    triangle: np.ndarray

    @classmethod
    def empty(cls, n):
        none = np.empty(0, dtype=np.int64)
        far, zeros = np.full(n, -np.inf), np.zeros((n, 3))
        return cls(zeros, np.full(n, -1.0), far, np.ones(n), zeros, np.full(n, -1), none, none)


class TriangulatedSurface(Surface):
    """Surface through triangles (m, 3) over points (n, 3) [mm], closed or open; normals point to the side from which the first
    triangle (of each connected part) turns anticlockwise, and the others are turned to agree with it.

    The triangles carry curved patches (`patches`) that go through their corners with common tangent planes across edges.
    Edges across which facets turn by more than `crease` [deg] are sharp. Where facets lie in one plane the surface
    is that plane; slivers take its normal. Normals at the vertices are those which make arcs of the edges, or `normals`
    (m, 3, 3), one for each corner of each triangle, as a CAD model gives them. With edges of length h the errors are
    h^3 to h^4 in the gap and h^2 to h^3 in the normal where the curvature is smooth; triangles that lie across a jump of the
    curvature err by h^2 and h there.
    The gap is the distance to the nearest point of that surface, found by Newton's method, negative behind it; normal and
    curvature are its derivatives. Beyond the rim of an open surface it is the distance to the rim and positive on both sides,
    as there is no body. The nearest point is sought from the closest point of the flat triangles, whose search is exact.

    - points (n, 3) [mm] and triangles (m, 3), without doubles and triangles without area; facets (m, 3): unit normals of these,
      areas (m,) [mm^2]
    - normals (n, 3) at the points, averaged where edges are sharp
    - rim (k, 2): points at the ends of edges of one triangle; forks (k, 2): of more than two; sharp (k, 2): of sharp edges
    - turned: how many triangles had to be; one_sided: False where none of the ways to turn them agrees

    Raises InputError if no triangle has an area, or for points, triangles or normals of a wrong shape or not finite.
    """

    def __init__(
        self, points: ArrayLike, triangles: ArrayLike, normals: ArrayLike | None = None, crease: float = CREASE
    ) -> None:
        x, cells = np.asarray(points, dtype=float), np.asarray(triangles)
        if x.ndim != 2 or x.shape[1] != 3 or not np.isfinite(x).all():
            raise InputError(f"points of the surface have the shape {x.shape}, but it must be (n, 3), all finite")
        if cells.ndim != 2 or cells.shape[1] != 3 or cells.dtype.kind not in "iu":
            raise InputError(f"triangles have the shape {cells.shape}, but it must be (m, 3), of integers")
        if cells.size and not 0 <= cells.min() <= cells.max() < len(x):
            raise InputError(f"triangles name points {cells.min()} to {cells.max()}, but there are {len(x)}")
        given = None if normals is None else np.asarray(normals, dtype=float)
        if given is not None and given.shape != (*cells.shape, 3):
            raise InputError(f"normals have the shape {given.shape}, but it must be {(*cells.shape, 3)}")
        self.crease = _number("crease", crease, "above 0 and below 180 deg", 0, 180)
        angle = math.radians(self.crease)
        x, number = _merged(x)
        cells = number[cells]
        corners = x[cells]
        edges = np.roll(corners, -1, 1) - corners
        longest = (edges**2).sum(2).max(1, initial=0)
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) > 1e-10 * longest
        if not area.any():
            raise InputError("the surface has no triangle with an area, but it must have one at least")
        used, number = np.unique(cells[area], return_inverse=True)
        cells, turn, self.one_sided = _agreeing(number.reshape(-1, 3))
        self.turned = int(turn.sum())
        if given is not None:
            given = given[area]
            given[turn] = given[turn][:, [0, 2, 1]]
            given = np.where(turn[:, None, None], -given, given)
            facets = patches.facet_normals(x[used], cells)[0][:, None]
            # at poles of a CAD model's faces there is none
            known = (given * facets).sum(2)[..., None] > math.cos(math.pi / 3)
            given = np.where(known, given, 0.0)
        self.points: np.ndarray = x[used]
        self.triangles: np.ndarray = cells
        scale = abs(self.points - self.points.mean(0)).max()
        self._across = across = patches.topology(cells)
        self._corner = corner = patches.corner_normals(self.points, cells, across, angle, FLAT * scale, given)
        self._patches = patches.curved(self.points, cells, across, corner)
        self.facets, self.areas = patches.facet_normals(self.points, cells)
        self.rim, self.forks, self.sharp = (
            self._ends(which)
            for which in (across.sharing == 1, across.sharing > 2, corner.sharp & (across.triangle >= 0))
        )
        self._side = 1.0  # of the gap beyond the rim
        self.normals: np.ndarray = self._average_normals()
        self._prepare_search()
        self._prepare_projection()

    def _ends(self, which):
        t, k = np.nonzero(which)
        ends = np.column_stack([self.triangles[t, np.array(NEXT)[k]], self.triangles[t, np.array(LAST)[k]]])
        return np.unique(np.sort(ends, 1), axis=0)

    @classmethod
    def read(cls, path: Path | str, chord: float = 0.1, crease: float = CREASE) -> Self:
        """The surface in a file [mm]: STL, VTP, MSH, or any other that meshio or PyVista reads, where quadrilaterals are cut;
        or STEP, IGES or BREP, whose faces gmsh meshes up to `chord` [mm] off them.

        Raises InputError if it cannot be read or has no triangle, or for a chord that is not above 0.
        """
        path, chord = Path(path), _number("chord", chord, "above 0", low=0)
        if not path.is_file():
            raise InputError(f"surface file {path} does not exist or is not a file; allowed is {FORMATS}")
        try:
            points, triangles, normals = read_triangles(path, chord)
        except (Exception, SystemExit) as error:  # the readers raise whatever their parsing stumbles on, or exit
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"surface file {path} cannot be read ({reason}); allowed is {FORMATS}") from None
        try:
            return cls(points, triangles, normals, crease)
        except InputError as error:
            raise InputError(f"surface file {path}: {error}") from None

    def turned_round(self) -> "TriangulatedSurface":
        """The same surface with the body on its other side, the normals reversed."""
        own = self._corner.normals[self._corner.name]
        return TriangulatedSurface(self.points, self.triangles[:, [0, 2, 1]], -own[:, [0, 2, 1]], self.crease)

    # -- what is known of the surface as a whole

    def _average_normals(self):
        total = np.zeros_like(self.points)
        np.add.at(total, self.triangles, self._corner.normals[self._corner.name])
        return total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]

    @property
    def turns(self) -> tuple[np.ndarray, np.ndarray]:
        """Edges that are not sharp (k, 2), by the points at their ends, and by how much facets turn there (k,) [rad]."""
        t, k = np.nonzero(~self._corner.sharp)
        other = self._across.triangle[t, k]
        once = t < other
        t, k, other = t[once], k[once], other[once]
        ends = np.column_stack([self.triangles[t, np.array(NEXT)[k]], self.triangles[t, np.array(LAST)[k]]])
        return ends, np.arccos(np.clip((self.facets[t] * self.facets[other]).sum(1), -1, 1))

    @property
    def bulges(self) -> np.ndarray:
        """How far the patches' control points lie off the facets, (m,) [mm]: more than the patches themselves."""
        return self._patches.bulge

    def _curvatures(self):
        """Principal curvatures (m, 2) [1/mm] in the patches' middles, the larger first; positive as a ball's."""
        every = np.arange(len(self.triangles))
        _, metric, bend, _ = _forms(patches.evaluate(self._patches, every, np.full((3, len(every)), 1 / 3)))
        det = np.maximum(metric[0] * metric[2] - metric[1] ** 2, 1e-300)
        mean = -(metric[2] * bend[0] + metric[0] * bend[2] - 2 * metric[1] * bend[1]) / (2 * det)
        gauss = (bend[0] * bend[2] - bend[1] ** 2) / det
        spread = np.sqrt(np.maximum(mean * mean - gauss, 0))
        return mean + spread, mean - spread

    # -- the surface seen from points

    def _mesh(self, low, high, size):
        # a point of the drawing for each smooth vertex, so that sharp edges look sharp
        points = np.empty_like(self._corner.normals)
        points[self._corner.name] = self.points[self.triangles]
        return points, self._corner.normals, self._corner.name

    def _behind(self):
        seen = copy(self)
        seen._side, seen._lists = -self._side, {}
        return seen

    def nearest(self, points: np.ndarray, reach: float) -> Nearest:
        """As in `Surface`."""
        lists, gap = self._listed(points, reach)
        row, triangle, weights, distance = self._closest(points, lists.row, lists.triangle)
        facet = self.facets[triangle]
        arm = points[row] - np.einsum("nc,nci->ni", weights, self._corners[triangle])
        high = _dot(arm, facet)
        beside = arm - high[:, None] * facet
        # known at once: what lies further than the reach, and what lies over planes
        far = distance - self._bulge > reach
        flat = ~far & self._flat[triangle] & (_dot(beside, beside) <= 1e-22)
        found = Nearest(gap, lists.normal.copy(), np.zeros((len(points), 3, 3)))
        found.gap[row[far]] = (distance[far] - self._bulge) * self._sides(points[row[far]], triangle[far], weights[far])
        found.gap[row[flat]], found.normal[row[flat]] = high[flat], facet[flat]
        rest = np.flatnonzero(~far & ~flat)
        at = row[rest]
        gap, normal, curvature = self._project(points[at], triangle[rest], weights[rest].T.copy())
        if self._parts > 1:  # of several the nearest
            known = np.full(len(points), np.inf)
            known[row[flat]] = abs(high[flat])
            order = np.argsort(-abs(gap), kind="stable")
            order = order[abs(gap[order]) < known[at[order]]]
            at, gap, normal, curvature = at[order], gap[order], normal[order], curvature[order]
        found.gap[at], found.normal[at], found.curvature[at] = gap, normal, curvature
        over = np.flatnonzero(lists.plane >= 0)
        facet = self.facets[lists.plane[over]]
        found.gap[over] = _dot(points[over] - self._middles[lists.plane[over]], facet)
        found.normal[over] = facet
        return found

    # -- search among the flat triangles

    def _prepare_search(self):
        self._corners = corners = self.points[self.triangles]
        edges = np.roll(corners, -1, 1) - corners
        area = np.cross(edges[:, 0], edges[:, 1])
        # gradients of the barycentric coordinates
        self._slopes = np.cross(area[:, None], np.roll(edges, -1, 1)) / (area**2).sum(1)[:, None, None]
        self._longest = math.sqrt((edges**2).sum(2).max())
        self._vertices = cKDTree(self.points)
        order = np.argsort(self.triangles.ravel(), kind="stable")
        starts = np.searchsorted(self.triangles.ravel()[order], np.arange(len(self.points) + 1))
        self._ring = order, starts  # 3 t + c of the corners at a point
        self._middles = centre = corners.mean(1)
        radius = np.linalg.norm(corners - centre[:, None], axis=2).max(1)
        size = np.floor(np.log2(radius / radius.max()) / 2)
        self._room = ROOM * math.sqrt(np.median(self.areas))
        self._lists: dict[int, _Lists] = {}
        self._by_size = []
        for each in np.unique(size)[::-1]:
            members = np.flatnonzero(size == each)
            self._by_size.append((cKDTree(centre[members]), members, radius[members].max() * (1 + 1e-9)))

    def _listed(self, points, reach):
        """The `_Lists` for these points, made anew for those that have left the places where they hold."""
        n = len(points)
        old = self._lists.pop(n, None) or _Lists.empty(n)
        moved = np.linalg.norm(points - old.place, axis=1)
        renew = np.flatnonzero(~((moved <= old.valid) | (old.clear - moved > reach)))
        if len(renew):
            # and those that soon will
            renew = np.flatnonzero(~((moved <= old.valid / 2) | (old.clear - moved > reach)))
            old = self._renewed(old, points, reach, renew)
            moved[renew] = 0
        self._lists[n] = old
        if len(self._lists) > KEPT:
            del self._lists[next(iter(self._lists))]  # that which was used least lately
        return old, np.copysign(old.clear - moved, old.side)

    def _renewed(self, old, points, reach, renew):
        place, valid, clear = old.place.copy(), old.valid.copy(), old.clear.copy()
        side, normal, plane = old.side.copy(), old.normal.copy(), old.plane.copy()
        x = points[renew]
        apart, vertex = self._vertices.query(x)
        ring, triangle, weights, bound = self._around(x, vertex)
        place[renew], normal[renew], valid[renew], plane[renew] = x, self.facets[triangle], -1.0, -1
        side[renew] = self._sides(x, triangle, weights)
        clear[renew] = apart - COVER * self._longest - self._bulge
        # the side is not sure where the closest point lies where the triangles about the vertex end
        near = np.flatnonzero((clear[renew] - self._room <= reach) | ~ring)
        row, triangle = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
        if len(near):
            row, triangle, least, sides = self._candidates(x[near], bound[near])
            near = renew[near]
            side[near], clear[near] = sides, least - self._bulge
            close = least - self._bulge - self._room <= reach
            row, triangle = near[row[close[row]]], triangle[close[row]]
            near, least = near[close], least[close]
            valid[near], clear[near] = self._room, -1.0
            low, high = np.full(len(points), len(self.facets)), np.full(len(points), -1)
            np.minimum.at(low, row, self._plane[triangle])
            np.maximum.at(high, row, self._plane[triangle])
            plane[near] = np.where(low == high, low, -1)[near]
            for each in np.unique(plane[near[plane[near] >= 0]]):
                at = near[plane[near] == each]
                tree, cover = self._beside(each)
                apart = tree.query(points[at])[0] - cover - least[np.searchsorted(near, at)]
                valid[at] = np.maximum(valid[at], apart / 2)
        changed = np.zeros(len(points), dtype=bool)
        changed[renew] = True
        row, triangle = (np.append(a[~changed[old.row]], b) for a, b in ((old.row, row), (old.triangle, triangle)))
        hold = plane[row] < 0
        order = np.argsort(row[hold], kind="stable")
        return _Lists(place, valid, clear, side, normal, plane, row[hold][order], triangle[hold][order])

    def _beside(self, plane):
        """Vertices and middles of edges of all triangles but a plane's, as a tree, and how far from these their points are."""
        if plane not in self._rest:
            corners = self._corners[self._plane != plane]
            onwards = np.roll(corners, -1, 1)
            longest = math.sqrt(((onwards - corners) ** 2).sum(2).max(initial=0))
            places = np.concatenate([corners, (corners + onwards) / 2]).reshape(-1, 3)
            self._rest[plane] = cKDTree(np.unique(places, axis=0)), COVER * longest / 2
        return self._rest[plane]

    def _around(self, points, vertex):
        """Of the triangles at a vertex each (n,): whether the closest point lies off the edges across from the vertex, the
        triangle, the barycentric coordinates and the distance, (n,) or (n, 3)."""
        order, starts = self._ring
        count = starts[vertex + 1] - starts[vertex]
        first = count.cumsum() - count
        row = np.repeat(np.arange(len(points)), count)
        corner = order[np.repeat(starts[vertex] - first, count) + np.arange(count.sum())]
        weights, square = self._on_triangle(points[row], corner // 3)
        best = np.lexsort((square, row))[first]
        corner, weights = corner[best], weights[best]
        own = np.take_along_axis(weights, corner[:, None] % 3, 1)[:, 0]
        return own > 0, corner // 3, weights, np.sqrt(square[best])

    def _candidates(self, points, distance):
        """Rows (k,) of points, and all triangles (k,) that may be the closest ones within `_room` of them; distances (n,) of the
        points, and on which side they are (n,). distance: not below theirs (n,) [mm]."""
        room = 2 * self._room + (2 * self._bulge if self._parts > 1 else 0.0)
        rows_of, triangles = [], []
        for tree, members, radius in self._by_size:
            rows, first, last = np.arange(len(points)), 0, 8
            while len(rows) and first < len(members):
                last = min(last, len(members))
                # no point of a triangle is nearer than its centre less its radius
                bound = distance[rows] + (radius + room)
                to_centre, near = tree.query(points[rows], range(first + 1, last + 1), distance_upper_bound=bound.max())
                maybe = to_centre < bound[:, None]
                row, column = np.nonzero(maybe)
                rows_of.append(rows[row])
                triangles.append(members[near[row, column]])
                rows = rows[maybe[:, -1]]
                first, last = last, 4 * last
        row, triangle = np.concatenate(rows_of), np.concatenate(triangles)
        weights, square = self._on_triangle(points[row], triangle)
        apart = np.sqrt(square)
        order = np.lexsort((apart, row))
        row, triangle, weights, apart = row[order], triangle[order], weights[order], apart[order]
        closest = np.searchsorted(row, np.arange(len(points)))
        distance = apart[closest]
        side = self._sides(points, triangle[closest], weights[closest])
        keep = apart <= distance[row] + room
        return row[keep], triangle[keep], distance, side

    def _sides(self, points, triangle, weights):
        """On which side (n,) of the surface points are whose closest points on triangles are given."""
        arm = points - np.einsum("nc,nci->ni", weights, self._corners[triangle])
        normal = np.einsum("nc,nci->ni", weights, self.normals[self.triangles[triangle]])
        facet = self.facets[triangle]
        beside = arm - _dot(arm, facet)[:, None] * facet
        beyond = ((weights <= 0) & (self._across.triangle[triangle] < 0)).any(1) & (_dot(beside, beside) > 1e-18)
        return np.where(beyond, self._side, np.copysign(1.0, _dot(arm, normal)))

    def _closest(self, points, row, triangle):
        """Of candidates the closest: rows of points, triangles, barycentric coordinates of the closest points and their distances.
        A point has one row, and more where parts beyond sharp edges may be as near."""
        weights, square = self._on_triangle(points[row], triangle)
        apart = np.sqrt(square)
        key = row if self._parts == 1 else row * self._parts + self._part[triangle]
        order = np.lexsort((apart, key))
        first = np.ones(len(key), dtype=bool)
        first[1:] = key[order][1:] != key[order][:-1]
        best = order[first]
        if self._parts > 1:
            least = np.full(len(points), np.inf)
            np.minimum.at(least, row[best], apart[best])
            bulge = np.zeros(len(points))
            np.maximum.at(bulge, row[best], self.bulges[triangle[best]])
            best = best[apart[best] <= least[row[best]] + 2 * bulge[row[best]] + 1e-12]
        return row[best], triangle[best], weights[best], apart[best]

    def _on_triangle(self, points, triangle):
        """Barycentric coordinates (n, 3) of the closest points on one triangle each, and the squared distances (n,)."""
        weights = np.einsum("nci,ni->nc", self._slopes[triangle], points - self._middles[triangle]) + 1 / 3
        corners = self._corners[triangle]
        outside = np.flatnonzero((weights[:, 0] < 0) | (weights[:, 1] < 0) | (weights[:, 2] < 0))
        if len(outside):
            p, c = points[outside], corners[outside]
            least = np.full(len(outside), np.inf)
            for i, j in ((0, 1), (1, 2), (2, 0)):
                edge, arm = c[:, j] - c[:, i], p - c[:, i]
                s = np.einsum("ni,ni->n", arm, edge) / np.einsum("ni,ni->n", edge, edge)
                s = np.minimum(np.maximum(s, 0), 1)
                arm -= s[:, None] * edge
                square = np.einsum("ni,ni->n", arm, arm)
                closer = np.flatnonzero(square < least)
                least[closer] = square[closer]
                at = outside[closer]
                weights[at], weights[at, i], weights[at, j] = 0, 1 - s[closer], s[closer]
        arm = points - np.einsum("nc,nci->ni", weights, corners)
        return weights, np.einsum("ni,ni->n", arm, arm)

    # -- nearest points of the patches

    def _prepare_projection(self):
        across, corner = self._across, self._corner
        t, k = np.nonzero(~corner.sharp)
        graph = sparse.coo_matrix((np.ones(len(t)), (t, across.triangle[t, k])), shape=(len(self.triangles),) * 2)
        self._parts, self._part = connected_components(graph, directed=False)
        self._bulge = float(self.bulges.max())
        self._on_rim = np.zeros(len(self.points), dtype=bool)
        self._on_rim[self._ends(across.triangle < 0)] = True
        own = corner.normals[corner.name]
        self._flat = ((own * self.facets[:, None]).sum(2) >= 1 - 1e-15).all(1) | (own == self.facets[:, None]).all(
            (1, 2)
        )
        self._flat &= self.bulges <= 1e-12 * self._longest
        # of planes, away from the rim and from sharp edges, a triangle that names them
        alone = self._flat & ~(corner.sharp.any(1) | self._on_rim[self.triangles].any(1))
        self._plane = np.where(alone, corner.region, -1)
        self._rest: dict[int, tuple[cKDTree, float]] = {}
        larger, smaller = self._curvatures()
        self.radii = (_least_radius(larger, self.areas), _least_radius(-smaller, self.areas))

    def _project(self, points, triangle, b):
        """Gap, normal and curvature at points (n, 3), sought from b (3, n) on the patches of `triangle` (n,)."""
        n = len(points)
        found = Nearest(np.full(n, np.nan), np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan))
        rows, x, tri = np.arange(n), points, triangle
        b = np.maximum(b, 0.0)
        b /= b.sum(0)
        came = np.full(n, -1)  # the edge across which it came without moving
        step, factor = np.zeros_like(b), np.ones(n)
        back = tri.copy(), b.copy(), np.full(n, np.inf)
        tolerance = 1e-11 + 1e-14 * abs(x).max(1, initial=0)
        for _ in range(100):
            if not len(rows):
                return found
            at = patches.evaluate(self._patches, tri, b)
            arm = x - at[:, 0]
            square = _dot(arm, arm)
            normal, metric, bend, height = _forms(at, arm)
            aside = np.sqrt(np.maximum(square - height**2, 0))
            small = aside < 1e-4 * abs(height)  # where the difference cancels
            if small.any():
                aside[small] = np.linalg.norm(arm[small] - height[small, None] * normal[small], axis=1)
            ended = aside <= tolerance
            if ended.any():
                where = rows[ended]
                found.gap[where], found.normal[where] = height[ended], normal[ended]
                found.curvature[where] = _hessian(at[ended], metric[:, ended], bend[:, ended], height[ended])
            # A step to a place that is further away is halved.
            worse = ~ended & (square > back[2] * (1 + 1e-12)) & (factor > 1e-3)
            pull = np.einsum("nai,ni->an", at[:, 1:3], arm)
            stiff = _convex(metric, metric - height * bend)
            det = stiff[0] * stiff[2] - stiff[1] ** 2
            du, dv = (stiff[2] * pull[0] - stiff[1] * pull[1]) / det, (stiff[0] * pull[1] - stiff[1] * pull[0]) / det
            new = np.array([-du - dv, du, dv])
            out = (b <= 0) & (new < 0)
            go = ~ended & ~worse
            stopped = go & out.any(0)
            corner = stopped & ((b <= 0).sum(0) == 2)
            edge = stopped & ~corner
            free = go & ~stopped
            factor = np.where(worse, factor / 2, 1.0)
            tri, b = np.where(worse, back[0], tri), np.where(worse, back[1], b)
            step = np.where(worse, step, new)
            moving = free | worse
            back = (np.where(go, tri, back[0]), np.where(go, b, back[1]), np.where(go, square, back[2]))
            came[moving] = -1
            with np.errstate(divide="ignore", invalid="ignore"):
                room = np.where(step < 0, b / -step, np.inf)
            share = np.minimum(room.min(0), factor)
            hit = room <= share
            moved = np.where(hit, 0.0, np.maximum(b + share * step, 0.0))
            b = np.where(moving, moved / np.maximum(moved.sum(0), 1e-300), b)
            if edge.any():
                ended |= self._at_edges(edge, rows, x, tri, b, out, came, at, arm, pull, stiff, tolerance, found)
            for i in np.flatnonzero(corner):
                ended[i] = self._at_corner(i, rows, tri, b, arm, tolerance, found)
                came[i], back[2][i] = -1, np.inf
            if ended.any():
                on = ~ended
                x, rows, tri, b, came, factor, tolerance = (
                    x[on],
                    rows[on],
                    tri[on],
                    b[:, on],
                    came[on],
                    factor[on],
                    tolerance[on],
                )
                step, back = step[:, on], (back[0][on], back[1][:, on], back[2][on])
        # no minimum was found, as happens at centres of curvature: what is nearest by now
        at = patches.evaluate(self._patches, tri, b)
        arm = x - at[:, 0]
        normal, _, _, height = _forms(at, arm)
        self._put(found, rows, arm, np.copysign(1.0, height), normal, 0.0)
        return found

    def _at_edges(self, edge, rows, x, tri, b, out, came, at, arm, pull, stiff, tolerance, found):
        """Points whose way leaves the patch at an edge: to the neighbour, or if that leads back, along the edge. Which have
        ended (n,)."""
        ended = np.zeros(len(rows), dtype=bool)
        i = np.flatnonzero(edge)
        k = out[:, i].argmax(0)
        other, there = self._across.triangle[tri[i], k], self._across.edge[tri[i], k]
        cross = (other >= 0) & (came[i] != k)
        j, nxt, last = i[cross], np.array(NEXT), np.array(LAST)
        old = b[:, j]
        moved = np.zeros_like(old)
        every = np.arange(len(j))
        moved[nxt[there[cross]], every] = old[last[k[cross]], every]
        moved[last[there[cross]], every] = old[nxt[k[cross]], every]
        b[:, j], tri[j], came[j] = moved, other[cross], there[cross]
        # along the edge, from its next to its last corner
        j, k = i[~cross], k[~cross]
        if not len(j):
            return ended
        du, dv = np.choose(k, [-1.0, 0.0, 1.0]), np.choose(k, [1.0, -1.0, 0.0])  # of u = b[1], v = b[2]
        slope = du * pull[0, j] + dv * pull[1, j]
        first = du[:, None] * at[j, 1] + dv[:, None] * at[j, 2]
        second = (du * du)[:, None] * at[j, 3] + (2 * du * dv)[:, None] * at[j, 4] + (dv * dv)[:, None] * at[j, 5]
        speed = (first * first).sum(1)
        done = abs(slope) <= tolerance[j] * np.sqrt(speed)
        size = speed - (arm[j] * second).sum(1)
        size = np.where(size > 0.1 * speed, size, speed)
        share = slope / size
        here, end = b[nxt[k], j], b[last[k], j]
        share = np.clip(share, -end, here)
        move = ~done
        b[nxt[k[move]], j[move]] = np.maximum(here[move] - share[move], 0)
        b[last[k[move]], j[move]] = np.maximum(end[move] + share[move], 0)
        came[j[move]] = -1
        if done.any():
            e, k, first, size = j[done], k[done], first[done], size[done]
            inner = self._across.triangle[tri[e], k] >= 0
            face = self.facets[tri[e]] + np.where(inner[:, None], self.facets[self._across.triangle[tri[e], k]], 0)
            side = np.where(inner, np.copysign(1.0, (arm[e] * face).sum(1)), self._side)
            self._put(found, rows[e], arm[e], side, face, first[:, :, None] * first[:, None] / size[:, None, None])
            ended[e] = True
        return ended

    def _at_corner(self, i, rows, tri, b, arm, tolerance, found):
        """Point i, whose way leaves its patch at a corner: to where it comes nearest among the patches there; whether it is
        nearest already."""
        point = self.triangles[tri[i], b[:, i].argmax()]
        order, starts = self._ring
        t, c = np.divmod(order[starts[point] : starts[point + 1]], 3)
        legs = self._patches.legs[t, c]
        pull = legs @ arm[i]
        gram = legs @ legs.swapaxes(1, 2)
        det = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
        inside = np.column_stack([gram[:, 1, 1] * pull[:, 0] - gram[:, 0, 1] * pull[:, 1],
                                  gram[:, 0, 0] * pull[:, 1] - gram[:, 0, 1] * pull[:, 0]]) / det[:, None]  # fmt: skip
        options = np.zeros((3, len(t), 2))
        options[0] = np.where((inside >= 0).all(1)[:, None], inside, 0)
        options[1, :, 0] = np.maximum(pull[:, 0] / gram[:, 0, 0], 0)
        options[2, :, 1] = np.maximum(pull[:, 1] / gram[:, 1, 1], 0)
        gain = (options * pull).sum(2)  # the square of how far the tangent leads
        which, best = np.unravel_index(gain.argmax(), gain.shape)
        if gain[which, best] <= tolerance[i] ** 2:
            rim = self._on_rim[point]
            normal = self.normals[point]
            side = self._side if rim else math.copysign(1.0, arm[i] @ normal)
            self._put(found, rows[i : i + 1], arm[i : i + 1], np.array([side]), normal[None], 0.0)
            return True
        onwards, backwards = options[which, best] / 3  # legs are a third of the derivative
        scale = 1 / max(1.0, onwards + backwards)
        tri[i] = t[best]
        b[:, i] = 0
        b[NEXT[c[best]], i], b[LAST[c[best]], i] = scale * onwards, scale * backwards
        b[c[best], i] = max(0.0, 1 - scale * (onwards + backwards))
        return False

    def _put(self, found, rows, arm, side, normal, along):
        """Into `rows` of `found` what belongs to nearest points on edges and corners."""
        distance = np.linalg.norm(arm, axis=1)
        on = distance < 1e-12
        unit = np.where(on[:, None], normal, side[:, None] * arm)
        unit /= np.maximum(np.linalg.norm(unit, axis=1), 1e-300)[:, None]
        found.gap[rows], found.normal[rows] = side * distance, unit
        flat = np.eye(3) - unit[:, :, None] * unit[:, None] - along
        found.curvature[rows] = np.where(on, 0, side / np.maximum(distance, 1e-12))[:, None, None] * flat


def _dot(a, b):
    return np.einsum("ni,ni->n", a, b)  # faster than a sum over rows of three


def _forms(at, arm=None):
    """Of places and derivatives (n, 6, 3) of patches: unit normal (n, 3), first and second fundamental form (3, n), and height
    (n,) of arms (n, 3) over them."""
    u, v = at[:, 1], at[:, 2]
    metric = np.array([_dot(u, u), _dot(u, v), _dot(v, v)])
    normal = np.cross(u, v)
    normal /= np.sqrt(np.maximum(_dot(normal, normal), 1e-300))[:, None]
    bend = np.einsum("nai,ni->an", at[:, 3:], normal)
    height = np.zeros(len(at)) if arm is None else _dot(arm, normal)
    return normal, metric, bend, height


def _convex(metric, stiff):
    """`stiff` (3, n), raised by as much of the metric as makes its least eigenvalue 0.1 in that metric."""
    det = metric[0] * metric[2] - metric[1] ** 2
    mean = (metric[2] * stiff[0] + metric[0] * stiff[2] - 2 * metric[1] * stiff[1]) / (2 * det)
    gauss = (stiff[0] * stiff[2] - stiff[1] ** 2) / det
    least = mean - np.sqrt(np.maximum(mean**2 - gauss, 0))
    return stiff + np.maximum(0.1 - least, 0) * metric


def _hessian(at, metric, bend, gap):
    """Hessian (n, 3, 3) of the gap over patches: -E I^-1 L (I - gap L)^-1 E^T of tangents E and fundamental forms I, L."""

    def matrix(a):
        return np.array([[a[0], a[1]], [a[1], a[2]]]).transpose(2, 0, 1)

    def inverse(a):
        det = a[0] * a[2] - a[1] ** 2
        det = np.where(abs(det) < 1e-300, 1e-300, det)
        return matrix(np.array([a[2], -a[1], a[0]]) / det)

    tangents = at[:, 1:3]
    inner = inverse(metric) @ matrix(bend) @ inverse(metric - gap * bend)
    full = -tangents.swapaxes(1, 2) @ inner @ tangents
    return (full + full.swapaxes(1, 2)) / 2


def _least_radius(curvature, area):
    """The least radius [mm] of what bends to this side, but for the last of its turning; inf where nothing does."""
    curvature = np.maximum(curvature, 0)
    weight = area * curvature**2
    turns = curvature * np.sqrt(area) > 1e-4  # less is rounding
    if not turns.any():
        return math.inf
    curvature, weight = curvature[turns], weight[turns]
    order = np.argsort(curvature)
    share = np.cumsum(weight[order])
    return 1 / float(curvature[order[np.searchsorted(share, BENT * share[-1])]])


def _merged(x):
    """Points without those that are others up to rounding, and the number among them of each."""
    x, number = np.unique(x, axis=0, return_inverse=True)
    number = number.reshape(-1)
    pairs = cKDTree(x).query_pairs(SAME * abs(x).max(initial=0), output_type="ndarray")
    if len(pairs):
        graph = sparse.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(x),) * 2)
        one = connected_components(graph, directed=False)[1]
        _, first = np.unique(one, return_index=True)
        x, number = x[first], one[number]
    return x, number


def _agreeing(triangles):
    """The triangles, turned the same way round as the first of their connected part; which were (m,); whether all agree."""
    m = len(triangles)
    ends = np.stack([triangles[:, NEXT], triangles[:, LAST]], 2)
    across = patches.topology(triangles)
    t, k = np.nonzero(across.triangle >= 0)
    o, back = across.triangle[t, k], across.edge[t, k]
    same = (ends[t, k, 0] == ends[o, back, 0]).astype(np.int64)
    # each triangle twice, as it is and turned, joined with what agrees with it
    rows = np.concatenate([t, t + m])
    cols = np.concatenate([o + same * m, o + (1 - same) * m])
    graph = sparse.coo_matrix((np.ones(len(rows)), (rows, cols)), shape=(2 * m, 2 * m))
    label = connected_components(graph, directed=False)[1].reshape(2, m)
    _, first, part = np.unique(label.min(0), return_index=True, return_inverse=True)
    turn = label[0] != label[0][first][part]
    agrees = bool((label[0] != label[1]).all())
    triangles = triangles.copy()
    triangles[turn] = triangles[turn][:, [0, 2, 1]]
    return triangles, turn, agrees
