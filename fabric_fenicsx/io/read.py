"""The surface mesh in a file, by the one library that reads its format, in a process of its own:
libraries print, exit, crash, and change the locale."""

import re
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from ..core.errors import InputError
from ..core.files import check_file, ending
from ..core.processes import in_child
from .abaqus import read_abaqus

READ = "a mesh that gmsh, PyVista or meshio reads"
NASTRAN = ".bdf", ".nas", ".dat", ".fem"
GMSH = ".unv", ".ply2", ".p3d", *NASTRAN
# how whole files end, which libraries read without a word where they are cut off
ENDS = {
    (".step", ".stp"): rb"END-ISO-10303-21\s*;",
    (".iges", ".igs"): rb"T *\d+\s*$",
    (".brep",): rb"\n[+-]\d+ \d+\s*$",
    (".unv",): rb"\n *-1\s*$",
    (".obj", ".ply2"): rb"\n$",
    NASTRAN: rb"\n$|ENDDATA\s*$",
}


class SurfaceMesh(NamedTuple):
    """A mesh in a file: points (n, 3) [mm]; surface cells (m, k) by meshio's name of their kind, as
    triangle, quad9 or polygon5, in gmsh's order of nodes; other kinds with their dimension."""

    points: np.ndarray
    cells: dict[str, np.ndarray]
    others: dict[str, int]


def read_surface_mesh(path: Path, what: str, allowed: str = READ) -> SurfaceMesh:
    """The mesh in a file, with surface cells, each once; `what` and `allowed` are words of
    errors."""
    check_file(path, what, allowed)
    check_end(path, what)
    kind = ending(path)
    own = {".stl": _stl, ".inp": read_abaqus, ".obj": _obj}.get(kind)
    # gmsh would run a .msh that does not begin with $, as those of Ansys, as a script
    is_gmsh = path.read_bytes().startswith(b"$") if kind == ".msh" else kind in GMSH
    is_vtk = re.fullmatch(r"\.(vt\w+|pv\w+|e|exo|ex2)", kind)
    library = _by_gmsh if is_gmsh else _by_pyvista if is_vtk else _by_meshio
    try:
        points, blocks, others = own(path) if own else in_child(library, path.absolute())
    except (RuntimeError, ValueError, OSError) as error:
        raise InputError(
            f"{what} {path} cannot be read as {kind or 'a mesh'} ({error}); expected {allowed}"
        ) from None
    parts: dict[str, list[np.ndarray]] = {}
    for corners, nodes in (block for block in blocks if len(block[1])):
        name, count = {3: "triangle", 4: "quad"}.get(corners, f"polygon{corners}"), nodes.shape[1]
        parts.setdefault(name if count == corners else f"{name}{count}", []).append(nodes)
    flaw, x, cells = "", np.pad(points, ((0, 0), (0, 3 - np.shape(points)[1]))).astype(float), {}
    for name, each in parts.items():
        nodes = np.concatenate(each).astype(np.int64)
        cells[name] = nodes[np.sort(np.unique(nodes, axis=0, return_index=True)[1])]
        if nodes.min() < 0 or nodes.max() >= len(x):
            flaw = "lacks nodes of its cells; expected a whole file"
    if not cells:
        flaw = f"holds no surface cells, but {sorted(others) or 'nodes alone'}; expected "
        flaw += f"{allowed}, with triangles or quadrilaterals"
    if flaw:
        raise InputError(f"{what} {path} {flaw}")
    return SurfaceMesh(x, cells, others)


def check_end(path: Path, what: str) -> None:
    """InputError for a file that ends before its format does; `what` it is, in words."""
    end = next((end for endings, end in ENDS.items() if ending(path) in endings), b"")
    if not re.search(end, path.read_bytes()[-1000:], re.IGNORECASE):
        flaw = f"does not end as {path.suffix} files do: it is cut off, or of another format"
        raise InputError(f"{what} {path} {flaw}; expected a whole file")


# Readers give points (n, 2 or 3), numbers of corners and nodes (m, k) of surface cells in blocks,
# and {kind: dimension} of others. They raise ValueError with the reason, and libraries in them
# whatever their parsing stumbles on.


def _stl(path):
    """Triangles as they are met, which no library reads: binary ones that begin with "solid" or end
    in further bytes, text with capitals, tabs, decimal commas. Corners at one place are one
    point."""
    data = path.read_bytes()
    header, facet = 84, 50  # bytes; a facet is its normal, three corners and two bytes
    count = int.from_bytes(data[header - 4 : header], "little")
    if count and len(data) >= header + facet * count:
        more, rest = (len(data) - header) // facet - count, data[header + facet * count :]
        if more and any(rest):
            raise ValueError(f"its header declares {count} triangles, but it has {count + more}")
        rows = np.frombuffer(data, np.dtype([("x", "<f4", (4, 3)), ("-", "<u2")]), count, header)
        corners = rows["x"][:, 1:].reshape(-1, 3).astype(float)
    else:
        facets = len(re.findall(rb"(?<!\S)facet\s+normal(?!\S)", data, re.IGNORECASE))
        if b"\0" in data and not facets:
            held = f"holds {len(data) - header} bytes of them: cut off"
            raise ValueError(f"it declares {count} triangles and {held}")
        vertices = re.findall(rb"(?<!\S)vertex\s+(\S+)\s+(\S+)\s+(\S+)", data, re.IGNORECASE)
        # letters in which a text ends
        if not facets or len(vertices) != 3 * facets or b"endsolid" not in data[-1000:].lower():
            found = f"{len(vertices)} vertices in {facets} facets"
            raise ValueError(f"it has {found}, or no `endsolid`")
        spelled = bytes.maketrans(b",dD", b".ee")  # decimal commas, exponents of Fortran
        corners = np.array([[word.translate(spelled) for word in x] for x in vertices], float)
    points, number = np.unique(corners, axis=0, return_inverse=True)
    return points, [(3, number.reshape(-1, 3))], {}


