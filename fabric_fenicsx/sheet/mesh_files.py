"""Meshes of sheets in files."""

from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.files import ending
from ..io.read import READ, read_surface_mesh
from .cells import CELLS, HIGHER, straight_cells, with_centres
from .mesh_checks import MeshArrays


def read_mesh(path: Path | str) -> MeshArrays:
    """The mesh in a file, not checked yet; InputError as in `Blank.read`."""
    path, file = Path(path), f"mesh file {path}"
    kinds = dict.fromkeys((".geo", ".step", ".stp", ".iges", ".igs", ".brep"), "a geometry")
    kinds |= {".dxf": "an outline", ".csv": "an outline"}
    if other := kinds.get(ending(path)):
        how = f": gmsh makes one with `gmsh -2 {path.name} -o {path.stem}.msh`"
        how = how if other == "a geometry" else ", or the file as `outline`"
        raise InputError(f"{file} is {other} without a mesh; allowed is {READ}{how}")
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
    unused, total = len(points) - len(np.unique(cells)), len(points)
    doubt = f"{file} has {unused} of {total} nodes in no cell of a sheet: it may be cut off"
    return MeshArrays(points, cells, kind, [doubt] if unused > 0.02 * total else [])
