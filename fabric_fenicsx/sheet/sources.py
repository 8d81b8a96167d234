"""Sheets as arrays, in their place: rectangles, outlines and meshes in files."""

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.files import ending
from ..core.formatting import rounded
from ..io import rings
from ..io.outline_files import read_outline
from ..io.read import READ, read_surface_mesh
from .mesh_checks import CELLS, MeshArrays
from .outline import outline_mesh
from .sheet import Layout, axes_of
from .specimen import specimen

FLAT_TOLERANCE = 1e-6  # of its size, up to which a sheet is flat


def rectangle(
    layout: Layout, sides: Sequence[float], turned: float, centred: bool | Sequence[bool]
) -> MeshArrays:
    """A rectangle of these sides [mm], `turned` from x [rad], with a corner or, `centred`, its
    middle at the origin. Cells along the yarns follow those in the middle."""
    if layout.pattern == "along":
        _check_triangles(layout, "cells along the yarns")
    (length, width), middle = sides, np.array(sides) / 2
    ny = layout.ny or max(1, round(layout.nx * width / length))
    cell = "quadrilateral" if (layout.element or "P")[0] == "Q" else "triangle"
    axes, shift = axes_of(turned), middle * np.asarray(centred)
    yarns = _yarns(layout, (middle - shift) @ axes)
    points, cells, kind = specimen(length, width, layout.nx, ny, layout.pattern, cell, *yarns)
    points[:, :2] = (points[:, :2] - shift) @ axes
    return MeshArrays(points, cells, kind, [])


def outline(
    layout: Layout,
    rim: Path | str | Sequence[ArrayLike],
    source: str,
    size: float | None,
    layer: str | None,
    turned: float,
    centred: bool,
    planes: Sequence[int],
) -> MeshArrays:
    """The inside of a `rim`, as in `Blank.outline`, that messages call `source`. Warnings say what
    was left out."""
    _check_triangles(layout, "an outline")
    notes = list[str]()
    if isinstance(rim, str | os.PathLike):
        sheet, notes = read_outline(rim, layer)
    else:
        sheet = rings.sheet_of([np.asarray(ring, float) for ring in rim], source)
    sheet = rings.centred(sheet) if centred else sheet
    for axis in planes:
        sheet = rings.mirrored_half(sheet, axis, source)
    low, high = np.reshape(sheet.bounds, (2, 2))
    a, between = _yarns(layout, sheet.centroid.coords[0])
    size = (high - low)[0] / layout.nx if size is None else size
    yarns = a + turned, a + turned + between
    try:
        points, triangles, kind, left_out = outline_mesh(sheet, size, layout.pattern, yarns)
    except InputError as error:
        raise InputError("; ".join([str(error), *notes])) from None
    return MeshArrays(points, triangles, kind, notes + left_out)


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
    if solid or len(surface) > 1 or not {*CELLS, "quad8"}.issuperset(surface):
        what = f"solid cells {solid}" if solid else f"cells {sorted(surface)}"
        raise InputError(f"{file} holds {what}; allowed is one kind out of {sorted(CELLS)}")
    ((kind, cells),) = surface.items()
    if kind == "quad8":
        # a node inside leaves the shape as it is
        numbers = len(points) + np.arange(len(cells))
        corners, middles = np.split(points[cells], [4], axis=1)
        points = np.vstack([points, middles.sum(1) / 2 - corners.sum(1) / 4])
        cells, kind = np.column_stack([cells, numbers]), "quad9"
    unused, total = len(points) - len(np.unique(cells)), len(points)
    doubt = f"{file} has {unused} of {total} nodes in no cell of a sheet: it may be cut off"
    return MeshArrays(points, cells, kind, [doubt] if unused > 0.02 * total else [])


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
