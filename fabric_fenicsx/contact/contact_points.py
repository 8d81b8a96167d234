"""Points of a sheet that lie over another sheet, and move relative to it, lagged in a solve."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import basix
import numpy as np
from mpi4py import MPI
from scipy import sparse

from ..core.compiled import compiled
from ..energy.morley import Where
from ..energy.nodes import CoupledNodes, GatheredNodes, Nodes
from ..energy.term import Triplets
from ..sheet.blank import Blank, Part
from ..surfaces.facets import LAST, NEXT, unit
from .faces import Corners, Face
from .pressure_law import FaceLaw

POINTS = {1: 1, 3: 2, 6: 4}  # of a cell: degree that they integrate exactly


class RelativeMotion:
    """Points of a sheet that move relative to another one.

    They move as the flat triangles do that they and the places below them lie in, `corners`. If
    unit `normals` (n, 3) are given, the points are those of the touching faces: a face's point
    moves by its offset, too, as its triangle turns: by offset times -sum_i (n.u_i) grad N_i. So
    forces there are borne by forces of the nodes that have their moment, too. All ranks make and
    use it together. Images of triangles move as their `mirrors` say.
    """

    def __init__(
        self, blank: Blank, corners: Sequence[Corners], normals: np.ndarray | None = None
    ) -> None:
        nodes = np.concatenate([triangles.nodes for triangles in corners], 1)
        self._known, places = np.unique(nodes, return_inverse=True)
        self._corners, self._normals, self._nodes = corners, normals, places.reshape(nodes.shape)
        over, below = (_motions(triangles, normals) for triangles in corners)
        self._motions = np.concatenate([over, -below], 2)
        self._gathered = GatheredNodes(blank, self._known)
        self._before = self._gathered.displacement()
        ones = np.ones(nodes.size), (places.ravel(), np.arange(nodes.size))
        self._on_nodes = sparse.csr_matrix(ones, shape=(len(self._known), nodes.size))

    def relative(self) -> np.ndarray:
        """Displacement of the points relative to the other sheet, (n, 3) [mm]."""
        return self._of_points(self._gathered.displacement())

    def offsets(self) -> np.ndarray:
        """Offsets of the touching faces from their triangles, less those below, (n, 3) [mm]."""
        moved = self._gathered.displacement() - self._before
        offsets = []
        for triangles, nodes in zip(self._corners, np.split(self._nodes, 2, axis=1)):
            across = _across(triangles.places + moved[nodes])
            across *= np.sign((across * self._normals).sum(1))[:, None]
            offsets.append(triangles.offset[:, None] * unit(across))
        return offsets[0] - offsets[1]

    def apart(self, owned: np.ndarray) -> np.ndarray:
        """Values at the points less those below them, (n, 3), from those at owned nodes."""
        return self._of_points(self._gathered.values(owned))

    def _of_points(self, values):
        return np.einsum("naj,nj->na", self._motions, values[self._nodes].reshape(-1, 18))

    def add(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add forces (n, 3) on the points, and their reactions, to f (this rank's dofs,) [N]."""
        borne = np.einsum("naj,na->nj", self._motions, forces).reshape(-1, 3)
        self._gathered.add(self._on_nodes @ borne, f)

    @cached_property
    def _coupled(self):
        return CoupledNodes(self._known, self._nodes)

    def triplets(self, blocks: np.ndarray) -> Triplets:
        """As of `Term.tangent`. blocks (n, 3, 3): growth of each point's force [N/mm]."""
        coupled = self._coupled
        values = _stiffness(self._motions, blocks, coupled.places, coupled.count)
        return coupled.rows, coupled.cols, values.ravel()


