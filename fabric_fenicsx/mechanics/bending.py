"""Bending: the yarns' resistance to being curved, out of the sheet and, if wanted, within it.

Cells are Morley's plate triangles (Morley 1968): their curvature is constant, and follows from the positions of the
nodes and the slopes across the middles of the edges. The slopes are no unknowns here but are read off the quadratics
through a cell's six nearest nodes, those of the cell and of its neighbours (Phaal & Calladine 1992), averaged over the
two cells at the edge. With these quadratics' own curvature instead, or with slopes averaged over plane cells (Oñate &
Zárate's BST 2000), `crossed` meshes converge to a plate up to a third too soft or a quarter too stiff: the first
is exact on quadratic deflections but out of balance under constant moments, the second the reverse. This passes both
tests, and only linear states are free of energy, as slopes are common to neighbours and Morley's triangle has no others.
"""

from collections.abc import Callable, Sequence

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

from .. import dolfinx_compat as compat
from ..blank import Blank
from ..errors import InputError

Where = Callable[[np.ndarray], np.ndarray]  # points (3, n) [mm] to a mask (n,)
LAST_RESORT = 1e-8  # weight of a cell whose own quadratic is not known for a free edge, beside one that knows its own
NO_STIFFNESS = 1e-9  # relative, against a free edge's slope
NO_WORK = 1e-12  # coefficients, of a cell's largest, that are rounding: on regular meshes many vanish


def plate_stiffness(modulus: float, thickness: float) -> float:
    """Bending stiffness E t^3 / 12 [N mm] of a strip, per width, from its `modulus` [MPa] and `thickness` [mm]."""
    return modulus * thickness**3 / 12


