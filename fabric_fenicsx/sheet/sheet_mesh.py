"""The mesh of a sheet with its yarns, its displacement, and numbers at its cells and nodes."""

from collections.abc import Callable
from typing import ClassVar

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.mesh import Mesh, exterior_facet_indices
from mpi4py import MPI
from numpy.typing import ArrayLike
from ufl.core.expr import Expr

from .. import dolfinx_compat as compat
from ..core.collective_errors import on_all
from ..core.errors import InputError
from .sources import FLAT_TOLERANCE

# an angle, a vector, or a function of points to either; see `Blank`
Direction = ArrayLike | Callable[[np.ndarray], ArrayLike]


class SheetMesh:
    """A mesh with fibre fields `a0`, `b0` and the displacement `u` in the space `V`, as in
    `Blank`."""

    # flat triangles of cells, by their nodes: halves, or the four between a quadratic cell's nodes
    TRIANGLES: ClassVar = {
        ("triangle", 1): [(0, 1, 2)],
        ("triangle", 2): [(0, 5, 4), (5, 1, 3), (4, 3, 2), (5, 3, 4)],
        ("quadrilateral", 1): [(0, 1, 2), (1, 3, 2)],
    }

    V: fem.FunctionSpace
    u: fem.Function

    def __init__(
        self,
        mesh: Mesh,
        a: Direction,
        b: Direction | None,
        frame: ArrayLike | None,
        up: ArrayLike,
        name: str,
    ) -> None:
        gdim = mesh.geometry.dim
        self.mesh, self.name = mesh, name
        self._made_at = mesh.geometry.x.copy()
        self.a0, self.b0 = fibre_fields(mesh, a, b, up)
        self.frame = np.eye(gdim) if frame is None else np.asarray(frame, dtype=float)
        square = self.frame.shape == (gdim, gdim)
        if not (square and np.allclose(self.frame @ self.frame.T, np.eye(gdim), atol=1e-12)):
            allowed = f"expected {gdim} orthonormal rows"
            raise InputError(f"frame of the blank is {self.frame.tolist()}; {allowed}")
        self._turned = not np.array_equal(self.frame, np.eye(gdim))
        # no numbers of the form, so that all angles share a compiled one
        self._axes = fem.Constant(mesh, self.frame.T.copy())

    def interpolate(self, degree: int) -> None:
        """Make the displacement, of this degree."""
        self.V = compat.vector_space(self.mesh, "Lagrange", degree, self.mesh.geometry.dim)
        self.u = fem.Function(self.V, name="u")
        self._coordinates = self.V.tabulate_dof_coordinates()
        self._coordinates.flags.writeable = False
        self._undeformed_areas = _areas(self.corners())

    def check_unmoved(self) -> None:
        """Raise InputError, on all ranks, if the mesh was moved after the blank was made: yarns,
        places and areas are those of before."""
        moved = not np.array_equal(self.mesh.geometry.x, self._made_at)
        if self.mesh.comm.allreduce(moved, MPI.LOR):
            flaw = f"the mesh of {self.name} was moved after the blank was made of it"
            raise InputError(f"{flaw}; expected a blank of the moved mesh")

    @property
    def displacement(self) -> Expr:
        """Displacement along x, y, z, a UFL vector (gdim,) in `u` [mm]."""
        return self.in_space(self.u)

    def in_space(self, u: Expr) -> Expr:
        """Components along x, y, z of a UFL vector with components along the frame's axes."""
        return ufl.dot(self._axes, u) if self._turned else u

    @property
    def degree(self) -> int:
        """Polynomial degree of the displacement."""
        return compat.degree(self.V)

    @property
    def cell_nodes(self) -> np.ndarray:
        """Local nodes of `u` of each owned cell, the corners first, (cells, k)."""
        return compat.dofmap(self.V)[: self.mesh.topology.index_map(2).size_local]

    def _cell_points(self):
        """Undeformed nodes of the owned cells' shape, (cells, k, 3) [mm]."""
        nodes = compat.geometry_dofmap(self.mesh)[: self.mesh.topology.index_map(2).size_local]
        return self.mesh.geometry.x[nodes]

    def coordinates(self) -> np.ndarray:
        """Undeformed positions of the local nodes of `u`, (nodes, 3) [mm], not to be written."""
        return self._coordinates

    def generic_displacement(self) -> np.ndarray:
        """A displacement of this rank's owned nodes (n, gdim) of about size 1 that no mode is
        orthogonal to: a function of their places, so neither ranks nor their numbering matter."""
        owned, gdim = self.V.dofmap.index_map.size_local, self.mesh.geometry.dim
        low, high = self.extent()
        x = (self.along(self.coordinates()[:owned].T).T - low) / (high - low).max()
        waves = np.sqrt([2, 3, 5, 7, 11, 13, 17, 19, 23])[: gdim**2].reshape(gdim, gdim)
        return np.cos(3 * x @ waves) + np.sin(17 * x @ waves.T)

    def nodal_displacement(self) -> np.ndarray:
        """Displacement along x, y, z at the local nodes, (nodes, gdim) [mm]."""
        values = self.u.x.array.reshape(-1, self.mesh.geometry.dim)
        return values @ self.frame if self._turned else values

    def along(self, points: np.ndarray) -> np.ndarray:
        """Coordinates along the frame's axes (gdim, n) of points (3, n) [mm]."""
        return self.frame @ points[: len(self.frame)]

    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest undeformed coordinates along the frame's axes, two arrays (gdim,)
        [mm]."""
        return bounds(self.mesh.comm, self.along(self.mesh.geometry.x.T))

    def sides(self) -> np.ndarray:
        """Lengths of the undeformed sheet along the frame's axes, (gdim,) [mm]."""
        return np.subtract(*self.extent()[::-1])

    def diameter(self) -> float:
        """Twice the largest distance of a node from the mean of all, in any frame [mm]."""
        comm, x = self.mesh.comm, self.coordinates()[: self.V.dofmap.index_map.size_local]
        centre = comm.allreduce(x.sum(0)) / comm.allreduce(len(x))
        farthest = np.linalg.norm(x - centre, axis=1).max(initial=0.0)
        return 2 * comm.allreduce(float(farthest), MPI.MAX)

    def midpoints(self) -> np.ndarray:
        """Undeformed centres of the owned cells along the frame's axes, (gdim, cells) [mm]."""
        return self.along(self.centres().T)

    def is_flat(self) -> bool:
        """True if the undeformed sheet lies in a plane z = const; on all ranks together."""
        low, high = bounds(self.mesh.comm, self.mesh.geometry.x.T)
        return bool(high[2] - low[2] <= FLAT_TOLERANCE * (high - low).max())

    def centres(self) -> np.ndarray:
        """Undeformed centres of the owned cells, (cells, 3) along x, y and z [mm]."""
        return self._cell_points().mean(1)

    def places(self) -> np.ndarray:
        """Undeformed centres of the owned cells, (cells, 2) along x and y, if the sheet is not flat
        (cells, 3) along z, too [mm]."""
        return self.centres()[:, : 2 if self.is_flat() else 3]

    def corners(self) -> np.ndarray:
        """Undeformed corners of the owned cells along the frame's axes, in order around each,
        (cells, 3 or 4, gdim) [mm]."""
        x = self._cell_points()[:, self.around]
        along = self.along(x.reshape(-1, 3).T)  # some ranks have no cell
        return np.moveaxis(along.reshape(len(along), *x.shape[:2]), 0, -1)

    def at_rim(self) -> np.ndarray:
        """Mask (cells,) of owned cells with a node at the mesh's edge."""
        topology = self.mesh.topology
        topology.create_connectivity(1, 2)
        nodes = np.zeros(len(self._coordinates), bool)
        sides = exterior_facet_indices(topology)
        nodes[fem.locate_dofs_topological(self.V, 1, sides)] = True
        return nodes[self.cell_nodes].any(1)

    @property
    def triangulated(self) -> bool:
        """True if `triangles` are all of the sheet's shape: P1, and P2 with straight sides."""
        return compat.is_affine(self.mesh) and self.degree <= 2

    def check_triangulated(self, what: str) -> None:
        """Raise InputError, on all ranks, unless `triangles` are all of the sheet's shape."""
        if not self.triangulated:
            found = f"{what} of {self.name} does not support these cells"
            raise InputError(f"{found}; expected P1, and P2 with straight sides")

    def triangles(self, cells: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Local nodes of `u` at the corners of the flat triangles that contact and bending take
        local `cells` as, (cells, k, 3): a linear triangle itself, halves of a quadrilateral, the
        four between the nodes of a quadratic triangle."""
        cell = compat.cell_name(self.mesh)
        corners = self.TRIANGLES.get((cell, self.degree), self.TRIANGLES[cell, 1])
        nodes = compat.dofmap(self.V)[cells][:, corners]
        # by their places: ranks may turn a cell, and terms remember values in its triangles
        places = np.moveaxis(self.coordinates()[nodes].mean(2).round(6), 2, 0)
        order = np.lexsort(places[::-1], axis=1)
        return np.take_along_axis(nodes, order[:, :, None], axis=1)

    def areas(self) -> np.ndarray:
        """Undeformed areas of the owned cells, of those with curved edges between their corners,
        (cells,) [mm2]."""
        return self._undeformed_areas.copy()

    def area_ratios(self) -> np.ndarray:
        """Areas of the owned cells now over those of the flat sheet, (cells,)."""
        x = self.coordinates()[:, : self.mesh.geometry.dim] + self.nodal_displacement()
        return _areas(x[self.cell_nodes[:, self.around]]) / self._undeformed_areas

    @property
    def around(self) -> list[int]:
        """Corners of a cell, of its nodes, in order around it."""
        return [0, 1, 2] if compat.cell_name(self.mesh) == "triangle" else [0, 1, 3, 2]

    def inverted_area(self) -> ufl.Form:
        """Area [mm2] of the cells that a plane displacement turns inside out, which a law in
        invariants of C alone can't see."""
        J = ufl.det(ufl.Identity(2) + ufl.grad(self.displacement))
        degree = 1 if compat.is_affine(self.mesh) and self.degree == 1 else 4
        return ufl.conditional(ufl.gt(J, 0), 0.0, 1.0) * ufl.dx(self.mesh, degree=degree)

    def summed(self, values: np.ndarray, cells: np.ndarray | None = None) -> np.ndarray:
        """Sums at the local nodes of `u`, (nodes, k), over the cells around each, of all ranks, of
        `values` (owned cells, nodes of a cell or its corners, k); cells: which of the owned
        (all)."""
        nodes = compat.dofmap(self.V)[slice(len(values)) if cells is None else cells]
        return self.summed_at(nodes[:, : values.shape[1]], values)

    def summed_at(self, nodes: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Sums at the local nodes of `u`, (nodes, k), of all ranks, of `values` (..., k) at the
        local `nodes` (...)."""
        columns, count = values.reshape(-1, values.shape[-1]).T, len(self.coordinates())
        total = np.stack([np.bincount(nodes.ravel(), each, count) for each in columns], axis=1)
        return self._exchanged(total.astype(float, copy=False), add=True)  # of no cells it is int

    def smoothed(self, values: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """Means over the nodes of each of the owned `cells`, (cells, k), of means by area of
        `values` (cells, k) over the cells around each node, on all ranks together."""
        sums = np.column_stack([values, np.ones(len(cells))]) * self.areas()[cells, None]
        sums = np.repeat(sums[:, None], self.cell_nodes.shape[1], 1)
        at_nodes = self.summed(sums, cells)[self.cell_nodes[cells]]
        return (at_nodes[..., :-1] / at_nodes[..., -1:]).mean(1)

    def cell_means(self, values: np.ndarray) -> np.ndarray:
        """Means over the nodes of each owned cell, (cells,), of `values` (owned nodes,), on all
        ranks together."""
        return self.with_ghosts(values)[self.cell_nodes].mean(1)

    def with_ghosts(self, values: np.ndarray) -> np.ndarray:
        """`values` (owned nodes,) or (owned nodes, k) of `u` at all local nodes, ghosts too."""
        local = np.zeros((len(self.coordinates()), *values.shape[1:]))
        local[: len(values)] = values
        return self._exchanged(local.reshape(len(local), -1), add=False).reshape(local.shape)

    def _exchanged(self, local, add):
        """Values (local nodes, k) with those of their owners, added up over ranks before."""
        if self.mesh.comm.size == 1:
            return local
        vector = la.vector(self.V.dofmap.index_map, local.shape[1])
        vector.array[:] = local.ravel()
        if add:
            vector.scatter_reverse(compat.ADD)
        vector.scatter_forward()
        return vector.array.reshape(local.shape).copy()


def _areas(corners: np.ndarray) -> np.ndarray:
    """Areas (m,) of the triangles that meet in the first of `corners` (m, 3 or 4, 2 or 3)."""
    arms = corners[:, 1:] - corners[:, :1]
    first, second = arms[:, :-1], arms[:, 1:]
    squares = (first**2).sum(2) * (second**2).sum(2) - (first * second).sum(2) ** 2
    return np.sqrt(np.maximum(squares, 0)).sum(1) / 2


def bounds(comm: MPI.Comm, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest of `values` (k, n) over n on all ranks, two arrays (k,)."""
    low, high = values.min(1, initial=np.inf), values.max(1, initial=-np.inf)
    comm.Allreduce(MPI.IN_PLACE, low, MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, MPI.MAX)
    return low, high


# -- fibre fields


def fibre_fields(
    mesh: Mesh, a: Direction = 0.0, b: Direction | None = None, up: ArrayLike = (0.0, 0.0, 1.0)
) -> tuple[fem.Function, fem.Function]:
    """DG0 vector fields a0, b0 (gdim components) of unit length in the cells' tangent planes, along
    the directions of `Blank`, which also has what is raised."""
    centre, normal = _midpoints(mesh, up)
    a0 = _tangent(mesh, centre, normal, a, "a")
    b0 = np.cross(normal, a0) if b is None else _tangent(mesh, centre, normal, b, "b")
    _refuse(mesh, abs((a0 * b0).sum(1)) > 1 - 1e-6, centre, "fibre directions a and b are parallel")
    space = compat.vector_space(mesh, "DG", 0, mesh.geometry.dim)
    fields = fem.Function(space), fem.Function(space)
    for field, values in zip(fields, (a0, b0)):
        field.x.array[:] = values[:, : mesh.geometry.dim].ravel()
    return fields


def _midpoints(mesh, up):
    """Centre and unit normal, on the side of `up`, of each local cell."""
    is_triangle = compat.cell_name(mesh) == "triangle"
    corners = mesh.geometry.x[compat.geometry_dofmap(mesh)][:, : 3 if is_triangle else 4]
    # two edges of a triangle, the diagonals of a quadrilateral in tensor-product order
    p, q, r, s = corners.swapaxes(0, 1)[[1, 0, 2, 0] if is_triangle else [3, 0, 2, 1]]
    normal = np.cross(p - q, r - s)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal[normal @ np.asarray(up, float) < 0] *= -1
    return corners.mean(1), normal


def _tangent(mesh, centre, normal, direction, name):
    """Unit vectors (cells, 3) along a direction in the cells' planes."""

    def refuse(bad, flaw):
        _refuse(mesh, bad, centre, f"fibre direction {name} {flaw}")

    function = direction if callable(direction) else lambda x: direction
    value = on_all(mesh.comm, lambda: np.asarray(function(centre.T), float))
    if value.ndim == 0 and abs(value) > 2 * np.pi:
        allowed = "an angle in radians; expected from -2 pi to 2 pi"
        raise InputError(f"fibre direction {name} is {value:g}, {allowed}")
    if value.ndim < (2 if callable(direction) else 1):
        value = np.stack(np.broadcast_arrays(np.cos(value), np.sin(value)))
    value = np.broadcast_to(value.T, (len(centre), len(value)))
    value = np.pad(value, ((0, 0), (0, 3 - len(value.T))))
    with np.errstate(invalid="ignore", divide="ignore"):
        value = value / np.linalg.norm(value, axis=1, keepdims=True)
        refuse(~np.isfinite(value).all(1), "is zero or not finite")
        out = (value * normal).sum(1)
    if mesh.geometry.dim == 2:
        refuse(abs(out) > 1e-6, "leaves the plane of the plane blank")
    value = value - out[:, None] * normal
    length = np.linalg.norm(value, axis=1)
    refuse(length < 0.1, "is normal to the sheet")  # or 84 deg and more out of its plane
    return value / length[:, None]


def _refuse(mesh, bad, centre, flaw):
    """Raise the same InputError on all ranks if any rank has a bad cell."""
    for place in np.concatenate(mesh.comm.allgather(centre[bad][:1].round(6))).tolist():
        where = f"in the cell at {tuple(place)} mm"
        raise InputError(f"{flaw} {where}; expected directions in its tangent plane")