class ContactPairs(NamedTuple):
    """The points of a sheet that lie over the other one, with the sheets in one shape.

    - points (n,): their numbers among all points; areas (n,): that they stand for [mm^2], as the
      sheet has stretched and sheared
    - gap (n,) between the faces [mm], its gradient `normal` (n, 3), its Hessian `curvature`
      (n, 3, 3) [1/mm]; growth (n,): how many times as thick both sheets are together as at the
      start, and growths (2, n): each of them, of the one with the points first
    - motion: what the points move with, on flat triangles, so that few nodes are coupled; relative
      (n, 3): their displacement relative to the other sheet in that shape [mm]
    - corners: the flat triangles of both sheets, of the one with the points first
    """

    points: np.ndarray
    areas: np.ndarray
    growth: np.ndarray
    growths: np.ndarray
    gap: np.ndarray
    normal: np.ndarray
    curvature: np.ndarray
    motion: RelativeMotion
    relative: np.ndarray
    corners: tuple[Corners, Corners]

    def unit_normals(self) -> np.ndarray:
        """Unit normals of the face below, towards the points (n, 3)."""
        return self.normal / np.linalg.norm(self.normal, axis=1)[:, None]

    def offsets(self) -> np.ndarray:
        """Vectors from mid-surface to mid-surface, across the faces (n, 3) [mm]."""
        over, below = self.corners
        return (below.offset - over.offset)[:, None] * self.unit_normals()

    def paraboloid(self) -> tuple[np.ndarray, np.ndarray]:
        """Gap (n,) [mm] and its gradient (n, 3) now, by the Hessian of then: without kinks."""
        moved = self.moved()
        turned = np.einsum("nij,nj->ni", self.curvature, moved)
        gap = self.gap + ((self.normal + 0.5 * turned) * moved).sum(1)
        return gap, self.normal + turned

    def moved(self) -> np.ndarray:
        """Displacement relative to the other sheet since then, (n, 3) [mm]."""
        return self.motion.relative() - self.relative


