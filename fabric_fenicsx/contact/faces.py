"""The smooth face of a sheet of flat triangles, and places of points over it."""

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from ..core.compiled import compiled
from ..energy.morley import Where
from ..sheet.blank import Part
from ..surfaces.facets import LAST, NEXT, vertex_normals

UP = np.array([0.0, 0.0, 1.0])
MAX_NEIGHBOURS = 24  # triangles nearest to a point, among which the one below it is sought


class ClosestPoint(NamedTuple):
    """Places on the face below n points.

    - triangle (n,), -1 where there is none; weights (n, 3): barycentric coordinates in it
    - gap (n,) [mm]; normal (n, 3): the gap's gradient, the face's normal but for terms of h^2
    - curvature (n, 3, 3) [1/mm]: turn of the normal as the point moves, the gap's Hessian but for
      such terms
    """

    triangle: np.ndarray
    weights: np.ndarray
    gap: np.ndarray
    normal: np.ndarray
    curvature: np.ndarray


class Corners(NamedTuple):
    """The flat triangles that n points lie in: nodes (n, 3), global numbers; places (n, 3, 3) [mm];
    weights (n, 3), barycentric; offset (n,) [mm] of the touching face from the triangle along the
    points' normals, with a sign. mirrors (n, 3, 3): what points on images of the triangles move
    with, of what they move with on these; None if there are no images."""

    nodes: np.ndarray
    places: np.ndarray
    weights: np.ndarray
    offset: np.ndarray
    mirrors: np.ndarray | None = None


