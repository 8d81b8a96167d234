"""The blank: a sheet with its parts, and the meshes that it is made of."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from dolfinx.mesh import Mesh
from mpi4py import MPI
from numpy.typing import ArrayLike

from .. import dolfinx_compat as compat
from ..core.collective_errors import on_root
from ..core.errors import InputError
from ..core.rules import FINITE, POSITIVE
from . import sources
from .mesh_checks import CELLS, MeshArrays, checked_mesh, cut_open
from .part import Part
from .sheet import Layout, Values
from .sheet_mesh import Direction, SheetMesh


class Blank(SheetMesh):
    """A woven sheet: mesh, fibre fields and the unknown displacement.

    Most are made by `rectangle`, `outline`, `read` or `from_arrays`. Raises InputError, on all
    ranks, for another frame, and for directions that are not finite, normal to the sheet, out of
    the plane of a plane blank, or parallel to each other.

    Parameters
    ----------
    mesh : dolfinx.mesh.Mesh
        Triangles or quadrilaterals in R^2 or R^3 [mm].
    a, b : float, (gdim,) or function
        Directions of the yarns: an angle from the x axis about the z axis [rad]; a vector; or a
        function of points (3, n) to angles (n,) or vectors (gdim, n). Without `b` yarns b are
        perpendicular to a, turned counter-clockwise as seen from `up` (3,).
    degree : int or None
        Of the displacement: 1 or 2, on triangles also 3. None: 2 in a plane; in space 1 where cells
        follow the yarns, so that they don't lock, and 2 elsewhere.
    frame : (gdim, gdim)
        Orthonormal rows; `u` holds the displacement's components along them, so that supports may
        act along axes which are turned in space (x, y, z).
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
        super().__init__(mesh, a, b, frame, up, name)
        self.warnings: list[str] = []
        in_space = mesh.geometry.dim == 3
        self.interpolate(degree or (1 if in_space else 2))
        self.whole = Part(self, orthogonal=b is None)
        if not degree and in_space and compat.is_affine(mesh) and not self.whole.follows_yarns():
            self.interpolate(2)
            self.whole = Part(self, orthogonal=b is None)
        self.straight, self.orthogonal = self.whole.straight, self.whole.orthogonal
        self.parts: dict[str, Part] = {}

    def part(self, name: str = "") -> Part:
        """The part of that name, "" for all of the blank. Raises InputError if there is none."""
        if name and name not in self.parts:
            known = ", ".join(self.parts) or "none, as it is one sheet"
            raise InputError(f"{self.name} has no part {name!r}; expected one of {known}")
        return self.parts[name] if name else self.whole

    def divide(self, patches: Mapping[str, Callable[[np.ndarray], np.ndarray]], rest: str) -> None:
        """Name `patches` {name: function of the cells' centres (3, n) [mm] to a mask (n,)} as
        `parts`, and `rest` what none of them marks. Raises InputError for a patch without cells,
        for a cell in two, and for a blank that has parts."""
        middles = self.mesh.geometry.x[compat.geometry_dofmap(self.mesh)].mean(1).T
        masks = {name: np.asarray(where(middles), bool) for name, where in patches.items()}
        count = np.sum(list(masks.values()), axis=0)
        sizes = [mask.sum() for mask in (count == 0, count > 1, *masks.values())]
        others, shared, *cells = self.mesh.comm.allreduce(np.array(sizes))
        if self.parts:
            known = f"{self.name} already has parts {', '.join(self.parts)}"
            raise InputError(f"{known}; divide it only once")
        if shared:
            raise InputError(f"patches of {self.name} overlap; expected one for each cell")
        if 0 in cells:
            empty = f"patch {list(masks)[cells.index(0)]} of {self.name} has no cells"
            raise InputError(f"{empty}; expected one or more")
        for name, mask in (masks | ({rest: count == 0} if others else {})).items():
            self.parts[name] = Part(self, name, np.flatnonzero(mask), orthogonal=self.orthogonal)

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
        """Blank from arrays on rank 0 (None elsewhere): points (n, 2 or 3) [mm] and cells (m, k) by
        their nodes, in gmsh's order, of a kind that meshio calls "triangle", "triangle6", "quad" or
        "quad9".

        source: what messages call the mesh. spatial: free to leave its plane; a sheet in a plane
        z = const is otherwise meshed in R^2, so its displacement has two components, and any other
        is a manifold mesh in R^3. options: those of `Blank`. Raises InputError, on all ranks, for a
        mesh that is no sheet, see `checked_mesh`; doubts stand in `warnings`.
        """
        make = partial(MeshArrays, np.asarray(points, float), np.asarray(cells), str(kind), [])
        return cls.made(comm, make, source, spatial, options)

    @classmethod
    def made(
        cls,
        comm: MPI.Comm,
        make: Callable[[], MeshArrays],
        source: str,
        spatial: bool,
        options: Values,
        centred: bool = False,
        height: float | None = None,
    ) -> Self:
        """Blank of what `make` returns on rank 0, checked; others as in `read`, `from_arrays`."""
        slits = options.pop("slits", ())

        def checked():
            points, cells, kind, notes = make()
            mesh = checked_mesh(points, cells, kind, source, spatial)
            points, moved = sources.moved_sheet(mesh.points, source, centred, height)
            points, cells = cut_open(points, mesh.cells, kind, slits, source)
            return MeshArrays(points, cells, kind, [*notes, *mesh.warnings, *moved])

        points, nodes, kind, warnings = on_root(comm, checked)
        if comm.rank:  # rank 0 gives all of the mesh
            points, nodes = points[:0], nodes[:0]
        how = CELLS[kind]
        nodes = nodes[:, compat.to_dolfinx_order(how.cell, nodes.shape[1])]
        blank = cls(compat.create_mesh(comm, nodes, points, how.cell, how.degree), **options)
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
        **layout: Any,
    ) -> Self:
        """Rectangle of `length` and `width` [mm] in the plane z = 0.

        - nx, ny: rectangles along length and width, square without `ny`; pattern: how they become
          cells, one of `sheet.specimen.PATTERNS`
        - element: "P1", "P2", "P3", "Q1" or "Q2"; by default P1 or P2, see `degree` of `Blank`
        - spatial: True: free to leave its plane
        - turned: angle from x to the length [rad]; the frame is then along length and width
        - centred: True: the middle is the origin, otherwise a corner; one for each side if two are
          given; planes: {axis, 0 or 1: place [mm]} by which it is moved
        - fibre_angle, yarn_angle: from the length to yarns a (0), a `Field`, too, and from there to
          yarns b (90) [deg]. Cells along the yarns follow those in the middle.
        - slits: lines (n, 2) [mm] along which the sheet is cut, as in `Sheet`

        Raises InputError for values that are not allowed or do not fit together.
        """
        sides = POSITIVE.check("`length`", length), POSITIVE.check("`width`", width)
        turned = FINITE.check("`turned`", layout.pop("turned", 0.0))
        centred, planes = layout.pop("centred", False), layout.pop("planes", {})
        sheet = Layout(nx=nx, ny=ny, pattern=pattern, **layout)
        make = partial(sources.rectangle, sheet, sides, turned, centred, planes)
        options = sheet.options(turned)
        return cls.made(comm, make, "the specimen", spatial, options)

    @classmethod
    def outline(
        cls,
        outline: Path | str | Sequence[ArrayLike],
        *,
        nx: int = 32,
        size: float | None = None,
        pattern: str | None = None,
        layer: str | None = None,
        spatial: bool = False,
        comm: MPI.Comm = MPI.COMM_WORLD,
        **layout: Any,
    ) -> Self:
        """Sheet in the plane z = 0 within an outline with holes, of triangles.

        - outline: file name of a DXF, a CSV of x and y, or a mesh; or rings (n, 2) [mm], of which
          the largest is the outline; layer: of a DXF, or several with commas between them
        - nx, size: edges of cells along the extent in x, or their length [mm]
        - pattern: "along", cells along both yarns but for a rim of others, the default where it is
          `spatial`; or "unstructured"
        - centred: True: the middle of its extent is the origin; otherwise it lies as in the file
        - planes: axes, 0 or 1, to which planes of symmetry are perpendicular, or {axis: place} of
          those not through the origin: of an outline on both sides the positive one is meshed
        - spatial, turned, element, fibre_angle, yarn_angle, slits: as in `rectangle`

        What was left out stands in `warnings`. Raises InputError for a file that cannot be read,
        rings that bound no sheet, quadrilaterals, an outline that a plane of symmetry does not
        mirror, and values that are not allowed.
        """
        pattern = pattern or ("along" if spatial else "unstructured")
        turned = FINITE.check("`turned`", layout.pop("turned", 0.0))
        place = turned, layout.pop("centred", False), layout.pop("planes", ())
        sheet = Layout(nx=nx, pattern=pattern, **layout)
        is_file = isinstance(outline, str | os.PathLike)
        source = f"outline {outline}" if is_file else "the outline"
        make = partial(sources.outline, sheet, outline, source, size, layer, *place)
        return cls.made(comm, make, source, spatial, sheet.options(turned))

    @classmethod
    def read(
        cls,
        path: Path | str,
        *,
        spatial: bool = False,
        comm: MPI.Comm = MPI.COMM_WORLD,
        centred: bool = False,
        height: float | None = None,
        **options: Any,
    ) -> Self:
        """Blank from a mesh in mm that gmsh, PyVista or meshio reads: .msh, .inp, .bdf, .unv, .vtk,
        .vtu, .stl, .xdmf and others.

        centred: True moves the middle of its extent in x and y to the origin; height: z [mm] to
        which a flat sheet is moved, None leaves it where it is; spatial, **options: as in
        `from_arrays`. Raises InputError as that, for a file that cannot be read or has solid, mixed
        or unknown cells, and for a sheet that is not flat and has a `height`.
        """
        make = partial(sources.read_mesh, path)
        return cls.made(comm, make, str(path), spatial, options, centred, height)