class ContactPoints:
    """Points in the triangles of one of two sheets, and the smooth `Face` of the other one below
    them.

    The points are in the sheet of smaller cells, in the upper one if they are equal.

    - parts: lower and upper sheet; part: the one with the points
    - places (k, 3): barycentric coordinates of the points of each triangle
    - areas (count,): undeformed areas that this rank's `count` points stand for [mm^2]
    - faces (lower, upper): the mean of their thicknesses is the distance of the mid-surfaces where
      the gap is 0
    - nodes: of the whole blank
    """

    SIDES = 1  # that points look to

    def __init__(
        self,
        lower: Part,
        upper: Part,
        rule: int,
        faces: Sequence[FaceLaw],
        symmetric: Sequence[Where],
    ) -> None:
        self.parts, self.faces = (lower, upper), faces
        comm, areas = self.blank.mesh.comm, [self.blank.areas()[part.cells] for part in self.parts]
        sizes = [comm.allreduce(sheet.sum()) / comm.allreduce(len(sheet)) for sheet in areas]
        over = 1 if sizes[1] <= sizes[0] * (1 + 1e-6) else 0
        self.part = self.parts[over]
        # of the distance, by which the face is off
        self._share = faces[over].thickness / sum(face.thickness for face in faces)
        self._face = Face(self.parts[1 - over], self.side, list(symmetric))
        self._over = Face(self.part, 1.0, list(symmetric)) if self.SIDES == 1 else self._face
        # other sheets may lie between them, and points rise by the distance where both touch
        apart = abs(self._over.flat_height() - self._face.flat_height())
        self._reach = apart + self._distance
        places, weights = basix.make_quadrature(basix.CellType.triangle, POINTS[rule])
        N = np.tile(np.column_stack([1 - places.sum(1), places]), (self.SIDES, 1))
        weights = np.tile(weights, self.SIDES)
        many = self.blank.triangles(self.part.cells).shape[1]
        self.places, self.per_cell = N, many * len(N)
        self._on_face = self._over.own_weights(N), self._over.flat(N)
        self.areas = (areas[over][:, None] / many * np.tile(weights / weights.sum(), many)).ravel()
        self.nodes = Nodes(self.blank)
        # of the thickness at nodes, where that is a field; None if no sheet's thickness varies
        thickens = any(face.thickening for face in faces)
        self._shares = np.ones(self.nodes.count) if thickens else None
        self._below = np.full(self.count, -1)  # what was found last
        self._pairs: tuple[np.ndarray, ContactPairs] | None = None

    @property
    def blank(self) -> Blank:
        """The stack of both sheets."""
        return self.parts[0].blank

    @property
    def count(self) -> int:
        """Number of this rank's points."""
        return len(self.areas)

    @property
    def side(self) -> float:
        """1 if the upper sheet has the points, else -1."""
        return 1.0 if self.part is self.parts[1] else -1.0

    @property
    def _distance(self):
        return sum(face.thickness for face in self.faces) / 2

    def vary(self, shares: np.ndarray) -> None:
        """Let the sheets be `shares` (owned nodes,) as thick as they were made."""
        self._shares, self._pairs = shares, None

    def pairs(self) -> ContactPairs:
        """The points over the other sheet at the present displacement, on all ranks together."""
        u = self.blank.u.x.array
        is_current = self._pairs is not None and np.array_equal(u, self._pairs[0])
        if self._pairs is None or not self.blank.mesh.comm.allreduce(is_current, MPI.LAND):
            self._pairs = u.copy(), self._faced()
        return self._pairs[1]

    def _faced(self):
        for face in dict.fromkeys((self._face, self._over)):
            face.take()
        below = self._project()
        at = np.flatnonzero(below.triangle >= 0)
        corners = self._corners(below, at)
        motion = RelativeMotion(self.blank, corners)
        areas = self.areas[at] * self.blank.area_ratios()[self.part.cells[at // self.per_cell]]
        growths = self._growths(below, at)
        growth = self._share * growths[0] + (1 - self._share) * growths[1]
        gap = below.gap[at] - self._distance * growth
        shape = gap, below.normal[at], below.curvature[at]
        return ContactPairs(at, areas, growth, growths, *shape, motion, motion.relative(), corners)

    def _project(self):
        points = self._over.points(*self._on_face)
        # a sheet that is folded over shows its back to points of the other one
        ahead = self.side * self._over.flat(self.places, self._over.normals)
        below = self._face.project(points, self._below, self._reach, ahead)
        self._below = below.triangle
        return below

    def _growths(self, below, at):
        if self._shares is None:
            return np.ones((2, len(at)))
        areas, powers = self.nodes.areas, np.zeros(self.nodes.count)
        for part, face in zip(self.parts, self.faces):
            powers[part.nodes] = face.thickening
        ratios = np.where(areas > 0, self.nodes.areas_now() / np.maximum(areas, 1e-300), 1.0)
        thicker = (self._shares * ratios**-powers)[:, None]
        over = self._over.flat(self.places, self._over.gathered(thicker))[at, 0]
        others = self._face.gathered(thicker)[self._face.triangles[below.triangle[at]], 0]
        return np.stack([over, (below.weights[at] * others).sum(1)])

    def _corners(self, below, at):
        gap, share, (cell, place) = below.gap[at], self._share, np.divmod(at, len(self.places))
        over = self._over.own_triangles[cell], self.places[place], -share * gap
        others = below.triangle[at], below.weights[at], (1 - share) * gap
        return self._over.corners(*over), self._face.corners(*others)

    def of_all(self, pairs: ContactPairs, values: np.ndarray, other: float = 0.0) -> np.ndarray:
        """Values (n, ...) of `pairs` as those of all points (count, ...), `other` over nothing."""
        at_all = np.full((self.count, *values.shape[1:]), other)
        at_all[pairs.points] = values
        return at_all

    def flat_places(self) -> np.ndarray:
        """Places of all points in the undeformed sheet, (count, 3) [mm]."""
        return self._on_face[1]

    def means(self, values: np.ndarray) -> np.ndarray:
        """Means over cells of values of all points (count, ...), by side (cells, SIDES, ...)."""
        count, many = len(self.part.cells), len(self.places)
        shape = count, self.per_cell // many, self.SIDES, many // self.SIDES
        return values.reshape(*shape, *values.shape[1:]).mean((1, 3))

    def of_cells(self, rows: np.ndarray) -> np.ndarray:
        """Values of all points (count, k), or (count,), by `rows` of the blank's owned cells."""
        values = rows[self.part.cells]
        wide = values.shape[1] // self.per_cell
        return values.reshape((self.count, wide) if wide > 1 else self.count)

    def below(self, pairs: ContactPairs, values: np.ndarray) -> np.ndarray:
        """Means of values (count,) at owned nodes of the sheet below, 0 with no points above."""
        areas = pairs.areas
        weighed = np.column_stack([areas * values[pairs.points], areas, 0 * areas])
        sums_at_nodes = np.zeros(3 * self.nodes.count)
        pairs.motion.add(weighed, sums_at_nodes)
        sums, areas = sums_at_nodes.reshape(-1, 3)[:, :2].T
        return np.divide(sums, areas, out=np.zeros_like(sums), where=areas < 0)


class LaggedFaces:
    """The `ContactPairs` that contact uses within a solve, so that its energy has no kinks.

    After a solve the faces are looked at again. If that changes the forces on the points by more
    than `lag` of their sum, they are updated, and the solve is to be repeated: all of the way to
    the solution at first, then as far as A. C. Aitken's rule says (U. Küttler and W. A. Wall,
    2008), less where solutions alternate. The first `owned` degrees of freedom are this rank's.

    accepted, now: those of the last accepted state and of the present solve
    """

    def __init__(self, points: ContactPoints, lag: float, owned: int) -> None:
        self._points, self.lag, self._owned = points, lag, owned
        self.accept()
        self.restore()

    @property
    def _u(self):
        return self._points.blank.u.x.array

    def _begin(self, place, pairs):
        """Take the faces of this displacement."""
        self._place, self._share, self.now = place, 1.0, pairs
        self._missed: np.ndarray | None = None

    def restore(self) -> None:
        """Go back to the faces of the last accepted state."""
        self._begin(self._accepted_place, self.accepted)

    def on_prediction(self) -> None:
        """Take the faces of a predicted state, with the areas of the last accepted one."""
        points, present = self._points, self._points.pairs()
        before = points.of_all(self.accepted, self.accepted.areas, np.nan)[present.points]
        areas = np.where(np.isnan(before), present.areas, before)
        self._begin(self._u.copy(), present._replace(areas=areas))

    def accept(self) -> None:
        self._accepted_place = self._u.copy()
        self.accepted = self.now = self._points.pairs()

    def update(self, forces: Callable[[ContactPairs], np.ndarray]) -> bool:
        """Update the faces if they are off by more than `lag`; true if so, the same on all
        ranks. forces: function of a `ContactPairs` to the forces on all points (count, 3) [N]."""
        comm, present, solution = self._points.blank.mesh.comm, self._points.pairs(), self._u.copy()
        before, after = forces(self.now), forces(present)
        sizes = [np.linalg.norm(each, axis=1).sum() for each in (after - before, after)]
        changed, total = comm.allreduce(np.array(sizes))
        if changed <= self.lag * total:
            return False
        missed = solution - self._place
        if self._missed is not None:
            less, last = (missed - self._missed)[: self._owned], self._missed[: self._owned]
            along, square = comm.allreduce(np.array([last @ less, less @ less]))
            self._share = float(np.clip(-self._share * along / max(square, 1e-300), 0.1, 1.0))
        before, self._missed, self._place = self._place, missed, solution
        if self._share < 1:
            self._u[:] = self._place = before + self._share * missed
            present = self._points.pairs()
            self._u[:] = solution
        self.now = present
        return True


def _motions(corners, normals):
    """Matrices from displacements of the corners to those of the points (n, 3, 9)."""
    x, mirrors = corners.places, corners.mirrors
    moves = corners.weights[:, None, :, None] * np.eye(3)[:, None]  # (n, 3, corners, 3)
    if normals is not None:
        across = _across(x)
        square = np.maximum((across**2).sum(1), 1e-300)[:, None, None]
        slopes = np.cross(across[:, None], x[:, LAST] - x[:, NEXT]) / square  # grad N_i (n, 3, 3)
        if mirrors is not None:
            normals = np.einsum("nij,nj->ni", mirrors, normals)
        turns = slopes.swapaxes(1, 2)[..., None] * normals[:, None, None]
        moves = moves - corners.offset[:, None, None, None] * turns
    if mirrors is not None:
        moves = np.einsum("nij,njcx->nicx", mirrors, moves)
    return moves.reshape(len(x), 3, 9)


def _across(x):
    """Vectors (n, 3) across triangles x (n, 3, 3), twice as long as their area."""
    return np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])


@compiled
def _stiffness(motions, blocks, places, count):
    """Sums (count, 3, 3) of transposed matrix times block times matrix."""
    values, pulled = np.zeros((count, 3, 3)), np.empty(motions.shape[1:])
    for n in range(len(motions)):
        L, B = motions[n], blocks[n]
        if not B.any():
            continue
        for a in range(3):
            for j in range(L.shape[1]):
                pulled[a, j] = B[a, 0] * L[0, j] + B[a, 1] * L[1, j] + B[a, 2] * L[2, j]
        for i in range(places.shape[1]):
            for j in range(places.shape[2]):
                p, q, value = L[:, 3 * i :], pulled[:, 3 * j :], values[places[n, i, j]]
                for a in range(3):
                    for b in range(3):
                        value[a, b] += p[0, a] * q[0, b] + p[1, a] * q[1, b] + p[2, a] * q[2, b]
    return values
