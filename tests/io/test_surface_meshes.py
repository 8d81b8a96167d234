"""Meshes of other programs are read; a file that no reader reads is refused with the reason."""

import locale
import math
import os
import struct

import meshio
import numpy as np
import pytest
import pyvista
from mpi4py import MPI

from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.core.processes import in_child
from fabric_fenicsx.io.read import read_surface_mesh
from fabric_fenicsx.sheet.specimen import own_model, specimen

SQUARE = np.array([[0.0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]])
POINTS, TRIANGLES, _ = specimen(20, 10, 4, 2, "right")
QUADS = specimen(20, 10, 4, 2, cell="quadrilateral")[1]


@pytest.fixture(autouse=True)
def same_locale():
    """VTK's writers leave another one behind."""
    before = locale.setlocale(locale.LC_ALL)
    yield
    locale.setlocale(locale.LC_ALL, before)


def read(path, text=None):
    if text is not None:
        path.write_text(text)
    return read_surface_mesh(path, "mesh file")


def area(mesh):
    """By the corners of all cells, [mm^2]."""
    total = 0.0
    for kind, cells in mesh.cells.items():
        x = mesh.points[cells[:, : 3 if kind.startswith("triangle") else 4]]
        parts = np.cross(x[:, 1:-1] - x[:, :1], x[:, 2:] - x[:, :1])
        total += abs(parts[..., 2].sum(1)).sum() / 2  # 0 of one that crosses itself
    return total


def by_gmsh(path, order=1, curves=False, **options):
    """A strip of 20 x 10 mm that gmsh meshes; curves: only its left side is in a group."""
    import gmsh

    with own_model(gmsh, **{"MeshSizeMax": 5, **options}):
        strip = gmsh.model.occ.addRectangle(0, 0, 0, 20, 10)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(1 if curves else 2, [4 if curves else strip])
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(path))


GMSH = {
    "version 2.2, binary": ("strip.msh", {"MshFileVersion": 2.2, "Binary": 1}),
    "curves in groups and all saved": ("strip.msh", {"curves": True, "SaveAll": 1}),
    "8 nodes": ("strip.msh", {"order": 2, "RecombineAll": 1, "SecondOrderIncomplete": 1}),
    "UNV of order 2": ("strip.unv", {"order": 2}),
}


@pytest.mark.versions
@pytest.mark.parametrize("case", GMSH)
def test_what_gmsh_writes_is_read(tmp_path, case, capfd):
    name, options = GMSH[case]
    by_gmsh(tmp_path / name, **options)
    mesh = read(tmp_path / name)
    assert len(mesh.cells) == 1 and area(mesh) == pytest.approx(200)
    assert capfd.readouterr() == ("", "")


@pytest.mark.versions
def test_a_cell_in_two_groups_is_one_cell(tmp_path):
    cells = [("quad", [[0, 1, 2, 3]])] * 2
    meshio.write_points_cells(tmp_path / "s.msh", SQUARE, cells, file_format="gmsh22")
    assert read(tmp_path / "s.msh").cells["quad"].tolist() == [[0, 1, 2, 3]]


def vtk_mesh():
    sizes = np.full((len(TRIANGLES), 1), 3)
    return pyvista.PolyData(POINTS, np.hstack([sizes, TRIANGLES]).ravel())


@pytest.mark.versions
def test_grids_blocks_and_strips_of_vtk_are_read(tmp_path):
    x, y = np.meshgrid([0.0, 5, 10, 20], [0.0, 10], indexing="ij")
    pyvista.StructuredGrid(x, y, 0 * x).save(tmp_path / "grid.vts")
    pyvista.MultiBlock({"ply": vtk_mesh()}).save(tmp_path / "blocks.vtm")
    vtk_mesh().strip().save(tmp_path / "strips.vtp")
    pyvista.ImageData(dimensions=(5, 3, 1), spacing=(5, 5, 1)).save(tmp_path / "image.vti")
    triangles = dict.fromkeys(("blocks.vtm", "strips.vtp"), "triangle")
    for name, kind in ({"grid.vts": "quad", "image.vti": "quad"} | triangles).items():
        mesh = read(tmp_path / name)
        assert [*mesh.cells] == [kind] and area(mesh) == pytest.approx(200)


@pytest.mark.versions
@pytest.mark.parametrize("cells", [TRIANGLES, QUADS])
def test_xdmf_of_dolfinx_is_read(tmp_path, cells):
    """With a field at two times, and the mesh alone in text."""
    from dolfinx import fem
    from dolfinx.io import XDMFFile

    cell, k = {3: "triangle", 4: "quadrilateral"}[cells.shape[1]], cells.shape[1]
    nodes = cells[:, compat.to_dolfinx_order(cell, k)]
    made = compat.create_mesh(MPI.COMM_SELF, nodes, POINTS[:, :2], cell, 1)
    u = fem.Function(compat.vector_space(made, "Lagrange", 1, 2), name="u")
    encodings = XDMFFile.Encoding.HDF5, XDMFFile.Encoding.ASCII
    for name, times, encoding in zip(("series", "text"), ((0.0, 1.0), ()), encodings):
        with XDMFFile(MPI.COMM_SELF, str(tmp_path / f"{name}.xdmf"), "w", encoding) as file:
            file.write_mesh(made)
            for time in times:
                file.write_function(u, time)
        assert area(read(tmp_path / f"{name}.xdmf")) == pytest.approx(200)


@pytest.mark.versions
def test_numbers_in_hdf5_are_read(tmp_path):
    cells = [("triangle", TRIANGLES)]
    for name in ("strip.med", "strip.xdmf"):  # where DOLFINx is loaded, h5py may not work
        in_child(meshio.write_points_cells, tmp_path / name, POINTS, cells)
        assert area(read(tmp_path / name)) == pytest.approx(200)


