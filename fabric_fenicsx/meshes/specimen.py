"""Rectangular specimen: structured (crossed, left, right), unstructured or with edges along yarns,
of triangles or quadrilaterals.

python3 meshes/specimen.py --length 200 --width 50 --nx 100 --ny 25 --pattern crossed --out
specimen.msh
"""

import argparse
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from scipy.spatial import Delaunay

from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.runtime.rules import COUNT, POSITIVE

PATTERNS = ("crossed", "graded", "left", "right", "along", "unstructured", "yarns")
EDGE = 0.5  # least distance of corners of squares from the sheet's edges, over their size
GRADING = 0.95  # by which cells of `graded` are shorter on the lines through the corners


def specimen(
    length: float = 200.0,
    width: float = 50.0,
    nx: int = 100,
    ny: int = 25,
    pattern: str = "crossed",
    cell: str = "triangle",
    yarns: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, str]:
    """Points (n, 3) [mm], cells (m, k) in gmsh's order and their kind, of the sheet [0, length] x
    [0, width].

    pattern: of nx x ny rectangles `crossed` makes four triangles each by both diagonals, `right`
    two by the diagonal that rises to the right, `left` by the other; `graded` is `crossed` with
    cells small across the lines at 45 deg through the corners, where a bias test's shear angle
    jumps; `along` is `crossed` of squares that are turned along the yarns, with other triangles
    between them and the edges; `unstructured` meshes with cells of about those sizes, and so does
    `yarns`, but with edges along the yarns through the corners.
    cell: "triangle" or "quadrilateral" (nx x ny rectangles, or unstructured). yarns: angle of one
    family of yarns to the length [rad], the other is perpendicular. Raises InputError for other
    patterns and cells, sizes or numbers that are not above 0, for quadrilaterals `along` yarns, and
    for `graded` if the length is not a multiple of the width.
    """
    for name, value, allowed in (
        ("pattern", pattern, PATTERNS),
        ("cell", cell, ("triangle", "quadrilateral")),
    ):
        if value not in allowed:
            raise InputError(f"{name} is {value!r}; allowed are {', '.join(allowed)}")
    length, width = POSITIVE.check("length", length), POSITIVE.check("width", width)
    nx, ny = COUNT.check("nx", nx), COUNT.check("ny", ny)
    if pattern == "graded" and not can_be_graded(length, width):
        raise InputError(
            f"a strip of {length:g} x {width:g} mm is asked for in pattern graded; allowed is a "
            "length that is a multiple of the width"
        )
    if pattern == "along":
        if cell != "triangle":
            raise InputError(f"pattern is along and cell {cell}; allowed are triangles")
        return _along(length, width, max(length / nx, width / ny), yarns)
    if pattern in ("unstructured", "yarns"):
        lines = yarns_through_corners(length, width, yarns) if pattern == "yarns" else ()
        return _unstructured(length, width, max(length / nx, width / ny), cell, lines)
    x, y = np.meshgrid(np.linspace(0, length, nx + 1), np.linspace(0, width, ny + 1), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    i, j = (k.ravel() for k in np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"))
    p00, p01 = i * (ny + 1) + j, i * (ny + 1) + j + 1
    p10, p11 = p00 + ny + 1, p01 + ny + 1
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
        points = graded(points, width)
    numbers = np.stack([np.column_stack(c) for c in cells], 1).reshape(-1, len(cells[0]))
    return (
        np.column_stack([points, np.zeros(len(points))]),
        numbers,
        "quad" if cell == "quadrilateral" else "triangle",
    )


def can_be_graded(length: float, width: float) -> bool:
    """Whether lines at 45 deg from the corners at both ends of a strip meet the others' ends on its
    edges."""
    return abs(length / width - round(length / width)) <= 1e-9


def graded(points: np.ndarray, width: float) -> np.ndarray:
    """Points (n, 2) [mm] moved along both diagonals towards the lines at 45 deg through a strip's
    corners; its edges stay, and so do the directions of edges at 45 deg."""
    along = np.stack([points[:, 0] + points[:, 1], points[:, 0] - points[:, 1]])
    along -= GRADING * width / (2 * np.pi) * np.sin(2 * np.pi * along / width)
    return np.column_stack([along.sum(0) / 2, (along[0] - along[1]) / 2])


def yarns_through_corners(length: float, width: float, angle: float) -> np.ndarray:
    """Segments (n, 2, 2) [mm] inside the sheet of the yarns that start at its corners, at `angle`
    [rad] and across it."""
    size, segments = np.array([length, width]), []
    for corner in np.array([(0, 0), (1, 0), (1, 1), (0, 1)]):
        for quarter in range(4):
            turned = angle + quarter * math.pi / 2
            direction = np.array([math.cos(turned), math.sin(turned)])
            inwards = direction * (1 - 2 * corner)
            if inwards.min() > 1e-9:
                start = corner * size
                segments.append((start, start + direction * (size / inwards).min()))
    return np.array(segments).reshape(-1, 2, 2)


def _along(
    length: float, width: float, size: float, angle: float
) -> tuple[np.ndarray, np.ndarray, str]:
    """Squares along `angle` [rad], each of four triangles by both diagonals, where their corners
    are `EDGE` of their size off the sheet's edges; other triangles from there to points on the
    edges."""
    sides = np.array([length, width])
    half = math.ceil(math.hypot(length, width) / 2 / size) + 1
    count = 2 * half + 1
    across = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    grid = np.indices((count, count)).reshape(2, -1).T - half
    grid = size * (grid - 0.5) @ across + sides / 2
    inside = (np.minimum(grid, sides - grid) > EDGE * size).all(1)
    number = np.where(inside, np.cumsum(inside) - 1, -1).reshape(count, count)
    x, y = (np.linspace(0, side, max(1, round(side / size)) + 1) for side in sides)
    edges = [np.column_stack([x, 0 * x + at]) for at in (0, width)]
    edges += [np.column_stack([0 * y + at, y])[1:-1] for at in (0, length)]
    points = np.concatenate([grid[inside], *edges])
    cells = Delaunay(points).simplices
    arms = points[cells[:, 1:]] - points[cells[:, :1]]
    area = arms[:, 0, 0] * arms[:, 1, 1] - arms[:, 0, 1] * arms[:, 1, 0]
    cells = cells[abs(area) > 1e-6 * size**2]  # flat ones lie along the edges
    # of each square both triangles, whichever diagonal they have
    square = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    square = square[(square >= 0).all(2)]
    halves = {tuple(sorted(cell)): n for n, cell in enumerate(cells.tolist())}
    gone, whole = [], []
    for corners in square.tolist():
        for k in range(2):
            pair = [sorted(corners[k : k + 3]), sorted((corners[2 + k :] + corners[: k + 1])[:3])]
            found = [halves[each] for each in map(tuple, pair) if each in halves]
            if len(found) == 2:
                gone += found
                whole.append(corners)
    corners = np.array(whole, dtype=np.int64).reshape(-1, 4)
    centre = len(points) + np.arange(len(corners))
    crossed = [(corners[:, k], corners[:, (k + 1) % 4], centre) for k in range(4)]
    points = np.concatenate([points, points[corners].mean(1)])
    cells = np.concatenate([np.delete(cells, gone, axis=0), *map(np.column_stack, crossed)])
    return np.column_stack([points, np.zeros(len(points))]), cells, "triangle"


def _unstructured(
    length: float, width: float, size: float, cell: str, lines: Iterable[np.ndarray] = ()
) -> tuple[np.ndarray, np.ndarray, str]:
    import gmsh

    gmsh.initialize(readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("specimen")
        occ = gmsh.model.occ
        sheet = occ.addRectangle(0, 0, 0, length, width)
        edges = [(1, occ.addLine(*(occ.addPoint(*end, 0) for end in line))) for line in lines]
        if edges:
            occ.fragment([(2, sheet)], edges)
        occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.Algorithm", 6)
        if cell == "quadrilateral":
            gmsh.option.setNumber("Mesh.RecombineAll", 1)
            gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3)  # blossom, quadrilaterals only
        gmsh.model.mesh.generate(2)
        tags, x, _ = gmsh.model.mesh.getNodes()
        number = np.zeros(int(tags.max()) + 1, dtype=np.int64)
        number[tags.astype(np.int64)] = np.arange(len(tags))
        corners, gmsh_type = (4, 3) if cell == "quadrilateral" else (3, 2)
        _, nodes = gmsh.model.mesh.getElementsByType(gmsh_type)
        return (
            x.reshape(-1, 3),
            number[nodes.astype(np.int64)].reshape(-1, corners),
            "quad" if corners == 4 else "triangle",
        )
    finally:
        gmsh.finalize()


def write(path: Path | str, points: np.ndarray, cells: np.ndarray, kind: str) -> None:
    """Write what `specimen` gives, and its four edges, as physical groups (sheet, left, right,
    bottom, top) to a .msh file."""
    import gmsh

    gmsh.initialize(readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("specimen")
        sheet = gmsh.model.addDiscreteEntity(2)
        gmsh.model.mesh.addNodes(2, sheet, np.arange(1, len(points) + 1), points.ravel())
        gmsh.model.mesh.addElementsByType(
            sheet, 3 if kind == "quad" else 2, [], (cells + 1).ravel()
        )
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [sheet]), "sheet")
        sides = np.sort(np.stack([cells, np.roll(cells, -1, 1)], 2).reshape(-1, 2), 1)
        sides, count = np.unique(sides, axis=0, return_counts=True)
        sides = sides[count == 1]
        low, high = points.min(0), points.max(0)
        tolerance = 1e-9 * (high - low).max()
        for name, axis, value in (
            ("left", 0, low),
            ("right", 0, high),
            ("bottom", 1, low),
            ("top", 1, high),
        ):
            on = (np.abs(points[sides][:, :, axis] - value[axis]) <= tolerance).all(1)
            edge = gmsh.model.addDiscreteEntity(1)
            gmsh.model.mesh.addElementsByType(edge, 1, [], (sides[on] + 1).ravel())
            gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, [edge]), name)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


