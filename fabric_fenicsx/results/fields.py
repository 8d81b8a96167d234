"""Fields of a membrane, as means over its cells, and their time series for ParaView."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
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
from ..blank import Blank
from ..material import stability
from ..mechanics.contact import Contact
from ..mechanics.membrane import Membrane
from ..running import replace
from ..scene import Scene

UNITS = {
    "u": "mm", "yarn_coordinate_a": "mm", "yarn_coordinate_b": "mm",
    "contact_traction": "MPa", "contact_pressure": "MPa", "contact_gap": "mm",
    "a": "-", "b": "-", "eps_a": "-", "eps_b": "-", "log_eps_11": "-", "log_eps_22": "-", "shear_angle": "rad",
    "I4": "-", "I6": "-", "I8": "-", "I10": "rad", "strain_state": "-", "rank": "-", "Normals": "-",
    "energy_a": "N mm/mm^3", "energy_b": "N mm/mm^3", "energy_shear": "N mm/mm^3", "sigma_a": "MPa", "sigma_b": "MPa",
    "stability_convexity": "-", "stability_ellipticity": "-",
}  # fmt: skip
ALONG = 100.0  # how much more it counts that a line follows its yarn than that lines are evenly spaced
CELLS_ACROSS = 100  # of the grid that a tool's surface is found on


def cell_fields(membrane: Membrane) -> tuple[dict[str, np.ndarray], float]:
    """Fields on this rank's owned cells, {name: array (cells,) or (cells, 3)}, and the kernel's mismatch there.

    a, b: deformed fibres [-]; eps_a, eps_b: nominal, log_eps_11, log_eps_22: logarithmic fibre strains [-];
    shear_angle [rad]; I4, I6, I8, I10; energy_a, energy_b, energy_shear [N mm/mm3]; strain_state 1..4, eq. (13);
    sigma_a, sigma_b: Cauchy stress along the deformed fibres [MPa]; stability_convexity, stability_ellipticity: the smallest
    indicators of a cell's points [-], 1 at rest and negative where the law itself allows a band, see `material.stability`.
    """
    state, fa, fb, mismatch = membrane.state()
    weights = membrane.weights

    def mean(values):
        return np.einsum("q,cq...->c...", weights, values)

    I4, I6, I8, I10 = np.moveaxis(state.invariants, -1, 0)
    parts = mean(state.energy_parts)
    fields = {"a": mean(fa), "b": mean(fb)}
    fields |= {"eps_a": mean(np.sqrt(I4) - 1), "eps_b": mean(np.sqrt(I8) - 1)}
    fields |= {"log_eps_11": mean(np.log(I4)) / 2, "log_eps_22": mean(np.log(I8)) / 2, "shear_angle": mean(I10)}
    fields |= {"I4": mean(I4), "I6": mean(I6), "I8": mean(I8), "I10": fields["shear_angle"]}
    fields |= {"energy_a": parts[:, 0], "energy_b": parts[:, 1], "energy_shear": parts[:, 2]}
    fields["strain_state"] = (1 + (fields["eps_b"] <= 0) + 2 * (fields["eps_a"] <= 0)).astype(np.int32)
    for name, f, I in (("sigma_a", fa, I4), ("sigma_b", fb, I8)):
        fields[name] = mean(np.einsum("cqi,cqij,cqj->cq", f, state.cauchy, f) / I)
    stable = stability.evaluate(membrane.fabric, state.invariants)
    fields |= {"stability_convexity": stable.convexity.min(1), "stability_ellipticity": stable.ellipticity.min(1)}
    return fields, mismatch


def watched(membrane: Membrane) -> tuple[float, np.ndarray]:
    """What a run watches on this rank: the least ellipticity indicator of all points, inf without cells, and each owned
    cell's larger mean nominal strain of its two yarns (cells,). A third of the cost of `cell_fields`."""
    F, b, _ = membrane.at_points()
    fa, fb = F[..., 0], F[..., 0] * b[..., :1] + F[..., 1] * b[..., 1:]
    I4, I6, I8 = (np.einsum("cqi,cqi->cq", x, y) for x, y in ((fa, fa), (fa, fb), (fb, fb)))
    gamma = np.arctan2(I6, np.sqrt(I4 * I8 - I6 * I6))
    if membrane.weave_angle is None:
        gamma -= np.arctan2(b[..., 0], b[..., 1])
    else:
        gamma -= np.pi / 2 - membrane.weave_angle
    least = stability.least_ellipticity(membrane.fabric, np.stack([I4, I6, I8, gamma], -1))
    return least, np.sqrt(np.maximum(I4 @ membrane.weights, I8 @ membrane.weights)) - 1


