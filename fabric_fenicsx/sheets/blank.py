"""The sheet: its mesh, yarn directions and displacement."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, Self

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
from .mesh_checks import MeshArrays, checked_mesh
from .parts import Part


class Blank:
    """A woven sheet: mesh, fibre fields `a0`, `b0` and the unknown `u`. `straight` has the two
    directions if each is one all over, `orthogonal` tells whether they are so in every point.
    `parts` are its named parts, see `divide` and `Stack`; `whole` is all of it.

    mesh: DOLFINx mesh of triangles or quadrilaterals in R^2 or R^3 [mm]. a, b, up: see
    `fibre_fields`. degree: of the displacement, 1 or 2, on triangles also 3. frame: (gdim, gdim)
    orthonormal rows; `u` holds the displacement's components along them, so that supports may act
    along axes which are turned in space (default: x, y, z). name: what errors call it; warnings:
    what may be wrong with its mesh, in words. Raises InputError for a frame of another kind, and as
    `fibre_fields` does.
    """

    def __init__(
        self,
        mesh: Mesh,
        a: Direction = 0.0,
        b: Direction | None = None,
        *,
        degree: int = 1,
        frame: ArrayLike | None = None,
        up: ArrayLike = (0.0, 0.0, 1.0),
        name: str = "blank",
    ) -> None:
        gdim = mesh.geometry.dim
        self.mesh, self.name = mesh, name
        self.warnings: list[str] = []
        self.from_file = False  # whether its cells are a user's
        self.a0, self.b0 = fibre_fields(mesh, a, b, up)
        self.V = compat.vector_space(mesh, "Lagrange", degree, gdim)
        self.whole = Part(self, orthogonal=b is None)
        self.straight, self.orthogonal = self.whole.straight, self.whole.orthogonal
        self.parts: dict[str, Part] = {}
        self.u = fem.Function(self.V, name="u")
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

    def part(self, name: str = "") -> Part:
        """The part of that name, "" for all of the blank. Raises InputError if there is none."""
        if name and name not in self.parts:
            raise InputError(
                f"{self.name} has no part {name!r}; allowed is one of "
                f"{', '.join(self.parts) or 'none, as it is one sheet'}"
            )
        return self.parts[name] if name else self.whole

    def divide(self, patches: Mapping[str, Callable[[np.ndarray], np.ndarray]], rest: str) -> None:
        """Name patches as `parts`, by functions of the cells' centres (3, n) [mm] to a mask (n,);
        what none of them marks is part `rest`, if there is any. Raises InputError for a patch
        without cells, for a cell in two, and for a blank that has parts."""
        if self.parts:
            raise InputError(
                f"{self.name} has parts {', '.join(self.parts)} already; allowed is to divide once"
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
        return _bounds(self.mesh.comm, self.along(self.mesh.geometry.x.T))

    def midpoints(self) -> np.ndarray:
        """Undeformed centres of the owned cells along the frame's axes, (gdim, cells) [mm]."""
        owned = self.mesh.topology.index_map(self.mesh.topology.dim).size_local
        return self.along(self.mesh.geometry.x[compat.geometry_dofmap(self.mesh)[:owned]].mean(1).T)

    def corners(self) -> np.ndarray:
        """Undeformed corners of the owned cells along the frame's axes, in order around each,
        (cells, 3 or 4, gdim) [mm]."""
        nodes = compat.geometry_dofmap(self.mesh)[: self.mesh.topology.index_map(2).size_local]
        around = [0, 1, 2] if compat.cell_name(self.mesh) == "triangle" else [0, 1, 3, 2]
        x = self.mesh.geometry.x[nodes[:, around]]
        along = self.along(x.reshape(-1, 3).T)  # of no cell on some ranks
        return np.moveaxis(along.reshape(len(along), *x.shape[:2]), 0, -1)

    def areas(self) -> np.ndarray:
        """Undeformed areas of the owned cells, of those with curved edges between their corners,
        (cells,) [mm2]."""
        x = self.corners()
        arms = x[:, 1:] - x[:, :1]
        first, second = arms[:, :-1], arms[:, 1:]
        squares = (first**2).sum(2) * (second**2).sum(2) - (first * second).sum(2) ** 2
        return np.sqrt(np.maximum(squares, 0)).sum(1) / 2

    def inverted_area(self) -> ufl.Form:
        """Area [mm2] of the cells that a plane displacement turns inside out, which a law in
        invariants of C alone can't see."""
        J = ufl.det(ufl.Identity(2) + ufl.grad(self.displacement))
        degree = 1 if compat.is_affine(self.mesh) and self.degree == 1 else 4
        return ufl.conditional(ufl.gt(J, 0), 0.0, 1.0) * ufl.Measure(
            "dx", self.mesh, metadata={"quadrature_degree": degree}
        )

    def summed(self, values: np.ndarray, cells: np.ndarray | None = None) -> np.ndarray:
        """Sums at the local nodes of `u`, (nodes, k) with k up to gdim, over the cells around each,
        of all ranks, of `values` (owned cells, nodes of a cell, k); cells: which of the owned
        (all)."""
        gdim, k = self.mesh.geometry.dim, values.shape[2]
        total = compat.petsc_vector(self.u).duplicate()
        with total.localForm() as local:
            local.set(0.0)
            nodes = compat.dofmap(self.V)[slice(len(values)) if cells is None else cells]
            np.add.at(local.array.reshape(-1, gdim)[:, :k], nodes.ravel(), values.reshape(-1, k))
        total.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        total.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
        with total.localForm() as local:
            return local.array.reshape(-1, gdim)[:, :k].copy()

    def with_ghosts(self, values: np.ndarray) -> np.ndarray:
        """`values` (owned nodes,) or (owned nodes, k) of `u` at all local nodes, ghosts too."""
        gdim, vector, parts = self.mesh.geometry.dim, compat.petsc_vector(self.u).duplicate(), []
        columns = values if values.ndim == 2 else values[:, None]
        for start in range(0, columns.shape[1], gdim):
            part = columns[:, start : start + gdim]
            vector.array.reshape(-1, gdim)[:, : part.shape[1]] = part
            vector.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
            with vector.localForm() as local:
                parts.append(local.array.reshape(-1, gdim)[:, : part.shape[1]].copy())
        found = np.hstack(parts)
        return found if values.ndim == 2 else found[:, 0]

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
        """Blank from `points` (n, 2 or 3) [mm] and `cells` (m, k) in gmsh's order, read on rank 0
        (None elsewhere).

        kind: meshio's name of the cells: "triangle", "triangle6", "quad", "quad9". A sheet in a
        plane z = const is meshed in R^2, so its displacement has two components, unless it is
        `spatial`, free to leave its plane; any other is a manifold mesh in R^3. source: what errors
        call the mesh; options: those of `Blank`. Raises InputError, on all ranks, for a mesh that
        is no sheet, see `mesh_checks.checked_mesh`; what may be wrong with one that is used all the
        same stands in `warnings`.
        """
        x, nodes, kind, warnings = _on_root(
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
        element: str | None = None,
        fibre_angle: float = 0.0,
        yarn_angle: float = 90.0,
        turned: float = 0.0,
        spatial: bool = False,
        centred: bool = False,
        comm: MPI.Comm = MPI.COMM_WORLD,
    ) -> Self:
        """Rectangle of `length` x `width` [mm] in the plane z = 0, meshed from nx x ny rectangles.

        - ny: by default the number that makes the rectangles square
        - pattern: how they become cells, one of `meshes.specimen.PATTERNS`
        - element: P1, P2, P3, Q1 or Q2; by default P2, if `spatial` P1
        - fibre_angle: from the length to yarns a; yarn_angle: from yarns a to yarns b [deg]
        - turned: from x to the length [rad]; the blank's frame is then its length and width
        - spatial: free to leave its plane
        - centred: the origin is the centre; otherwise it is a corner

        Raises InputError as `specimen` does.
        """
        from ..meshes.specimen import specimen

        element = element or ("P1" if spatial else "P2")
        options = layout(element, fibre_angle, yarn_angle, turned)
        points = cells = kind = None
        if comm.rank == 0:
            ny = ny or max(1, round(nx * width / length))
            cell = "triangle" if element[0] == "P" else "quadrilateral"
            points, cells, kind = specimen(
                length, width, nx, ny, pattern, cell, math.radians(fibre_angle)
            )
            points[:, :2] -= np.array([length, width]) / 2 if centred else 0.0
            points[:, :2] = points[:, :2] @ axes_of(turned)
        return cls.from_arrays(comm, points, cells, kind, "the specimen", spatial, **options)

    @classmethod
    def read(
        cls,
        path: Path | str,
        *,
        spatial: bool = False,
        comm: MPI.Comm = MPI.COMM_WORLD,
        **options: Any,
    ) -> Self:
        """Blank from any file that meshio reads (.msh of gmsh, .vtk, .vtu, .stl, .inp, .xdmf ...),
        in mm; the rest, and what is raised, as in `from_arrays`; InputError also for a file that
        cannot be read or has solid or mixed cells."""
        if not isinstance(path, (str, os.PathLike)):
            raise InputError(
                f"mesh file is given as {type(path).__name__}; allowed is its name, as a text or "
                "a path"
            )
        points, cells, kind, _ = _on_root(comm, lambda: MeshArrays(*_read(Path(path)), []))
        source = str(path)
        blank = cls.from_arrays(comm, points, cells, kind, source, spatial, **options)
        blank.from_file = True
        return blank


