"""Contact of a sheet with itself, as where a fold closes, and where it passes through itself."""

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from ..core.errors import InputError
from ..core.formatting import coordinates
from ..core.rules import POSITIVE
from ..energy.morley import Where
from ..energy.output import Value, joined
from ..energy.term import SceneFacts
from ..io.field import Field
from ..sheet.blank import Blank, Part
from ..sheet.stack import Stack
from ..surfaces.facets import facet_normals
from .contact_points import ContactPoints
from .coulomb import Coulomb
from .faces import MAX_NEIGHBOURS
from .pressure_law import FaceLaw
from .sheet_contact import LAG, FaceContact


class SelfPoints(ContactPoints):
    """Points in the triangles of a sheet that look to both sides for another place of it, or for
    their own image in a plane of symmetry: of a fold the same face looks back, the top at the top,
    of a roll the other one.

    Either place has points, so each stands for half of its area. Triangles with a common node do
    not face each other, nor do those nearer in the flat sheet than pi / 2 thicknesses, in a roll
    twice that: a sheet can touch itself there only if it is bent more sharply than round its own
    thickness, which bending resists. What lay on one side of a point in the accepted state counts
    as there, also if it has come through the sheet since.
    """

    SIDES = 2

    def __init__(self, part: Part, rule: int, face: FaceLaw, symmetric: Sequence[Where]) -> None:
        super().__init__(part, part, rule, [face, face], symmetric)
        thickness = float(face.thickness)
        corners = self._over.X[self._over.triangles]
        self._centres, self._apart = corners.mean(1), np.pi / 2 * thickness
        self._edge = np.linalg.norm(np.diff(corners, axis=1), axis=2).max()
        self._reach = 2 * thickness + self._edge / 2
        self._sides = np.resize(np.repeat([1.0, -1.0], len(self.places) // 2), self.count)
        # flat places that the points lay over in the accepted state, and last
        self._partners = self._partners_now = np.full((self.count, 3), np.inf)
        self._mirrors: np.ndarray | None = None  # of all points, if some lie at their images

    def remember(self) -> None:
        """Take the places found last as those of the accepted state."""
        self._partners = self._partners_now

    def _project(self):
        below, self._mirrors = self._over_others(), None
        for nodes, normal in self._over.planes:
            if len(nodes):
                self._mirror(below, nodes, normal)
        return below

    def _mirror(self, below, nodes, normal):
        """Let points that are nearer to their images in a plane of symmetry than to what they lie
        over lie over these. nodes, normal: of the plane."""
        face, many = self._over, len(self.places)
        own = face.own_triangles.repeat(many)
        off = face.points(*self._on_face) - face.places[nodes].mean(0)
        gap = 2 * off @ normal
        across = face.flat(self.places, face.normals) @ normal
        away = 2 * abs((self._centres - face.X[nodes].mean(0)) @ normal)
        free = (away > self._apart) & ~np.isin(face.triangles, nodes).any(1)
        faces = free[own] & (self._sides * across < -np.sqrt(0.5))
        at = np.flatnonzero(faces & (gap < np.minimum(abs(below.gap), self._reach)))
        if self._mirrors is None:
            self._mirrors = np.tile(np.eye(3), (self.count, 1, 1))
        self._mirrors[at] = np.eye(3) - 2 * np.outer(normal, normal)
        below.triangle[at], below.gap[at], below.normal[at] = own[at], gap[at], normal
        below.weights[at], below.curvature[at] = self.places[at % many], 0.0

    def _corners(self, below, at):
        over, others = super()._corners(below, at)
        mirrors = None if self._mirrors is None else self._mirrors[at]
        return over, others._replace(mirrors=mirrors)

    def _over_others(self):
        """The `ClosestPoint` of all points on other places of the sheet."""
        face, many = self._over, len(self.places)
        triangle, y = np.full(self.count, -1), np.zeros((self.count, 3))
        self._partners_now = np.full((self.count, 3), np.inf)
        corners = face.places[face.triangles]
        middles, across = corners.mean(1), facet_normals(face.places, face.triangles)[0]
        size = np.linalg.norm(corners - middles[:, None], axis=2).max()
        cells, near = self._layers(middles, across, self._reach + 2 * size)
        if not len(cells):
            return face.projection(triangle, y, self._reach)
        rows = (cells[:, None] * many + np.arange(many)).ravel()
        near, sides = near.repeat(many, axis=0), self._sides[rows]
        points = face.points(*(each[rows] for each in self._on_face))
        normals = face.flat(self.places, face.normals)

        def towards(at, along):
            """Sides of a place with normals `along`, on which points `at` may be."""
            return np.where((along * normals[at]).sum(1) < 0, 1.0, -1.0) * self._sides[at]

        # heights from which on a triangle counts: any or none, if it lay on this or the other side
        others = rows + (sides * many / 2).astype(int)
        here, there = (
            np.linalg.norm(self._centres[near] - self._partners[each][:, None], axis=2)
            for each in (rows, others)
        )
        known = np.minimum(here, there) < 2 * self._edge
        least = np.where(known, np.where(here < there, -np.inf, np.inf), 0.0)
        # leave out those that the point is clearly beside or on the wrong side of
        off = points[:, None] - middles[near]
        height = (off * across[near]).sum(2)
        beside = np.linalg.norm(off, axis=2) > np.hypot(height, size + abs(height) / 2)
        facing = np.einsum("nki,ni->nk", across[near], normals[rows]) < 0
        above = np.where(facing, 1.0, -1.0) * sides[:, None] * height
        near[beside | (above < least - size)] = -1

        def fits(at, k, height, along):
            return towards(rows[at], along) * height > least[at, k]

        triangle[rows], y[rows] = face.seek(points, np.arange(len(rows)), near, fits)
        below = face.projection(triangle, y, self._reach)
        at = np.flatnonzero(below.triangle >= 0)
        # in a bend, past its centre, the place found is the farthest one, not the nearest
        turned = abs(below.gap[at]) * np.linalg.norm(below.curvature[at], axis=(1, 2))
        below.triangle[at[turned > 1]] = -1
        at = at[turned <= 1]
        flat = face.X[face.triangles[below.triangle[at]]]
        self._partners_now[at] = np.einsum("nc,nci->ni", below.weights[at], flat)
        facing_points = towards(at, below.normal[at])
        below.gap[at] *= facing_points
        below.normal[at] *= facing_points[:, None]
        below.curvature[at] *= facing_points[:, None, None]
        return below

    def _layers(self, middles, normals, reach):
        """Numbers (k,) of this rank's triangles over or under which others lie within `reach`,
        with normals opposed to theirs or, in a roll, along them, and numbers of these, the nearest
        first, (k, n), -1 for none. middles, normals (m, 3): of all triangles."""
        triangles, local, count = self._over.triangles, self._over.own_triangles, len(middles)
        tree, farthest = cKDTree(np.hstack([middles / reach, normals])), np.sqrt(1 + 2)
        directions = [(-1, 0.0)]
        if (normals @ normals.mean(0)).min() <= 0:  # a sheet with a roll in it is turned over, too
            # a layer over or under the triangle, as its neighbours are nearer to itself
            directions += [(1, self._distance), (1, -self._distance)]
        layers, order = [], []
        for direction, off in directions:
            asked = np.hstack([(middles + off * normals) / reach, direction * normals])[local]
            near = tree.query(asked, range(1, MAX_NEIGHBOURS + 1), distance_upper_bound=farthest)[1]
            near_by = np.minimum(near, count - 1)
            shared = triangles[near_by][..., None] == triangles[local][:, None, None]
            away, turned, flat = (
                np.linalg.norm(values[near_by] - sign * values[local][:, None], axis=2)
                for values, sign in ((middles, 1), (normals, direction), (self._centres, 1))
            )
            least = self._apart if direction < 0 else 2 * np.maximum(self._apart, away)
            near[shared.any((2, 3)) | (flat < least) | (near == count)] = -1
            layers.append(near)
            order.append(np.where(near < 0, np.inf, np.hypot(away / reach, turned)))
        near = np.take_along_axis(np.hstack(layers), np.hstack(order).argsort(1, kind="stable"), 1)
        cells = np.flatnonzero(near[:, 0] >= 0)
        return cells, near[cells][:, : (near >= 0).sum(1).max(initial=0)]


class SelfContact(FaceContact):
    """Contact of a sheet with itself, where it folds over or rolls up.

    Like `SheetContact`, with the same laws, at points of both faces (`SelfPoints`). Until a fold
    closes it only searches for one after each solve. In a stack each sheet has its own:
    `SelfContact().on("upper")`.

    Parameters
    ----------
    thickness
        Of the sheet with a `penalty` [mm]; by default, and without one, that of the scene's fabric
        or metal, on a patched sheet of the first one.
    penalty, points, lag, symmetric, friction
        As in `SheetContact`. A fold that closes on its image in a plane of symmetry is pressed by
        it, too.

    Raises
    ------
    InputError
        For another number of points, and values not above 0; as the scene is made, for several
        sheets at once, for a sheet in a plane or curved, for other cells than triangles, and where
        a thickness or penalty is needed.

    Examples
    --------
    >>> ff.SelfContact(friction=0.3).on("upper").name
    'self-contact of upper'
    """

    def __init__(
        self,
        thickness: float | None = None,
        penalty: float | None = None,
        points: int = 3,
        lag: float = LAG,
        symmetric: Where | Sequence[Where] = (),
        friction: float | Field | Coulomb = 0.0,
    ) -> None:
        super().__init__("self-contact", penalty, points, lag, symmetric, friction)
        if thickness is not None:
            POSITIVE.check("thickness of the self-contact", thickness)
        self._given["thickness"] = thickness

    def set_up(self, scene: SceneFacts) -> None:
        part, blank = self.part, self.blank
        is_stack = isinstance(blank, Stack) and part.is_whole
        if is_stack or blank.mesh.geometry.dim < 3 or not blank.is_flat():
            sheet = "a stack" if is_stack else f"{blank.name}, which is curved or in a plane"
            raise InputError(
                f"{self.name} is asked of {sheet}; expected one flat sheet that is `spatial`, of "
                'a stack by `.on("NAME")`'
            )
        face = self._face_of(scene, part, self._given["thickness"] or part.thickness)
        self._begin(scene, SelfPoints(part, self._points_of_cell, face, self.symmetric))

    def _totals(self):
        sums, now = super()._totals(), self.faces.now
        mirrors = now.corners[1].mirrors
        if mirrors is not None:  # their images are pressed, too
            imaged = np.linalg.det(mirrors) < 0
            forces = (self.state().pressure * now.areas)[imaged]
            sums[3] += self.blank.mesh.comm.allreduce(forces.sum(), MPI.SUM)
        return sums

    def accept(self) -> None:
        super().accept()
        self.points.remember()

    def _lost(self, pressure):
        lost = np.zeros(len(self.blank.areas()))
        depths = self._depths(self.points.faces[0], pressure, 0)
        lost[self.points.part.cells] = self.points.means(depths).sum(1)
        return lost

    def summary(self) -> dict[str, Value]:
        deep = self.penetration_of_thickness()
        facts = {"normal_force_N": float(self.totals[3]), "penetration_of_thickness": deep}
        return {"self_contact": joined({self.part.name or self.blank.name: facts})}


def crossings(places: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Places (k, 3) where an edge of triangles (m, 3) of nodes at `places` (n, 3) passes through
    one of the others that it has no node in common with."""
    sides = triangles[:, [(0, 1), (1, 2), (2, 0)]].reshape(-1, 2)
    edges = np.unique(np.sort(sides, axis=1), axis=0)
    if not len(edges):
        return np.empty((0, 3))
    corners = places[triangles]
    centres, starts = corners.mean(1), places[edges[:, 0]]
    along = places[edges[:, 1]] - starts
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max()
    radii = np.linalg.norm(along, axis=1) / 2 + reach
    near = cKDTree(centres).query_ball_point(starts + along / 2, radii)
    edge = np.repeat(np.arange(len(edges)), [len(each) for each in near])
    triangle = np.concatenate(near).astype(np.int64)
    apart = (edges[edge][:, :, None] != triangles[triangle][:, None]).all((1, 2))
    edge, triangle = edge[apart], triangle[apart]
    corners, p, d = corners[triangle], starts[edge], along[edge]
    # p + t d is a corner and shares u, v of the sides from it
    sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], -d], 2)
    # an edge and a triangle in a plane do not cross
    at = abs(np.linalg.det(sides)) > 1e-6 * np.prod(np.linalg.norm(sides, axis=1), axis=1)
    shares = np.linalg.solve(sides[at], (p - corners[:, 0])[at][..., None])[..., 0]
    through = (shares >= 0).all(1) & (shares[:, 2] <= 1) & (shares[:, :2].sum(1) <= 1)
    return (p[at] + shares[:, 2:] * d[at])[through]


def self_crossings(part: Part) -> np.ndarray:
    """Crossings of a sheet at its present displacement, its cells taken as flat triangles, on all
    ranks (k, 3) [mm]; none of a sheet in a plane."""
    blank, comm = part.blank, part.blank.mesh.comm
    if blank.mesh.geometry.dim < 3:
        return np.empty((0, 3))
    known = blank.triangles(part.cells).reshape(-1, 3).astype(np.int32)
    numbers = blank.V.dofmap.index_map.local_to_global(known.ravel())
    places = (blank.coordinates() + blank.nodal_displacement())[known.ravel()]
    gathered = comm.gather((numbers, places))
    if gathered is None:
        return comm.bcast(None)
    numbers, places = (np.concatenate(each) for each in zip(*gathered))
    _, first, node = np.unique(numbers, return_index=True, return_inverse=True)
    return comm.bcast(crossings(places[first], node.reshape(-1, 3)))


def crossing_warning(blank: Blank) -> str:
    """A warning if parts of a blank, as sheets of a stack, have passed through one another, which
    contact at points within cells lets corners do; otherwise ""."""
    parts = list(blank.parts.values())
    places = self_crossings(blank.whole)
    if not len(places) or len(parts) < 2 or any(len(self_crossings(part)) for part in parts):
        return ""
    return (
        f"{' and '.join(part.name for part in parts)} pass through each other at {len(places)} "
        f"places, as at {coordinates(places[0])} mm: contact acts at points within cells, so take "
        "smaller cells"
    )
