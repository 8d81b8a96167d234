"""Meshes of sheets in files, and arrays that one rank has read."""

import os
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ..runtime.errors import InputError
from .cells import CELLS
from .mesh_checks import MeshArrays


def on_root(comm: MPI.Comm, make: Callable[[], MeshArrays]) -> MeshArrays:
    """Mesh arrays made on rank 0; an InputError there is raised on every rank; other ranks get
    empty parts."""
    part: MeshArrays | None = None
    error = None
    if comm.rank == 0:
        try:
            part = make()
        except InputError as e:
            error = str(e)
    known = part and (part.points.shape[1], part.cells.shape[1], part.kind, part.warnings)
    error, known = comm.bcast((error, known))
    if error:
        raise InputError(error)
    if part:
        return part
    gdim, nodes, kind, warnings = known
    return MeshArrays(np.empty((0, gdim)), np.empty((0, nodes), dtype=np.int64), kind, warnings)


def read_mesh(path: Path | str) -> MeshArrays:
    """The mesh in a file, not checked yet; InputError for a file that cannot be read, or has solid
    or mixed cells."""
    if not isinstance(path, (str, os.PathLike)):
        raise InputError(
            f"mesh file is given as {type(path).__name__}; allowed is its name, as a text or a path"
        )
    path = Path(path)
    import meshio  # as long to import as a coarse solve takes, and only own meshes need it

    if not path.is_file():
        raise InputError(
            f"mesh file {path} does not exist or is not a file; allowed is any mesh that gmsh or "
            "meshio writes"
        )
    try:
        with redirect_stdout(None):  # its reader of .msh prints an empty line
            mesh = meshio.read(path)
    # meshio's readers raise whatever their parsing stumbles on, or exit
    except (Exception, SystemExit) as e:
        reason = " ".join(str(e).split()) or type(e).__name__
        raise InputError(
            f"mesh file {path} cannot be read ({reason}); allowed is any mesh that gmsh or meshio "
            "writes"
        ) from None
    solid = sorted({block.type for block in mesh.cells if block.dim == 3})
    if solid:
        raise InputError(
            f"mesh file {path} holds solid cells {solid}; allowed is a sheet, of one kind out of "
            f"{sorted(CELLS)}"
        )
    surface: dict[str, list[np.ndarray]] = {
        block.type: []
        for block in mesh.cells
        if block.type in CELLS or block.type in ("quad8", "polygon")
    }
    for block in mesh.cells:
        if block.type in surface:
            surface[block.type].append(block.data)
    if len(surface) > 1 or set(surface) - set(CELLS):
        raise InputError(
            f"mesh file {path} holds cells {sorted(surface)}; allowed is one kind out of "
            f"{sorted(CELLS)}"
        )
    if not surface:
        raise InputError(f"mesh file {path} holds no surface cells; allowed are {sorted(CELLS)}")
    ((kind, blocks),) = surface.items()
    return MeshArrays(mesh.points, np.concatenate(blocks), kind, [])
