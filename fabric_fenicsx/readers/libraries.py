"""Readers of surface meshes that libraries bring: each has faults that others do not have.

Each takes a path and raises whatever its parsing stumbles on, `NotMine` for a file that it cannot
know.
"""

import re
from pathlib import Path
from tempfile import NamedTemporaryFile, TemporaryDirectory
from typing import Any

import numpy as np

from ..runtime.child import in_child
from ..runtime.files import ending
from .surface_mesh import OtherFormat, SurfaceMesh, surface_kind

# gmsh takes a file of another ending for a script and runs it
GMSH = (".msh", ".unv", ".bdf", ".nas", ".fem", ".dat", ".mesh", ".ply2", ".med", ".cgns", ".p3d")
XDMF = (".xdmf", ".xmf")
HDF = (*XDMF, ".med", ".cgns", ".h5m", ".e", ".exo", ".ex2")  # of numbers in HDF5
OBJ = ["v"], ["f"]  # first words of lines that count
PIXEL = 8  # VTK's type of a cell with its nodes row by row


class NotMine(Exception):
    """A file that the reader does not know by its ending."""


def by_meshio(path: Path) -> SurfaceMesh:
    """Read by meshio."""
    import meshio  # takes long to import

    if ending(path) not in meshio.extension_to_filetypes:
        raise NotMine
    # the HDF5 of DOLFINx in this process may be none that h5py can use
    is_hdf = ending(path) in HDF
    mesh = in_child(_read_by_meshio, path) if is_hdf else _read_by_meshio(path)
    data = path.read_bytes() if ending(path) == ".vtk" else b""
    told = re.search(rb"\nCELLS\s+(\d+)", data)
    if told and int(told[1]) != sum(map(len, mesh.cells)):
        raise OtherFormat(f"not all of its {int(told[1])} cells")
    blocks, others = [], {}
    for block in mesh.cells:
        if block.dim != 2:
            others[block.type] = block.dim
        elif block.type.startswith("polygon"):
            blocks += [(surface_kind(len(cell), len(cell)), cell[None]) for cell in block.data]
        else:
            blocks.append((block.type, block.data))
    return SurfaceMesh.collected(mesh.points, blocks, others)


def _read_by_meshio(path):
    """meshio's mesh; of a time series the mesh that all times share."""
    import meshio

    if ending(path) in XDMF and b"Temporal" in path.read_bytes():
        with meshio.xdmf.TimeSeriesReader(path) as series:
            return meshio.Mesh(*series.read_points_cells())
    if ending(path) == ".obj":  # without weights, colours, textures and normals
        lines = [line.split() for line in path.read_text("utf-8", "replace").splitlines()]
        plain = [words[: 4 if words[0] == "v" else None] for words in lines if words[:1] in OBJ]
        with NamedTemporaryFile("w", suffix=".obj") as file:
            file.write("\n".join(map(" ".join, plain)))
            file.flush()
            return meshio.read(file.name)
    return meshio.read(path)


def by_gmsh(path: Path) -> SurfaceMesh:
    """Read by gmsh, which some files crash."""
    if ending(path) not in GMSH:
        raise NotMine
    with open(path, "rb") as file:
        if ending(path) == ".msh" and file.read(1) != b"$":
            raise OtherFormat("no section that begins with $")
    with TemporaryDirectory() as folder:
        path, known = path.absolute(), ending(path).replace(".fem", ".bdf")
        if path.suffix != known:  # gmsh does not know OptiStruct's name, and few in capitals
            link = Path(folder) / f"mesh{known}"
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
    """Numbers and places of nodes, properties and nodes of each kind of elements, warnings."""
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


def by_pyvista(path: Path) -> SurfaceMesh:
    """Read by PyVista with VTK's own readers. Blocks are one mesh, joined where they meet."""
    if ending(path) == ".ply":  # of which VTK reads on for ever where one is cut off
        raise NotMine
    import pyvista
    from vtkmodules.util.numpy_support import vtk_to_numpy

    try:
        reader: Any = pyvista.get_reader(str(path))
    except ValueError:
        raise NotMine from None
    if hasattr(reader.reader, "SetGenerateGlobalNodeIdArray"):  # blocks of Exodus share nodes
        reader.reader.SetGenerateGlobalNodeIdArray(True)
    mesh: Any = reader.read()
    if isinstance(mesh, pyvista.MultiBlock):
        mesh = mesh.combine(merge_points=True)
    if ending(path) == ".obj":
        mesh = mesh.clean()  # VTK gives each corner a point of its own
    if isinstance(mesh, pyvista.PolyData) and mesh.n_strips:
        mesh = mesh.triangulate()
    if not isinstance(mesh, pyvista.UnstructuredGrid):
        mesh = mesh.cast_to_unstructured_grid()
    offsets = vtk_to_numpy(mesh.GetCells().GetOffsetsArray())
    types, starts, sizes = mesh.celltypes, offsets[:-1], np.diff(offsets)
    blocks, others = [], {}
    for kind, count in {*zip(types.tolist(), sizes.tolist())}:
        which = np.flatnonzero((types == kind) & (sizes == count))
        cells = mesh.cell_connectivity[starts[which][:, None] + np.arange(count)]
        first = mesh.GetCell(int(which[0]))
        if first.GetCellDimension() == 2:
            cells = cells[:, [0, 1, 3, 2]] if kind == PIXEL else cells
            blocks.append((surface_kind(first.GetNumberOfEdges(), count), cells))
        else:
            name = first.GetClassName().removeprefix("vtk").lower()
            others[name] = first.GetCellDimension()
    return SurfaceMesh.collected(mesh.points, blocks, others)
