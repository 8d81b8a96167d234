"""The sheet: its mesh, yarn directions, displacement and parts."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self, Unpack

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, locate_entities_boundary, meshtags
from mpi4py import MPI
from numpy.typing import ArrayLike
from petsc4py import PETSc
from ufl.core.expr import Expr

from .. import dolfinx_compat as compat
from ..runtime.errors import InputError
from ..runtime.rules import COUNT, POSITIVE
from .cells import CELLS
from .fibres import Direction, fibre_fields
from .layout import Layout, axes_of, blank_options
from .mesh_checks import MeshArrays, checked_mesh
from .mesh_files import on_root, read_mesh

SAME = 1e-15  # by which directions may differ that are taken as one
# cosine of the angle between an edge and a yarn that it follows: a bias test's force is 3 % too
# large with 1 deg, 8 % with 3 deg, 22 % with 10 deg
ALONG = math.cos(math.radians(1.0))
OFF = 0.5  # share of the cells off the yarns from which a mesh is taken not to follow them

FLAT = 1e-6  # of its size, up to which a sheet is flat
# flat triangles of cells, by their nodes: halves, or the four between a quadratic cell's nodes
TRIANGLES = {
    ("triangle", 1): [(0, 1, 2)],
    ("triangle", 2): [(0, 5, 4), (5, 1, 3), (4, 3, 2), (5, 3, 4)],
    ("quadrilateral", 1): [(0, 1, 2), (1, 3, 2)],
}


class Blank:
    """A woven sheet: mesh, fibre fields `a0`, `b0` and the unknown `u`. `straight` has the two
    directions if each is one all over, `orthogonal` tells whether they are so in every point.
    `parts` are its named parts, see `divide` and `Stack`; `whole` is all of it.

    mesh: DOLFINx mesh of triangles or quadrilaterals in R^2 or R^3 [mm]. a, b, up: see
    `fibre_fields`. degree: of the displacement, 1 or 2, on triangles also 3; None: 2 in a plane, in
    space 1 where cells follow the yarns, so that they don't lock, and 2 elsewhere. frame: (gdim,
    gdim) orthonormal rows; `u` holds the displacement's components along them, so that supports may
    act along axes which are turned in space (default: x, y, z). name: what errors call it;
    warnings: what may be wrong with its mesh, in words. Raises InputError for a frame of another
    kind, and as `fibre_fields` does.
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
        self.from_file = False  # whether its cells are a user's
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

    def is_flat(self) -> bool:
        """Whether the undeformed sheet lies in a plane z = const; on all ranks together."""
        low, high = _bounds(self.mesh.comm, self.mesh.geometry.x.T)
        return bool(high[2] - low[2] <= FLAT * (high - low).max())

    def places(self) -> np.ndarray:
        """By which cells are told of: undeformed centres of the owned ones (cells, 2) along x and
        y, if the sheet is not flat (cells, 3) along z, too [mm]."""
        nodes = compat.geometry_dofmap(self.mesh)[: self.mesh.topology.index_map(2).size_local]
        return self.mesh.geometry.x[nodes].mean(1)[:, : 2 if self.is_flat() else 3]

    def corners(self) -> np.ndarray:
        """Undeformed corners of the owned cells along the frame's axes, in order around each,
        (cells, 3 or 4, gdim) [mm]."""
        nodes = compat.geometry_dofmap(self.mesh)[: self.mesh.topology.index_map(2).size_local]
        x = self.mesh.geometry.x[nodes[:, self._around()]]
        along = self.along(x.reshape(-1, 3).T)  # some ranks have no cell
        return np.moveaxis(along.reshape(len(along), *x.shape[:2]), 0, -1)

    @property
    def triangulated(self) -> bool:
        """Whether `triangles` tell all of the sheet's shape: P1, and P2 with straight sides."""
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
        return _areas(x[corners[:, self._around()]]) / self.areas()

    def _around(self):
        """The corners of a cell, of its nodes, in order around it."""
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
        """Sums at the local nodes of `u`, (nodes, k) with k up to gdim, over the cells around each,
        of all ranks, of `values` (owned cells, nodes of a cell or its corners, k); cells: which of
        the owned (all)."""
        gdim, k = self.mesh.geometry.dim, values.shape[2]
        total = compat.petsc_vector(self.u).duplicate()
        with total.localForm() as local:
            local.set(0.0)
            nodes = compat.dofmap(self.V)[slice(len(values)) if cells is None else cells]
            nodes = nodes[:, : values.shape[1]]
            np.add.at(local.array.reshape(-1, gdim)[:, :k], nodes.ravel(), values.reshape(-1, k))
        total.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        total.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
        with total.localForm() as local:
            return local.array.reshape(-1, gdim)[:, :k].copy()

    def cell_means(self, values: np.ndarray) -> np.ndarray:
        """Means over the nodes of each owned cell, (cells,), of `values` (owned nodes,), on all
        ranks together."""
        nodes = compat.dofmap(self.V)[: self.mesh.topology.index_map(2).size_local]
        return self.with_ghosts(values)[nodes].mean(1)

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
        """Rectangle of `length` x `width` [mm] in the plane z = 0, meshed from nx x ny rectangles.

        - ny: by default the number that makes the rectangles square
        - pattern: how they become cells, one of `meshes.specimen.PATTERNS`
        - spatial: free to leave its plane
        - element: P1, P2, P3, Q1 or Q2; by default P1 or P2, see `Blank`
        - fibre_angle: from the length to yarns a (0), yarn_angle: from there to yarns b (90) [deg]
        - turned: from x to the length [rad]; the blank's frame is then its length and width
        - centred: the origin is the centre; otherwise it is a corner

        Raises InputError as `specimen` does.
        """
        from ..meshes.specimen import specimen

        options = blank_options(layout)
        length, width = POSITIVE.check("`length`", length), POSITIVE.check("`width`", width)
        nx = COUNT.check("`nx`", nx)
        ny = max(1, round(nx * width / length)) if ny is None else COUNT.check("`ny`", ny)
        cell = "quadrilateral" if (layout.get("element") or "P")[0] == "Q" else "triangle"
        yarns = math.radians(layout.get("fibre_angle", 0.0))
        points, cells, kind, _ = on_root(
            comm, lambda: MeshArrays(*specimen(length, width, nx, ny, pattern, cell, yarns), [])
        )
        points[:, :2] -= np.array([length, width]) / 2 if layout.get("centred") else 0.0
        points[:, :2] = points[:, :2] @ axes_of(layout.get("turned", 0.0))
        return cls.from_arrays(comm, points, cells, kind, "the specimen", spatial, **options)

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
        """Sheet in the plane z = 0 with this outline and its holes, meshed by triangles.

        - outline: a file, and `layer` of a drawing, as `meshes.outline_files.read_outline` takes
          them, or rings (n, 2) [mm], of which the largest is the outline and others are holes
        - size: of the cells' edges [mm]; by default the extent along x over `nx`
        - pattern: `unstructured`, or `along` both yarns, see `meshes.outline.outline_mesh`
        - spatial and layout: as in `rectangle`, but the sheet lies as in the file, unless `centred`

        `warnings` have what was left out. Raises InputError for quadrilaterals, and as the
        functions named here and `from_arrays` do.
        """
        from ..meshes.outline import outline_mesh
        from ..meshes.outline_files import read_outline
        from ..meshes.rings import sheet_of

        options, nx = blank_options(layout), COUNT.check("`nx`", nx)
        if (layout.get("element") or "P")[0] != "P":
            raise InputError(
                f"`element` is {layout['element']}; allowed for an outline are triangles (P)"
            )
        source = f"outline {outline}" if isinstance(outline, (str, os.PathLike)) else "the outline"
        yarns = options["a"], options.get("b", options["a"] + math.pi / 2)

        def made():
            if isinstance(outline, (str, os.PathLike)):
                sheet, told = read_outline(outline, layer)
            else:
                sheet, told = sheet_of([np.asarray(ring, float) for ring in outline], source), []
            low, high = np.reshape(sheet.bounds, (2, 2))
            edge = (high - low)[0] / nx if size is None else size
            try:
                points, cells, kind, left_out = outline_mesh(sheet, edge, pattern, yarns)
            except InputError as error:
                raise InputError("; ".join([str(error), *told])) from None
            if layout.get("centred"):
                points[:, :2] -= (low + high) / 2
            return MeshArrays(points, cells, kind, told + left_out)

        points, cells, kind, told = on_root(comm, made)
        blank = cls.from_arrays(comm, points, cells, kind, source, spatial, **options)
        blank.warnings = [*told, *blank.warnings]
        blank.from_file = True
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
        """Blank from a mesh that meshio, gmsh or PyVista reads (.msh, .inp, .bdf, .unv, .vtk, .vtu,
        .stl, .xdmf ...), in mm; the rest, and what is raised, as in `from_arrays`; InputError also
        for a file that cannot be read or has solid, mixed or unknown cells."""
        points, cells, kind, _ = on_root(comm, lambda: read_mesh(path))
        source = str(path)
        blank = cls.from_arrays(comm, points, cells, kind, source, spatial, **options)
        blank.from_file = True
        return blank