def main() -> None:
    """What `python3 meshes/specimen.py` does; exit status 2 for options that are not allowed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--length", type=float, default=200.0, help="along x [mm]")
    parser.add_argument("--width", type=float, default=50.0, help="along y [mm]")
    parser.add_argument("--nx", type=int, default=100, help="rectangles along the length")
    parser.add_argument("--ny", type=int, default=25, help="rectangles across the width")
    parser.add_argument("--pattern", choices=PATTERNS, default="crossed")
    parser.add_argument(
        "--fibre-angle",
        type=float,
        default=0.0,
        help="of the yarns [deg], for patterns `along` and `yarns`",
    )
    parser.add_argument("--cell", choices=("triangle", "quadrilateral"), default="triangle")
    parser.add_argument(
        "--out", default="specimen.msh", help="file to write, of any format that gmsh writes"
    )
    args = parser.parse_args()
    if not math.isfinite(args.fibre_angle):
        parser.error(f"--fibre-angle is {args.fibre_angle}; allowed is a finite angle in deg")
    for name in ("length", "width", "nx", "ny"):
        if not 0 < getattr(args, name) < float("inf"):
            parser.error(f"--{name} is {getattr(args, name)}; allowed is a finite value above 0")
    sizes = args.length, args.width, args.nx, args.ny
    try:
        points, cells, kind = specimen(
            *sizes, args.pattern, args.cell, math.radians(args.fibre_angle)
        )
    except InputError as error:
        parser.error(str(error))
    try:
        open(args.out, "w").close()  # gmsh only logs that it could not write
    except OSError as error:
        parser.error(
            f"--out {args.out} can't be written ({error.strerror}); allowed is a file "
            "in a folder that is there"
        )
    write(args.out, points, cells, kind)
    print(f"{args.out}: {len(points)} nodes, {len(cells)} {args.cell}s")
