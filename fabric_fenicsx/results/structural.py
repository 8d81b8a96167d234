"""Formed plies with their yarn directions, for a structural analysis: VTU and Abaqus input."""

import re
import unicodedata
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import pyvista

from ..runtime.errors import InputError
from ..runtime.files import replace_file
from .fields import read_state, save, sheets_of

SAME = 1e-6  # mm within which nodes of different ranks are one
CORNERS = {5: 3, 69: 3, 9: 4, 70: 4}  # of VTK's cells, which begin with them
UNITS = {
    "yarn_a": "-",
    "yarn_b": "-",
    "normal": "-",
    "shear_angle": "rad",
    "area_ratio": "-",
    "part": "-",
}
TABLE = "yarn_axes"
LABEL = 64  # characters, of the 80 that Abaqus reads, so that "_yarns_a" fits behind


class FormedPly(NamedTuple):
    """points (n, 3) [mm] of the formed ply's nodes, cells (m, 3 or 4) by their corners,
    anticlockwise about the normal, and fields {name: (m,) or (m, 3)}: unit vectors `yarn_a`,
    `yarn_b`, `normal` (to the side from which b is anticlockwise of a), `shear_angle` [rad],
    `area_ratio` (formed over flat). A sheet without yarns, as of metal, has `area_ratio` alone."""

    points: np.ndarray
    cells: np.ndarray
    fields: dict[str, np.ndarray]


def formed_ply(grid: pyvista.UnstructuredGrid) -> FormedPly:
    """The formed ply of a grid as `Result.grids` has it; cells of higher degree by their
    corners."""
    corners = CORNERS[int(grid.celltypes[0])]
    cells = grid.cell_connectivity.reshape(grid.n_cells, -1)[:, :corners]
    kind = pyvista.CellType.TRIANGLE if corners == 3 else pyvista.CellType.QUAD
    flat = pyvista.UnstructuredGrid({kind: cells}, np.asarray(grid.points, dtype=float))
    flat.point_data["u"] = np.asarray(grid.point_data["u"], dtype=float)
    flat = flat.clean(tolerance=SAME)
    formed = flat.copy()
    formed.points = formed.points + formed.point_data["u"]
    joined = formed.cells_dict[kind].astype(np.int64)
    # not VTK's compute_cell_sizes, which crashed on Debian 13
    ratio = np.divide(*(_areas(np.asarray(g.points)[joined]) for g in (formed, flat)))
    fields = {}
    if "a" in grid.cell_data:
        a, b = (_unit(np.asarray(grid.cell_data[name], dtype=float)) for name in "ab")
        fields = {"yarn_a": a, "yarn_b": b, "normal": _unit(np.cross(a, b))}
        fields["shear_angle"] = np.asarray(grid.cell_data["shear_angle"])
    points, cells = np.asarray(formed.points), joined
    if fields:
        p, q, r = points[cells[:, 0]], points[cells[:, 1]], points[cells[:, -1]]
        behind = (np.cross(q - p, r - p) * fields["normal"]).sum(1) < 0
        cells[behind] = cells[behind, ::-1]
    return FormedPly(points, cells, fields | {"area_ratio": ratio})


def _areas(corners):
    """Of cells with corners (m, 3 or 4, 3), of the triangles that meet in the first corner."""
    arms = corners[:, 1:] - corners[:, :1]
    return np.linalg.norm(np.cross(arms[:, :-1], arms[:, 1:]), axis=2).sum(1) / 2


def _unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


class State(NamedTuple):
    """A written state of a run: its load, and what it reads from the results `folder`."""

    folder: Path
    load: float

    def plies(self) -> dict[str, pyvista.UnstructuredGrid]:
        """Each ply {name: grid}, or the one {"": grid}."""
        names = [name for name in _names(self.folder / "fields.pvd") if name]
        return sheets_of(read_state(self.folder, self.load), names)

    def tools(self) -> dict[str, pyvista.PolyData]:
        """Surfaces of the tools, where they are then {name: surface}; empty without tools."""
        listed = self.folder / "tools.pvd"
        if not listed.is_file():
            return {}
        reader = pyvista.PVDReader(listed)
        reader.set_active_time_value(self.load)
        (blocks,) = reader.read()
        return dict(zip(blocks.keys(), blocks))


def states(folder: Path | str) -> list[State]:
    """All states in the results `folder`. Raises InputError where there are none."""
    folder = Path(folder)
    if not (folder / "fields.pvd").is_file():
        raise InputError(f"{folder} has no fields.pvd; allowed is the folder of a run's results")
    loads = pyvista.PVDReader(folder / "fields.pvd").time_values
    return [State(folder, float(load)) for load in loads]


