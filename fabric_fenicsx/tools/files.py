"""Triangles in files."""

from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

FORMATS = "STL, VTP, MSH, STEP, IGES"
CAD = (".step", ".stp", ".iges", ".igs", ".brep")


def read_triangles(path: Path, chord: float) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Points (n, 3) [mm] and triangles (m, 3) in a file, and of CAD models the normals at the triangles' corners (m, 3, 3);
    raises whatever its reader raises."""
    if path.suffix.lower() in CAD:
        return _mesh_of_model(path, chord)
    return *_read_mesh(path), None


def _read_mesh(path):
    import meshio  # takes long to import

    if path.suffix.lower() in meshio.extension_to_filetypes:
        with redirect_stdout(None):  # its reader of .msh prints an empty line
            mesh = meshio.read(path)
        points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.points.shape[1])))
        parts = [np.empty((0, 3), dtype=np.int64)]
        for block in mesh.cells:
            if block.type.startswith("triangle"):
                parts.append(block.data[:, :3])
            elif block.type.startswith("quad"):
                parts += [block.data[:, :3], block.data[:, [0, 2, 3]]]
        return points, np.concatenate(parts).astype(np.int64)
    import pyvista

    mesh = pyvista.read(path)
    if isinstance(mesh, pyvista.MultiBlock):
        mesh = mesh.combine()
    mesh = (mesh if isinstance(mesh, pyvista.PolyData) else mesh.extract_geometry()).triangulate()
    return mesh.points, np.asarray(mesh.faces).reshape(-1, 4)[:, 1:]
