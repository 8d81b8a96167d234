"""Morley's plate triangle without slopes of its own: curvatures from the positions of nodes alone.

Cells are Morley's plate triangles (Morley 1968): their curvature is constant, and follows from the
positions of the nodes and the slopes across the middles of the edges. The slopes are no unknowns
here. A quadratic goes through a cell's six nearest nodes, those of the cell and of its neighbours
(Phaal & Calladine 1992); the slope at an edge is the mean of those of its two cells' quadratics.

Two simpler choices do not converge to the right plate on `crossed` meshes. The quadratics' own
curvature makes it up to a third too soft: it is exact on quadratic deflections, but out of balance
under constant moments. Slopes averaged over plane cells (Oñate & Zárate's BST 2000) make it up to a
quarter too stiff, with the reverse fault. The one taken passes both tests. Only linear states are
free of energy, as slopes are common to neighbours and Morley's triangle has no other such states.
"""

import math
from collections.abc import Callable, Sequence
from copy import copy
from typing import NamedTuple, Self

import dolfinx
import numpy as np
from mpi4py import MPI

from ...runtime.errors import InputError
from ...sheets.blank import Blank

Where = Callable[[np.ndarray], np.ndarray]  # points (3, n) [mm] to a mask (n,)
PLATE = np.sqrt([1.0, 1.0, 2.0])  # weights of x,11, x,22, x,12 in a norm that no axes change


