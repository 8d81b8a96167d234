"""Rectangular specimen: structured (crossed, left, right), unstructured or with edges along yarns,
of triangles or quadrilaterals; and what gmsh makes."""

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import ModuleType

import numpy as np

from ..core.errors import InputError

PATTERNS = ("crossed", "graded", "left", "right", "along", "unstructured", "yarns")


def specimen(
    length: float = 200.0,
    width: float = 50.0,
    nx: int = 100,
    ny: int = 25,
    pattern: str = "crossed",
    cell: str = "triangle",
    yarns: float = 0.0,
    between: float = math.pi / 2,
) -> tuple[np.ndarray, np.ndarray, str]:
    """Points (n, 3) [mm], cells (m, k) in gmsh's order and their kind, of the sheet [0, length] x
    [0, width]; yarns: angle of one family of yarns to the length, between: to the other [rad].

    pattern: of nx x ny rectangles `crossed` makes four triangles each by both diagonals, `right`
    two by the diagonal that rises to the right, `left` by the other; `graded` is `crossed` with
    cells small across the lines at 45 deg through the corners; `unstructured` meshes with cells of
    about those sizes; `yarns`, too, but with edges along the yarns through the corners, where the
    shear angle jumps, and small cells there.
    """
    if pattern == "graded" and not blocks(length, width):
        raise InputError(
            f"a strip of {length:g} x {width:g} mm is too short for the pattern graded; expected a "
            "length of 2 widths or more"
        )
    if pattern in ("unstructured", "yarns"):
        lines = yarns_through_corners(length, width, yarns, between) if pattern == "yarns" else ()
        return _unstructured(length, width, max(length / nx, width / ny), cell, lines)
    x, y = np.meshgrid(np.linspace(0, length, nx + 1), np.linspace(0, width, ny + 1), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    p00 = (np.arange(nx)[:, None] * (ny + 1) + np.arange(ny)).ravel()
    p01, p10, p11 = p00 + 1, p00 + ny + 1, p00 + ny + 2
    cells: list[tuple[np.ndarray, ...]]
    if cell == "quadrilateral":
        cells = [(p00, p10, p11, p01)]
    elif pattern == "right":
        cells = [(p00, p10, p11), (p00, p11, p01)]
    elif pattern == "left":
        cells = [(p00, p10, p01), (p10, p11, p01)]
    else:
        centre = len(points) + np.arange(nx * ny)
        points = np.vstack([points, points[[p00, p10, p11, p01]].mean(0)])
        cells = [(p00, p10, centre), (p10, p11, centre), (p11, p01, centre), (p01, p00, centre)]
    if pattern == "graded":
        points = graded(points, length, width)
    numbers = np.stack([np.column_stack(c) for c in cells], 1).reshape(-1, len(cells[0]))
    kind = "quad" if cell == "quadrilateral" else "triangle"
    return np.column_stack([points, np.zeros(len(points))]), numbers, kind


def blocks(length: float, width: float) -> int:
    """Squares of which `graded` cells are made, 0 if a strip is too short: those at its ends stay
    squares, those between them are stretched to fill it."""
    share = length / width
    is_whole = abs(share - round(share)) <= 1e-3  # cells of a shorter block would be slivers
    return 0 if share < 2 - 1e-9 else round(share) if is_whole else max(3, round(share))


def graded(points: np.ndarray, length: float, width: float) -> np.ndarray:
    """Points (n, 2) [mm] of a strip moved along both diagonals of its `blocks` towards lines at 45
    deg through their corners; its edges stay, and so do, in the squares at its ends, where the
    shear jumps, the directions of edges at 45 deg."""
    count = blocks(length, width)
    x, y = points[:, 0] * (count * width / length), points[:, 1]
    along = np.stack([x + y, x - y])
    # by which cells of `graded` are shorter on the lines through the corners
    along -= 0.95 * width / (2 * np.pi) * np.sin(2 * np.pi * along / width)
    even, ends = width * np.array([0, 1, count - 1, count]), [0, width, length - width, length]
    keep = slice(None, None, 3 if count == 2 else 1)
    x = np.interp(along.sum(0) / 2, even[keep], ends[keep])
    return np.column_stack([x, (along[0] - along[1]) / 2])


def yarns_through_corners(
    length: float, width: float, angle: float, between: float = math.pi / 2
) -> np.ndarray:
    """Segments (n, 2, 2) [mm] inside the sheet of the yarns that start at its corners, at `angle`
    and at `angle + between` [rad]."""
    size, segments = np.array([length, width]), []
    for corner in np.array([(0, 0), (1, 0), (1, 1), (0, 1)]):
        for turned in (angle, angle + between, angle + math.pi, angle + between + math.pi):
            direction = np.array([math.cos(turned), math.sin(turned)])
            inwards = direction * (1 - 2 * corner)
            if inwards.min() > 1e-9:
                start = corner * size
                segments.append((start, start + direction * (size / inwards).min()))
    # rounded and in order, so that cells do not depend on which yarns are called a
    found = np.array(segments).reshape(-1, 2, 2).round(12)
    return found[np.lexsort(found.reshape(-1, 4).T)]


def _unstructured(
    length: float, width: float, size: float, cell: str, lines: Iterable[np.ndarray] = ()
) -> tuple[np.ndarray, np.ndarray, str]:
    import gmsh

    # to 1e-6 mm, so that cells do not change with an angle as little as rounding
    lines = np.asarray(lines).reshape(-1, 2, 2).round(6)
    # sizes of cells at the yarns through the corners, and from `reach` off them on
    near, far, reach = (0.4 * size, 2 * size, 4 * size) if len(lines) else (size, size, 0.0)
    options = {"MeshSizeMin": near, "MeshSizeMax": far, "Algorithm": 6.0}
    corners = 4 if cell == "quadrilateral" else 3
    if corners == 4:
        options |= {"RecombineAll": 1.0, "RecombinationAlgorithm": 3.0}  # blossom, no triangles
    if len(lines):
        options["MeshSizeExtendFromBoundary"] = 0.0
    segments = np.hstack([lines[:, 0], lines[:, 1] - lines[:, 0]]).tolist()

    def graded_size(x, y):
        """Size at a place by the distance from lines, in plain floats: gmsh asks so often."""
        least = reach
        for x0, y0, dx, dy in segments:
            along = ((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy)
            along = min(1.0, max(0.0, along))
            least = min(least, math.hypot(x - x0 - along * dx, y - y0 - along * dy))
        return near + (far - near) * least / reach

    with own_model(gmsh, **options):
        occ = gmsh.model.occ
        sheet = occ.addRectangle(0, 0, 0, length, width)
        edges = [(1, occ.addLine(*(occ.addPoint(*end, 0) for end in line))) for line in lines]
        if edges:
            occ.fragment([(2, sheet)], edges)
        occ.synchronize()
        found = meshed(gmsh, corners, graded_size if edges else None)
    return *found, "quad" if corners == 4 else "triangle"


@contextmanager
def own_model(gmsh: ModuleType, **options: float) -> Iterator[None]:
    """A new current model of gmsh with these options; a user's session stays as it was."""
    running = getattr(gmsh, "isInitialized", lambda: False)()
    if not running:
        gmsh.initialize(readConfigFiles=False)
    before = gmsh.model.getCurrent()
    numbers = {"General.Terminal": 0.0} | {f"Mesh.{name}": v for name, v in options.items()}
    usual = {name: gmsh.option.getNumber(name) for name in numbers}
    for name, value in numbers.items():
        gmsh.option.setNumber(name, value)
    gmsh.model.add("fabric_fenicsx")
    try:
        yield
    finally:
        if running:
            gmsh.model.remove()
            gmsh.model.setCurrent(before)
            for name, value in usual.items():
                gmsh.option.setNumber(name, value)
        else:
            gmsh.finalize()


def meshed(
    gmsh: ModuleType, corners: int = 3, size_at: Callable[[float, float], float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and cells (m, corners) of gmsh's current model, of its sizes or size_at(x, y)
    [mm]."""
    if size_at:
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, *_: size_at(x, y))
    try:
        gmsh.model.mesh.generate(2)
    finally:
        if size_at:
            gmsh.model.mesh.removeSizeCallback()
    tags, x, _ = gmsh.model.mesh.getNodes()
    _, nodes = gmsh.model.mesh.getElementsByType({3: 2, 4: 3}[corners])
    order = np.argsort(tags)
    cells = order[np.searchsorted(tags[order], nodes)]
    return x.reshape(-1, 3), cells.reshape(-1, corners)