class Bending:
    """Energy 1/2 D_a |x,aa|^2 + 1/2 D_b |x,bb|^2 + 1/2 D_t |x,ab|^2 over the undeformed `blank`.

    x,aa is the second derivative of the deformed position along yarn a, x,ab the twist; of them counts what is normal
    to the deformed cell and, times `in_plane`, what is tangent to it. Curvature of the undeformed sheet is free.
    D_a, D_b, D_t: stiffness [N mm], D_b by default D_a. An isotropic plate without lateral contraction has
    D_t = 2 D_a; D_t = 0 leaves pure twist, a saddle along the yarns' diagonals, to the membrane.
    in_plane: from 0, of D_a, D_b and D_t; all there is in a plane blank. It gives shear bands a width of about
    sqrt(in_plane D / membrane stiffness in shear).
    symmetric: functions of points (3, n) [mm] to a mask (n,), one for each plane of symmetry, that mark the blank's edge
    there, which supports must hold in its plane; clamped: the same for edges whose tangent plane is held. All other
    edges are free of moment.
    Normals are those of the last accepted state, so within a step the energy is quadratic; what turning normals add to
    its derivative is held at that state too, where the forces are therefore exact.
    Raises InputError, on all ranks, for a blank other than of linear triangles, negative stiffnesses, or edges not found.
    """

    name = "bending"
    energy_kind = "bending"

    def __init__(
        self,
        blank: Blank,
        D_a: float,
        D_b: float | None = None,
        D_t: float = 0.0,
        in_plane: float = 0.0,
        symmetric: Where | Sequence[Where] = (),
        clamped: Where | Sequence[Where] = (),
    ) -> None:
        self.blank, self.holds = blank, ("turn",) if clamped else ()
        self.stiffnesses = np.array([D_a, D_a if D_b is None else D_b, D_t], float)
        self.in_plane = float(in_plane)
        given = np.append(self.stiffnesses, self.in_plane)
        if not (np.isfinite(given).all() and given.min() >= 0):
            raise InputError(f"bending has D_a, D_b, D_t, in_plane = {given.tolist()}; allowed are numbers from 0")
        if not (compat.is_affine(blank.mesh) and blank.degree == 1):
            raise InputError(f"bending of {blank.name} is asked on other than linear triangles; allowed is P1")
        self._cells, self._dim = _Cells(blank, symmetric, clamped), blank.mesh.geometry.dim
        operator, curved = self._cells.curvature(self.stiffnesses)
        self._weights = self._cells.area[:, None] * self.stiffnesses
        self._own_curvature = np.where(np.abs(curved) < 1e-10 * np.abs(curved).max(initial=1e-300), 0, curved)
        if np.abs(curved).max(initial=0) * np.sqrt(self._cells.area.max(initial=0)) < 1e-10:
            self._own_curvature[:] = 0  # flat but for rounding
        self._gathered(operator)
        self.accept()

    # -- what a scene calls

    def accept(self) -> None:
        """Take normals from the blank's displacement."""
        U, dim = self._displacement(), self._dim
        self._rest, self._normal, self._turning, self._origin = self._own_curvature, None, None, U
        P = np.broadcast_to(self.in_plane * np.eye(dim), (len(self._rest), dim, dim))
        if dim == 3:
            corners = self._cells.corners + U[self._columns[:, :3]]
            edges, axes = np.roll(corners, -2, 1) - np.roll(corners, -1, 1), self._axes(corners)
            self._normal = normal = axes[:, 2]
            P = P + (1 - self.in_plane) * normal[:, :, None] * normal[:, None]
            turned = np.einsum("cki,ckj->cij", axes, self._axes(self._cells.corners))
            self._rest = np.einsum("cij,ckj->cki", turned, self._own_curvature)
            curvature = self._curvature(U)
            torque = np.cross(self._moments(curvature - self._rest), curvature).sum(1)
            area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)  # twice
            slopes = np.cross(normal[:, None], edges) / area[:, None, None]  # gradients of the shape functions
            along = -np.einsum("ci,cni->cn", np.cross(torque, normal), slopes)
            self._turning = np.zeros_like(U)
            np.add.at(self._turning, self._columns[:, :3], along[:, :, None] * normal[:, None])
        blocks = (self._pair_weights @ P.reshape(len(P), dim * dim)).reshape(-1, dim, dim)
        i, j = self._pairs
        blocks = np.concatenate([blocks, blocks[i != j]])
        for mirror, transposed in zip(self._pair_mirrors, (True, False)):
            at = mirror > 0
            R = self._cells.mirrors[mirror[at]]
            blocks[at] = R.swapaxes(1, 2) @ blocks[at] if transposed else blocks[at] @ R
        self._values = blocks.ravel()

    def stored(self) -> float:
        """Energy of this rank's owned cells at the blank's displacement [N mm]."""
        U = self._displacement()
        bent = self._curvature(U) - self._rest
        energy = 0.5 * np.vdot(bent, self._moments(bent))
        return float(energy + (0 if self._turning is None else np.vdot(self._turning, U - self._origin)))

    def add_forces(self, f: np.ndarray) -> None:
        """Add the energy's derivative at the blank's displacement to f, of this rank's degrees of freedom [N]."""
        moments = self._moments(self._curvature(self._displacement()) - self._rest)
        forces = self._transposed @ moments.reshape(-1, self._dim)
        if self._turning is not None:
            forces += self._turning
        at = self._mirrored
        forces[at] = np.einsum("nij,ni->nj", self._cells.mirrors[self._codes[at]], forces[at])
        self._sent.array[:] = forces.ravel()
        self._sum.set(0)
        self._scatter.scatter(self._sent, self._sum, addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        f[: self._sum.local_size] += self._sum.array

    def stiffness(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Second derivative of this rank's owned cells' energy as triplets (rows, columns, values), (k,) each [N/mm],
        to be summed.

        Rows and columns are GLOBAL degrees of freedom, the same ones at every call: a cell reaches over two neighbours,
        further than a rank's ghosts.
        """
        return self._rows, self._cols, self._values

    def curvatures(self) -> np.ndarray:
        """Second derivatives x,aa, x,bb, x,ab in each owned cell along the frame's axes, (cells, 3, gdim) [1/mm]."""
        return self._curvature(self._displacement())

    # --

    def _axes(self, corners):
        """Unit vectors along the first yarn, across it and normal to the cells with these corners, (cells, 3, 3)."""
        a = np.einsum("cn,cni->ci", self._cells.along_a, corners)
        a /= np.linalg.norm(a, axis=1, keepdims=True)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return np.stack([a, np.cross(normal, a), normal], 1)

    def _moments(self, bent):
        """What is conjugate to the curvatures by which cells are `bent`, (cells, 3, gdim) [N mm mm]."""
        moments = self.in_plane * bent
        if self._normal is not None:
            out = (1 - self.in_plane) * (bent @ self._normal[:, :, None])
            moments += out * self._normal[:, None]
        moments *= self._weights[:, :, None]
        return moments

    def _curvature(self, U):
        return (self._operator @ U).reshape(-1, 3, self._dim) + self._own_curvature

    def _displacement(self):
        """Displacement of the nodes that this rank's cells reach and of their mirror images, (nodes, gdim)."""
        self._scatter.scatter(compat.petsc_vector(self.blank.u), self._sent)
        U, at = self._sent.array.reshape(-1, self._dim).copy(), self._mirrored
        U[at] = np.einsum("nij,nj->ni", self._cells.mirrors[self._codes[at]], U[at])
        return U

    def _gathered(self, operator):
        """Sparse matrices from the cells' `operator` (cells, 3, 12), and who is needed from which rank."""
        cells, dim, mirrors = self._cells, self._dim, len(self._cells.mirrors)
        count = len(operator)
        keys, columns = np.unique(cells.nodes * mirrors + cells.codes, return_inverse=True)
        self._columns = columns = columns.reshape(cells.nodes.shape)
        nodes, self._codes = np.divmod(keys, mirrors)
        self._mirrored = np.flatnonzero(self._codes)
        vector = compat.petsc_vector(self.blank.u)
        wanted = PETSc.IS().createBlock(dim, nodes.astype(PETSc.IntType), comm=MPI.COMM_SELF)
        self._sent = PETSc.Vec().createSeq(len(nodes) * dim, comm=MPI.COMM_SELF)
        self._scatter = PETSc.Scatter().create(vector, wanted, self._sent, None)
        self._sum = vector.duplicate()
        rows = np.arange(3 * count).reshape(count, 3, 1) + np.zeros_like(columns)[:, None]
        over = np.broadcast_to(columns[:, None], rows.shape)
        self._operator = sparse.csr_matrix(
            (operator.ravel(), (rows.ravel(), over.ravel())), shape=(3 * count, len(nodes))
        )
        self._operator.eliminate_zeros()
        self._transposed = self._operator.T.tocsr()
        # the stiffness of a pair of nodes is the sum over cells of a number times the cell's P
        products = np.einsum("ck,cki,ckj->cij", self._weights, operator, operator, optimize=True)
        cell, i, j = np.nonzero((products != 0) & (columns[:, :, None] <= columns[:, None]))
        keys, pair = np.unique(columns[cell, i] * len(nodes) + columns[cell, j], return_inverse=True)
        self._pair_weights = sparse.csr_matrix((products[cell, i, j], (pair, cell)), shape=(len(keys), count))
        i, j = self._pairs = np.divmod(keys, len(nodes))
        i, j = np.concatenate([i, j[i != j]]), np.concatenate([j, i[i != j]])
        self._pair_mirrors = self._codes[i], self._codes[j]
        axis = np.arange(dim)
        rows, cols = (nodes[i] * dim)[:, None, None] + axis[:, None], (nodes[j] * dim)[:, None, None] + axis
        self._rows, self._cols = (k.astype(PETSc.IntType).ravel() for k in np.broadcast_arrays(rows, cols))


class _Cells:
    """This rank's owned cells, and the 12 nodes that each one's curvature is read off.

    nodes: their global numbers (cells, 12), first the cell's own, then those opposite across its edges, then for each
    edge the two that the cell beyond has besides. codes: which of the matrices `mirrors` (k, gdim, gdim) takes each
    node's displacement to that of the image which stands for it, 0 for itself. Edge e is opposite corner e.
    """

    def __init__(self, blank, symmetric, clamped):
        self.blank, self.comm = blank, blank.mesh.comm
        self.index_map = blank.mesh.topology.index_map(2)
        self.count = self.index_map.size_local
        self.dofs = compat.dofmap(blank.V)
        self.positions = blank.along(blank.coordinates().T).T
        self._beyond()
        self._geometry()
        self._edges(symmetric, clamped)
        self._quadratics()

    def _beyond(self):
        """The cell beyond each edge, -1 if there is none, and that edge's number there."""
        topology = self.blank.mesh.topology
        topology.create_connectivity(1, 2)
        topology.create_connectivity(2, 1)
        facets, cells = topology.connectivity(2, 1).array.reshape(-1, 3), topology.connectivity(1, 2)
        sides = np.diff(cells.offsets)
        both = np.add.reduceat(np.append(cells.array, 0), cells.offsets[:-1]) if len(sides) else np.empty(0, int)
        mine = facets[: self.count]
        self.beyond = np.where(sides[mine] == 2, both[mine] - np.arange(self.count)[:, None], -1)
        self.edge_beyond = (facets[self.beyond] == mine[:, :, None]).argmax(2)
        alone = self.comm.allreduce(int((self.beyond < 0).sum()))
        if alone != 2 * topology.index_map(1).size_global - 3 * self.index_map.size_global:
            raise InputError(
                f"bending of {self.blank.name} finds edges of more than two cells, or ranks that don't know the cells beyond theirs; allowed is a manifold with ghost cells across shared facets"
            )

    def _geometry(self):
        """Sizes, directions and, in each cell's plane from its middle along a0 and across, coordinates."""
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
        a, b = (blank.along(f.x.array.reshape(-1, x.shape[2])[:count].T).T for f in (blank.a0, blank.b0))
        across = b - (a * b).sum(1, keepdims=True) * a
        self.axes = np.stack([a, across / np.linalg.norm(across, axis=1, keepdims=True)], 1)
        self.yarn_b = np.einsum("cki,ci->ck", self.axes, b)
        self.centre = x.mean(1, keepdims=True)
        self.out2 = np.einsum("cki,cei->cek", self.axes, self.outward)
        self.along_a = -self.out2[:, :, 0] / self.height

    def _plane(self, points):
        return np.einsum("cki,cni->cnk", self.axes, points - self.centre)

    def _edges(self, symmetric, clamped):
        """What is beyond each edge: a cell, the mirror image of this one (`image`), or nothing (`free`)."""
        points, dim = self.blank.coordinates().T, self.corners.shape[2]
        symmetric, clamped = ([k] if callable(k) else list(k) for k in (symmetric, clamped))
        nodes = self.dofs[: self.count]
        self.plane, self.image = np.zeros((self.count, 3), int), np.zeros((self.count, 3), bool)
        self.normal = self.outward.copy()  # of the plane that images are mirrored in
        mirrors = [np.eye(dim)]
        for number, where in enumerate(symmetric + clamped):
            on = np.asarray(where(points), bool)[nodes]
            on = (self.beyond < 0) & np.roll(on, -1, 1) & np.roll(on, -2, 1) & ~self.image
            total = self.comm.allreduce((self.length[:, :, None] * self.outward)[on].sum(0), MPI.SUM)
            is_plane = number < len(symmetric)
            kind, size = "symmetric" if is_plane else "clamped", np.linalg.norm(total)
            if self.comm.allreduce(int(on.sum())) == 0:
                raise InputError(
                    f"bending of {self.blank.name} finds none of its edges where function {number + 1} marks {kind} ones; allowed are functions that mark both ends of edges"
                )
            self.image |= on
            if not is_plane:
                continue
            total /= max(size, 1e-300)
            if self.comm.allreduce(int((self.outward[on] @ total < 0.5).sum())):
                raise InputError(
                    f"bending of {self.blank.name} has symmetric edges in more than one plane by function {number + 1}; allowed is one function for each plane"
                )
            self.plane[on], self.normal[on] = number + 1, total
            mirrors.append(np.eye(dim) - 2 * np.outer(total, total))
        self.free = (self.beyond < 0) & ~self.image
        self.planes = len(mirrors)
        # code first * planes + second: mirrored in the second, then in the first
        self.mirrors = np.array([first @ second for first in mirrors for second in mirrors])

    def _reflected(self, points, e):
        """Images of points (cells, 3) beyond edge e."""
        normal = self.normal[:, e]
        return points - 2 * ((points - self.middle[:, e]) * normal).sum(1, keepdims=True) * normal

    def _quadratics(self):
        """For each cell its six nodes, and the slopes out of its edges' middles of the quadratic through them."""
        count, nodes, beyond = self.count, self.dofs[: self.count], self.beyond
        local = np.where(beyond < 0, nodes, self.dofs[beyond, self.edge_beyond])
        opposite = self.positions[local]
        for e in range(3):
            alone = beyond[:, e] < 0
            opposite[alone, e] = self._reflected(self.corners[:, e], e)[alone]
        # unfold the neighbours into the cell's plane
        arm = opposite - self.middle
        along = (arm * self.tangent).sum(2, keepdims=True)
        far = np.linalg.norm(arm - along * self.tangent, axis=2, keepdims=True)
        there = self._plane(self.middle + along * self.tangent + far * self.outward)
        here = self._plane(self.corners)
        slope = -self.out2 / self.height[:, :, None]  # gradients of the corners' linear functions, (cells, 3, 2)
        shape = 1 / 3 + np.einsum("cnk,cek->cen", slope, there)
        jumps = np.zeros((count, 3, 6))  # by how much the nodes opposite lie off the cell's plane
        jumps[:, :, :3], jumps[:, np.arange(3), np.arange(3) + 3] = -shape, ~self.free
        matrix = _monomials(there) - np.einsum("cen,cnk->cek", shape, _monomials(here))
        scale = self.area[:, None, None]
        lost = np.abs(np.linalg.det(matrix / scale)) < 1e-12  # six nodes on a conic
        matrix[lost] = scale[lost] * np.eye(3)
        inverse = np.linalg.inv(matrix)
        self.trust = (np.linalg.norm(inverse, axis=(1, 2)) * self.area) ** -4.0
        self.trust[self.free.any(1)] *= LAST_RESORT
        self.trust[lost] = 1e-300
        inverse[lost] = 0
        self.inverse, self.jumps, self.opposite = inverse, jumps, opposite
        self.linear = np.einsum("cek,cnk->cen", self.out2, slope)  # slopes of the cell's linear functions
        self.quadratic = np.einsum("ceki,cei->cek", _gradients(self._plane(self.middle)), self.out2) - np.einsum(
            "cen,cnk->cek", self.linear, _monomials(here)
        )
        self.six = (
            self.blank.V.dofmap.index_map.local_to_global(np.concatenate([nodes, local], 1).astype(np.int32).ravel())
            .reshape(-1, 6)
            .astype(np.int64)
        )

    def curvature(self, stiffnesses):
        """Operator (cells, 3, 12) from the 12 nodes' displacements to x,aa, x,bb, x,ab, and these of the undeformed
        sheet (cells, 3, gdim). Free edges take the slopes of least energy: no moment is on them."""
        count, six, dim = self.count, self.six, self.corners.shape[2]
        plate = np.broadcast_to(np.diag([1, 1, np.sqrt(2)]), (count, 3, 3))  # slopes must not depend on a D_t near 0
        hessian = np.einsum("cke,cen->ckn", _relaxed(self.inverse, plate, self.free), self.jumps)
        slopes = np.einsum("cek,ckn->cen", self.quadratic, hessian)
        slopes[:, :, :3] += self.linear
        # what a rank must know of the cells beyond its own
        parts = [slopes.reshape(count, 18), six, self.plane, self.opposite.reshape(count, 3 * dim), self.trust[:, None]]
        sent = dolfinx.la.vector(self.index_map, sum(part.shape[1] for part in parts))
        known = sent.array.reshape(-1, sum(part.shape[1] for part in parts))
        known[:count] = np.concatenate(parts, 1)
        sent.scatter_forward()
        ends = np.cumsum([part.shape[1] for part in parts])[:-1]
        their_slopes, their_six, their_plane, their_opposite, trust = np.split(known, ends, 1)
        their_slopes, their_opposite = their_slopes.reshape(-1, 3, 6), their_opposite.reshape(-1, 3, dim)
        own = np.arange(count)
        x = np.concatenate([self.corners, self.opposite, np.zeros((count, 6, dim))], 1)
        self.nodes = np.concatenate([six, np.zeros((count, 6), int)], 1)
        self.codes = np.zeros((count, 12), int)
        self.codes[:, 3:6] = self.plane
        bends = np.zeros((count, 3, 12))  # slope of an edge less that of the plane cell
        bends[:, :, :3] = -self.linear
        for e in range(3):
            image = self.image[:, e]
            other = np.where(self.beyond[:, e] < 0, own, self.beyond[:, e])
            edge = np.where(self.beyond[:, e] < 0, e, self.edge_beyond[:, e])
            share = trust[own, 0] / (trust[own, 0] + trust[other, 0])
            share = np.where(self.free[:, e], 0, share)[:, None]
            rest = np.where(self.free[:, e, None], 0, 1 - share)
            bends[:, e, :6] += share * slopes[:, e]
            theirs = their_slopes[other, edge]
            follows = their_six[other, (edge + 1) % 3] == six[:, (e + 1) % 3]
            place = np.empty((count, 6), int)  # of their six nodes among these 12
            place[own, edge], place[own, 3 + edge] = 3 + e, e
            for k in (1, 2):
                place[own, (edge + k) % 3] = np.where(follows, (e + k) % 3, (e + 3 - k) % 3)
                new, source = 5 + 2 * e + k, (edge + k) % 3
                place[own, 3 + source] = new
                self.nodes[:, new] = their_six[other, 3 + source]
                plane = their_plane[other, source].astype(int)
                self.codes[:, new] = plane + np.where(image, self.plane[:, e] * self.planes, 0)
                x[:, new] = their_opposite[other, source]
                x[image, new] = self._reflected(x[:, new], e)[image]
            np.add.at(bends, (own[:, None], e, place), -rest * theirs)  # type: ignore[arg-type]
        first, second = np.divmod(self.codes, self.planes)
        self.codes[first == second] = 0
        out = self.out2
        spread = np.stack([out[:, :, 0] ** 2, out[:, :, 1] ** 2, out[:, :, 0] * out[:, :, 1]], 1)
        spread *= (self.length / self.area[:, None])[:, None]
        c, s = self.yarn_b.T
        one, zero = np.ones_like(c), np.zeros_like(c)
        yarns = np.array([[one, zero, zero], [c * c, s * s, 2 * c * s], [c, zero, s]]).transpose(2, 0, 1)
        relaxed = _relaxed(spread, np.sqrt(stiffnesses)[:, None] * yarns, self.free)
        operator = np.einsum("cij,cje,cen->cin", yarns, relaxed, bends, optimize=True)
        operator[np.abs(operator) < NO_WORK * np.abs(operator).max((1, 2), initial=0)[:, None, None]] = 0
        return operator, np.einsum("ckn,cni->cki", operator, x)


def _monomials(p):
    """1/2 x^2, 1/2 y^2, x y at points (..., 2), whose second derivatives are unit ones."""
    return np.stack([p[..., 0] ** 2 / 2, p[..., 1] ** 2 / 2, p[..., 0] * p[..., 1]], -1)


def _gradients(p):
    """Their gradients, (..., 3, 2)."""
    x, y, zero = p[..., 0], p[..., 1], np.zeros_like(p[..., 0])
    return np.stack([np.stack([x, zero], -1), np.stack([zero, y], -1), np.stack([y, x], -1)], -2)


def _relaxed(operator, root, free):
    """`operator` (cells, 3, edges) where what comes from `free` edges (cells, edges) is what least |root @ operator @
    edges| asks for, from the other edges; root: (cells, 3, 3)."""
    relaxed = operator * ~free[:, None]
    at = np.flatnonzero(free.any(1))
    loose, root = operator[at] * free[at, None], root[at]
    left, size, right = np.linalg.svd(root @ loose)
    # what no stiffness asks for stays zero
    least = NO_STIFFNESS * np.linalg.norm(root, axis=(1, 2)) * np.linalg.norm(loose, axis=(1, 2))
    works = size > least[:, None]
    inverse = np.where(works, 1 / np.where(works, size, 1), 0)[:, :, None] * left.swapaxes(1, 2)
    relaxed[at] -= loose @ right.swapaxes(1, 2) @ inverse @ root @ relaxed[at]
    return relaxed