def _obj(path):
    """Points and faces, without weights, textures and normals, in which libraries stumble."""
    points, blocks = [], []
    for line in path.read_text("utf-8", "replace").splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            points.append([*map(float, rest[:3])])
        elif word == "f":  # of numbers from 1, or back from the last point
            numbers = [int(each.split("/")[0]) for each in rest]
            cell = [n - 1 if n > 0 else n + len(points) for n in numbers]
            blocks.append((len(cell), np.array([cell])))
    return points, blocks, {}


def _with_included(path):
    """The text of a Nastran file with those that it includes, of which gmsh knows nothing."""
    include, text = r"(?im)^ *INCLUDE +(['\"]?)([^'\"\n]+)\1.*$", path.read_text("latin-1")
    return re.sub(include, lambda m: _with_included(path.parent / m[2].strip()), text)


def _by_gmsh(path):
    import gmsh

    is_nastran = ending(path) in NASTRAN
    text = _with_included(path) if is_nastran else ""
    for line in text.expandtabs(8).splitlines():
        # fields with commas between them, of 16 columns, of 8
        wide = 16 if "*" in line[:8] else 8
        card = line.split(",") if "," in line else [line[:8], *re.findall(f".{{{wide}}}", line[8:])]
        name = card[0].strip(" *").upper()
        if name in ("GRID", "GRDSET") and "".join(card[2:3]).strip(" 0"):
            words = " ".join(line.split())
            raise ValueError(f"it has a {name} in coordinate system {card[2].strip()}, {words}")
    gmsh.initialize(readConfigFiles=False)
    with TemporaryDirectory() as folder:
        # gmsh does not know OptiStruct's name, and few in capitals
        link = Path(folder) / f"mesh{'.bdf' if is_nastran else ending(path)}"
        if is_nastran:
            link.write_text(text, "latin-1")
        else:
            link.symlink_to(path)
        gmsh.merge(str(link))
    numbers, x, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(numbers)
    blocks, others = [], {}
    for kind, _, nodes in zip(*gmsh.model.mesh.getElements()):
        name, dim, _, count, *_ = gmsh.model.mesh.getElementProperties(kind)
        if dim == 2:
            at = order[np.searchsorted(numbers, nodes, sorter=order)]
            blocks.append((3 if name.startswith("Tri") else 4, at.reshape(-1, count)))
        else:
            others[name.lower()] = dim
    return x.reshape(-1, 3), blocks, others


def _by_pyvista(path):
    import pyvista
    from vtkmodules.util.numpy_support import vtk_to_numpy

    caught = pyvista.VtkErrorCatcher(send_to_logging=False)
    with caught, suppress(RuntimeError):
        reader = pyvista.get_reader(str(path))
        if hasattr(reader.reader, "SetGenerateGlobalNodeIdArray"):  # blocks of Exodus share nodes
            reader.reader.SetGenerateGlobalNodeIdArray(True)
        mesh = reader.read()
    # others follow from the first; PyVista 0.44 has no other events
    if errors := getattr(caught, "error_events", caught.events):
        raise ValueError(errors[0].alert)
    if isinstance(mesh, pyvista.MultiBlock):
        mesh = mesh.combine(merge_points=True)
    if isinstance(mesh, pyvista.PolyData) and mesh.n_strips:
        mesh = mesh.triangulate()
    grid = mesh.cast_to_unstructured_grid()
    offsets = vtk_to_numpy(grid.GetCells().GetOffsetsArray())
    starts, sizes, blocks, others = offsets[:-1], np.diff(offsets), [], {}
    for kind, count in {*zip(grid.celltypes.tolist(), sizes.tolist())}:
        which = np.flatnonzero((grid.celltypes == kind) & (sizes == count))
        cells = grid.cell_connectivity[starts[which][:, None] + np.arange(count)]
        first = grid.GetCell(int(which[0]))
        if first.GetCellDimension() == 2:
            cells = cells[:, [0, 1, 3, 2]] if kind == pyvista.CellType.PIXEL else cells
            blocks.append((first.GetNumberOfEdges(), cells))
        else:
            others[first.GetClassName().removeprefix("vtk").lower()] = first.GetCellDimension()
    return grid.points, blocks, others


def _by_meshio(path):
    import meshio

    if b"Temporal" in path.read_bytes() and ending(path) in (".xdmf", ".xmf"):
        with meshio.xdmf.TimeSeriesReader(path) as series:  # all times share the mesh
            mesh = meshio.Mesh(*series.read_points_cells())
    else:
        mesh = meshio.read(path)
    blocks, others = [], {}
    for block in mesh.cells:
        if block.dim != 2:
            others[block.type] = block.dim
        elif block.type.startswith("polygon"):
            blocks += [(len(cell), cell[None]) for cell in block.data]
        else:
            blocks.append((3 if block.type.startswith("triangle") else 4, block.data))
    return mesh.points, blocks, others
