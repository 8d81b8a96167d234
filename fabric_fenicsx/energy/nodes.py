"""Nodes of a sheet: those that tools press, any of all ranks, alone and in pairs, and of cells."""

import functools
from collections.abc import Callable
from types import ModuleType

import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

from .. import dolfinx_compat as compat
from ..core.errors import InputError
from ..sheet.blank import Blank, Part
from .assembly import assembled
from .morley import MorleyCells, Section, Shape, Where
from .term import Triplets


class GatheredNodes:
    """Nodes of a blank by their global numbers (n,), of any rank. All ranks use it together."""

    def __init__(self, blank: Blank, nodes: np.ndarray) -> None:
        self._u = compat.petsc_vector(blank.u)
        self._dim = blank.mesh.geometry.dim
        wanted = PETSc.IS().createBlock(self._dim, nodes.astype(PETSc.IntType), comm=MPI.COMM_SELF)
        self._here = PETSc.Vec().createSeq(len(nodes) * self._dim, comm=MPI.COMM_SELF)
        self._scatter = PETSc.Scatter().create(self._u, wanted, self._here, None)
        self._sum = self._u.duplicate()

    def displacement(self) -> np.ndarray:
        """(n, gdim) [mm]."""
        return self._of(self._u)

    def values(self, owned: np.ndarray) -> np.ndarray:
        """Values here, (n, gdim), from those at each rank's owned nodes (nodes, gdim)."""
        self._sum.array[:] = owned.ravel()
        return self._of(self._sum)

    def _of(self, vector):
        self._scatter.scatter(vector, self._here)
        return self._here.array.reshape(-1, self._dim).copy()

    def add(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add forces (n, gdim) of all ranks to f, of this rank's degrees of freedom [N]."""
        self._here.array[:] = forces.ravel()
        self._sum.set(0)
        self._scatter.scatter(
            self._here, self._sum, addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE
        )
        f[: self._sum.local_size] += self._sum.array


class CoupledNodes:
    """Pairs of nodes that are coupled, as both are of one cell or move with one point.

    nodes: global numbers (known,); columns (n, k): which of them each of n cells or points has;
    coupled (n, k, k): True for pairs of these that count, by default all

    - ends: first and last node (count,) of each pair, of `nodes`; places (n, k, k): which pair each
      of a cell's is, -1 for those that do not count
    - rows, cols (count dim^2,): global degrees of freedom of the pairs' blocks
    """

    def __init__(
        self,
        nodes: np.ndarray,
        columns: np.ndarray,
        coupled: np.ndarray | None = None,
        dim: int = 3,
    ) -> None:
        wide = columns.shape[1]
        self.places = np.full((len(columns), wide, wide), -1, dtype=np.int32)
        cell, i, j = np.nonzero(self.places if coupled is None else coupled)
        keys = columns[cell, i].astype(np.int64) * len(nodes) + columns[cell, j]
        keys, self.places[cell, i, j] = np.unique(keys, return_inverse=True)
        self.ends, self.count = np.divmod(keys, max(len(nodes), 1)), len(keys)
        axis, (i, j) = np.arange(dim), (dim * nodes[end][:, None, None] for end in self.ends)
        both = np.broadcast_arrays(i + axis[:, None], j + axis)
        self.rows, self.cols = (each.astype(PETSc.IntType).ravel() for each in both)


def values_at(
    function: Callable[[np.ndarray], np.ndarray], points: np.ndarray, kind: type = bool
) -> np.ndarray:
    """Values of a `function` of `points` (3, n): a mask (n,) or, of `kind` float, numbers (n,)."""
    return np.broadcast_to(np.asarray(function(points)).astype(kind), points.shape[1])


def shares_at(function: Callable[[np.ndarray], np.ndarray], points: np.ndarray) -> np.ndarray:
    """Values (n,) of a `function` of `points` (3, n), from 0 to 1."""
    return np.clip(values_at(function, points, float), 0, 1)


def _centres(k):
    """Barycentric coordinates (k^2, 3) of the centres of k^2 equal triangles."""
    i, j = (3 * each.ravel() for each in np.mgrid[:k, :k])
    up, down = (np.column_stack([i + n, j + n])[i + j < 3 * (k + 1 - n)] for n in (1, 2))
    first = np.concatenate([up, down]) / (3 * k)
    return np.column_stack([1 - first.sum(1), first])


class Nodes:
    """This rank's owned nodes of a blank in space, where forces of tools go.

    - part: of the blank, by default all of it; where: function of undeformed points (3, n) to a
      mask (n,), by default true: which nodes of the part count
    - mask (count,): which ones count, of the `count` nodes of the blank
    - places (count, 3) [mm], areas of the part (count,) [mm^2]: undeformed, 0 at other nodes; of
      a quadratic triangle those of its four flat ones; `areas_now` gives those of the present
    - rows, cols (9 count,): global degrees of freedom of each node's 3 x 3 block

    Raises InputError for a blank in a plane, along turned axes or of other cells, and for a `where`
    that marks no node.
    """

    WITHIN = _centres(5)  # of each triangle
    BEYOND = 1e-3  # weight of corners that are not borne

    def __init__(self, blank: Blank, part: Part | None = None, where: Where | None = None) -> None:
        mesh, part = blank.mesh, part or blank.whole
        cells = blank.degree == 1 or blank.triangulated
        refused = {
            "in a plane; expected a blank made with `spatial=True`": mesh.geometry.dim != 3,
            "along turned axes; expected x, y and z": (blank.frame != np.eye(3)).any(),
            "on other cells; expected P1, Q1, and P2 with straight sides": not cells,
        }
        for words in (words for words, is_refused in refused.items() if is_refused):
            raise InputError(f"contact of {blank.name} is requested {words}")
        self.blank, self.comm = blank, mesh.comm
        self.count = blank.V.dofmap.index_map.size_local
        self.places = blank.coordinates()[: self.count]
        self.areas, self.part = _areas(blank, part)[: self.count], part
        self.mask = part.nodes
        if where:
            self.mask = part.nodes & values_at(where, self.places.T)
            self.areas[~self.mask] = 0.0
            if not self.comm.allreduce(int(self.mask.sum())):
                raise InputError(
                    f"contact of {blank.name} is requested where no node is; expected 1 or more"
                )
        each = np.arange(self.count)
        alone = CoupledNodes(blank.V.dofmap.index_map.local_range[0] + each, each[:, None])
        self.rows, self.cols = alone.rows, alone.cols

    def displacement(self) -> np.ndarray:
        """(count, 3) [mm]."""
        return self.view().copy()

    def view(self) -> np.ndarray:
        """As `displacement`, in the memory of the blank's own."""
        return self.blank.u.x.array.reshape(-1, 3)[: self.count]

    def areas_now(self) -> np.ndarray:
        """Areas of the part at the nodes at the present displacement (count,) [mm^2]."""
        return self.areas * self.part.growth()[: self.count]

    def shares_under(self, under: Where, borne: Where) -> np.ndarray:
        """Shares (count,) of the present areas at the nodes, by two functions of `shares_at`: of
        what is `under` one, at `WITHIN` each triangle, and goes to the corners that are `borne`.
        An `under` that tells what it is `over` whole triangles is not asked within them."""
        blank, triangles = self.blank, self.blank.triangles(self.part.cells).reshape(-1, 3)
        x = blank.coordinates() + blank.nodal_displacement()
        corners, held = x[triangles], shares_at(borne, x.T)[triangles][:, None] + self.BEYOND
        over = under.over(corners) if hasattr(under, "over") else np.full(len(corners), np.nan)
        pressed = np.repeat(over[:, None] / 3, 3, 1)
        split = np.isnan(over) | (over > 0) & (np.ptp(held, axis=(1, 2)) > 0)
        places = np.einsum("kc,nci->ink", self.WITHIN, corners[split]).reshape(3, -1)
        weights = self.WITHIN * held[split]
        shares = shares_at(under, places).reshape(-1, len(self.WITHIN), 1)
        weights *= shares / weights.sum(2)[..., None]
        pressed[split] = weights.mean(1)
        sides = corners[:, 1:] - corners[:, :1]
        areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)[:, None]
        both = np.stack([areas * pressed, areas * np.full((1, 3), 1 / 3)], -1)
        share, whole = blank.summed_at(triangles, both)[: self.count].T
        return np.divide(share, whole, out=np.zeros_like(share), where=whole > 0)

    def common(self, rows: np.ndarray) -> np.ndarray:
        """The row (k,) that all nodes of all ranks have in `rows` (count, k)."""
        return next(firsts[0] for firsts in self.comm.allgather(rows[:1]) if len(firsts))

    def total(self, values: np.ndarray) -> np.ndarray:
        """Sum over all ranks' nodes of values (count, ...)."""
        return self.comm.allreduce(values.sum(0), MPI.SUM)


