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

In `crossed` squares along the yarns these, which hardly stretch, keep each middle node at the mean
of its corners. On a sheet that bends in its plane this adds a zigzag of middles and corners, whose
curvature would make it 1.475 times as stiff: `within` does not see it.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import dolfinx
import numpy as np
from mpi4py import MPI

from ..core.errors import InputError
from ..sheet.blank import Blank, Part

Where = Callable[[np.ndarray], np.ndarray]  # points (3, n) [mm] to a mask (n,)


class MorleyCells(NamedTuple):
    """The flat triangles of this rank's owned cells of a part, `per_cell` of each, and the 12 nodes
    that each one's curvature is read off.

    - mirrors (k, gdim, gdim): matrices that take a node's displacement to its image's; codes
      (cells, 12): number of a node's, 0 where no image is needed
    - nodes (cells, 12): their global numbers: first the cell's own, then those opposite across its
      edges, then for each edge the two others of the cell beyond; edge e is opposite corner e
    - area (cells,) [mm^2], corners (cells, 3, gdim) and slopes (cells, 3, 2) of the corners' linear
      functions, of the undeformed cells
    - bends (cells, 3 edges, 12): operator from displacements to how the slopes out of the edges
      differ from the cell's; own (cells, 3, gdim): that of the undeformed sheet; spread
      (cells, 3, 3): the curvatures that they give
    - operator (cells, 3, 12) from displacements to x,aa, x,bb, x,ab; curved (cells, 3, gdim): these
      of the undeformed sheet; within (cells, 3, 12): as `operator`, for bending within the sheet
    - hinges (cells, 3, 6): as `bends`, but of the plane cells on both sides of an edge (Oñate &
      Zárate's BST), from the first six of the nodes, each edge's from its four; hinged
      (cells, 3, gdim): as `own`
    """

    blank: Blank
    per_cell: int
    mirrors: np.ndarray
    area: np.ndarray
    corners: np.ndarray
    slopes: np.ndarray
    nodes: np.ndarray
    codes: np.ndarray
    bends: np.ndarray
    own: np.ndarray
    spread: np.ndarray
    operator: np.ndarray
    curved: np.ndarray
    within: np.ndarray
    hinges: np.ndarray
    hinged: np.ndarray


class Shape(NamedTuple):
    """Cells as they are deformed: base vectors (cells, 3, 2), normals (cells, 3), gradients of the
    corners' functions (cells, 3, 3), the normal curvature's derivative by each node's motion along
    the normal (cells, 3, nodes), and itself (cells, 3); or, in its place, what else the operator of
    `shape` gives along the normal."""

    base: np.ndarray
    normal: np.ndarray
    gradients: np.ndarray
    bends: np.ndarray
    curvature: np.ndarray


class Section(NamedTuple):
    """What bending's stiffness depends on: the shape, what is conjugate to its curvature (cells, 3)
    [N mm], its derivatives in curvatures (cells, 3, 3), and those of `stretching` in them."""

    shape: Shape
    moments: np.ndarray
    bending: np.ndarray
    mixed: np.ndarray


