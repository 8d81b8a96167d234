"""Meshes of sheets in files, and arrays that one rank has read."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ..readers.read import READ, read_surface_mesh
from ..runtime.errors import InputError
from .cells import CELLS, HIGHER, straight_cells, with_centres
from .mesh_checks import MeshArrays

UNUSED = 0.02  # share of nodes without a cell, from which a mesh may be cut off
GEOMETRY = (".geo", ".step", ".stp", ".iges", ".igs", ".brep")  # what gmsh makes meshes of


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
    empty = part and part._replace(points=part.points[:0], cells=part.cells[:0])
    error, empty = comm.bcast((error, empty))
    if error:
        raise InputError(error)
    return part or empty


def read_mesh(path: Path | str) -> MeshArrays:
    """The mesh in a file, not checked yet; InputError as in `Blank.read`."""
    if not isinstance(path, (str, os.PathLike)):
        raise InputError(
            f"mesh file is given as {type(path).__name__}; allowed is its name, as a text or a path"
        )
    path = Path(path)
    if path.suffix.lower() in GEOMETRY:
        raise InputError(
            f"mesh file {path} is a geometry without a mesh; allowed is {READ}: gmsh "
            f"makes one with `gmsh -2 {path.name} -o {path.stem}.msh`"
        )
    if path.suffix.lower() in (".dxf", ".csv"):
        raise InputError(
            f"mesh file {path} is an outline without a mesh; allowed is {READ}, or the file as "
            "`outline`"
        )
    points, surface, others, note = read_surface_mesh(path, "mesh file")
    if solid := sorted(kind for kind, dim in others.items() if dim == 3):
        raise InputError(
            f"mesh file {path} holds solid cells {solid}; allowed is a sheet, of one kind out of "
            f"{sorted(CELLS)}"
        )
    if len(surface) > 1:
        raise InputError(
            f"mesh file {path} holds cells {sorted(surface)}; allowed is one kind out of "
            f"{sorted(CELLS)}"
        )
    ((kind, cells),) = surface.items()
    if kind == "quad8":
        points, cells = with_centres(points, cells)
        kind = "quad9"
    elif kind in HIGHER:
        cells, kind = straight_cells(points, cells, kind, f"mesh file {path}")
    if kind not in CELLS:
        raise InputError(
            f"mesh file {path} holds cells {kind}; allowed is one kind out of {sorted(CELLS)}"
        )
    unused = len(points) - len(np.unique(cells))
    notes = [note] if note else []
    if unused > UNUSED * len(points):
        notes.append(
            f"mesh file {path} has {unused} of {len(points)} nodes in no cell of a sheet: it may "
            "be cut off"
        )
    return MeshArrays(points, cells, kind, notes)