def nodal_fields(scene: Scene) -> dict[str, np.ndarray]:
    """Contact of this rank's local nodes with all tools, {} without: traction (nodes, 3) and its size, pressure [MPa], and
    gap [mm] from the ply's face to the nearest tool, negative where that is penetrated."""
    contacts = [term for term in scene.terms if isinstance(term, Contact)]
    if not contacts:
        return {}
    values = fem.Function(scene.blank.V)

    def with_ghosts(owned):
        values.x.array[: owned.size] = owned.ravel()
        values.x.scatter_forward()
        return values.x.array.reshape(-1, 3).copy()

    x = contacts[0].nodes.places + contacts[0].nodes.displacement()
    gap = np.full(len(x), np.inf)
    for term in contacts:
        to_tool = term.tool.evaluate(x).gap
        lost = np.isnan(to_tool)  # so far off that no nearest point is found: a lower bound will do
        to_tool[lost] = term.tool.evaluate(x[lost], reach=0.0).gap
        gap = np.minimum(gap, to_tool - term.thickness / 2)
    traction = with_ghosts(sum(term.tractions() for term in contacts))
    gap = with_ghosts(np.repeat(gap, 3))[:, 0]
    return {"contact_traction": traction, "contact_pressure": np.linalg.norm(traction, axis=1), "contact_gap": gap}


def yarn_coordinates(blank: Blank) -> np.ndarray:
    """Distance from the origin across the yarns a and across the yarns b [mm] at the local nodes, (nodes, 2): where it is
    constant runs a yarn of the undeformed sheet.

    For straight yarns that is exact. Curved ones get the functions whose slope along the yarns is nearest to 0 and, with
    1 / `ALONG` of the weight, across them nearest to 1: between yarns that converge distances cannot stay.
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
    anchor = fem.Constant(mesh, 1e-8 / (highs - lows).max() ** 2)  # little enough not to bend a line
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
    """`DIR/fields.pvd` with one unstructured grid a state and rank: undeformed geometry, in VTK's cells of the
    displacement's degree; displacement `u` and `yarn_coordinates` at the points, `cell_fields` on the cells, `rank`.

    terms: of the scene; if there are contacts among them, `DIR/tools.pvd` has a surface a state and tool, where that then is.
    Times are load factors. Each array has its unit as VTK's UNITS_LABEL and, as ParaView does not show that, in the
    field data `units`. states: those kept of a run that is resumed. Each file is whole at any moment and listed after
    it is there. Raises OSError, on all ranks, that names the file which can't be written.
    """

    def __init__(self, directory: Path, membrane: Membrane, states: Iterable[Sequence] = (), terms: Iterable[Any] = ()) -> None:  # fmt: skip
        self.membrane, self.blank = membrane, membrane.blank
        self.comm = self.blank.mesh.comm
        self.directory = directory
        self.states = [tuple(state) for state in states]  # (load, ranks with cells) of each state written
        self._tools = list(dict.fromkeys(term.tool for term in terms if isinstance(term, Contact)))
        extent = self.blank.extent()
        self._surfaces = [_triangulated(tool, *extent) for tool in self._tools] if self.comm.rank == 0 else []
        cells, types, points = compat.vtk_mesh(self.blank.V)
        self._points = self._at_vtk_nodes(points)
        self._ranks = [rank for rank, n in enumerate(self.comm.allgather(len(types))) if n]
        self._grid = pyvista.UnstructuredGrid(cells, types, self._points) if len(types) else None
        yarns = self._at_vtk_nodes(yarn_coordinates(self.blank)[: len(points)])
        if self._grid:
            self._grid.cell_data["rank"] = np.full(self._grid.n_cells, self.comm.rank, dtype=np.int32)
            for name, values in zip("ab", yarns.T):
                self._grid.point_data[f"yarn_coordinate_{name}"] = values
        self._together(self._begin)

    def write(self, load: float, fields: Mapping[str, np.ndarray], nodal: Mapping[str, np.ndarray] | None = None) -> None:  # fmt: skip
        """Append the state at `load` with its `cell_fields` and `nodal_fields`; one at the same load gives way to it."""
        if self.states and self.states[-1][0] == load:
            self.states.pop()
        self._together(lambda: self._write(len(self.states), fields, nodal or {}))
        self.states.append((load, self._ranks))
        self._together(self._list)

    def _at_vtk_nodes(self, values):
        """Nodal values (nodes, k) at the nodes of VTK's cells, which are evenly spaced; those of cubic elements are not."""
        degree = self.blank.degree
        if degree < 3:
            return values
        shape, variants = getattr(basix.CellType, compat.cell_name(self.blank.mesh)), basix.LagrangeVariant
        ours, vtk = (basix.create_element(basix.ElementFamily.P, shape, degree, v) for v in (variants.gll_warped, variants.equispaced))  # fmt: skip
        cells = compat.dofmap(self.blank.V)[: self.blank.mesh.topology.index_map(2).size_local]
        moved = values.copy()
        moved[cells] = np.einsum("pq,cqk->cpk", ours.tabulate(0, vtk.points)[0, :, :, 0], values[cells])
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
            for old in folder.glob("[0-9]*_*.vt*"):
                if int(old.name.split("_")[0]) >= len(self.states) or old.suffix == ".part":
                    old.unlink()
            if used:
                folder.mkdir(exist_ok=True)

    def _write(self, number, fields, nodal):
        if self._grid:
            n = len(self._points)
            u = self._at_vtk_nodes(self.blank.nodal_displacement()[:n])
            self._grid.point_data["u"] = np.pad(u, ((0, 0), (0, 3 - u.shape[1])))
            for name, array in nodal.items():
                self._grid.point_data[name] = array[:n]
            for name, array in fields.items():
                self._grid.cell_data[name] = array
            _save(self.directory / "fields" / f"{number:04d}_{self.comm.rank}.vtu", self._grid)
        for k, surface in enumerate(self._surfaces):
            moved = surface.translate(self._tools[k].displacement)
            _save(self.directory / "tools" / f"{number:04d}_{k}.vtp", moved)

    def _list(self):
        """Write the .pvd files of `states`, fields.pvd if there is one."""
        if self.comm.rank != 0:
            return
        sets: dict[str, list[str]] = {"fields.pvd": [], "tools.pvd": []}
        for i, (load, ranks) in enumerate(self.states):
            sets["fields.pvd"] += [
                f'timestep="{float(load)!r}" part="{r}" file="fields/{i:04d}_{r}.vtu"' for r in ranks
            ]
            sets["tools.pvd"] += [f'timestep="{float(load)!r}" part="{k}" name={quoteattr(tool.name)} file="tools/{i:04d}_{k}.vtp"' for k, tool in enumerate(self._tools)]  # fmt: skip
        for name, entries in sets.items():
            if entries:
                lines = "\n".join(f"<DataSet {entry}/>" for entry in entries)
                text = f'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n{lines}\n</Collection>\n</VTKFile>\n'
                replace(self.directory / name, text.encode())
            else:
                (self.directory / name).unlink(missing_ok=True)


