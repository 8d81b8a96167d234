"""Written states of a run as PyVista grids: whole or a sheet at a time, with units."""

import json
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import lazy_loader
import numpy as np
from scipy.spatial.transform import Rotation

from ..core.errors import InputError
from ..core.files import replace_file
from ..core.rules import unknown_key
from ..surfaces.tool import Frame, Tool
from .ply import Grid, Surface, mark_planes, marked_planes, set_arrays

pyvista = lazy_loader.load("pyvista")


class State(NamedTuple):
    """A written state of a run: the `folder` of its results, and the load."""

    folder: Path
    load: float

    def plies(self) -> dict[str, Grid]:
        """Each ply {name: grid}, or the one {"": grid}."""
        sets = ElementTree.parse(self.folder / "fields.pvd").getroot().iter("DataSet")
        names = dict.fromkeys(entry.get("name", "") for entry in sets)
        return sheets_of(read_state(self.folder, self.load), [name for name in names if name])

    def tools(self) -> dict[str, Surface]:
        """Surfaces of the tools, where they are then {name: surface}; empty without tools."""
        if not (self.folder / "tools.pvd").is_file():
            return {}
        (blocks,) = _read(self.folder / "tools.pvd", self.load)
        return dict(zip(blocks.keys(), blocks))


def states(folder: Path | str) -> list[State]:
    """All states in the results `folder`. Raises InputError where there are none."""
    folder = Path(folder)
    if not (folder / "fields.pvd").is_file():
        raise InputError(f"{folder} has no fields.pvd; expected the folder of a run's results")
    loads = pyvista.PVDReader(folder / "fields.pvd").time_values
    return [State(folder, float(load)) for load in loads]


def read_grids(folder: Path | str) -> dict[str, Grid]:
    """The last state of each ply {name: grid}, or of the one {"": grid}, in the results `folder`.
    Raises InputError where there are none."""
    return states(folder)[-1].plies()


def frame_of(folder: Path | str, tool: str) -> Frame:
    """The coordinates of a tool's file at the end of the run in the results `folder`, or above it,
    of one that is unloaded; tool: its name, "tool" for the leading one. Raises InputError."""
    places: dict[str, dict] = {}
    for summary in (Path(folder) / "summary.json", Path(folder).resolve().parent / "summary.json"):
        if not places and summary.is_file():
            places = json.loads(summary.read_text()).get("quantities", {}).get("tool_places", {})
    place = places.get([*places, tool][0] if tool == "tool" else tool)
    if not place:
        raise unknown_key(tool, places, f"tool {tool} of {folder}")
    axes = Rotation.from_euler("xyz", place["turned_by_deg"], degrees=True).as_matrix()
    return Frame(np.array(place["placed_at_mm"]), axes)


def read_state(folder: Path, load: float | None = None) -> Grid:
    """The state at `load`, by default the last, in `folder`/fields.pvd: one grid of all ranks'
    parts. A cell field that only some sheets have is NaN on the others."""
    blocks = [block for block in _read(folder / "fields.pvd", load) if block.n_cells]
    grid = combined(blocks)
    mark_planes(grid, marked_planes(blocks[0]))
    return grid


def combined(grids: Sequence[Grid]) -> Grid:
    """One grid of several; a cell field that only some have becomes NaN on the others."""
    shapes = {name: np.shape(values)[1:] for g in grids for name, values in g.cell_data.items()}
    for grid in grids:
        for name in shapes.keys() - set(grid.cell_data):
            grid.cell_data[name] = np.full((grid.n_cells, *shapes[name]), np.nan)
    return pyvista.MultiBlock(grids).combine()


def _read(listed, load):
    """Blocks of the state at `load`, by default the last, that a .pvd file lists."""
    reader = pyvista.PVDReader(listed)
    reader.set_active_time_value(reader.time_values[-1] if load is None else load)
    blocks = reader.read()
    for block in blocks:
        if isinstance(block, pyvista.DataSet):
            _drop_units(block)
    return blocks


def _drop_units(block):
    """Give the arrays of a grid the names and units that they had before `save`."""
    radians, units = list(block.field_data.get("radians", ())), []
    for line in block.field_data.get("units", ()):
        written, unit = line.removesuffix("]").split(" [")
        name, angle = written.removesuffix(_suffix(unit)), written in radians
        units.append(f"{name} [{'rad' if angle else unit}]")
        for arrays in (block.point_data, block.cell_data):
            if written in arrays and written != name:
                values = arrays.pop(written)
                arrays[name] = np.radians(values) if angle else values
    block.field_data["units"] = units


def _suffix(unit):
    """The end of a name that tells its unit: "_N_per_mm2", of no unit ""."""
    plain = unit.replace(" ", "").replace("^", "").replace("/", "_per_")
    return f"_{plain}" if plain.strip("-") else ""


def units(folder: Path | str) -> dict[str, str]:
    """Units {name: unit} of the arrays in the results `folder`."""
    blocks = _read(Path(folder) / "fields.pvd", None)
    lines = (str(text) for block in blocks for text in block.field_data.get("units", ()))
    return dict(re.findall(r"(\w+) \[(.*?)\]", "\n".join(lines)))


