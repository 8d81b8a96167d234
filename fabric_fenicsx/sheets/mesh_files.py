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
    file, kind_of_file, flaw = f"mesh file {path}", ending(path), ""
    # what gmsh makes meshes of
    if kind_of_file in (".geo", ".step", ".stp", ".iges", ".igs", ".brep"):
        how = f"gmsh makes one with `gmsh -2 {path.name} -o {path.stem}.msh`"
        flaw = f"is a geometry without a mesh; allowed is {READ}: {how}"
    elif kind_of_file in (".dxf", ".csv"):
        flaw = f"is an outline without a mesh; allowed is {READ}, or the file as `outline`"
    if flaw:
        raise InputError(f"{file} {flaw}")
    points, surface, others = read_surface_mesh(path, "mesh file")
    solid = sorted(kind for kind, dim in others.items() if dim == 3)
    known = {*CELLS, *HIGHER, "quad8"}
    if solid or len(surface) > 1 or not known.issuperset(surface):
        what = f"solid cells {solid}" if solid else f"cells {sorted(surface)}"
        raise InputError(f"{file} holds {what}; allowed is one kind out of {sorted(CELLS)}")
    ((kind, cells),) = surface.items()
    if kind == "quad8":
        points, cells = with_centres(points, cells)
        kind = "quad9"
    elif kind in HIGHER:
        cells, kind = straight_cells(points, cells, kind, file)
    unused = len(points) - len(np.unique(cells))
    notes = []
    # share of nodes without a cell, from which a mesh may be cut off
    if unused > 0.02 * len(points):
        some = f"{unused} of {len(points)} nodes"
        notes.append(f"{file} has {some} in no cell of a sheet: it may be cut off")
    return MeshArrays(points, cells, kind, notes)
