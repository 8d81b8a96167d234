"""Sheets as arrays, in their place: rectangles, outlines and meshes in files."""

import math
import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.files import ending
from ..core.formatting import rounded
from ..io import rings
from ..io.outline_files import read_outline
from ..io.read import READ, read_surface_mesh
from .mesh_checks import CELLS, MeshArrays, at_place
from .outline import outline_mesh
from .sheet import Layout, axes_of
from .specimen import specimen

FLAT_TOLERANCE = 1e-6  # of its size, up to which a sheet is flat
# corners and degree of cells of which DOLFINx would have more than the checks can judge
HIGHER = {f"triangle{(p + 1) * (p + 2) // 2}": (3, p) for p in range(3, 11)} | {
    f"quad{(p + 1) ** 2}": (4, p) for p in range(3, 11)
}
STRAIGHT_TOLERANCE = 1e-6  # distance of nodes from an edge or a plane, over the edge's length


def rectangle(
    layout: Layout,
    sides: Sequence[float],
    turned: float,
    centred: bool | Sequence[bool],
    planes: Mapping[int, float] = MappingProxyType({}),
) -> MeshArrays:
    """A rectangle of these sides [mm], `turned` from x [rad], with a corner or, `centred`, its
    middle at the origin, moved to `planes` {axis: place}. Cells along the yarns follow those in the
    middle."""
    if layout.pattern == "along":
        _check_triangles(layout, "cells along the yarns")
    (length, width), middle = sides, np.array(sides) / 2
    ny = layout.ny or max(1, round(layout.nx * width / length))
    cell = "quadrilateral" if (layout.element or "P")[0] == "Q" else "triangle"
    axes, shift = axes_of(turned), middle * np.asarray(centred)
    start = np.array([planes.get(axis, 0.0) for axis in (0, 1)])
    yarns = _yarns(layout, (middle - shift) @ axes + start)
    points, cells, kind = specimen(length, width, layout.nx, ny, layout.pattern, cell, *yarns)
    points[:, :2] = (points[:, :2] - shift) @ axes + start
    return MeshArrays(points, cells, kind, [])


def outline(
    layout: Layout,
    rim: Path | str | Sequence[ArrayLike],
    cells: tuple[float | None, str | None],
    turned: float,
    centred: bool,
    planes: Collection[int] | Mapping[int, float],
) -> MeshArrays:
    """The inside of a `rim`, as in `Blank.outline`; cells: their size [mm], and the layer of a DXF.
    Warnings say what was left out."""
    _check_triangles(layout, "an outline")
    (size, layer), source, notes = cells, outline_source(rim), list[str]()
    if isinstance(rim, str | os.PathLike):
        sheet, notes = read_outline(rim, layer)
    else:
        sheet = rings.sheet_of([np.asarray(ring, float) for ring in rim], source)
    places = planes if isinstance(planes, Mapping) else dict.fromkeys(planes, 0.0)
    sheet = rings.centred(sheet) if centred else sheet
    for axis, place in places.items():
        sheet = rings.mirrored_half(sheet, axis, source, place)
    low, high = np.reshape(sheet.bounds, (2, 2))
    a, between = _yarns(layout, sheet.centroid.coords[0])
    size = (high - low)[0] / layout.nx if size is None else size
    yarns = a + turned, a + turned + between
    try:
        points, triangles, kind, left_out = outline_mesh(sheet, size, layout.pattern, yarns)
    except InputError as error:
        raise InputError("; ".join([str(error), *notes])) from None
    return MeshArrays(points, triangles, kind, notes + left_out)


def outline_source(rim: Path | str | Sequence[ArrayLike]) -> str:
    """What messages call an outline."""
    return f"outline {rim}" if isinstance(rim, str | os.PathLike) else "the outline"


def _check_triangles(layout, what):
    if (layout.element or "P")[0] != "P":
        raise InputError(f"`element` is {layout.element}; allowed for {what} are triangles (P)")


def _yarns(layout, place):
    """Angle from the length to yarns a, and from there to yarns b, [rad] at a place (x, y)."""
    a = layout.fibre_angles(np.array([[*place, 0.0]]))[0]
    return math.radians(a), math.radians(layout.yarn_angle)


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


def moved_sheet(
    points: np.ndarray, source: str, centred: bool, height: float | None
) -> tuple[np.ndarray, list[str]]:
    """Points (n, 2 or 3) [mm] of a sheet, moved as in `Blank.read`, and a warning if z changes."""
    points, low, high = points.copy(), points.min(0), points.max(0)
    if centred:
        points[:, :2] -= (low + high)[:2] / 2
    if height is None or len(low) == 2:
        return points, []
    near, place = FLAT_TOLERANCE * (high - low).max(), f"z = {rounded(low[2], 4)}"
    if high[2] - low[2] > near:
        raise InputError(
            f"{source} reaches from {place} to {rounded(high[2], 4)} mm; allowed is a flat sheet, "
            "in a plane z = const"
        )
    points[:, 2] = height
    doubt = (
        f"{source} lies in {place} mm and was put in z = {height:g}, where a press has its blank"
    )
    return points, [doubt] if abs(low[2] - height) > near else []
