"""Readers of surface meshes that libraries bring: each has faults that others do not have.

Each takes a path and raises whatever its parsing stumbles on, `NotMine` for a file that it cannot
know.
"""

import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ..runtime.child import in_child
from .surface_mesh import OtherFormat, SurfaceMesh, surface_kind

# gmsh takes a file of another ending for a script and runs it
GMSH = (".msh", ".unv", ".bdf", ".nas", ".fem", ".dat", ".mesh", ".ply2", ".med", ".cgns", ".p3d")
XDMF = (".xdmf", ".xmf")
# of VTK's types of cells, with the number of corners
CORNERS = {5: 3, 9: 4, 22: 3, 23: 4, 28: 4, 34: 3, 69: 3, 70: 4}
POLYGON, STRIP, PIXEL = 7, 6, 8


class NotMine(Exception):
    """A file that the reader does not know by its ending."""


def by_meshio(path: Path) -> SurfaceMesh:
    """Read by meshio."""
    import meshio  # takes long to import

    if path.suffix.lower() not in meshio.extension_to_filetypes:
        raise NotMine
    mesh = meshio.read(path)
    data = path.read_bytes() if path.suffix.lower() == ".vtk" else b""
    told = re.search(rb"\nCELLS\s+(\d+)", data)
    if told and int(told[1]) != sum(map(len, mesh.cells)):
        raise OtherFormat(f"not all of its {int(told[1])} cells")
    blocks, others = [], {}
    for block in mesh.cells:
        if block.dim != 2:
            others[block.type] = block.dim
        elif block.type.startswith("polygon"):
            blocks += [_polygon(np.atleast_2d(cell)) for cell in block.data]
        else:
            blocks.append((block.type, block.data))
    return SurfaceMesh.collected(mesh.points, blocks, others)


def by_gmsh(path: Path) -> SurfaceMesh:
    """Read by gmsh, which some files crash."""
    if path.suffix.lower() not in GMSH:
        raise NotMine
    with open(path, "rb") as file:
        if path.suffix.lower() == ".msh" and file.read(1) != b"$":
            raise OtherFormat("no section that begins with $")
    with TemporaryDirectory() as folder:
        path = path.absolute()
        if path.suffix.lower() == ".fem":  # OptiStruct's name for .bdf
            link = Path(folder) / "deck.bdf"
            link.symlink_to(path)
            path = link
        numbers, x, found, warnings = in_child(_merged_by_gmsh, str(path))
    print(*warnings, sep="\n")
    order = np.argsort(numbers)
    blocks, others = [], {}
    for (name, dim, _, count, *_), nodes in found:
        if dim == 2:
            kind = surface_kind(3 if name.startswith("Tri") else 4, count)
            at = order[np.searchsorted(numbers, nodes, sorter=order)]
            blocks.append((kind, at.reshape(-1, count)))
        else:
            others[name.lower()] = dim
    return SurfaceMesh.collected(x.reshape(-1, 3), blocks, others)


def _merged_by_gmsh(path):
    """Numbers and places of the nodes in a file, properties and nodes of each kind of elements, and
    lines of warnings."""
    import gmsh

    gmsh.initialize(readConfigFiles=False)
    gmsh.logger.start()
    gmsh.merge(path)
    numbers, x, _ = gmsh.model.mesh.getNodes()
    found = [
        (gmsh.model.mesh.getElementProperties(kind), np.asarray(nodes, dtype=np.int64))
        for kind, _, nodes in zip(*gmsh.model.mesh.getElements())
    ]
    return numbers, x, found, [line for line in gmsh.logger.get() if line.startswith("Warning")]


def by_dolfinx(path: Path) -> SurfaceMesh:
    """Read by DOLFINx, which needs no h5py for the .h5 file beside its XDMF."""
    if path.suffix.lower() not in XDMF:
        raise NotMine
    import dolfinx
    from mpi4py import MPI

    from .. import dolfinx_compat as compat

    text = path.read_text(errors="replace")
    name = re.search(r"<Grid[^>]*\bName=\"([^\"]*)\"", text)
    where = (name[1] if name else "mesh", "/Xdmf/Domain")
    kinds = dolfinx.io.XDMFFile.Encoding
    encoding = kinds.HDF5 if 'Format="HDF"' in text else kinds.ASCII
    with dolfinx.io.XDMFFile(MPI.COMM_SELF, str(path), "r", encoding) as file:
        cell, _ = file.read_cell_type(*where)
        cells, x = file.read_topology_data(*where), file.read_geometry_data(*where)
    corners = {"triangle": 3, "quadrilateral": 4}.get(cell.name)
    if not corners:
        dim = dolfinx.cpp.mesh.cell_dim(cell)
        return SurfaceMesh.collected(x, [], {cell.name: dim})
    ordered = np.empty_like(cells)
    ordered[:, compat.to_dolfinx_order(cell.name, cells.shape[1])] = cells
    if cells.shape[1] == 3 and x.shape[1] == 2:  # DOLFINx' triangles turn either way round
        edges = x[ordered[:, 1:]] - x[ordered[:, :1]]
        back = np.linalg.det(edges) < 0
        ordered[back] = ordered[back][:, [0, 2, 1]]
    return SurfaceMesh.collected(x, [(surface_kind(corners, cells.shape[1]), ordered)], {})


def by_pyvista(path: Path) -> SurfaceMesh:
    """Read by PyVista with VTK's own readers, of one mesh or of several blocks."""
    if path.suffix.lower() == ".ply":  # of which VTK reads on for ever where one is cut off
        raise NotMine
    import pyvista
    from vtkmodules.util.numpy_support import vtk_to_numpy

    try:
        reader = pyvista.get_reader(str(path))
    except ValueError:
        raise NotMine from None
    mesh: Any = reader.read()
    if isinstance(mesh, pyvista.MultiBlock):
        mesh = mesh.combine()
    if path.suffix.lower() == ".obj":
        mesh = mesh.clean()  # VTK gives each corner a point of its own
    if isinstance(mesh, pyvista.PolyData) and mesh.n_strips:
        mesh = mesh.triangulate()
    if not isinstance(mesh, pyvista.UnstructuredGrid):
        mesh = mesh.cast_to_unstructured_grid()
    types, nodes = mesh.celltypes, mesh.cell_connectivity
    offsets = vtk_to_numpy(mesh.GetCells().GetOffsetsArray())
    ends, sizes = offsets[1:], np.diff(offsets)
    blocks, others = [], {}
    for kind, count in {*zip(types.tolist(), sizes.tolist())}:
        which = np.flatnonzero((types == kind) & (sizes == count))
        first = mesh.GetCell(int(which[0]))
        name = first.GetClassName().removeprefix("vtk").lower()
        if first.GetCellDimension() != 2:
            others[name] = first.GetCellDimension()
        else:
            blocks.append(_of_vtk(kind, name, nodes[ends[which][:, None] + np.arange(-count, 0)]))
    return SurfaceMesh.collected(mesh.points, blocks, others)


def _of_vtk(kind, name, cells):
    """Cells (m, k) of one of VTK's types, with meshio's name if there is one."""
    if kind == PIXEL:
        return "quad", cells[:, [0, 1, 3, 2]]
    if kind == POLYGON:
        return _polygon(cells)
    if corners := CORNERS.get(kind):
        return surface_kind(corners, cells.shape[1]), cells
    return name, cells


def _polygon(cells):
    count = cells.shape[1]
    return (surface_kind(count, count) if count in (3, 4) else f"polygon{count}"), cells
