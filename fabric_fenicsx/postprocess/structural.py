"""Formed plies with their yarn directions, for a structural analysis: VTU and Abaqus input."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyvista

from ..runtime.errors import InputError
from ..runtime.files import replace_file
from .ply import SAME, Grid, areas, grid_of
from .states import save, set_labels

CORNERS = {5: 3, 69: 3, 9: 4, 70: 4}  # of VTK's cells, which begin with them
UNITS = dict.fromkeys(("yarn_a", "yarn_b", "normal", "area_ratio", "part"), "-")
UNITS["shear_angle"] = "rad"
TABLE = "yarn_axes"


class FormedPly(NamedTuple):
    """points (n, 3) [mm] of the formed ply's nodes, cells (m, 3 or 4) by their corners,
    anticlockwise about the normal, and fields {name: (m,) or (m, 3)}: unit vectors `yarn_a`,
    `yarn_b`, `normal` (to the side from which b is anticlockwise of a), `shear_angle` [rad],
    `area_ratio` (formed over flat). A sheet without yarns, as of metal, has `area_ratio` alone."""

    points: np.ndarray
    cells: np.ndarray
    fields: dict[str, np.ndarray]


def formed_ply(grid: Grid) -> FormedPly:
    """The formed ply of a grid as `Result.grids` has it; cells of higher degree by their
    corners."""
    corners = CORNERS[int(grid.celltypes[0])]
    cells = grid.cell_connectivity.reshape(grid.n_cells, -1)[:, :corners]
    x, u = (np.asarray(each, dtype=float) for each in (grid.points, grid.point_data["u"]))
    flat = grid_of(x, cells, u).clean(tolerance=SAME)
    ((_, cells),) = flat.cells_dict.items()
    cells, x = cells.astype(np.int64), np.asarray(flat.points)
    points, fields = x + np.asarray(flat.point_data["u"]), {}
    # not VTK's compute_cell_sizes, which crashed on Debian 13
    ratio = areas(points[cells]) / areas(x[cells])
    if "a" in grid.cell_data:
        a, b = (_unit(np.asarray(grid.cell_data[name], dtype=float)) for name in "ab")
        fields = {"yarn_a": a, "yarn_b": b, "normal": _unit(np.cross(a, b))}
        fields["shear_angle"] = np.asarray(grid.cell_data["shear_angle"])
        p, q, r = points[cells[:, 0]], points[cells[:, 1]], points[cells[:, -1]]
        behind = (np.cross(q - p, r - p) * fields["normal"]).sum(1) < 0
        cells[behind] = cells[behind, ::-1]
    return FormedPly(points, cells, fields | {"area_ratio": ratio})


def _unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def checked(path: Path | str) -> Path:
    """The path of a file to write; InputError if its ending is none of those known."""
    path = Path(path)
    if path.suffix not in (".vtu", ".inp"):
        raise InputError(f"the ending of {path} is unknown; allowed are .vtu and .inp")
    return path


def export(grids: Mapping[str, Grid], path: Path | str) -> None:
    """Write the formed plies {name: grid} with their yarn directions to `path`: `.vtu` for VTK's
    readers, `.inp` as Abaqus input.

    The VTU file has the fields of `FormedPly` and `part`, the ply's number. The Abaqus file has
    for each ply its nodes, shell elements (S3 or S4) in a set with its name as `set_labels` spells
    it and, as distributions, two orientations LABEL_yarns_a and LABEL_yarns_b: axis 1 along that
    yarn, axis 3 along `normal`. Raises InputError for another ending, and if no ply has yarns.
    """
    path, plies = checked(path), {name: formed_ply(grid) for name, grid in grids.items()}
    if not any("yarn_a" in ply.fields for ply in plies.values()):
        raise InputError("no sheet has yarns; allowed is at least one ply of fabric")
    if path.suffix == ".vtu":
        save(path, _joined(plies.values()), UNITS)
    else:
        replace_file(path, "".join(_abaqus(plies)))


def _joined(plies):
    """All plies as one grid; directions of a sheet without yarns are NaN."""
    grids = []
    for number, ply in enumerate(plies):
        grid, m = grid_of(ply.points, ply.cells, 0 * ply.points), len(ply.cells)
        grid.clear_point_data()
        missing = dict.fromkeys(("yarn_a", "yarn_b", "normal"), np.full((m, 3), np.nan))
        missing["shear_angle"] = np.full(m, np.nan)
        grid.cell_data.update(missing | ply.fields)
        grid.cell_data["part"] = np.full(m, number, dtype=np.int32)
        grids.append(grid)
    return pyvista.MultiBlock(grids).combine() if len(grids) > 1 else grids[0]


def _abaqus(plies):
    """Lines of the Abaqus input."""
    labels = set_labels(plies)
    yield "** formed plies with their yarn directions, by fabric_fenicsx; mm\n"
    yield f"*DISTRIBUTION TABLE, NAME={TABLE}\nCOORD3D, COORD3D\n"
    node = element = 0
    for name, (points, cells, fields) in plies.items():
        label = labels[name]
        yield f"** ply {name!a}: ELSET {label}\n" if name else ""
        yield "*NODE\n"
        yield from _lines(node, points)
        yield f"*ELEMENT, TYPE=S{cells.shape[1]}, ELSET={label}\n"
        yield from _lines(element, cells + node + 1)
        if "yarn_a" in fields:
            a, b = fields["yarn_a"], fields["yarn_b"]
            # the second axis so that the third is the same
            for yarn, axes in (("a", [a, b]), ("b", [b, -a])):
                own = f"{label}_yarns_{yarn}"
                yield f"*DISTRIBUTION, NAME={own}, LOCATION=ELEMENT, TABLE={TABLE}\n"
                yield ", 1.0, 0.0, 0.0, 0.0, 1.0, 0.0\n"
                yield from _lines(element, np.hstack(axes))
                yield f"*ORIENTATION, NAME={own}, SYSTEM=RECTANGULAR\n{own}\n3, 0.0\n"
        node, element = node + len(points), element + len(cells)


def _lines(before, rows):
    """Rows of numbers, each with its own number, of which the first comes after `before`."""
    for number, row in enumerate(rows.tolist(), before + 1):
        yield f"{number}, {', '.join(f'{value:.9g}' for value in row)}\n"
