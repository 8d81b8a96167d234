"""Meshes of sheets in files."""

from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.files import ending
from ..io.read import READ, read_surface_mesh
from .mesh_checks import CELLS, MeshArrays, at_place

# corners and degree of cells of which DOLFINx would have more than the checks can judge
HIGHER = {f"triangle{(p + 1) * (p + 2) // 2}": (3, p) for p in range(3, 11)} | {
    f"quad{(p + 1) ** 2}": (4, p) for p in range(3, 11)
}
STRAIGHT_TOLERANCE = 1e-6  # distance of nodes from an edge or a plane, over the edge's length


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


def with_centres(points: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and cells (m, 9) of the same shape as quadrilaterals (m, 8) without a node inside."""
    x = points[cells]
    centres = x[:, 4:].sum(1) / 2 - x[:, :4].sum(1) / 4
    numbers = len(points) + np.arange(len(cells))
    return np.vstack([points, centres]), np.column_stack([cells, numbers])


def straight_cells(
    points: np.ndarray, cells: np.ndarray, kind: str, source: str
) -> tuple[np.ndarray, str]:
    """The corners (m, 3 or 4) of plane cells (m, k) of a higher degree with straight edges, and
    their kind; `kind` is one of `HIGHER`. Raises InputError for cells of another shape."""
    k, degree = HIGHER[kind]
    x = points[cells]
    edges = np.roll(x[:, :k], -1, 1) - x[:, :k]
    length = np.linalg.norm(edges, axis=2)
    near = STRAIGHT_TOLERANCE * length.max(1)
    arms = x[:, k : k * degree].reshape(-1, k, degree - 1, 3) - x[:, :k, None]
    beside = np.linalg.norm(np.cross(arms, edges[:, :, None]), axis=3).max(2)
    normal = np.cross(edges[:, 0], edges[:, 1])
    above = abs(((x - x[:, :1]) * normal[:, None]).sum(2)).max(1)
    curved = (beside > near[:, None] * length).any(1)
    curved |= above > near * np.linalg.norm(normal, axis=1)
    if curved.any():
        first = int(curved.argmax())
        raise InputError(
            f"{source} has curved cells of order {degree}, the first number {first} "
            f"{at_place(x[first, :k].mean(0))}; allowed curved cells of order 2 (in gmsh "
            "Mesh.ElementOrder = 2) and straight ones"
        )
    return cells[:, :k], {3: "triangle", 4: "quad"}[k]
