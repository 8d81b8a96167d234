"""Meshes of rectangles and of sheets with an outline, as arrays on rank 0."""

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from mpi4py import MPI
from numpy.typing import ArrayLike

from ..meshes.outline import outline_mesh
from ..meshes.outline_files import read_outline
from ..meshes.rings import sheet_of
from ..meshes.specimen import specimen
from ..runtime.errors import InputError
from ..runtime.rules import COUNT, POSITIVE
from .layout import Layout, axes_of, blank_options
from .mesh_checks import MeshArrays
from .mesh_files import on_root

Outline = Path | str | Sequence[ArrayLike]


def rectangle(
    comm: MPI.Comm,
    sides: tuple[float, float],
    counts: tuple[int, int | None],
    pattern: str,
    layout: Layout,
) -> MeshArrays:
    """A rectangle of length and width `sides` [mm], from nx x ny rectangles: `counts`."""
    length, width = POSITIVE.check("`length`", sides[0]), POSITIVE.check("`width`", sides[1])
    nx, ny = COUNT.check("`nx`", counts[0]), counts[1]
    ny = max(1, round(nx * width / length)) if ny is None else COUNT.check("`ny`", ny)
    cell = "quadrilateral" if (layout.get("element") or "P")[0] == "Q" else "triangle"
    yarns = math.radians(layout.get("fibre_angle", 0.0))
    mesh = on_root(
        comm, lambda: MeshArrays(*specimen(length, width, nx, ny, pattern, cell, yarns), [])
    )
    if layout.get("centred"):
        mesh.points[:, :2] -= np.array([length, width]) / 2
    mesh.points[:, :2] = mesh.points[:, :2] @ axes_of(layout.get("turned", 0.0))
    return mesh


def within(
    comm: MPI.Comm,
    outline: Outline,
    layer: str | None,
    edges: tuple[int, float | None],
    pattern: str,
    layout: Layout,
) -> MeshArrays:
    """The sheet within an outline; `edges` of its cells: how many along x, or their length [mm]."""
    options, nx = blank_options(layout), COUNT.check("`nx`", edges[0])
    if (layout.get("element") or "P")[0] != "P":
        raise InputError(
            f"`element` is {layout['element']}; allowed for an outline are triangles (P)"
        )
    yarns = options["a"], options.get("b", options["a"] + math.pi / 2)

    def made():
        sheet, notes = _outline(outline, layer)
        low, high = np.reshape(sheet.bounds, (2, 2))
        size = (high - low)[0] / nx if edges[1] is None else edges[1]
        try:
            points, cells, kind, left_out = outline_mesh(sheet, size, pattern, yarns)
        except InputError as error:
            raise InputError("; ".join([str(error), *notes])) from None
        if layout.get("centred"):
            points[:, :2] -= (low + high) / 2
        return MeshArrays(points, cells, kind, notes + left_out)

    return on_root(comm, made)


def source_of(outline: Outline) -> str:
    """Name of an outline in messages."""
    return f"outline {outline}" if isinstance(outline, (str, os.PathLike)) else "the outline"


def _outline(outline: Outline, layer: str | None) -> tuple[shapely.Polygon, list[str]]:
    if isinstance(outline, (str, os.PathLike)):
        return read_outline(outline, layer)
    return sheet_of([np.asarray(ring, float) for ring in outline], source_of(outline)), []
