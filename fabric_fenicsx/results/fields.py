"""The fields of a scene as a time series for ParaView."""

from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path
from xml.sax.saxutils import quoteattr

import basix
import lazy_loader
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..core.collective_errors import on_all, on_root
from ..core.files import replace_file
from ..energy.output import Fields
from ..scene import output
from ..scene.scene import Scene
from ..sheet.blank import Blank
from .measures import planes_of_symmetry
from .ply import Grid, mark_planes, plain_grid, set_arrays
from .states import save, triangulated, with_known_fields

pyvista = lazy_loader.load("pyvista")


def yarn_coordinates(blank: Blank) -> np.ndarray:
    """Distance from the origin across the yarns a and across the yarns b [mm] at the local nodes,
    (nodes, 2): where it is constant runs a yarn of the undeformed sheet. For straight yarns that is
    exact. Curved ones get the functions whose slope along the yarns is nearest to 0 and, with a
    weight of 1 %, across them nearest to 1: between yarns that converge distances cannot stay."""
    mesh, comm = blank.mesh, blank.mesh.comm
    gdim = mesh.geometry.dim
    if blank.whole.straight:
        a, b = np.array(blank.whole.straight)
        across = np.column_stack([b - (a @ b) * a, a - (a @ b) * b])
        return blank.coordinates()[:, :gdim] @ (across / np.linalg.norm(across, axis=0))
    x, u, v = ufl.SpatialCoordinate(mesh), ufl.TrialFunction(blank.V), ufl.TestFunction(blank.V)
    # little enough not to bend a line
    anchor = fem.Constant(mesh, 1e-8 / blank.sides().max() ** 2)
    bilinear, linear = anchor * ufl.inner(u, v), 0
    for k, (f, g) in enumerate([(blank.a0, blank.b0), (blank.b0, blank.a0)]):
        n = g - ufl.dot(f, g) * f
        n = n / ufl.sqrt(ufl.dot(n, n))
        along, beside = ((ufl.dot(d, ufl.grad(u[k])), ufl.dot(d, ufl.grad(v[k]))) for d in (f, n))
        bilinear += 100 * along[0] * along[1] + beside[0] * beside[1]
        linear += beside[1] + anchor * ufl.dot(n, x) * v[k]
    A = fem_petsc.assemble_matrix(compat.form(bilinear * ufl.dx))
    A.assemble()
    b = fem_petsc.assemble_vector(compat.form(linear * ufl.dx))
    b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    solver, distances = PETSc.KSP().create(comm), fem.Function(blank.V)
    solver.setOperators(A)
    solver.setType("preonly")
    solver.getPC().setType("cholesky")
    solver.getPC().setFactorSolverType("mumps")
    solver.solve(b, compat.petsc_vector(distances))
    distances.x.scatter_forward()
    return distances.x.array.reshape(-1, gdim)[:, :2]