def sheets_of(grid: Grid, names: Sequence[str]) -> dict[str, Grid]:
    """The sheets of a stack with these names {name: grid}, or without names {"": the grid}."""
    if not names:
        return {"": grid}
    number = np.asarray(grid.cell_data["part"])
    sheets = {}
    for k, name in enumerate(names):
        sheets[name] = with_known_fields(grid.extract_cells(number == k))
        mark_planes(sheets[name], marked_planes(grid))
    return sheets


def of_fabric(grids: Mapping[str, Grid]) -> dict[str, Grid]:
    """The plies {name: grid} that have yarns."""
    return {name: grid for name, grid in grids.items() if "shear_angle" in grid.cell_data}


def with_known_fields(grid: Grid) -> Grid:
    """The grid without cell fields that are NaN all over, whose range VTK can't read back."""
    for name, values in list(grid.cell_data.items()):
        if np.issubdtype(values.dtype, np.floating) and np.isnan(values).all():
            grid.cell_data.remove(name)
    for arrays in (grid.cell_data, grid.point_data):
        for name in set(arrays) & {"vtkOriginalCellIds", "vtkOriginalPointIds"}:
            arrays.remove(name)
    return grid


def save(
    path: Path, data: Grid | Surface, known: Mapping[str, str], portable: bool = False
) -> None:
    """Write a grid or surface to `path`, whole or not at all. known: units of arrays {name: unit};
    in the file a name ends with its unit, and angles are in degrees. portable: without texts and
    LZ4, which meshio cannot read."""
    from vtkmodules import vtkIOXML
    from vtkmodules.util.numpy_support import vtk_to_numpy

    written, units, radians = data.NewInstance(), [], []
    written.ShallowCopy(data)
    for arrays in (written.GetPointData(), written.GetCellData()):
        names = [arrays.GetArrayName(k) for k in range(arrays.GetNumberOfArrays())]
        for name in [each for each in names if each in known]:
            unit = "deg" if known[name] == "rad" else known[name]
            longer = f"{name}{_suffix(unit)}"
            units.append(f"{longer} [{unit}]")
            if longer != name:
                values = vtk_to_numpy(arrays.GetArray(name))
                arrays.RemoveArray(name)
                set_arrays(arrays, {longer: values if unit == known[name] else np.degrees(values)})
            if unit != known[name]:
                radians.append(longer)
    is_grid = data.IsA("vtkUnstructuredGrid")
    writer = vtkIOXML.vtkXMLUnstructuredGridWriter() if is_grid else vtkIOXML.vtkXMLPolyDataWriter()
    if not portable:
        texts = {"units": units} | ({"radians": radians} if radians else {})
        set_arrays(written.GetFieldData(), texts)
        writer.SetCompressorTypeToLZ4()  # takes a third of zlib's time
    writer.SetInputData(written)
    # not VTK's raw data, which ParaView 5.11 can't read with Debian 12's expat
    writer.SetDataModeToBinary()
    # to memory first, as VTK does not say what error it met with a file
    writer.WriteToOutputStringOn()
    writer.Write()
    replace_file(path, writer.GetOutputString().encode())


def triangulated(tool: Tool, low: np.ndarray, high: np.ndarray) -> Surface:
    """Surface of `tool`, before it is moved, around a blank from `low` to `high` (3,) [mm], as far
    as it comes near the blank on its path."""
    size = high - low
    is_flat = size < 1e-6 * size.max()
    margin = np.maximum(0.1 * size, 0.5 * size.max() * is_flat)
    places = np.array([tool.path(load) for load in (0.0, 1.0)])
    low, high = low - margin - places.max(0), high + margin - places.min(0)
    # of the grid that a tool's surface is found on
    points, normals, triangles = tool.surface.mesh(low, high, (high - low).max() / 100)
    surface = pyvista.PolyData.from_regular_faces(points.astype(np.float32), triangles)
    surface.point_data.active_normals = normals.astype(np.float32)
    surface.field_data["tool"] = [tool.name]
    return surface


def set_labels(names: Iterable[str], longest: int = 64) -> dict[str, str]:
    """Labels {name: label} of plies in files' names and in Abaqus: letters, digits and _ only, a
    letter first, no two alike but for capitals. A sign becomes p or m: +45 is p45. longest: of a
    label [characters]; Abaqus reads 80, so that "_yarns_a" fits behind."""
    labels: dict[str, str] = {}
    for name in names:
        plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
        plain = re.sub(r"(?<![^\W_])([+-])(?=\d)", lambda sign: "pm"[sign[1] == "-"], plain)
        plain = re.sub(r"[\W_]+", "_", plain, flags=re.ASCII).strip("_")
        plain = plain if plain[:1].isalpha() else f"ply_{plain}".rstrip("_")
        taken = {each.lower() for each in labels.values()}
        endings = chain([""], (f"_{again}" for again in count(2)))
        tried = (plain[: longest - len(end)] + end for end in endings)
        labels[name] = next(label for label in tried if label.lower() not in taken)
    return labels