def morley_cells(
    part: Part,
    stiffnesses: np.ndarray,
    symmetric: Where | Sequence[Where] = (),
    clamped: Where | Sequence[Where] = (),
) -> MorleyCells:
    """`MorleyCells` of a part. Free edges take the slopes of least energy, and so bear no moment.

    stiffnesses [N mm]: D_a, D_b, D_t along the yarns, or the matrix (3, 3) that couples them along
    orthonormal axes, the first one along yarn a. symmetric, clamped: as in `Bending`. Raises
    InputError, on all ranks, for edges not found, for symmetric ones in several planes, and for
    meshes that are no manifold.
    """
    flat = _FlatCells(part.blank)
    sides = _Sides(flat, symmetric, clamped)
    own = _Quadratics(flat, sides)
    bends, x, nodes, codes, pinned = _bends(flat, sides, own)
    out = flat.out2
    spread = np.stack([out[:, :, 0] ** 2, out[:, :, 1] ** 2, out[:, :, 0] * out[:, :, 1]], 1)
    spread *= (flat.length / flat.area[:, None])[:, None]
    one, zero = np.ones(flat.count), np.zeros(flat.count)
    if stiffnesses.ndim == 1:
        root, (c, s) = np.diag(np.sqrt(stiffnesses)), flat.yarn_b.T
    else:
        root, c, s = np.linalg.cholesky(stiffnesses).T, zero, one
    yarns = np.array([[one, zero, zero], [c * c, s * s, 2 * c * s], [c, zero, s]])
    yarns = yarns.transpose(2, 0, 1)
    spread = np.einsum("cij,cje->cie", yarns, _relaxed(spread, root @ yarns, sides.free))
    bends = _without_rounding(bends)
    operator = _without_rounding(np.einsum("cie,cen->cin", spread, bends))
    within = _without_rounding(_blind_to_pinned(operator, bends, flat.plane(x), pinned))
    hinges = _without_rounding(own.jumps * ~sides.free[:, :, None] / (2 * own.far[:, :, None]))
    arrays = [flat.area, flat.corners, -out / flat.height[:, :, None], nodes, codes]
    arrays += [bends, bends @ x, spread, operator, operator @ x, within]
    arrays += [hinges, hinges @ x[:, :6]]
    here = (part.cells[:, None] * flat.per_cell + np.arange(flat.per_cell)).ravel()
    return MorleyCells(part.blank, flat.per_cell, sides.mirrors, *(each[here] for each in arrays))


class _FlatCells:
    """Flat triangles of a blank's cells: of all local ones the nodes `dofs` (local, 3); of the
    `count` owned ones sizes and directions, and, in each one's plane from its middle along a0 and
    across (`axes`), what `plane` gives."""

    def __init__(self, blank: Blank) -> None:
        self.blank, dofs = blank, blank.triangles()
        owned, k = blank.mesh.topology.index_map(2).size_local, dofs.shape[1]
        self.per_cell, self.count, self.dofs = k, k * owned, dofs.reshape(-1, 3)
        self.positions = blank.along(blank.coordinates().T).T
        self.corners = x = self.positions[self.dofs[: self.count]]
        edge = np.roll(x, -2, 1) - np.roll(x, -1, 1)
        self.length = np.linalg.norm(edge, axis=2)
        self.tangent = edge / self.length[:, :, None]
        self.middle = x.sum(1, keepdims=True) / 2 - x / 2
        out = self.middle - x
        out -= (out * self.tangent).sum(2, keepdims=True) * self.tangent
        self.height = np.linalg.norm(out, axis=2)
        self.outward = out / self.height[:, :, None]
        self.area = 0.5 * self.length[:, 0] * self.height[:, 0]
        fibres = [f.x.array.reshape(-1, x.shape[2])[:owned] for f in (blank.a0, blank.b0)]
        a, b = (blank.along(np.repeat(f, k, axis=0).T).T for f in fibres)
        across = b - (a * b).sum(1, keepdims=True) * a
        self.axes = np.stack([a, across / np.linalg.norm(across, axis=1, keepdims=True)], 1)
        self.yarn_b = np.einsum("cki,ci->ck", self.axes, b)
        self.out2 = np.einsum("cki,cei->cek", self.axes, self.outward)

    def plane(self, points):
        centre = self.corners.mean(1, keepdims=True)
        return np.einsum("cki,cni->cnk", self.axes, points - centre)