class Part:
    """Cells of a `blank`: a sheet of a stack, a patch, or all of it.

    - name: "" if it is all of the blank; thickness: of a stack's sheet, otherwise None [mm]
    - cells (n,): this rank's owned cells
    - nodes (owned nodes,): mask of those at the part's cells, also at cells of other ranks
    - straight: directions of yarns a and b where they are the same in all cells, otherwise None
    - orthogonal: whether the yarns are so in every point
    """

    def __init__(
        self,
        blank: Blank,
        name: str = "",
        local_cells: np.ndarray | None = None,
        thickness: float | None = None,
        orthogonal: bool | None = None,
    ) -> None:
        mesh = blank.mesh
        self.blank, self.name, self.thickness = blank, name, thickness
        self.is_whole = local_cells is None
        owned = mesh.topology.index_map(2).size_local
        local = np.arange(len(compat.dofmap(blank.V))) if local_cells is None else local_cells
        self.cells = local[local < owned].astype(np.int32)
        count = blank.V.dofmap.index_map.size_local
        at = compat.dofmap(blank.V)[local].ravel()
        self.nodes = np.zeros(count, dtype=bool)
        self.nodes[at[at < count]] = True
        fibres = [field.x.array.reshape(-1, mesh.geometry.dim) for field in (blank.a0, blank.b0)]
        self.straight = _common(mesh.comm, [values[self.cells] for values in fibres])
        crossed = self.straight is not None or compat.is_affine(mesh)
        self.orthogonal = crossed if orthogonal is None else orthogonal and crossed
        if not self.is_whole:
            self._tags = meshtags(mesh, 2, np.sort(self.cells), np.ones(len(self.cells), np.int32))

    def follows_yarns(self) -> bool:
        """Whether few of the cells lie off the yarns."""
        return self.share_off_the_yarns() <= OFF

    def share_off_the_yarns(self) -> float:
        """Share of the part's cells at whose corners edges of the mesh do not run along both
        yarns, of all ranks."""
        blank, around = self.blank, self.blank._around()
        corners, k = blank.corners()[self.cells], len(around)
        edges = np.roll(corners, -1, 1) - corners
        edges /= np.linalg.norm(edges, axis=2, keepdims=True)
        follows = []
        for field in (blank.a0, blank.b0):
            yarn = field.x.array.reshape(-1, blank.mesh.geometry.dim)[self.cells]
            edge = np.abs((edges * blank.along(yarn.T).T[:, None]).sum(2)) >= ALONG
            follows.append(edge | np.roll(edge, 1, 1))  # both of its ends
        marks = np.stack(follows, -1).astype(float)[:, np.argsort(around)]
        nodes = compat.dofmap(blank.V)[self.cells, :k]
        reached = (blank.summed(marks, self.cells)[nodes] > 0).any(1).all(1)
        counts = np.array([(~reached).sum(), len(nodes)])
        off, cells = blank.mesh.comm.allreduce(counts, MPI.SUM)
        return float(off / cells)

    def dx(self, degree: int | None = None, drawn: float = 1.0) -> ufl.Measure:
        """Integration over the part, exact for polynomials of this degree on cells with straight
        sides; None: what UFL estimates. On P1 the displacement is of degree 1, so its square needs
        2, on P2 4; with less, nothing tells that the energy is off. drawn: distance of the points
        from the cells' centres, over those of that rule.

        All parts of a blank have the same subdomain number, so that they share compiled forms. So
        a form must not mix parts.
        """
        metadata: dict[str, Any] = {} if degree is None else {"quadrature_degree": degree}
        if degree is not None and drawn != 1:
            points, weights = compat.quadrature(self.blank.mesh, degree, drawn)
            # tuples, as UFL takes the names of forms from their text
            metadata |= {
                "quadrature_rule": "custom",
                "quadrature_points": tuple(map(tuple, points.tolist())),
                "quadrature_weights": tuple(weights.tolist()),
            }
        if self.is_whole:
            return ufl.Measure("dx", self.blank.mesh, metadata=metadata)
        return ufl.Measure(
            "dx", self.blank.mesh, subdomain_data=self._tags, subdomain_id=1, metadata=metadata
        )

    def ds(
        self, edge: Callable[[np.ndarray], np.ndarray], degree: int | None = None
    ) -> ufl.Measure:
        """Integration over those sides at the part's outer edge that `edge` marks, a function of
        points (3, n) [mm] to a mask (n,), true at both ends of a side; degree: as in `dx`.
        InputError, on all ranks, if it marks none."""
        mesh = self.blank.mesh
        mesh.topology.create_connectivity(1, 2)
        sides = np.unique(locate_entities_boundary(mesh, 1, edge)).astype(np.int32)
        cells = mesh.topology.connectivity(1, 2)
        of = np.array([cells.links(side)[0] for side in sides], dtype=np.int32)
        sides = sides[np.isin(of, self.cells)]
        if mesh.comm.allreduce(len(sides), MPI.SUM) == 0:
            where = f"{self.name}, part of {self.blank.name}" if self.name else self.blank.name
            raise InputError(
                f"the edge marks no side of {where}; allowed is a function of points (3, n) that "
                "is true at both ends of some sides"
            )
        tags = meshtags(mesh, 1, sides, np.ones(len(sides), dtype=np.int32))
        metadata = {} if degree is None else {"quadrature_degree": degree}
        return ufl.Measure("ds", mesh, subdomain_data=tags, subdomain_id=1, metadata=metadata)

    def spread(self, values: np.ndarray) -> np.ndarray:
        """`values` (cells, ...) of the part's cells among the blank's owned cells; others get NaN,
        in whole numbers 0."""
        if self.is_whole:
            return values
        shape = self.blank.mesh.topology.index_map(2).size_local, *values.shape[1:]
        none = np.nan if np.issubdtype(values.dtype, np.floating) else 0
        found = np.full(shape, none, dtype=values.dtype)
        found[self.cells] = values
        return found