def read_grids(folder: Path | str) -> dict[str, pyvista.UnstructuredGrid]:
    """The last state of each ply {name: grid}, or of the one {"": grid}, in the results `folder`.
    Raises InputError where there are none."""
    return states(folder)[-1].plies()


def _names(listed):
    """Names of the sets that a .pvd file lists."""
    sets = ElementTree.parse(listed).getroot().iter("DataSet")
    return list(dict.fromkeys(entry.get("name", "") for entry in sets))


def units(folder: Path | str) -> dict[str, str]:
    """Units {name: unit} of the arrays in the results `folder`."""
    reader = pyvista.PVDReader(Path(folder) / "fields.pvd")
    reader.set_active_time_value(reader.time_values[-1])
    told = (text for block in reader.read() for text in block.field_data.get("units", ()))
    return {name: unit for name, unit in re.findall(r"(\w+) \[(.*?)\]", "\n".join(map(str, told)))}


def checked(path: Path | str) -> Path:
    """The path of a file to write; InputError if its ending is none of those known."""
    path = Path(path)
    if path.suffix not in (".vtu", ".inp"):
        raise InputError(f"the ending of {path} is unknown; allowed are .vtu and .inp")
    return path


def export(grids: Mapping[str, pyvista.UnstructuredGrid], path: Path | str) -> None:
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
        replace_file(path, "".join(_abaqus(plies)).encode())


def _joined(plies):
    """All plies as one grid; directions of a sheet without yarns are NaN."""
    grids = []
    for number, ply in enumerate(plies):
        kind = pyvista.CellType.TRIANGLE if ply.cells.shape[1] == 3 else pyvista.CellType.QUAD
        grid = pyvista.UnstructuredGrid({kind: ply.cells}, ply.points)
        m = len(ply.cells)
        missing = dict.fromkeys(("yarn_a", "yarn_b", "normal"), np.full((m, 3), np.nan))
        missing["shear_angle"] = np.full(m, np.nan)
        for name, values in (missing | ply.fields).items():
            grid.cell_data[name] = values
        grid.cell_data["part"] = np.full(m, number, dtype=np.int32)
        grids.append(grid)
    return pyvista.MultiBlock(grids).combine() if len(grids) > 1 else grids[0]


def set_labels(names: Iterable[str]) -> dict[str, str]:
    """Abaqus' labels {name: label} of plies: letters, digits and _ only, a letter first, at most
    `LABEL` of them, and no two alike, as Abaqus does not tell capitals apart. A sign before a
    number becomes p or m: +45 is p45."""
    labels: dict[str, str] = {}
    for name in names:
        plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
        plain = re.sub(r"(?<![^\W_])([+-])(?=\d)", lambda sign: "pm"[sign[1] == "-"], plain)
        plain = re.sub(r"[\W_]+", "_", plain, flags=re.ASCII).strip("_")
        plain = plain if plain[:1].isalpha() else f"ply_{plain}".rstrip("_")
        taken, label, again = {each.lower() for each in labels.values()}, plain[:LABEL], 1
        while label.lower() in taken:
            again += 1
            label = f"{plain[: LABEL - len(str(again)) - 1]}_{again}"
        labels[name] = label
    return labels


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
        yield from (_line(node + k, p) for k, p in enumerate(points, 1))
        yield f"*ELEMENT, TYPE=S{cells.shape[1]}, ELSET={label}\n"
        for k, corners in enumerate(cells + node + 1, 1):
            yield f"{element + k}, {', '.join(map(str, corners))}\n"
        if "yarn_a" in fields:
            a, b = fields["yarn_a"], fields["yarn_b"]
            # the second axis so that the third is the same
            for yarn, first, second in (("a", a, b), ("b", b, -a)):
                own = f"{label}_yarns_{yarn}"
                yield f"*DISTRIBUTION, NAME={own}, LOCATION=ELEMENT, TABLE={TABLE}\n"
                yield ", 1.0, 0.0, 0.0, 0.0, 1.0, 0.0\n"
                yield from (
                    _line(element + k, axes) for k, axes in enumerate(np.hstack([first, second]), 1)
                )
                yield f"*ORIENTATION, NAME={own}, SYSTEM=RECTANGULAR\n{own}\n3, 0.0\n"
        node, element = node + len(points), element + len(cells)


def _line(number, values):
    return f"{number}, {', '.join(f'{value:.9g}' for value in values)}\n"