GRIDS = "".join(f"GRID,{i},,{x},{y},{z}\n" for i, (x, y, z) in enumerate(SQUARE, 1))


def test_a_deck_is_read_and_nodes_in_a_coordinate_system_are_refused(tmp_path):
    for name, more in (("s.bdf", "45.0\nENDDATA"), ("s.fem", "7")):  # an angle, a system of a cell
        mesh = read(tmp_path / name, f"CEND\nBEGIN BULK\n{GRIDS}CQUAD4,1,1,1,2,3,4,{more}\n")
        assert area(mesh) == 100 and [*mesh.cells] == ["quad"]
    three = "\n".join(GRIDS.splitlines()[:3])
    for card in (
        "GRID           4       5      0.     10.      0.",
        "GRID*                  4               5              0.             10.",
        "  GRID,4,5,0.,10.,0.",
    ):
        text = f"BEGIN BULK\n{three}\n{card}\nCQUAD4,1,1,1,2,3,4\nENDDATA\n"
        with pytest.raises(InputError, match="has a GRID in coordinate system 5, .*; expected"):
            read(tmp_path / "square.bdf", text)
    (tmp_path / "nodes.inc").write_text(GRIDS)
    text = "BEGIN BULK\ninclude 'nodes.inc'\n{}CQUAD4,1,1,1,2,3,4\nENDDATA\n"
    assert area(read(tmp_path / "square.bdf", text.format(""))) == 100
    with pytest.raises(InputError, match="has a GRDSET in coordinate system 5"):
        read(tmp_path / "square.bdf", text.format("GRDSET,,5\n"))


@pytest.mark.parametrize(
    "name, text, words",
    [
        ("mesh.k", "*KEYWORD\n", r"as .k \(Could not deduce file format"),
        ("none.vtu", None, "none.vtu does not exist"),
        ("half.vtu", "<VTKFile><Un", "cannot be read as .vtu .*unclosed token"),
        ("mesh.msh", 'SystemCall "touch ran";\n', "cannot be read as .msh .*ansys, gmsh"),
    ],
)
def test_files_that_no_reader_can_know(tmp_path, monkeypatch, name, text, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        read(tmp_path / name, text)
    assert not (tmp_path / "ran").exists()


LEFT = dict.fromkeys(("bdf", "obj", "ply", "unv"), 0.97)
LEFT |= {"vtk": 0.9, "mesh": 0.9, "msh": 0.9, "inp": 0.6, "vtu": 0.5}


@pytest.mark.versions
@pytest.mark.parametrize("ending", LEFT)
def test_what_is_cut_off_is_refused(tmp_path, ending):
    path = tmp_path / f"strip.{ending}"
    if path.suffix in (".obj", ".ply", ".vtu"):
        meshio.write_points_cells(path, POINTS, [("triangle", TRIANGLES)])
    else:
        by_gmsh(path)
    data = path.read_bytes()
    assert area(read(path)) == pytest.approx(200)
    cut = data[: int(LEFT[ending] * len(data))]
    # an end of a line may be that of a file
    path.write_bytes(cut[: cut.rindex(b",")] if path.suffix == ".inp" else cut)
    with pytest.raises(InputError, match=path.name):
        read(path)


def test_a_crash_of_a_library_does_not_take_the_run_along():
    with pytest.raises(RuntimeError, match="it crashed .SIGABRT."):
        in_child(os.abort)
    with pytest.raises(RuntimeError, match="math domain error"):
        in_child(math.sqrt, -1.0)
    assert in_child(math.sqrt, 4.0) == 2


CORNERS = np.array([[[0, 0, 0], [2, 0, 0], [2, 1.5, 0]], [[0, 0, 0], [2, 1.5, 0], [0, 1, -0.5]]])


def text(number="{:e}"):
    lines = ["solid plate"]
    for corners in CORNERS:
        lines += ["facet normal 0 0 1", "outer loop"]
        lines += [" ".join(["vertex", *map(number.format, x)]) for x in corners]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid plate", ""])


def binary(header=b"", count=2, end=b""):
    facets = [struct.pack("<12fH", 0, 0, 1, *corners.ravel(), 0) for corners in CORNERS]
    return header.ljust(80) + struct.pack("<I", count) + b"".join(facets) + end


# what the net's drawn files have not: tests/invariance/test_readers.py
FILES = {
    "decimal commas": text("{:.3f}").replace(".", ",").encode(),
    "exponents of Fortran": text().replace("e+", "D+").replace("e-", "D-").encode(),
    "a name in Latin 1": text().replace("plate", "Größe").encode("latin-1"),
    "a mark of Unicode": text().encode("utf-8-sig"),
    "a byte behind": binary(end=b"\n"),
    "bytes behind": binary(b"solid", end=bytes(100)),
}


@pytest.mark.parametrize("case", FILES)
def test_stl_with(tmp_path, case):
    (tmp_path / "plate.stl").write_bytes(FILES[case])
    mesh = read(tmp_path / "plate.stl")
    x = mesh.points[mesh.cells["triangle"][:2]]
    np.testing.assert_allclose(x, CORNERS, atol=1e-7)
    assert len(mesh.points) == 4


def test_stl_that_is_cut_off_or_wrong(tmp_path):
    for content, words in (
        (text()[:-60].encode(), "has 5 vertices in 2 facets"),
        (binary(count=3), "declares 3 triangles and holds 100 bytes of them"),
    ):
        (tmp_path / "plate.stl").write_bytes(content)
        with pytest.raises(InputError, match=words):
            read(tmp_path / "plate.stl")