def _areas(corners: np.ndarray) -> np.ndarray:
    """Areas (m,) of the triangles that meet in the first of `corners` (m, 3 or 4, 2 or 3)."""
    arms = corners[:, 1:] - corners[:, :1]
    first, second = arms[:, :-1], arms[:, 1:]
    squares = (first**2).sum(2) * (second**2).sum(2) - (first * second).sum(2) ** 2
    return np.sqrt(np.maximum(squares, 0)).sum(1) / 2


def _bounds(comm: MPI.Comm, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest of `values` (k, n) over n on all ranks, two arrays (k,)."""
    low, high = values.min(1, initial=np.inf), values.max(1, initial=-np.inf)
    lows, highs = np.empty_like(low), np.empty_like(high)
    comm.Allreduce(low, lows, MPI.MIN)
    comm.Allreduce(high, highs, MPI.MAX)
    return lows, highs


def _common(comm: MPI.Comm, fields: list[np.ndarray]) -> list[list[float]] | None:
    """The vectors that fields (cells, k) have in all cells of all ranks, None if one differs."""
    values = np.hstack(fields)
    low = comm.allreduce(values.min(0, initial=np.inf), np.minimum)
    high = comm.allreduce(values.max(0, initial=-np.inf), np.maximum)
    return high.reshape(len(fields), -1).tolist() if (high - low).max() <= SAME else None
