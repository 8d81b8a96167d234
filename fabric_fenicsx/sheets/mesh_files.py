"""Meshes of sheets in files."""

from pathlib import Path

import numpy as np

from ..readers.read import READ, read_surface_mesh
from ..runtime.errors import InputError
from ..runtime.files import ending
from .cells import CELLS, HIGHER, straight_cells, with_centres
from .mesh_checks import MeshArrays


def read_mesh(path: Path | str) -> MeshArrays:
    """The mesh in a file, not checked yet; InputError as in `Blank.read`."""
    path = Path(path)
    file, kind_of_file = f"mesh file {path}", ending(path)
    # what gmsh makes meshes of
    if kind_of_file in (".geo", ".step", ".stp", ".iges", ".igs", ".brep"):
        how = f"gmsh makes one with `gmsh -2 {path.name} -o {path.stem}.msh`"
        raise InputError(f"{file} is a geometry without a mesh; allowed is {READ}: {how}")
    if kind_of_file in (".dxf", ".csv"):
        flaw = "is an outline without a mesh"
        raise InputError(f"{file} {flaw}; allowed is {READ}, or the file as `outline`")
    points, surface, others = read_surface_mesh(path, "mesh file")
    allowed = f"allowed is one kind out of {sorted(CELLS)}"
    if solid := sorted(kind for kind, dim in others.items() if dim == 3):
        raise InputError(f"{file} holds solid cells {solid}; {allowed}")
    if len(surface) > 1:
        raise InputError(f"{file} holds cells {sorted(surface)}; {allowed}")
    ((kind, cells),) = surface.items()
    if kind == "quad8":
        points, cells = with_centres(points, cells)
        kind = "quad9"
    elif kind in HIGHER:
        cells, kind = straight_cells(points, cells, kind, file)
    if kind not in CELLS:
        raise InputError(f"{file} holds cells {kind}; {allowed}")
    unused = len(points) - len(np.unique(cells))
    notes = []
    # share of nodes without a cell, from which a mesh may be cut off
    if unused > 0.02 * len(points):
        some = f"{unused} of {len(points)} nodes"
        notes.append(f"{file} has {some} in no cell of a sheet: it may be cut off")
    return MeshArrays(points, cells, kind, notes)