def _areas(blank, part):
    """Areas of the part at the nodes of the blank, this rank's own first."""
    if blank.degree == 2:  # the integrals of shape functions are 0 at corners
        return part.flat_areas().copy()
    return assembled(ufl.TestFunction(blank.V)[0] * part.dx())[::3].copy()


class Stencil:
    """The nodes that the 12 of each of this rank's cells are, mirror images counted apart.

    operator, own: as `MorleyCells` gives them for the cells; apart: edges do not bend together;
    columns: which of the nodes each of a cell's 12 is, (cells, 12); count: how many there are;
    coupled: pairs of them that a cell's energy couples; slopes (cells, 3, 2): of the corners'
    functions
    """

    def __init__(
        self, cells: MorleyCells, operator: np.ndarray, own: np.ndarray, apart: bool = False
    ) -> None:
        self._dim, self._mirrors = cells.corners.shape[2], cells.mirrors
        keys = cells.nodes * len(cells.mirrors) + cells.codes
        keys, columns = np.unique(keys, return_inverse=True)
        self.columns = columns.reshape(cells.nodes.shape)
        self._nodes, self._codes = np.divmod(keys, len(cells.mirrors))
        self._mirrored = np.flatnonzero(self._codes)
        self._gathered = GatheredNodes(cells.blank, self._nodes)
        self.count = len(keys)
        entries = np.ones(columns.size), (columns.ravel(), np.arange(columns.size))
        self._on_nodes = sparse.csr_matrix(entries, shape=(self.count, columns.size))
        bends = operator != 0 if apart else (operator != 0).any(1, keepdims=True)
        bends[:, :, :3] = True
        couples = (bends[:, :, :, None] & bends[:, :, None]).any(1)
        of_cells = self.columns[:, : operator.shape[2]]
        self.coupled = CoupledNodes(self._nodes, of_cells, couples, self._dim)
        self.slopes = np.ascontiguousarray(cells.slopes)
        self._undeformed = cells.corners, self.slopes, operator, own
        self.cells = cells

    @functools.cached_property
    def hinges(self) -> "Stencil":
        """The stencil of each edge as a hinge of the two cells at it, by itself."""
        own = self.cells.hinged * self._undeformed[3].any()
        return Stencil(self.cells, self.cells.hinges, own, apart=True)

    @functools.cached_property
    def loops(self) -> ModuleType:
        """`metal_cells`, which imports numba: a sheet in a plane does without."""
        from . import metal_cells

        return metal_cells

    def displacement(self) -> np.ndarray:
        """Motion of nodes and mirror images along the frame's axes, (count, gdim) [mm]."""
        return self._with_images(self._gathered.displacement())

    def _with_images(self, U):
        at = self._mirrored
        U[at] = np.einsum("nij,nj->ni", self._mirrors[self._codes[at]], U[at])
        return U

    def summed(self, forces: np.ndarray) -> np.ndarray:
        """Forces on nodes and images (count, gdim) of those on the cells' (cells, 12, gdim) [N]."""
        return self._on_nodes @ forces.reshape(-1, self._dim)

    def add_forces(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add forces (count, gdim) [N], which this overwrites, to f (local dofs,) on any rank."""
        at = self._mirrored
        forces[at] = np.einsum("nij,ni->nj", self._mirrors[self._codes[at]], forces[at])
        self._gathered.add(forces, f)

    def shape(self, U: np.ndarray) -> Shape:
        """The shape of the cells at the `displacement` U (count, 3)."""
        return self.loops.shape(*self._undeformed, U, self.columns)

    def add_difference(self, one: Section, other: Section, v: np.ndarray, f: np.ndarray) -> None:
        """Add to f (owned dofs,) what a section's stiffness gives along v, less that of another."""
        motion, forces = self._with_images(self._gathered.values(v)), np.zeros((self.count, 3))
        for section, factor in ((one, 1.0), (other, -1.0)):
            along = motion, factor, forces
            self.loops.add_bending_along(section, self.slopes, self.columns, *along)
        self.add_forces(forces, f)

    def triplets(self, blocks: np.ndarray) -> Triplets:
        """As `Term.tangent` gives them, from blocks (pairs, gdim, gdim) of the `coupled` [N/mm],
        which this turns into those of the nodes that images stand for."""
        i, j = (self._codes[end] for end in self.coupled.ends)
        for mirror, transposed in ((i, True), (j, False)):
            at = mirror > 0
            R = self._mirrors[mirror[at]]
            blocks[at] = R.swapaxes(1, 2) @ blocks[at] if transposed else blocks[at] @ R
        return self.coupled.rows, self.coupled.cols, blocks.ravel()