class _Sides:
    """Edges of the cells: the cell `beyond` each, -1 if there is none, and that edge's number there
    (`edge_beyond`); whether beyond lies the cell's mirror image (`image`), in which `plane` and
    with what `normal`, or nothing (`free`). All are (cells, 3)."""

    def __init__(self, flat, symmetric, clamped):
        self._find_cells_beyond(flat)
        points, comm = flat.blank.coordinates().T, flat.blank.mesh.comm
        symmetric, clamped = ([k] if callable(k) else list(k) for k in (symmetric, clamped))
        nodes, dim = flat.dofs[: flat.count], flat.corners.shape[2]
        self.plane, self.image = np.zeros((flat.count, 3), int), np.zeros((flat.count, 3), bool)
        self.normal, mirrors = flat.outward.copy(), [np.eye(dim)]
        for number, where in enumerate(symmetric + clamped):
            on = np.asarray(where(points), bool)[nodes]
            on = (self.beyond < 0) & np.roll(on, -1, 1) & np.roll(on, -2, 1) & ~self.image
            total = comm.allreduce((flat.length[:, :, None] * flat.outward)[on].sum(0), MPI.SUM)
            is_plane = number < len(symmetric)
            total /= max(np.linalg.norm(total), 1e-300)
            counts = on.sum(), (flat.outward[on] @ total < 0.5).sum()
            marked, off = comm.allreduce(np.array(counts))
            if not marked or (is_plane and off):
                kind = "symmetric" if is_plane else "clamped"
                k = number if is_plane else number - len(symmetric)
                fault = "sides in more than one plane" if marked else "no side of the sheet's edge"
                raise InputError(
                    f"function {k + 1} in `{kind}` of the bending of {flat.blank.name} marks "
                    f"{fault}; expected a function of points (3, n) that is true at both ends of "
                    "some sides, one for each plane"
                )
            self.image |= on
            if is_plane:
                self.plane[on], self.normal[on] = number + 1, total
                mirrors.append(np.eye(dim) - 2 * np.outer(total, total))
        self.free, self.planes = (self.beyond < 0) & ~self.image, len(mirrors)
        # code first * planes + second: mirrored in the second, then in the first
        self.mirrors = np.array([first @ second for first in mirrors for second in mirrors])

    def _find_cells_beyond(self, flat):
        ends = np.sort(flat.dofs[:, [[1, 2], [2, 0], [0, 1]]], axis=2).reshape(-1, 2)
        _, edges = np.unique(ends, axis=0, return_inverse=True)
        order = np.argsort(edges.ravel(), kind="stable")
        first = np.flatnonzero(np.diff(edges.ravel()[order], prepend=-1))
        sides = np.diff(first, append=len(order))
        other = np.full(len(order), -1)
        one, two = order[first[sides == 2]], order[first[sides == 2] + 1]
        other[one], other[two] = two, one
        other = other[: 3 * flat.count].reshape(-1, 3)
        self.beyond, self.edge_beyond = np.where(other < 0, -1, other // 3), other % 3
        topology, comm = flat.blank.mesh.topology, flat.blank.mesh.comm
        topology.create_connectivity(1, 2)
        alone = comm.allreduce(int((self.beyond < 0).sum()))
        free = 2 * topology.index_map(1).size_global - 3 * topology.index_map(2).size_global
        if alone != free * math.isqrt(flat.per_cell):
            raise InputError(
                f"bending of {flat.blank.name} finds edges of more than two cells, or ranks that "
                "lack the cells beyond theirs; expected a manifold with ghosts at facets"
            )

    def reflected(self, flat, points, e):
        """Images of points (cells, 3) beyond edge e."""
        normal = self.normal[:, e]
        return points - 2 * ((points - flat.middle[:, e]) * normal).sum(1, keepdims=True) * normal


class _Quadratics:
    """The quadratic through each cell's six nodes `six` (cells, 6), global numbers: `slopes`
    (cells, 3, 6) out of its edges' middles, of the nodes' displacements, those of the plane cell
    `linear` (cells, 3, 3), how far to `trust` it (cells,), which are `pinned` (cells, 6). opposite
    (cells, 3, gdim): the nodes across the edges; far (cells, 3): how far off the edges these are;
    jumps (cells, 3, 6): by how much they lie off the cell's plane."""

    def __init__(self, flat, sides):
        count, nodes, beyond = flat.count, flat.dofs[: flat.count], sides.beyond
        local = np.where(beyond < 0, nodes, flat.dofs[beyond, sides.edge_beyond])
        self.opposite = flat.positions[local]
        for e in range(3):
            alone = beyond[:, e] < 0
            images = sides.reflected(flat, flat.corners[:, e], e)
            self.opposite[alone, e] = images[alone]
        # unfold the neighbours into the cell's plane
        arm = self.opposite - flat.middle
        along = (arm * flat.tangent).sum(2, keepdims=True) * flat.tangent
        self.far = np.linalg.norm(arm - along, axis=2)
        there = flat.plane(flat.middle + along + self.far[:, :, None] * flat.outward)
        here = flat.plane(flat.corners)
        # gradients of the corners' linear functions, (cells, 3, 2)
        slope = -flat.out2 / flat.height[:, :, None]
        shape = 1 / 3 + np.einsum("cnk,cek->cen", slope, there)
        self.jumps = jumps = np.zeros((count, 3, 6))
        jumps[:, :, :3], jumps[:, np.arange(3), np.arange(3) + 3] = -shape, ~sides.free
        matrix = _monomials(there) - np.einsum("cen,cnk->cek", shape, _monomials(here))
        scale = flat.area[:, None, None]
        lost = np.abs(np.linalg.det(matrix / scale)) < 1e-12  # six nodes on a conic
        matrix[lost] = scale[lost] * np.eye(3)
        inverse = np.linalg.inv(matrix)
        # of x,11, x,22, x,12, which axes in any direction then measure alike
        weights = np.sqrt([1.0, 1.0, 2.0])
        size = np.linalg.norm(inverse * weights[:, None], axis=(1, 2))
        self.trust = (size * flat.area) ** -4.0
        # a last resort: beside a free edge a cell's own quadratic is not known
        self.trust[sides.free.any(1)] *= 1e-8
        self.trust[lost] = 1e-300
        inverse[lost] = 0
        # slopes of the cell's linear functions
        self.linear = np.einsum("cek,cnk->cen", flat.out2, slope)
        # slopes of the monomials there
        x, y, s, t = np.concatenate([flat.plane(flat.middle), flat.out2], 2).transpose(2, 0, 1)
        at_middles = np.stack([x * s, y * t, y * s + x * t], -1)
        quadratic = at_middles - np.einsum("cen,cnk->cek", self.linear, _monomials(here))
        # slopes must not depend on a D_t near 0
        plate = np.broadcast_to(np.diag(weights), (count, 3, 3))
        hessian = np.einsum("cke,cen->ckn", _relaxed(inverse, plate, sides.free), jumps)
        self.slopes = np.einsum("cek,ckn->cen", quadratic, hessian)
        self.slopes[:, :, :3] += self.linear
        self.pinned = _held_by_yarns(flat)[np.concatenate([nodes, local], 1)]
        six = np.concatenate([nodes, local], 1).astype(np.int32).ravel()
        six = flat.blank.V.dofmap.index_map.local_to_global(six)
        self.six = six.reshape(-1, 6).astype(np.int64)


def _held_by_yarns(flat):
    """Mask of local nodes in the middle of `crossed` squares along the yarns: in all four cells the
    edge opposite to them runs along a yarn, and the others do not."""
    along = np.einsum("cki,cei->cek", flat.axes, flat.tangent)
    cosines = abs(np.stack([along[..., 0], np.einsum("cek,ck->ce", along, flat.yarn_b)]))
    off = (cosines < math.cos(math.radians(1.0))).all(0)
    middle = ~off & np.roll(off, -1, 1) & np.roll(off, -2, 1) & (flat.blank.degree == 1)
    known = np.stack([middle, np.ones_like(middle)], -1)
    return (flat.blank.summed_at(flat.dofs[: flat.count], known) == 4).all(1)


def _with_beyond(flat, *parts):
    """Arrays (cells, ...) of this rank's cells, with those of the cells beyond them."""
    widths = [math.prod(part.shape[1:]) for part in parts]
    index_map = flat.blank.mesh.topology.index_map(2)
    sent = dolfinx.la.vector(index_map, sum(widths) * flat.per_cell)
    known = np.split(sent.array.reshape(-1, sum(widths)), np.cumsum(widths)[:-1], 1)  # views
    for values, part in zip(known, parts):
        values[: flat.count] = part.reshape(flat.count, values.shape[1])
    sent.scatter_forward()
    return (v.reshape(-1, *part.shape[1:]).astype(part.dtype) for v, part in zip(known, parts))


def _bends(flat, sides, own):
    """Slopes of the edges less those of the plane cell (cells, 3, 12), of the 12 nodes'
    displacements, these nodes' positions (cells, 12, gdim), numbers and codes (cells, 12), and
    which are pinned (cells, 12)."""
    given = own.slopes, own.six, sides.plane, own.opposite, own.trust, own.pinned
    slopes, six, planes, opposite, trust, pins = _with_beyond(flat, *given)
    count, here = flat.count, np.arange(flat.count)
    x = np.zeros((count, 12, flat.corners.shape[2]))
    x[:, :3], x[:, 3:6] = flat.corners, own.opposite
    nodes = np.concatenate([own.six, np.zeros((count, 6), int)], 1)
    pinned = np.concatenate([own.pinned, np.zeros((count, 6), bool)], 1)
    codes = np.zeros((count, 12), int)
    codes[:, 3:6] = sides.plane
    bends = np.zeros((count, 3, 12))
    bends[:, :, :3] = -own.linear
    for e in range(3):
        image, free = sides.image[:, e], sides.free[:, e]
        other = np.where(sides.beyond[:, e] < 0, here, sides.beyond[:, e])
        edge = np.where(sides.beyond[:, e] < 0, e, sides.edge_beyond[:, e])
        share = np.where(free, 0, trust[here] / (trust[here] + trust[other]))[:, None]
        rest = np.where(free[:, None], 0, 1 - share)
        bends[:, e, :6] += share * own.slopes[:, e]
        follows = six[other, (edge + 1) % 3] == own.six[:, (e + 1) % 3]
        place = np.empty((count, 6), int)  # of their six nodes among these 12
        place[here, edge], place[here, 3 + edge] = 3 + e, e
        for k in (1, 2):
            place[here, (edge + k) % 3] = np.where(follows, (e + k) % 3, (e + 3 - k) % 3)
            new, source = 5 + 2 * e + k, (edge + k) % 3
            place[here, 3 + source] = new
            nodes[:, new], pinned[:, new] = six[other, 3 + source], pins[other, 3 + source]
            mirrored = np.where(image, sides.plane[:, e] * sides.planes, 0)
            codes[:, new] = planes[other, source] + mirrored
            x[:, new] = opposite[other, source]
            x[image, new] = sides.reflected(flat, x[:, new], e)[image]
        at = here[:, None], e, place
        np.add.at(bends, at, -rest * slopes[other, edge])  # type: ignore[arg-type]
    first, second = np.divmod(codes, sides.planes)
    codes[first == second] = 0
    return bends, x, nodes, codes, pinned


def _blind_to_pinned(operator, bends, points, pinned):
    """The operator (cells, 3, 12) changed least, on nodes that `bends` has, so that a motion of all
    `pinned` nodes (cells, 12) alone is none of curvature, and that of quadratics as before; points:
    the nodes' (cells, 12, 2) in each cell's plane."""
    at = np.flatnonzero(pinned.any(1))
    used, alone = (bends[at] != 0).any(1), pinned[at].astype(float)
    p = points[at] / np.abs(points[at]).max((1, 2), keepdims=True, initial=1e-300)
    smooth = np.concatenate([np.ones_like(p[..., :1]), p, _monomials(p)], 2) * used[:, :, None]
    alone = (alone * used)[:, :, None]
    rest = (alone - smooth @ (np.linalg.pinv(smooth) @ alone))[:, :, 0]
    size = (rest**2).sum(1)
    # where it is that of a quadratic, as next to a free edge, they cannot be distinguished
    rest *= np.where(size > 1e-6, 1 / np.maximum(size, 1e-6), 0)[:, None]
    blind = operator.copy()
    blind[at] -= operator[at] @ alone * rest[:, None]
    return blind


def _monomials(p):
    """1/2 x^2, 1/2 y^2, x y at points (..., 2), whose second derivatives are unit ones."""
    return np.stack([p[..., 0] ** 2 / 2, p[..., 1] ** 2 / 2, p[..., 0] * p[..., 1]], -1)


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