class FieldSeries:
    """`DIR/fields.pvd` with one unstructured grid a state and rank: undeformed geometry, in VTK's
    cells of the displacement's degree, `u`, `yarn_coordinates` and the scene's fields, `rank`. Each
    sheet of a stack and each patch has a grid with its name, and the number `part`. If tools may
    touch, `DIR/tools.pvd` has a block with the name and surface of each tool where that then is.

    Times are load factors. The name of each array ends with its unit, see `states.save`; the field
    data have planes of symmetry. states: those kept of a run that is resumed. Each file is whole at
    any moment and listed after it is there. Raises InputError, on all ranks, for a file that can't
    be written.
    """

    def __init__(self, directory: Path, scene: Scene, states: Iterable[Sequence] = ()) -> None:
        self.scene, self.blank, self.comm = scene, scene.blank, scene.comm
        self.directory = directory
        # (load, ranks with cells) of each state written
        self.states = [tuple(state) for state in states]
        self._units = dict.fromkeys(("u", "yarn_coordinate_a", "yarn_coordinate_b"), "mm")
        self._units |= dict.fromkeys(("rank", "part", "Normals"), "-")
        self._tools = output.tools(scene)
        self._parts = list(self.blank.parts.values()) or [self.blank.whole]
        extent, tools = self.blank.extent(), self._tools if self.comm.rank == 0 else []
        self._surfaces = [triangulated(tool, *extent) for tool in tools]
        cells, types, points = compat.vtk_mesh(self.blank.V)
        self._ranks = [rank for rank, n in enumerate(self.comm.allgather(len(types))) if n]
        yarns = yarn_coordinates(self.blank)
        self._planes = planes_of_symmetry(scene)
        self._grid: Grid | None = None
        if len(types):
            self._grid = plain_grid(cells, types, self._at_vtk_nodes(points))
            numbers = {"rank": np.full(len(types), self.comm.rank, dtype=np.int32)}
            if self.blank.parts:
                numbers["part"] = np.zeros(len(types), dtype=np.int32)
                for k, part in enumerate(self._parts):
                    numbers["part"][part.cells] = k
            set_arrays(self._grid.GetCellData(), numbers)
            across = {f"yarn_coordinate_{k}": x for k, x in zip("ab", yarns.T)}
            self._set_points(self._grid, across)
        on_root(self.comm, self._begin)

    def write(self, load: float, fields: Fields | None = None) -> None:
        """Append the scene's present state at `load`, instead of one at that load; fields: its
        cell fields, if they are known already."""
        if self.states and self.states[-1][0] == load:
            self.states.pop()
        cells = output.cell_fields(self.scene) if fields is None else fields
        nodes = output.nodal_fields(self.scene, cells)
        self._units |= cells.units | nodes.units
        on_all(self.comm, lambda: self._write(len(self.states), cells, nodes))
        self.states.append((load, self._ranks))
        on_root(self.comm, self._list)

    def _file(self, number, rank, part):
        return f"fields/{number:04d}_{rank}" + (f"_{part}" if self.blank.parts else "") + ".vtu"

    def _at_vtk_nodes(self, values):
        """Nodal values (nodes, k) at VTK's nodes, evenly spaced; cubic elements' are not."""
        degree, variants = self.blank.degree, basix.LagrangeVariant
        if degree < 3:
            return values
        shape = getattr(basix.CellType, compat.cell_name(self.blank.mesh))
        kinds = basix.ElementFamily.P, shape, degree
        ours = basix.create_element(*kinds, variants.gll_warped)
        vtk = basix.create_element(*kinds, variants.equispaced)
        cells = compat.dofmap(self.blank.V)[: self.blank.mesh.topology.index_map(2).size_local]
        at, moved = ours.tabulate(0, vtk.points)[0, :, :, 0], values.copy()
        moved[cells] = np.einsum("pq,cqk->cpk", at, values[cells])
        return moved

    def _set_points(self, grid, fields):
        n = grid.GetNumberOfPoints()
        for name, values in fields.items():
            columns = self._at_vtk_nodes(values.reshape(len(values), -1))
            set_arrays(grid.GetPointData(), {name: columns[:n].reshape(n, *values.shape[1:])})

    def _begin(self):
        """List the states kept, then remove files of others."""
        self._list()
        for name, is_used in (("fields", True), ("tools", self._tools)):
            folder = self.directory / name
            for old in folder.glob("[0-9]*.vt*"):
                number = int(old.name.split("_")[0].split(".")[0])
                if number >= len(self.states) or old.suffix == ".part":
                    old.unlink()
            if is_used:
                folder.mkdir(exist_ok=True)

    def _write(self, number, fields, nodal):
        if self._grid:
            u = self.blank.nodal_displacement()
            nodal["u"] = np.pad(u, ((0, 0), (0, 3 - u.shape[1])))
            self._set_points(self._grid, nodal)
            set_arrays(self._grid.GetCellData(), fields)
            for k, part in enumerate(self._parts):
                if not len(part.cells):  # VTK's writer may crash on a grid without cells
                    continue
                grid = self._grid
                if not part.is_whole:
                    grid = with_known_fields(pyvista.wrap(grid).extract_cells(part.cells))
                mark_planes(grid, self._planes)
                save(self.directory / self._file(number, self.comm.rank, k), grid, self._units)
        if not self._surfaces:
            return
        blocks = []  # which have names in PyVista, too
        for k, (tool, surface) in enumerate(zip(self._tools, self._surfaces)):
            file = f"{number:04d}_{k}.vtp"
            save(self.directory / "tools" / file, surface.translate(tool.displacement), self._units)
            blocks.append(f'index="{k}" name={quoteattr(tool.name)} file="{file}"')
        path = self.directory / "tools" / f"{number:04d}.vtm"
        replace_file(path, _list_of("vtkMultiBlockDataSet", "1.0", blocks))

    def _list(self):
        """Write the .pvd files of `states`, each if there is one."""
        listed: dict[str, list[str]] = {"fields.pvd": [], "tools.pvd": []}
        for i, (load, ranks) in enumerate(self.states):
            at = f'timestep="{float(load)!r}"'
            for n, ((k, part), rank) in enumerate(product(enumerate(self._parts), ranks)):
                file = self._file(i, rank, k)
                if (self.directory / file).exists():
                    name = f" name={quoteattr(part.name)}" if part.name else ""
                    listed["fields.pvd"].append(f'{at} part="{n}"{name} file="{file}"')
            if self._tools:
                listed["tools.pvd"].append(f'{at} part="0" file="tools/{i:04d}.vtm"')
        for path, entries in listed.items():
            if entries:
                replace_file(self.directory / path, _list_of("Collection", "0.1", entries))
            else:
                (self.directory / path).unlink(missing_ok=True)


def _list_of(kind, version, entries):
    lines = "\n".join(f"<DataSet {entry}/>" for entry in entries)
    return (
        f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="{version}">\n'
        f"<{kind}>\n{lines}\n</{kind}>\n</VTKFile>\n"
    )