class Face:
    """A smooth surface through the nodes of a part of triangles, known on all ranks.

    Over barycentric coordinates N of a triangle it is sum_i N_i x_i + sum_{i<k} N_i N_k (G_i - G_k)
    (X_k - X_i) / 2. X are the undeformed places, x the deformed ones, and G the gradients of the
    displacement at the nodes, averaged over the triangles around each. It is continuous across
    edges, and linear in x, so that virtual work on it is exact. Quadratic displacements are met
    exactly where the cells around both nodes are regular. The interpolation is that of A. Vlachos
    et al., Curved PN triangles, 2001, of degree 2. Beside free edges gradients are known from one
    side only, so the bulges fade out there, over two rows of nodes: otherwise a uniform pressure
    would load the nodes unevenly.

    The normal is interpolated between the corners' (N. Max, 1999, see `vertex_normals`), so it is
    continuous, too. It points to `side` (1 or -1) times the z axis of the undeformed sheet; there
    the gap is positive.

    - nodes (n,): global numbers; X (n, 3): undeformed places [mm]
    - triangles (m, 3): corners, by their places in `nodes`
    - own_triangles (cells,): numbers of this rank's cells among `triangles`
    - symmetric: as in `Bending`, functions of points that mark edges on planes of symmetry
    - planes: of these, numbers of the nodes on each, and its normal (3,) towards the sheet

    Raises InputError for other cells than triangles, linear or quadratic with straight sides.
    """

    FLAT_ROWS = 2  # of nodes beside a free edge, over which the face becomes flat

    def __init__(self, part: Part, side: float, symmetric: list[Where]) -> None:
        blank, comm = part.blank, part.blank.mesh.comm
        blank.check_triangulated("contact of sheets")
        corners = blank.triangles(part.cells)
        index_map = blank.V.dofmap.index_map
        numbers = index_map.local_to_global(corners.ravel().astype(np.int32)).reshape(-1, 3)
        counts = comm.allgather(len(numbers))
        triangles = np.concatenate(comm.allgather(numbers)).astype(np.int64)
        self.nodes, triangles = np.unique(triangles, return_inverse=True)
        self._count = index_map.size_local
        self._comm, self._blank = comm, blank
        self.X = X = self.gathered(blank.coordinates()[: self._count])
        # in an order that does not depend on the ranks: of two triangles at an edge one is found
        order = np.lexsort(X[triangles.reshape(-1, 3)].mean(1).round(9).T)
        self.triangles = triangles.reshape(-1, 3)[order]
        first = sum(counts[: comm.rank])
        self.own_triangles = order.argsort()[first : first + len(numbers)]
        # corners in an order that does not depend on the ranks
        place = np.empty(len(X), dtype=np.int64)
        place[np.lexsort(X.round(9).T)] = np.arange(len(X))
        order = np.argsort(place[self.triangles], axis=1)
        self.triangles = np.take_along_axis(self.triangles, order, 1)
        p, q, r = X[self.triangles].swapaxes(0, 1)
        turned = np.cross(q - p, r - p) @ UP * side < 0
        self.triangles[turned] = self.triangles[turned][:, [0, 2, 1]]
        self.planes = [_plane(X, np.asarray(where(X.T), bool)) for where in symmetric]
        share = self._rows_to_free_edges() / self.FLAT_ROWS
        self._edges, self._bulges = self._bulge_operator(share)
        self.take()

    def gathered(self, values: np.ndarray) -> np.ndarray:
        """Rows of all ranks' owned nodes, for the nodes of this face."""
        return np.concatenate(self._comm.allgather(values))[self.nodes]

    def _rows_to_free_edges(self):
        """Number of cells between each node (n,) and the nearest free edge, up to `FLAT_ROWS`."""
        sides = np.sort(self.triangles[:, [NEXT, LAST]].swapaxes(1, 2).reshape(-1, 2), 1)
        ends, count = np.unique(sides, axis=0, return_counts=True)
        free = ends[count == 1]
        for at, _ in self.planes:
            free = free[~np.isin(free, at).all(1)]
        rows = np.full(len(self.nodes), float(self.FLAT_ROWS))
        rows[free] = 0.0
        for _ in range(self.FLAT_ROWS):
            np.minimum.at(rows, ends.ravel(), rows[ends[:, ::-1]].ravel() + 1)
        return rows

    def _bulge_operator(self, share):
        """Edges opposite the corners of each triangle (m, 3), and the matrix (edges, nodes) from
        displacements to (G_i - G_k) (X_k - X_i) / 2, times the `share` (n,) at its ends."""
        X, triangles, n = self.X[:, :2], self.triangles, len(self.nodes)
        p, q, r = X[triangles].swapaxes(0, 1)
        twice = np.linalg.det(np.stack([q - p, r - p], 1))
        # gradients of the barycentric coordinates times twice the area, (m, 3, 2)
        sides = np.stack([r - q, p - r, q - p], 1)
        slopes = np.stack([-sides[..., 1], sides[..., 0]], -1) * np.sign(twice)[:, None, None]
        around = np.zeros(n)
        np.add.at(around, triangles, abs(twice)[:, None])
        rows, cols = np.repeat(triangles, 3, axis=1).ravel(), np.tile(triangles, (1, 3)).ravel()
        G = [
            sparse.csr_matrix(
                (np.tile(slopes[:, :, k], (1, 3)).ravel() / around[rows], (rows, cols)), (n, n)
            )
            for k in (0, 1)
        ]
        for at, normal in self.planes:  # the mirrored cells make the slope across the plane 0
            on = np.zeros(n)
            on[at] = 1.0
            across = normal[0] * G[0] + normal[1] * G[1]
            G = [G[k] - sparse.diags(on * normal[k]) @ across for k in (0, 1)]
        ends = np.sort(np.stack([triangles[:, NEXT], triangles[:, LAST]], 2).reshape(-1, 2), 1)
        keys, edges = np.unique(ends @ [n, 1], return_inverse=True)
        i, k = np.divmod(keys, n)
        side = (X[k] - X[i]) * np.minimum(share[i], share[k])[:, None]
        bulges = sum(sparse.diags(side[:, d] / 2) @ (G[d][i] - G[d][k]) for d in (0, 1))
        return edges.reshape(-1, 3), bulges.tocsr()

    def own_weights(self, N: np.ndarray) -> sparse.csr_matrix:
        """Matrix (cells k, nodes) from nodes to the face at barycentric coordinates N (k, 3)."""
        triangle = np.repeat(self.own_triangles, len(N))
        n, N = len(triangle), np.tile(N, (len(self.own_triangles), 1))
        starts = np.arange(0, 3 * n + 1, 3)
        corners = sparse.csr_matrix(
            (N.ravel(), self.triangles[triangle].ravel(), starts), (n, len(self.nodes))
        )
        products = N[:, NEXT] * N[:, LAST]
        between = sparse.csr_matrix(
            (products.ravel(), self._edges[triangle].ravel(), starts), (n, self._bulges.shape[0])
        )
        return (corners + between @ self._bulges).tocsr()

    def corners(self, triangle: np.ndarray, N: np.ndarray, offset: np.ndarray) -> Corners:
        """`Corners` of triangles (n,), with barycentric coordinates N (n, 3) and offsets (n,)."""
        nodes = self.triangles[triangle]
        return Corners(self.nodes[nodes], self.places[nodes], N, offset)

    def flat(self, N: np.ndarray, values: np.ndarray | None = None) -> np.ndarray:
        """Values (nodes, i), by default undeformed places [mm], at the points of `own_weights` in
        the flat triangles, (cells k, i)."""
        corners = (self.X if values is None else values)[self.triangles[self.own_triangles]]
        return np.einsum("kc,nci->nki", N, corners).reshape(-1, corners.shape[2])

    def flat_height(self) -> float:
        """z of the undeformed sheet [mm]."""
        return float(self.X[:, 2].mean())

    def take(self) -> None:
        """Take the shape from the present displacement."""
        moved = self._blank.nodal_displacement()[: self._count]
        self.displacement = self.gathered(moved)
        self.places = self.X + self.displacement
        self._tree: cKDTree | None = None
        for name in ("normals", "_bulge"):
            vars(self).pop(name, None)

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normals at the nodes, (n, 3)."""
        normals = vertex_normals(self.places, self.triangles)
        for at, plane in self.planes:
            normals[at] -= (normals[at] @ plane)[:, None] * plane
            normals[at] /= np.linalg.norm(normals[at], axis=1)[:, None]
        return normals

    @cached_property
    def _bulge(self):
        return self._bulges @ self.displacement

    def points(self, weights: sparse.csr_matrix, flat: np.ndarray) -> np.ndarray:
        """Places (n, 3) [mm] now of points with these `weights` that lay at `flat` (n, 3)."""
        return flat + weights @ self.displacement

    def project(
        self, points: np.ndarray, guess: np.ndarray, reach: float, ahead: np.ndarray | None = None
    ) -> ClosestPoint:
        """The places below points (n, 3) [mm], up to `reach` [mm] away. guess (n,): triangles to
        look in first, -1 for none; ahead (n, 3): if given, triangles are passed over whose normal
        is more than 90 deg off this one."""

        def fits(rows, k, height, along):
            return ahead is None or (along * ahead[rows]).sum(1) > 0

        at = np.flatnonzero(guess >= 0)
        triangle, y = np.full(len(points), -1), np.zeros((len(points), 3))
        triangle[at], y[at] = self.seek(points, at, guess[at, None], fits)
        rest = np.flatnonzero(triangle < 0)
        if len(rest):
            near = self._near(points[rest], reach)
            triangle[rest], y[rest] = self.seek(points, rest, near, fits)
        return self.projection(triangle, y, reach)

    def _near(self, points, reach):
        """Numbers of the triangles near points (n, 3), the nearest first, (n, k)."""
        corners = self.places[self.triangles]
        self._tree = self._tree or cKDTree(corners.mean(1))
        many = min(MAX_NEIGHBOURS, len(self.triangles))
        largest = np.linalg.norm(corners - corners.mean(1, keepdims=True), axis=2).max()
        away, near = self._tree.query(points, many, distance_upper_bound=2 * (reach + largest))
        away, near = (each.reshape(len(points), many) for each in (away, near))
        near[near == len(corners)] = -1
        # of equally near ones in their order, on any ranks
        return np.take_along_axis(near, np.lexsort((near, away.round(6)), axis=1), 1)

    def seek(
        self, points: np.ndarray, rows: np.ndarray, triangles: np.ndarray, fits: Callable
    ) -> tuple[np.ndarray, np.ndarray]:
        """The first of `triangles` (k, many) that each of `rows` (k,) of the points lies over, -1
        for none; two coordinates in it and a height, over its normal's length (k, 3). fits: a
        function of places among the rows, the place among `many`, heights, and normals (., 3), to
        whether that may be (.,)."""
        triangle, y = np.full(len(rows), -1), np.zeros((len(rows), 3))
        for k, candidates in enumerate(triangles.T):
            at = np.flatnonzero((triangle < 0) & (candidates >= 0))
            place, within, along = self._project_onto(points[rows[at]], candidates[at])
            within &= fits(rows[at], k, place[:, 2], along)
            triangle[at[within]], y[at[within]] = candidates[at[within]], place[within]
        return triangle, y

    def projection(self, triangle: np.ndarray, y: np.ndarray, reach: float) -> ClosestPoint:
        """The places below points up to `reach` [mm] away, from what `seek` gives."""
        n = len(triangle)
        empty = np.zeros((n, 3)), np.full(n, np.inf), np.zeros((n, 3)), np.zeros((n, 3, 3))
        below = ClosestPoint(triangle, *empty)
        at = np.flatnonzero(triangle >= 0)
        if len(at):
            self._fill(at, y, below)
        below.triangle[~(abs(below.gap) <= reach)] = -1
        return below

    def _project_onto(self, points, triangle):
        """The places (n, 3), as in `seek`, of triangles (n,) whose interpolated normals go through
        points (n, 3); whether they are within the triangle; and those normals. They are not the
        nearest ones, as the triangle is not curved with its normals."""
        nodes = self.triangles[triangle]
        y, along, settled = _meet(points, self.places[nodes], self.normals[nodes])
        inside = np.minimum(y[:, :2].min(1), 1 - y[:, 0] - y[:, 1]) >= -1e-7  # rounding
        return y, settled & inside, along

    def _fill(self, at, y, below):
        """Fill rows `at` (k,) of `below`, of points over places y (n, 3) of their triangles."""
        y, triangle = y[at], below.triangle[at]
        nodes = self.triangles[triangle]
        x, normals = self.places[nodes], self.normals[nodes]
        e, m = (values[:, 1:] - values[:, :1] for values in (x, normals))
        along = normals[:, 0] + np.einsum("na,nai->ni", y[:, :2], m)
        inverse = _inverse(np.concatenate([e + y[:, 2:, None] * m, along[:, None]], 1))
        weights = np.column_stack([1 - y[:, 0] - y[:, 1], y[:, 0], y[:, 1]])
        length = np.sqrt(np.einsum("ni,ni->n", along, along))
        unit = along / length[:, None]
        products = weights[:, NEXT] * weights[:, LAST]
        edges = self._bulge[self._edges[triangle]]
        bulge, height = np.einsum("nc,nci->ni", products, edges), y[:, 2:]
        # change of the unit normal as the point moves
        m_along = np.einsum("nai,ni->na", m, unit)
        turns = m - m_along[:, :, None] * unit[:, None]  # along both coordinates
        turns /= length[:, None, None]
        turn = np.einsum("nia,naj->nij", inverse[:, :, :2], turns)
        turn -= unit[:, :, None] * np.einsum("ni,nij->nj", unit, turn)[:, None]
        steep = weights[:, NEXT, None] * edges[:, LAST] + weights[:, LAST, None] * edges[:, NEXT]
        rise = height * m_along
        rise -= np.einsum("nai,ni->na", steep[:, 1:] - steep[:, :1], unit)
        rise -= np.einsum("nai,ni->na", turns, bulge)
        slope = length[:, None] * inverse[:, :, 2]
        slope += np.einsum("nia,na->ni", inverse[:, :, :2], rise)
        below.weights[at] = weights
        below.gap[at] = y[:, 2] * length - np.einsum("ni,ni->n", bulge, unit)
        below.normal[at] = slope
        below.curvature[at] = (turn + turn.swapaxes(1, 2)) / 2


@compiled
def _meet(points, corners, normals):
    """Places y and normals as in `Face._project_onto`, of corners and normals there (n, 3, 3), by
    Newton's method, and whether that settled (n,)."""
    n = len(points)
    y, along, settled = np.zeros((n, 3)), np.empty((n, 3)), np.zeros(n, np.bool_)
    e, m, miss, off = np.empty((2, 3)), np.empty((2, 3)), np.empty(3), np.empty(3)
    for i in range(n):
        at, a = y[i], along[i]
        for k in range(3):
            off[k] = corners[i, 0, k] - points[i, k]
            for j in range(2):
                e[j, k] = corners[i, j + 1, k] - corners[i, 0, k]
                m[j, k] = normals[i, j + 1, k] - normals[i, 0, k]
        for _ in range(12):  # of which Newton's method takes three or four
            u, v, h = at
            for k in range(3):
                a[k] = normals[i, 0, k] + u * m[0, k] + v * m[1, k]
                miss[k] = off[k] + u * e[0, k] + v * e[1, k] + h * a[k]
            p, q, r = (
                (e[0, 0] + h * m[0, 0], e[0, 1] + h * m[0, 1], e[0, 2] + h * m[0, 2]),
                (e[1, 0] + h * m[1, 0], e[1, 1] + h * m[1, 1], e[1, 2] + h * m[1, 2]),
                (a[0], a[1], a[2]),
            )
            volume, size = _triple(p, q, r), 0.0
            volumes = _triple(miss, q, r), _triple(p, miss, r), _triple(p, q, miss)
            for k in range(3):
                step = volumes[k] / volume
                at[k] = min(max(at[k] - step, -1e3), 1e3)
                size += abs(step)
            if not size > 1e-14:
                break
        settled[i] = size < 1e-9
    return y, along, settled


@compiled
def _triple(a, b, c):
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


def _inverse(slopes):
    """Inverses (n, 3, 3) of matrices with rows (n, 3, 3)."""
    a, b, c = slopes.swapaxes(0, 1)
    columns = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 2)
    return columns / np.einsum("ni,ni->n", a, columns[:, :, 0])[:, None, None]


def _plane(places, on):
    """Numbers of the places (n, 3) on an edge of symmetry, and the plane's inward normal (3,)."""
    at = np.flatnonzero(on)
    if not len(at):
        return at, UP
    along = np.linalg.svd(places[at] - places[at].mean(0), full_matrices=False)[2][0]
    normal = np.cross(along, UP)
    normal *= np.sign((places.mean(0) - places[at[0]]) @ normal)
    return at, normal / max(np.linalg.norm(normal), 1e-300)