class MorleyCells:
    """The flat triangles of this rank's owned cells, `per_cell` of each, and the 12 nodes that
    each one's curvature is read off.

    nodes: their global numbers (cells, 12): first the cell's own, then those opposite across its
    edges, then for each edge the two others of the cell beyond. codes: number of the matrix in
    `mirrors` (k, gdim, gdim) that takes a node's displacement to its image's; 0 where no image is
    needed. Edge e is opposite corner e. Of the undeformed cells: area (cells,) [mm^2], corners
    (cells, 3, gdim), and along_a (cells, 3), weights with which corners sum to yarn a's direction.
    yarn_b (cells, 2): yarn b's direction along yarn a and across; (0, 1) makes axes orthonormal.

    symmetric, clamped: as in `Bending`. Raises InputError, on all ranks, for edges not found, for
    symmetric ones in several planes, and for meshes that are no manifold.
    """

    def __init__(
        self,
        blank: Blank,
        symmetric: Where | Sequence[Where] = (),
        clamped: Where | Sequence[Where] = (),
    ) -> None:
        self.blank, self.comm = blank, blank.mesh.comm
        self.index_map = blank.mesh.topology.index_map(2)
        dofs = blank.triangles()
        self.per_cell = dofs.shape[1]
        self.dofs = dofs.reshape(-1, 3)
        self.count = self.per_cell * self.index_map.size_local
        self.positions = blank.along(blank.coordinates().T).T
        self._beyond()
        self._geometry()
        self._edges(symmetric, clamped)
        self._quadratics()

    def only(self, cells: np.ndarray) -> Self:
        """Those `cells` (k,) of them, after `curvature`."""
        some = copy(self)
        names = "area corners opposite jumps far free along_a out2 height nodes codes"
        names += " bends spread own"
        for name in names.split():
            setattr(some, name, getattr(self, name)[cells])
        return some

    def of(self, cells: np.ndarray) -> np.ndarray:
        """Which of them lie in the blank's `cells` (n,), (n per_cell,)."""
        return (cells[:, None] * self.per_cell + np.arange(self.per_cell)).ravel()

    def _beyond(self):
        """The cell beyond each edge, -1 if there is none, and that edge's number there."""
        ends = np.sort(self.dofs[:, [[1, 2], [2, 0], [0, 1]]], axis=2).reshape(-1, 2)
        _, edges = np.unique(ends, axis=0, return_inverse=True)
        order = np.argsort(edges.ravel(), kind="stable")
        first = np.flatnonzero(np.diff(edges.ravel()[order], prepend=-1))
        sides = np.diff(first, append=len(order))
        other = np.full(len(order), -1)
        one, two = order[first[sides == 2]], order[first[sides == 2] + 1]
        other[one], other[two] = two, one
        other = other[: 3 * self.count].reshape(-1, 3)
        self.beyond, self.edge_beyond = np.where(other < 0, -1, other // 3), other % 3
        topology = self.blank.mesh.topology
        topology.create_connectivity(1, 2)
        alone = self.comm.allreduce(int((self.beyond < 0).sum()))
        free = 2 * topology.index_map(1).size_global - 3 * self.index_map.size_global
        if alone != free * math.isqrt(self.per_cell):
            raise InputError(
                f"bending of {self.blank.name} finds edges of more than two cells, or ranks that "
                "don't know the cells beyond theirs; allowed is a manifold with ghosts at facets"
            )

    def _geometry(self):
        """Sizes, directions and, in each cell's plane from its middle along a0 and across,
        coordinates."""
        blank, count = self.blank, self.count
        self.corners = x = self.positions[self.dofs[:count]]
        edge = np.roll(x, -2, 1) - np.roll(x, -1, 1)
        self.length = np.linalg.norm(edge, axis=2)
        self.tangent = edge / self.length[:, :, None]
        self.middle = x.sum(1, keepdims=True) / 2 - x / 2
        out = self.middle - x
        out -= (out * self.tangent).sum(2, keepdims=True) * self.tangent
        self.height = np.linalg.norm(out, axis=2)
        self.outward = out / self.height[:, :, None]
        self.area = 0.5 * self.length[:, 0] * self.height[:, 0]
        owned, k = self.index_map.size_local, self.per_cell
        fibres = [f.x.array.reshape(-1, x.shape[2])[:owned] for f in (blank.a0, blank.b0)]
        a, b = (blank.along(np.repeat(f, k, axis=0).T).T for f in fibres)
        across = b - (a * b).sum(1, keepdims=True) * a
        self.axes = np.stack([a, across / np.linalg.norm(across, axis=1, keepdims=True)], 1)
        self.yarn_b = np.einsum("cki,ci->ck", self.axes, b)
        self.centre = x.mean(1, keepdims=True)
        self.out2 = np.einsum("cki,cei->cek", self.axes, self.outward)
        self.along_a = -self.out2[:, :, 0] / self.height

    def _plane(self, points):
        return np.einsum("cki,cni->cnk", self.axes, points - self.centre)

    def _edges(self, symmetric, clamped):
        """Mark edges beyond which lies the cell's mirror image (`image`), or nothing (`free`)."""
        points, dim = self.blank.coordinates().T, self.corners.shape[2]
        symmetric, clamped = ([k] if callable(k) else list(k) for k in (symmetric, clamped))
        nodes = self.dofs[: self.count]
        self.plane, self.image = np.zeros((self.count, 3), int), np.zeros((self.count, 3), bool)
        self.normal = self.outward.copy()  # of the plane that images are mirrored in
        mirrors = [np.eye(dim)]
        for number, where in enumerate(symmetric + clamped):
            on = np.asarray(where(points), bool)[nodes]
            on = (self.beyond < 0) & np.roll(on, -1, 1) & np.roll(on, -2, 1) & ~self.image
            total = self.comm.allreduce(
                (self.length[:, :, None] * self.outward)[on].sum(0), MPI.SUM
            )
            is_plane = number < len(symmetric)
            size = np.linalg.norm(total)
            if self.comm.allreduce(int(on.sum())) == 0:
                raise InputError(
                    f"{self._label(number, symmetric)} marks no side of the sheet's edge; allowed "
                    "is a function of points (3, n) that is true at both ends of some sides"
                )
            self.image |= on
            if not is_plane:
                continue
            total /= max(size, 1e-300)
            if self.comm.allreduce(int((self.outward[on] @ total < 0.5).sum())):
                raise InputError(
                    f"{self._label(number, symmetric)} marks sides in more than one plane; allowed "
                    "is a function for each plane"
                )
            self.plane[on], self.normal[on] = number + 1, total
            mirrors.append(np.eye(dim) - 2 * np.outer(total, total))
        self.free = (self.beyond < 0) & ~self.image
        self.planes = len(mirrors)
        # code first * planes + second: mirrored in the second, then in the first
        self.mirrors = np.array([first @ second for first in mirrors for second in mirrors])

    def _label(self, number, symmetric):
        """Name in messages of the function of this number among the symmetric and clamped ones."""
        count = len(symmetric)
        name, k = ("symmetric", number) if number < count else ("clamped", number - count)
        return f"function {k + 1} in `{name}` of the bending of {self.blank.name}"

    def _reflected(self, points, e):
        """Images of points (cells, 3) beyond edge e."""
        normal = self.normal[:, e]
        return points - 2 * ((points - self.middle[:, e]) * normal).sum(1, keepdims=True) * normal

    def _quadratics(self):
        """For each cell its six nodes, and the slopes out of its edges' middles of the quadratic
        through them."""
        count, nodes, beyond = self.count, self.dofs[: self.count], self.beyond
        local = np.where(beyond < 0, nodes, self.dofs[beyond, self.edge_beyond])
        opposite = self.positions[local]
        for e in range(3):
            alone = beyond[:, e] < 0
            opposite[alone, e] = self._reflected(self.corners[:, e], e)[alone]
        # unfold the neighbours into the cell's plane
        arm = opposite - self.middle
        along = (arm * self.tangent).sum(2, keepdims=True)
        self.far = np.linalg.norm(arm - along * self.tangent, axis=2)
        there = self._plane(
            self.middle + along * self.tangent + self.far[:, :, None] * self.outward
        )
        here = self._plane(self.corners)
        # gradients of the corners' linear functions, (cells, 3, 2)
        slope = -self.out2 / self.height[:, :, None]
        shape = 1 / 3 + np.einsum("cnk,cek->cen", slope, there)
        jumps = np.zeros((count, 3, 6))  # by how much the nodes opposite lie off the cell's plane
        jumps[:, :, :3], jumps[:, np.arange(3), np.arange(3) + 3] = -shape, ~self.free
        matrix = _monomials(there) - np.einsum("cen,cnk->cek", shape, _monomials(here))
        scale = self.area[:, None, None]
        lost = np.abs(np.linalg.det(matrix / scale)) < 1e-12  # six nodes on a conic
        matrix[lost] = scale[lost] * np.eye(3)
        inverse = np.linalg.inv(matrix)
        # of second derivatives that axes in any direction measure alike
        size = np.linalg.norm(inverse * PLATE[:, None], axis=(1, 2))
        self.trust = (size * self.area) ** -4.0
        # a last resort: beside a free edge a cell's own quadratic is not known
        self.trust[self.free.any(1)] *= 1e-8
        self.trust[lost] = 1e-300
        inverse[lost] = 0
        self.inverse, self.jumps, self.opposite = inverse, jumps, opposite
        # slopes of the cell's linear functions
        self.linear = np.einsum("cek,cnk->cen", self.out2, slope)
        self.quadratic = np.einsum(
            "ceki,cei->cek", _gradients(self._plane(self.middle)), self.out2
        ) - np.einsum("cen,cnk->cek", self.linear, _monomials(here))
        self.six = (
            self.blank.V.dofmap.index_map.local_to_global(
                np.concatenate([nodes, local], 1).astype(np.int32).ravel()
            )
            .reshape(-1, 6)
            .astype(np.int64)
        )

    def hinges(self) -> tuple[np.ndarray, np.ndarray]:
        """As `bends` and `own`, but of the plane cells on both sides of an edge (Oñate & Zárate's
        BST): operator (cells, 3, 6) from the first six of the nodes, each edge's from its four."""
        operator = _without_rounding(
            self.jumps * ~self.free[:, :, None] / (2 * self.far[:, :, None])
        )
        x = np.concatenate([self.corners, self.opposite], 1)
        return operator, operator @ x

    def curvature(self, stiffnesses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Operator (cells, 3, 12) from the 12 nodes' displacements to x,aa, x,bb, x,ab, and these
        of the undeformed sheet (cells, 3, gdim). stiffnesses: D_a, D_b, D_t [N mm], or the matrix
        (3, 3) that couples them. Free edges take the slopes of least energy, and so bear no
        moment. Keeps how the slopes out of the edges differ from the cell's, `bends` (cells, 3
        edges, 12) of displacements, `own` of the undeformed sheet (cells, 3, gdim), and `spread`
        (cells, 3, 3), the curvatures that they give."""
        slopes = self._slopes()
        bends, x = self._bends(slopes, self._known_beyond(slopes))
        out = self.out2
        spread = np.stack([out[:, :, 0] ** 2, out[:, :, 1] ** 2, out[:, :, 0] * out[:, :, 1]], 1)
        spread *= (self.length / self.area[:, None])[:, None]
        c, s = self.yarn_b.T
        one, zero = np.ones_like(c), np.zeros_like(c)
        yarns = np.array([[one, zero, zero], [c * c, s * s, 2 * c * s], [c, zero, s]]).transpose(
            2, 0, 1
        )
        if stiffnesses.ndim == 1:
            root = np.sqrt(stiffnesses)[:, None] * yarns
        else:
            root = np.linalg.cholesky(stiffnesses).T @ yarns
        relaxed = _relaxed(spread, root, self.free)
        self.spread = np.einsum("cij,cje->cie", yarns, relaxed)
        self.bends = _without_rounding(bends)
        self.own = np.einsum("cen,cni->cei", self.bends, x)
        operator = _without_rounding(np.einsum("cie,cen->cin", self.spread, bends))
        return operator, np.einsum("ckn,cni->cki", operator, x)

    def _slopes(self):
        """Slopes out of the edges' middles (cells, 3, 6), of the six nodes' displacements, of each
        cell's own quadratic."""
        # slopes must not depend on a D_t near 0
        plate = np.broadcast_to(np.diag(PLATE), (self.count, 3, 3))
        hessian = np.einsum("cke,cen->ckn", _relaxed(self.inverse, plate, self.free), self.jumps)
        slopes = np.einsum("cek,ckn->cen", self.quadratic, hessian)
        slopes[:, :, :3] += self.linear
        return slopes

    def _known_beyond(self, slopes):
        """Data of this rank's cells and of those beyond them, as a `_Beyond`."""
        parts = _Beyond(slopes, self.six, self.plane, self.opposite, self.trust)
        widths = [math.prod(part.shape[1:]) for part in parts]
        sent = dolfinx.la.vector(self.index_map, sum(widths) * self.per_cell)
        known = np.split(sent.array.reshape(-1, sum(widths)), np.cumsum(widths)[:-1], 1)  # views
        for values, part in zip(known, parts):
            values[: self.count] = part.reshape(self.count, values.shape[1])
        sent.scatter_forward()
        pairs = zip(known, parts)
        return _Beyond(*(v.reshape(-1, *p.shape[1:]).astype(p.dtype) for v, p in pairs))

    def _bends(self, slopes, known):
        """Slopes of the edges less those of the plane cell (cells, 3, 12), of the 12 nodes'
        displacements, and these nodes' positions (cells, 12, gdim). Numbers the nodes."""
        count, six, own = self.count, self.six, np.arange(self.count)
        x = np.zeros((count, 12, self.corners.shape[2]))
        x[:, :3], x[:, 3:6] = self.corners, self.opposite
        self.nodes = np.concatenate([six, np.zeros((count, 6), int)], 1)
        self.codes = np.zeros((count, 12), int)
        self.codes[:, 3:6] = self.plane
        bends = np.zeros((count, 3, 12))
        bends[:, :, :3] = -self.linear
        for e in range(3):
            image, free = self.image[:, e], self.free[:, e]
            other = np.where(self.beyond[:, e] < 0, own, self.beyond[:, e])
            edge = np.where(self.beyond[:, e] < 0, e, self.edge_beyond[:, e])
            share = known.trust[own] / (known.trust[own] + known.trust[other])
            share = np.where(free, 0, share)[:, None]
            rest = np.where(free[:, None], 0, 1 - share)
            bends[:, e, :6] += share * slopes[:, e]
            follows = known.six[other, (edge + 1) % 3] == six[:, (e + 1) % 3]
            place = np.empty((count, 6), int)  # of their six nodes among these 12
            place[own, edge], place[own, 3 + edge] = 3 + e, e
            for k in (1, 2):
                place[own, (edge + k) % 3] = np.where(follows, (e + k) % 3, (e + 3 - k) % 3)
                new, source = 5 + 2 * e + k, (edge + k) % 3
                place[own, 3 + source] = new
                self.nodes[:, new] = known.six[other, 3 + source]
                mirrored = np.where(image, self.plane[:, e] * self.planes, 0)
                self.codes[:, new] = known.plane[other, source] + mirrored
                x[:, new] = known.opposite[other, source]
                x[image, new] = self._reflected(x[:, new], e)[image]
            theirs = known.slopes[other, edge]
            np.add.at(bends, (own[:, None], e, place), -rest * theirs)  # type: ignore[arg-type]
        first, second = np.divmod(self.codes, self.planes)
        self.codes[first == second] = 0
        return bends, x


class _Beyond(NamedTuple):
    """Slopes (cells, 3, 6), nodes (cells, 6), planes of mirrors (cells, 3), nodes opposite (cells,
    3, gdim) and trust (cells,) of this rank's cells and of those beyond them."""

    slopes: np.ndarray
    six: np.ndarray
    plane: np.ndarray
    opposite: np.ndarray
    trust: np.ndarray


def _monomials(p):
    """1/2 x^2, 1/2 y^2, x y at points (..., 2), whose second derivatives are unit ones."""
    return np.stack([p[..., 0] ** 2 / 2, p[..., 1] ** 2 / 2, p[..., 0] * p[..., 1]], -1)


def _gradients(p):
    """Their gradients, (..., 3, 2)."""
    x, y, zero = p[..., 0], p[..., 1], np.zeros_like(p[..., 0])
    return np.stack([np.stack([x, zero], -1), np.stack([zero, y], -1), np.stack([y, x], -1)], -2)


def _without_rounding(operator):
    """The operator (cells, k, 12), on regular meshes with many coefficients of 0."""
    size = np.abs(operator)
    return np.where(size < 1e-12 * size.max((1, 2), initial=0)[:, None, None], 0.0, operator)


def _relaxed(operator, root, free):
    """`operator` (cells, 3, edges) where what comes from `free` edges (cells, edges) is what least
    |root @ operator @ edges| asks for, from the other edges; root: (cells, 3, 3)."""
    relaxed = operator * ~free[:, None]
    at = np.flatnonzero(free.any(1))
    loose, root = operator[at] * free[at, None], root[at]
    left, size, right = np.linalg.svd(root @ loose)
    # what no stiffness asks for stays zero
    least = 1e-9 * np.linalg.norm(root, axis=(1, 2)) * np.linalg.norm(loose, axis=(1, 2))
    works = size > least[:, None]
    inverse = np.where(works, 1 / np.where(works, size, 1), 0)[:, :, None] * left.swapaxes(1, 2)
    relaxed[at] -= loose @ right.swapaxes(1, 2) @ inverse @ root @ relaxed[at]
    return relaxed