def axes_of(turned: float) -> np.ndarray:
    """Directions of length and width of a sheet `turned` from x [rad], as rows (2, 2)."""
    return np.array([[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]])


def layout(
    element: str, fibre_angle: float, yarn_angle: float = 90.0, turned: float = 0.0
) -> dict[str, Any]:
    """Options of a `Blank` for an element's name, angles of its yarns [deg] and a sheet `turned` in
    its plane [rad]."""
    if not abs(fibre_angle) <= 360:
        raise InputError(f"fibre angle is {fibre_angle:g} deg; allowed is from -360 to 360 deg")
    a = math.radians(fibre_angle) + turned
    options: dict[str, Any] = {"a": a, "degree": int(element[1])}
    if turned:
        options["frame"] = axes_of(turned)
    if yarn_angle != 90:
        options["b"] = a + math.radians(yarn_angle)
    return options


def _bounds(comm: MPI.Comm, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest of `values` (k, n) over n on all ranks, two arrays (k,)."""
    low, high = values.min(1, initial=np.inf), values.max(1, initial=-np.inf)
    lows, highs = np.empty_like(low), np.empty_like(high)
    comm.Allreduce(low, lows, MPI.MIN)
    comm.Allreduce(high, highs, MPI.MAX)
    return lows, highs


def _on_root(comm: MPI.Comm, make: Callable[[], MeshArrays]) -> MeshArrays:
    """Mesh arrays made on rank 0; an InputError there is raised on every rank; other ranks get
    empty parts."""
    part: MeshArrays | None = None
    error = None
    if comm.rank == 0:
        try:
            part = make()
        except InputError as e:
            error = str(e)
    known = part and (part.points.shape[1], part.cells.shape[1], part.kind, part.warnings)
    error, known = comm.bcast((error, known))
    if error:
        raise InputError(error)
    if part:
        return part
    gdim, nodes, kind, warnings = known
    return MeshArrays(np.empty((0, gdim)), np.empty((0, nodes), dtype=np.int64), kind, warnings)


def _read(path: Path) -> tuple[np.ndarray, np.ndarray, str]:
    import meshio  # as long to import as a coarse solve takes, and only own meshes need it

    if not path.is_file():
        raise InputError(
            f"mesh file {path} does not exist or is not a file; allowed is any mesh that gmsh or "
            "meshio writes"
        )
    try:
        with redirect_stdout(None):  # its reader of .msh prints an empty line
            mesh = meshio.read(path)
    # meshio's readers raise whatever their parsing stumbles on, or exit
    except (Exception, SystemExit) as e:
        reason = " ".join(str(e).split()) or type(e).__name__
        raise InputError(
            f"mesh file {path} cannot be read ({reason}); allowed is any mesh that gmsh or meshio "
            "writes"
        ) from None
    solid = sorted({block.type for block in mesh.cells if block.dim == 3})
    if solid:
        raise InputError(
            f"mesh file {path} holds solid cells {solid}; allowed is a sheet, of one kind out of "
            f"{sorted(CELLS)}"
        )
    surface: dict[str, list[np.ndarray]] = {
        block.type: []
        for block in mesh.cells
        if block.type in CELLS or block.type in ("quad8", "polygon")
    }
    for block in mesh.cells:
        if block.type in surface:
            surface[block.type].append(block.data)
    if len(surface) > 1 or set(surface) - set(CELLS):
        raise InputError(
            f"mesh file {path} holds cells {sorted(surface)}; allowed is one kind out of "
            f"{sorted(CELLS)}"
        )
    if not surface:
        raise InputError(f"mesh file {path} holds no surface cells; allowed are {sorted(CELLS)}")
    ((kind, blocks),) = surface.items()
    return mesh.points, np.concatenate(blocks), kind