def _triangulated(tool, low, high):
    """Surface [pyvista.PolyData] of `tool`, before it is moved, around a blank from `low` to `high` (3,) [mm]."""
    margin = np.maximum(0.1 * (high - low), 0.5 * (high - low).max() * (high - low < 1e-6 * (high - low).max()))
    places = np.array([tool.path(load) for load in (0.0, 1.0)])
    low, high = low - margin - places.max(0), high + margin - places.min(0)
    points, normals, triangles = tool.surface.mesh(low, high, (high - low).max() / CELLS_ACROSS)
    surface = pyvista.PolyData.from_regular_faces(points.astype(np.float32), triangles)
    surface.point_data.active_normals = normals.astype(np.float32)
    surface.field_data["tool"] = [tool.name]
    return surface


def _save(path, data):
    """Write a grid or surface with the units of its arrays to `path`, whole or not at all; OSError naming it."""
    units = []
    for arrays in (data.point_data, data.cell_data):
        for name in arrays:
            if name in UNITS:
                arrays.VTKObject.GetAbstractArray(name).GetInformation().Set(vtkDataArray.UNITS_LABEL(), UNITS[name])
                units.append(f"{name} [{UNITS[name]}]")
    data.field_data["units"] = units
    writer = vtkXMLUnstructuredGridWriter() if isinstance(data, pyvista.UnstructuredGrid) else vtkXMLPolyDataWriter()
    writer.SetInputData(data)
    # Of all that takes a fifth of zlib's time. Not VTK's raw data: ParaView 5.11 with Debian 12's expat can't read it.
    writer.SetDataModeToBinary()
    writer.SetCompressorTypeToLZ4()
    # to memory first, as VTK does not say what error it met with a file
    writer.WriteToOutputStringOn()
    writer.Write()
    replace(path, writer.GetOutputString().encode())


def read_last(directory: Path) -> pyvista.UnstructuredGrid:
    """Last state of `DIR/fields.pvd`: one grid [pyvista.UnstructuredGrid] of all ranks' parts."""
    reader = pyvista.PVDReader(directory / "fields.pvd")
    reader.set_active_time_value(reader.time_values[-1])
    return reader.read().combine()
