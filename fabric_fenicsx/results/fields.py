"""The fields of a scene as a time series for ParaView."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import basix
import numpy as np
import pyvista
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc
from vtkmodules.vtkCommonCore import vtkDataArray
from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

from .. import dolfinx_compat as compat
from ..mechanics.output import Fields
from ..runtime.files import replace_file
from ..scene import output as reports
from ..scene.scene import Scene
from ..sheets.blank import Blank
from ..tools.tool import Tool

# of the arrays that are there with any terms
UNITS = {
    "u": "mm",
    "yarn_coordinate_a": "mm",
    "yarn_coordinate_b": "mm",
    "rank": "-",
    "part": "-",
    "Normals": "-",
}
# how much more it counts that a line follows its yarn than that lines are evenly spaced
ALONG = 100.0
CELLS_ACROSS = 100  # of the grid that a tool's surface is found on


def yarn_coordinates(blank: Blank) -> np.ndarray:
    """Distance from the origin across the yarns a and across the yarns b [mm] at the local nodes,
    (nodes, 2): where it is constant runs a yarn of the undeformed sheet.

    For straight yarns that is exact. Curved ones get the functions whose slope along the yarns is
    nearest to 0 and, with 1 / `ALONG` of the weight, across them nearest to 1: between yarns that
    converge distances cannot stay.
    """
    mesh, comm = blank.mesh, blank.mesh.comm
    gdim = mesh.geometry.dim
    fibres = np.column_stack([f.x.array.reshape(-1, gdim) for f in (blank.a0, blank.b0)])
    low = comm.allreduce(fibres.min(0, initial=np.inf), np.minimum)
    high = comm.allreduce(fibres.max(0, initial=-np.inf), np.maximum)
    if (high - low).max() < 1e-12:
        a, b = low[:gdim], low[gdim:]
        across = np.column_stack([b - (a @ b) * a, a - (a @ b) * b])
        return blank.coordinates()[:, :gdim] @ (across / np.linalg.norm(across, axis=0))
    x, u, v = ufl.SpatialCoordinate(mesh), ufl.TrialFunction(blank.V), ufl.TestFunction(blank.V)
    lows, highs = blank.extent()
    # little enough not to bend a line
    anchor = fem.Constant(mesh, 1e-8 / (highs - lows).max() ** 2)
    bilinear, linear = anchor * ufl.inner(u, v), 0
    for k, (f, g) in enumerate([(blank.a0, blank.b0), (blank.b0, blank.a0)]):
        n = g - ufl.dot(f, g) * f
        n = n / ufl.sqrt(ufl.dot(n, n))
        along, beside = ((ufl.dot(d, ufl.grad(u[k])), ufl.dot(d, ufl.grad(v[k]))) for d in (f, n))
        bilinear += ALONG * along[0] * along[1] + beside[0] * beside[1]
        linear += beside[1] + anchor * ufl.dot(n, x) * v[k]
    A = fem_petsc.assemble_matrix(compat.form(bilinear * ufl.dx))
    A.assemble()
    b = fem_petsc.assemble_vector(compat.form(linear * ufl.dx))
    b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    solver, found = PETSc.KSP().create(comm), fem.Function(blank.V)
    solver.setOperators(A)
    solver.setType("preonly")
    solver.getPC().setType("cholesky")
    solver.getPC().setFactorSolverType("mumps")
    solver.solve(b, compat.petsc_vector(found))
    found.x.scatter_forward()
    return found.x.array.reshape(-1, gdim)[:, :2]


class FieldSeries:
    """`DIR/fields.pvd` with one unstructured grid a state and rank: undeformed geometry, in VTK's
    cells of the displacement's degree; displacement `u`, `yarn_coordinates` and the scene's nodal
    fields at the points, its cell fields on the cells, `rank`. Sheets of a stack
    and patches have a grid each, with its name, and the number `part`.

    If the sheet may touch tools, `DIR/tools.pvd` has for each state a block with the name of each
    tool, its surface where that then is. Times are load factors. Each array has its unit as VTK's
    UNITS_LABEL and, as ParaView does not show that, in the field data `units`. states: those kept
    of a run that is resumed. Each file is whole at any moment and listed after it is there. Raises
    OSError, on all ranks, that names the file which can't be written.
    """

    def __init__(self, directory: Path, scene: Scene, states: Iterable[Sequence] = ()) -> None:
        self.scene, self.blank, self.comm = scene, scene.blank, scene.comm
        self.directory = directory
        # (load, ranks with cells) of each state written
        self.states = [tuple(state) for state in states]
        self._units = dict(UNITS)
        self._tools = reports.tools(scene)
        self._parts = list(self.blank.parts.values()) or [self.blank.whole]
        extent = self.blank.extent()
        self._surfaces = (
            [triangulated(tool, *extent) for tool in self._tools] if self.comm.rank == 0 else []
        )
        cells, types, points = compat.vtk_mesh(self.blank.V)
        self._points = self._at_vtk_nodes(points)
        self._ranks = [rank for rank, n in enumerate(self.comm.allgather(len(types))) if n]
        self._grid = pyvista.UnstructuredGrid(cells, types, self._points) if len(types) else None
        yarns = self._at_vtk_nodes(yarn_coordinates(self.blank)[: len(points)])
        if self._grid:
            self._grid.cell_data["rank"] = np.full(
                self._grid.n_cells, self.comm.rank, dtype=np.int32
            )
            if self.blank.parts:
                number = np.zeros(len(types), dtype=np.int32)
                for k, part in enumerate(self._parts):
                    number[part.cells] = k
                self._grid.cell_data["part"] = number
            for name, values in zip("ab", yarns.T):
                self._grid.point_data[f"yarn_coordinate_{name}"] = values
        self._together(self._begin)

    def write(self, load: float, fields: Fields | None = None) -> None:
        """Append the scene's present state at `load`; one at the same load gives way to it.

        fields: its cell fields, if they are known already.
        """
        if self.states and self.states[-1][0] == load:
            self.states.pop()
        cells = reports.cell_fields(self.scene) if fields is None else fields
        nodes = reports.nodal_fields(self.scene, cells)
        self._units |= cells.units | nodes.units
        self._together(lambda: self._write(len(self.states), cells, nodes))
        self.states.append((load, self._ranks))
        self._together(self._list)

    def _file(self, number, rank, part):
        """Name of the file of a state, a rank and, if there are several, a part."""
        return f"{number:04d}_{rank}" + (f"_{part}" if self.blank.parts else "")

    def _at_vtk_nodes(self, values):
        """Nodal values (nodes, k) at the nodes of VTK's cells, which are evenly spaced; those of
        cubic elements are not."""
        degree = self.blank.degree
        if degree < 3:
            return values
        shape, variants = (
            getattr(basix.CellType, compat.cell_name(self.blank.mesh)),
            basix.LagrangeVariant,
        )
        ours, vtk = (
            basix.create_element(basix.ElementFamily.P, shape, degree, variant)
            for variant in (variants.gll_warped, variants.equispaced)
        )
        cells = compat.dofmap(self.blank.V)[: self.blank.mesh.topology.index_map(2).size_local]
        moved = values.copy()
        moved[cells] = np.einsum(
            "pq,cqk->cpk", ours.tabulate(0, vtk.points)[0, :, :, 0], values[cells]
        )
        return moved

    def _together(self, act):
        """Have all ranks act; what OSError any of them meets is raised on all."""
        error = None
        try:
            act()
        except OSError as e:
            error = e.errno, e.strerror, e.filename
        errors = [e for e in self.comm.allgather(error) if e]
        if errors:
            raise OSError(*errors[0])

    def _begin(self):
        """List the states kept, then remove files of others."""
        if self.comm.rank != 0:
            return
        self._list()
        for name, used in (("fields", True), ("tools", self._tools)):
            folder = self.directory / name
            for old in folder.glob("[0-9]*.vt*"):
                number = int(old.name.split("_")[0].split(".")[0])
                if number >= len(self.states) or old.suffix == ".part":
                    old.unlink()
            if used:
                folder.mkdir(exist_ok=True)

    def _write(self, number, fields, nodal):
        if self._grid:
            n = len(self._points)
            u = self._at_vtk_nodes(self.blank.nodal_displacement()[:n])
            self._grid.point_data["u"] = np.pad(u, ((0, 0), (0, 3 - u.shape[1])))
            for name, array in nodal.items():
                columns = array if array.ndim == 2 else array[:, None]
                self._grid.point_data[name] = self._at_vtk_nodes(columns)[:n].reshape(
                    n, *array.shape[1:]
                )
            for name, array in fields.items():
                self._grid.cell_data[name] = array
            for k, part in enumerate(self._parts):
                if not len(part.cells):  # VTK's writer may crash on a grid without cells
                    continue
                grid = (
                    self._grid
                    if part.is_whole
                    else with_known_fields(self._grid.extract_cells(part.cells))
                )
                path = self.directory / "fields" / f"{self._file(number, self.comm.rank, k)}.vtu"
                save(path, grid, self._units)
        for k, surface in enumerate(self._surfaces):
            moved = surface.translate(self._tools[k].displacement)
            save(self.directory / "tools" / f"{number:04d}_{k}.vtp", moved, self._units)
        if self._surfaces:  # whose blocks have names in PyVista, too
            blocks = [
                f'index="{k}" name={quoteattr(tool.name)} file="{number:04d}_{k}.vtp"'
                for k, tool in enumerate(self._tools)
            ]
            path = self.directory / "tools" / f"{number:04d}.vtm"
            replace_file(path, _list_of("vtkMultiBlockDataSet", "1.0", blocks))

    def _list(self):
        """Write the .pvd files of `states`, fields.pvd if there is one."""
        if self.comm.rank != 0:
            return
        sets: dict[str, list[str]] = {"fields.pvd": [], "tools.pvd": []}
        for i, (load, ranks) in enumerate(self.states):
            sets["fields.pvd"] += [
                f'timestep="{float(load)!r}" part="{n}"{name} '
                f'file="fields/{self._file(i, r, k)}.vtu"'
                for n, (k, name, r) in enumerate(
                    (k, f" name={quoteattr(part.name)}" if part.name else "", r)
                    for k, part in enumerate(self._parts)
                    for r in ranks
                    if (self.directory / "fields" / f"{self._file(i, r, k)}.vtu").exists()
                )
            ]
            if self._tools:
                sets["tools.pvd"].append(
                    f'timestep="{float(load)!r}" part="0" file="tools/{i:04d}.vtm"'
                )
        for name, entries in sets.items():
            if entries:
                replace_file(self.directory / name, _list_of("Collection", "0.1", entries))
            else:
                (self.directory / name).unlink(missing_ok=True)


def _list_of(kind, version, entries):
    """A file of VTK that lists others."""
    lines = "\n".join(f"<DataSet {entry}/>" for entry in entries)
    return (
        f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="{version}">\n'
        f"<{kind}>\n{lines}\n</{kind}>\n</VTKFile>\n"
    )


def triangulated(tool: Tool, low: np.ndarray, high: np.ndarray) -> pyvista.PolyData:
    """Surface of `tool`, before it is moved, around a blank from `low` to `high`
    (3,) [mm]."""
    margin = np.maximum(
        0.1 * (high - low), 0.5 * (high - low).max() * (high - low < 1e-6 * (high - low).max())
    )
    places = np.array([tool.path(load) for load in (0.0, 1.0)])
    low, high = low - margin - places.max(0), high + margin - places.min(0)
    points, normals, triangles = tool.surface.mesh(low, high, (high - low).max() / CELLS_ACROSS)
    surface = pyvista.PolyData.from_regular_faces(points.astype(np.float32), triangles)
    surface.point_data.active_normals = normals.astype(np.float32)
    surface.field_data["tool"] = [tool.name]
    return surface


def with_known_fields(grid: pyvista.UnstructuredGrid) -> pyvista.UnstructuredGrid:
    """The grid without cell fields that are NaN all over it: of vectors VTK can't read back the
    range that it writes."""
    for name, values in list(grid.cell_data.items()):
        if np.issubdtype(values.dtype, np.floating) and np.isnan(values).all():
            grid.cell_data.remove(name)
    for arrays in (grid.cell_data, grid.point_data):
        for name in set(arrays) & {"vtkOriginalCellIds", "vtkOriginalPointIds"}:
            arrays.remove(name)
    return grid


def sheets_of(
    grid: pyvista.UnstructuredGrid, names: Sequence[str]
) -> dict[str, pyvista.UnstructuredGrid]:
    """The sheets of a stack with these names {name: grid}, or without names {"": the grid}."""
    if not names:
        return {"": grid}
    number = np.asarray(grid.cell_data["part"])
    return {
        name: with_known_fields(grid.extract_cells(number == k)) for k, name in enumerate(names)
    }


def save(path: Path, data: pyvista.DataSet, known: Mapping[str, str]) -> None:
    """Write a grid or surface with the units of its arrays, out of those `known`, to `path`, whole
    or not at all; OSError naming it."""
    units = []
    for arrays in (data.point_data, data.cell_data):
        for name in arrays:
            if name in known:
                arrays.VTKObject.GetAbstractArray(name).GetInformation().Set(
                    vtkDataArray.UNITS_LABEL(), known[name]
                )
                units.append(f"{name} [{known[name]}]")
    data.field_data["units"] = units
    writer = (
        vtkXMLUnstructuredGridWriter()
        if isinstance(data, pyvista.UnstructuredGrid)
        else vtkXMLPolyDataWriter()
    )
    writer.SetInputData(data)
    # Of all that takes a fifth of zlib's time. Not VTK's raw data: ParaView 5.11 with Debian 12's
    # expat can't read it.
    writer.SetDataModeToBinary()
    writer.SetCompressorTypeToLZ4()
    # to memory first, as VTK does not say what error it met with a file
    writer.WriteToOutputStringOn()
    writer.Write()
    replace_file(path, writer.GetOutputString().encode())


def read_last(directory: Path) -> pyvista.UnstructuredGrid:
    """Last state of `DIR/fields.pvd`, as of `read_state`."""
    return read_state(directory, pyvista.PVDReader(directory / "fields.pvd").time_values[-1])


def read_state(directory: Path, load: float) -> pyvista.UnstructuredGrid:
    """The state at `load` in `DIR/fields.pvd`: one grid of all ranks' parts. A cell field that only
    some sheets have is NaN on the others."""
    reader = pyvista.PVDReader(directory / "fields.pvd")
    reader.set_active_time_value(load)
    blocks = pyvista.MultiBlock([block for block in reader.read() if block.n_cells])
    shapes = {name: np.shape(values)[1:] for b in blocks for name, values in b.cell_data.items()}
    for block in blocks:
        for name in shapes.keys() - set(block.cell_data):
            block.cell_data[name] = np.full((block.n_cells, *shapes[name]), np.nan)
    return blocks.combine()
