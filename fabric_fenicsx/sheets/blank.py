"""The sheet: its mesh, yarn directions, displacement and parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self, Unpack

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh
from mpi4py import MPI
from numpy.typing import ArrayLike
from petsc4py import PETSc
from ufl.core.expr import Expr

from .. import dolfinx_compat as compat
from ..runtime.errors import InputError
from .cells import CELLS
from .fibres import Direction, fibre_fields
from .layout import Layout, blank_options
from .mesh_checks import checked_mesh
from .mesh_files import on_root, read_mesh
from .part import Part, bounds

FLAT = 1e-6  # of its size, up to which a sheet is flat
# flat triangles of cells, by their nodes: halves, or the four between a quadratic cell's nodes
TRIANGLES = {
    ("triangle", 1): [(0, 1, 2)],
    ("triangle", 2): [(0, 5, 4), (5, 1, 3), (4, 3, 2), (5, 3, 4)],
    ("quadrilateral", 1): [(0, 1, 2), (1, 3, 2)],
}


class Blank:
    """A woven sheet: mesh, fibre fields and the unknown displacement.

    Most are made by `rectangle`, `outline`, `read` or `from_arrays`.

    Parameters
    ----------
    mesh : dolfinx.mesh.Mesh
        Triangles or quadrilaterals in R^2 or R^3 [mm].
    a, b : float, (gdim,) or function
        Directions of the yarns: an angle from the x axis about the z axis [rad]; a vector; or a
        function of points (3, n) to angles (n,) or vectors (gdim, n). Without `b` yarns b are
        perpendicular to a, turned counter-clockwise as seen from `up`.
    degree : int or None
        Of the displacement: 1 or 2, on triangles also 3. None: 2 in a plane; in space 1 where cells
        follow the yarns, so that they don't lock, and 2 elsewhere.
    frame : (gdim, gdim)
        Orthonormal rows; `u` holds the displacement's components along them, so that supports may
        act along axes which are turned in space (x, y, z).
    up : (3,)
        The side from which `b` is counter-clockwise.
    name : str
        The sheet's name in messages.

    Attributes
    ----------
    a0, b0, u
        Unit vectors along the yarns, one a cell; the displacement [mm]: DOLFINx functions.
    whole, parts
        All of it as a `Part`; its named parts, see `divide` and `Stack`.
    straight, orthogonal
        Both directions if each is one all over, otherwise None; True if they are orthogonal in
        every point.
    warnings : list of str
        Doubts about its mesh.

    Raises
    ------
    InputError
        On all ranks, for another frame, and for directions that are not finite, normal to the
        sheet, out of the plane of a plane blank, or parallel to each other.

    Examples
    --------
    >>> sheet = ff.Blank.rectangle(100, 50, nx=4, fibre_angle=45)
    >>> round(float(sheet.areas().sum()), 6), sheet.degree
    (5000.0, 2)
    """

    def __init__(
        self,
        mesh: Mesh,
        a: Direction = 0.0,
        b: Direction | None = None,
        *,
        degree: int | None = 1,
        frame: ArrayLike | None = None,
        up: ArrayLike = (0.0, 0.0, 1.0),
        name: str = "blank",
    ) -> None:
        gdim = mesh.geometry.dim
        self.mesh, self.name = mesh, name
        self.warnings: list[str] = []
        self.from_file = False  # True if its cells are a user's
        self.a0, self.b0 = fibre_fields(mesh, a, b, up)
        self.frame = np.eye(gdim) if frame is None else np.asarray(frame, dtype=float)
        if self.frame.shape != (gdim, gdim) or not np.allclose(
            self.frame @ self.frame.T, np.eye(gdim), atol=1e-12
        ):
            raise InputError(
                f"frame of the blank is {self.frame.tolist()}; allowed are {gdim} orthonormal rows"
            )
        self._turned = not np.array_equal(self.frame, np.eye(gdim))
        # no numbers of the form, so that all angles share a compiled one
        self._axes = fem.Constant(mesh, self.frame.T.copy())
        orthogonal = b is None
        self._interpolate(degree or (1 if gdim == 3 else 2), orthogonal)
        may_lock = degree is None and gdim == 3 and compat.is_affine(mesh)
        if may_lock and not self.whole.follows_yarns():
            self._interpolate(2, orthogonal)
        self.straight, self.orthogonal = self.whole.straight, self.whole.orthogonal
        self.parts: dict[str, Part] = {}

    def _interpolate(self, degree, orthogonal):
        self.V = compat.vector_space(self.mesh, "Lagrange", degree, self.mesh.geometry.dim)
        self.u, self.whole = fem.Function(self.V, name="u"), Part(self, orthogonal=orthogonal)

    def part(self, name: str = "") -> Part:
        """The part of that name, "" for all of the blank. Raises InputError if there is none."""
        if name and name not in self.parts:
            raise InputError(
                f"{self.name} has no part {name!r}; allowed is one of "
                f"{', '.join(self.parts) or 'none, as it is one sheet'}"
            )
        return self.parts[name] if name else self.whole

    def divide(self, patches: Mapping[str, Callable[[np.ndarray], np.ndarray]], rest: str) -> None:
        """Name patches as `parts`.

        Parameters
        ----------
        patches : dict of functions
            From the cells' centres (3, n) [mm] to a mask (n,).
        rest : str
            The part of what none of them marks, if there is any.

        Raises
        ------
        InputError
            For a patch without cells, for a cell in two, and for a blank that has parts.
        """
        if self.parts:
            raise InputError(
                f"{self.name} has parts {', '.join(self.parts)} already: it is divided only once"
            )
        middles = self.mesh.geometry.x[compat.geometry_dofmap(self.mesh)].mean(1).T
        masks = {name: np.asarray(where(middles), bool) for name, where in patches.items()}
        taken = np.sum(list(masks.values()), axis=0)
        if self.mesh.comm.allreduce(int((taken > 1).sum())):
            raise InputError(f"patches of {self.name} overlap; allowed is one for each cell")
        masks |= {rest: taken == 0}
        for name, mask in masks.items():
            if self.mesh.comm.allreduce(int(mask.sum())):
                at = np.flatnonzero(mask)
                self.parts[name] = Part(self, name, at, orthogonal=self.orthogonal)
            elif name != rest:
                raise InputError(
                    f"patch {name} of {self.name} has no cells; allowed are one or more"
                )

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

    def coordinates(self) -> np.ndarray:
        """Undeformed positions of the local nodes of `u`, (nodes, 3) [mm]."""
        return self.V.tabulate_dof_coordinates()

    def generic_displacement(self) -> np.ndarray:
        """A displacement of this rank's owned nodes (n, gdim) of about size 1 that no mode is
        orthogonal to: a function of their places, so neither ranks nor their numbering matter."""
        owned, gdim = self.V.dofmap.index_map.size_local, self.mesh.geometry.dim
        low, high = self.extent()
        x = (self.along(self.coordinates()[:owned].T).T - low) / (high - low).max()
        waves = np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0])[: gdim**2]
        waves = waves.reshape(gdim, gdim)
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

    def midpoints(self) -> np.ndarray:
        """Undeformed centres of the owned cells along the frame's axes, (gdim, cells) [mm]."""
        nodes = compat.geometry_dofmap(self.mesh)[: self.mesh.topology.index_map(2).size_local]
        return self.along(self.mesh.geometry.x[nodes].mean(1).T)

    def is_flat(self) -> bool:
        """True if the undeformed sheet lies in a plane z = const; on all ranks together."""
        low, high = bounds(self.mesh.comm, self.mesh.geometry.x.T)
        return bool(high[2] - low[2] <= FLAT * (high - low).max())

    def places(self) -> np.ndarray:
        """Undeformed centres of the owned cells, (cells, 2) along x and y, if the sheet is not flat
        (cells, 3) along z, too [mm]."""
        nodes = compat.geometry_dofmap(self.mesh)[: self.mesh.topology.index_map(2).size_local]
        return self.mesh.geometry.x[nodes].mean(1)[:, : 2 if self.is_flat() else 3]

    def corners(self) -> np.ndarray:
        """Undeformed corners of the owned cells along the frame's axes, in order around each,
        (cells, 3 or 4, gdim) [mm]."""
        nodes = compat.geometry_dofmap(self.mesh)[: self.mesh.topology.index_map(2).size_local]
        x = self.mesh.geometry.x[nodes[:, self.around]]
        along = self.along(x.reshape(-1, 3).T)  # some ranks have no cell
        return np.moveaxis(along.reshape(len(along), *x.shape[:2]), 0, -1)

    @property
    def triangulated(self) -> bool:
        """True if `triangles` are all of the sheet's shape: P1, and P2 with straight sides."""
        return compat.is_affine(self.mesh) and self.degree <= 2

    def triangles(self, cells: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Local nodes of `u` at the corners of the flat triangles that contact and bending take
        local `cells` as, (cells, k, 3): a linear triangle itself, halves of a quadrilateral, the
        four between the nodes of a quadratic triangle."""
        cell = compat.cell_name(self.mesh)
        corners = TRIANGLES.get((cell, self.degree), TRIANGLES[cell, 1])
        found = compat.dofmap(self.V)[cells][:, corners]
        # by their places: ranks may turn a cell, and terms remember values in its triangles
        places = np.moveaxis(self.coordinates()[found].mean(2).round(6), 2, 0)
        order = np.lexsort(places[::-1], axis=1)
        return np.take_along_axis(found, order[:, :, None], axis=1)

    def areas(self) -> np.ndarray:
        """Undeformed areas of the owned cells, of those with curved edges between their corners,
        (cells,) [mm2]."""
        return _areas(self.corners())

    def area_ratios(self) -> np.ndarray:
        """Areas of the owned cells now over those of the flat sheet, both as `areas`, (cells,)."""
        x = self.coordinates()[:, : self.mesh.geometry.dim] + self.nodal_displacement()
        corners = compat.dofmap(self.V)[: self.mesh.topology.index_map(2).size_local]
        return _areas(x[corners[:, self.around]]) / self.areas()

    @property
    def around(self) -> list[int]:
        """Corners of a cell, of its nodes, in order around it."""
        return [0, 1, 2] if compat.cell_name(self.mesh) == "triangle" else [0, 1, 3, 2]

    def inverted_area(self) -> ufl.Form:
        """Area [mm2] of the cells that a plane displacement turns inside out, which a law in
        invariants of C alone can't see."""
        J = ufl.det(ufl.Identity(2) + ufl.grad(self.displacement))
        degree = 1 if compat.is_affine(self.mesh) and self.degree == 1 else 4
        return ufl.conditional(ufl.gt(J, 0), 0.0, 1.0) * ufl.Measure(
            "dx", self.mesh, metadata={"quadrature_degree": degree}
        )

    def summed(self, values: np.ndarray, cells: np.ndarray | None = None) -> np.ndarray:
        """Sums at the local nodes of `u`, (nodes, k), over the cells around each, of all ranks, of
        `values` (owned cells, nodes of a cell or its corners, k); cells: which of the owned
        (all)."""
        nodes = compat.dofmap(self.V)[slice(len(values)) if cells is None else cells]
        nodes = nodes[:, : values.shape[1]]
        total = np.zeros((len(self.coordinates()), values.shape[2]))
        np.add.at(total, nodes.ravel(), values.reshape(-1, values.shape[2]))
        return self._exchanged(total, add=True)

    def cell_means(self, values: np.ndarray) -> np.ndarray:
        """Means over the nodes of each owned cell, (cells,), of `values` (owned nodes,), on all
        ranks together."""
        nodes = compat.dofmap(self.V)[: self.mesh.topology.index_map(2).size_local]
        return self.with_ghosts(values)[nodes].mean(1)

    def with_ghosts(self, values: np.ndarray) -> np.ndarray:
        """`values` (owned nodes,) or (owned nodes, k) of `u` at all local nodes, ghosts too."""
        local = np.zeros((len(self.coordinates()), *values.shape[1:]))
        local[: len(values)] = values
        return self._exchanged(local.reshape(len(local), -1), add=False).reshape(local.shape)

    def _exchanged(self, local, add):
        """Values (local nodes, k) with those of their owners, added up over ranks before."""
        gdim, vector = self.mesh.geometry.dim, compat.petsc_vector(self.u).duplicate()
        found = np.empty_like(local)
        for start in range(0, local.shape[1], gdim):
            columns = slice(start, min(start + gdim, local.shape[1]))
            with vector.localForm() as form:
                form.set(0.0)
                form.array.reshape(-1, gdim)[:, : columns.stop - start] = local[:, columns]
            if add:
                vector.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
            vector.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
            with vector.localForm() as form:
                found[:, columns] = form.array.reshape(-1, gdim)[:, : columns.stop - start]
        return found

    @classmethod
    def from_arrays(
        cls,
        comm: MPI.Comm,
        points: ArrayLike | None,
        cells: ArrayLike | None,
        kind: str | None,
        source: str = "the mesh",
        spatial: bool = False,
        **options: Any,
    ) -> Self:
        """Blank from arrays on rank 0 (None elsewhere).

        Parameters
        ----------
        points : (n, 2 or 3)
            [mm]
        cells : (m, k)
            Numbers of their nodes, in gmsh's order.
        kind : {"triangle", "triangle6", "quad", "quad9"}
            meshio's name of the cells.
        source : str
            What messages call the mesh.
        spatial : bool
            True: free to leave its plane. A sheet in a plane z = const is otherwise meshed in R^2,
            so its displacement has two components; any other is a manifold mesh in R^3.
        **options
            Those of `Blank`.

        Raises
        ------
        InputError
            On all ranks, for a mesh that is no sheet, see `mesh_checks.checked_mesh`; doubts about
            one that is used all the same stand in `warnings`.
        """
        x, nodes, kind, warnings = on_root(
            comm,
            lambda: checked_mesh(
                np.asarray(points, float), np.asarray(cells), kind, source, spatial
            ),
        )
        how = CELLS[kind]
        nodes = nodes[:, compat.to_dolfinx_order(how.cell, nodes.shape[1])]
        blank = cls(compat.create_mesh(comm, nodes, x, how.cell, how.degree), **options)
        blank.warnings = warnings
        return blank

    @classmethod
    def rectangle(
        cls,
        length: float,
        width: float,
        *,
        nx: int = 32,
        ny: int | None = None,
        pattern: str = "crossed",
        spatial: bool = False,
        comm: MPI.Comm = MPI.COMM_WORLD,
        **layout: Unpack[Layout],
    ) -> Self:
        """Rectangle in the plane z = 0.

        Parameters
        ----------
        length, width : float
            [mm]
        nx, ny : int
            Rectangles along length and width, square without `ny`.
        pattern : str
            How they become cells, one of `meshes.specimen.PATTERNS`.
        spatial : bool
            True: free to leave its plane.
        element : {"P1", "P2", "P3", "Q1", "Q2"}
            By default P1 or P2, see `degree` of `Blank`.
        fibre_angle, yarn_angle : float
            From the length to yarns a (0), and from there to yarns b (90) [deg].
        turned : float
            From x to the length [rad]; the blank's frame is then its length and width.
        centred : bool
            True: the origin is the centre, otherwise a corner.

        Raises
        ------
        InputError
            For values that are not allowed or do not fit together.
        """
        from .meshing import rectangle

        options = blank_options(layout)
        mesh = rectangle(comm, (length, width), (nx, ny), pattern, layout)
        return cls.from_arrays(comm, *mesh[:3], "the specimen", spatial, **options)

    @classmethod
    def outline(
        cls,
        outline: Path | str | Sequence[ArrayLike],
        *,
        nx: int = 32,
        size: float | None = None,
        pattern: str = "unstructured",
        layer: str | None = None,
        spatial: bool = False,
        comm: MPI.Comm = MPI.COMM_WORLD,
        **layout: Unpack[Layout],
    ) -> Self:
        """Sheet in the plane z = 0 within an outline with holes, of triangles.

        Parameters
        ----------
        outline : file name or list of (n, 2)
            A DXF, a CSV of x and y, or a mesh; or rings [mm], of which the largest is the outline.
        nx, size : int, float
            Edges of cells along the extent in x, or their length [mm].
        pattern : {"unstructured", "along"}
            `along`: cells along both yarns.
        layer : str
            Of a DXF, or several with commas between them.
        spatial, **layout
            As in `rectangle`; the sheet lies as in the file, unless `centred`.

        Raises
        ------
        InputError
            For a file that cannot be read, rings that bound no sheet, quadrilaterals, and values
            that are not allowed. What was left out stands in `warnings`.
        """
        from .meshing import source_of, within

        mesh = within(comm, outline, layer, (nx, size), pattern, layout)
        options, source = blank_options(layout), source_of(outline)
        blank = cls.from_arrays(comm, *mesh[:3], source, spatial, **options)
        blank.warnings, blank.from_file = [*mesh.warnings, *blank.warnings], True
        return blank

    @classmethod
    def read(
        cls,
        path: Path | str,
        *,
        spatial: bool = False,
        comm: MPI.Comm = MPI.COMM_WORLD,
        **options: Any,
    ) -> Self:
        """Blank from a mesh in mm that meshio, gmsh or PyVista reads: .msh, .inp, .bdf, .unv, .vtk,
        .vtu, .stl, .xdmf and others.

        Parameters
        ----------
        path
            The file.
        spatial, **options
            As in `from_arrays`.

        Raises
        ------
        InputError
            As `from_arrays`, and for a file that cannot be read or has solid, mixed or unknown
            cells.
        """
        mesh = on_root(comm, lambda: read_mesh(path))
        blank = cls.from_arrays(comm, *mesh[:3], str(path), spatial, **options)
        blank.from_file = True
        return blank


def _areas(corners: np.ndarray) -> np.ndarray:
    """Areas (m,) of the triangles that meet in the first of `corners` (m, 3 or 4, 2 or 3)."""
    arms = corners[:, 1:] - corners[:, :1]
    first, second = arms[:, :-1], arms[:, 1:]
    squares = (first**2).sum(2) * (second**2).sum(2) - (first * second).sum(2) ** 2
    return np.sqrt(np.maximum(squares, 0)).sum(1) / 2
