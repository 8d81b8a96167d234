"""A formed ply as nodes and triangles, from the grid of a state."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import lazy_loader
import numpy as np
from numpy.typing import ArrayLike

from ..core.rules import unknown_key
from ..surfaces.tool import Frame

if TYPE_CHECKING:
    import pyvista

    Grid: TypeAlias = pyvista.UnstructuredGrid
    Surface: TypeAlias = pyvista.PolyData
else:  # takes half a second
    Grid = Surface = object
    pyvista = lazy_loader.load("pyvista")

SAME = 1e-6  # mm within which places are the same
# field data: axes to which planes of symmetry are perpendicular, and where these cut them [mm]
SYMMETRIC, PLACES = "planes_of_symmetry", "places_of_planes"


class Ply(NamedTuple):
    """x, u (n, 3) [mm]: undeformed places of nodes and displacements; cells (m, 3), triangles that
    are anticlockwise on the flat ply, or as exported (m, 3 or 4); fields {name: (m,) or (m, 3)} on
    these; planes: {axis to which a plane of symmetry is perpendicular: its place [mm]}."""

    x: np.ndarray
    u: np.ndarray
    cells: np.ndarray
    fields: dict
    planes: Mapping[int, float]

    @property
    def formed(self) -> np.ndarray:
        """Places of the nodes now, (n, 3) [mm]."""
        return self.x + self.u

    def at_nodes(self, values: np.ndarray) -> np.ndarray:
        """Means (n,) of `values` (m,) over the cells around each node, by areas on the flat ply."""
        area, n = plan_area(self.x, self.cells), len(self.x)
        sums = (np.bincount(self.cells.ravel(), np.repeat(v, 3), n) for v in (area * values, area))
        return np.divide(*sums)


def grid_of(points: np.ndarray, cells: np.ndarray, u: np.ndarray) -> Grid:
    """A grid of points (n, 3) with displacements `u`, and cells (m, 3 or 4) of corners."""
    kind = pyvista.CellType.TRIANGLE if cells.shape[1] == 3 else pyvista.CellType.QUAD
    grid = pyvista.UnstructuredGrid({kind: cells}, points)
    grid.point_data["u"] = u
    return grid


def plain_grid(cells: np.ndarray, types: np.ndarray, points: np.ndarray) -> Grid:
    """VTK's own grid of cells of one type, given as PyVista takes them, which itself takes long to
    import."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkUnstructuredGrid

    grid, places, listed = vtkUnstructuredGrid(), vtkPoints(), vtkCellArray()
    places.SetData(numpy_to_vtk(np.ascontiguousarray(points), deep=True))
    listed.ImportLegacyFormat(numpy_to_vtkIdTypeArray(np.array(cells, np.int64), deep=True))
    grid.SetPoints(places)
    grid.SetCells(int(types[0]), listed)
    return grid


def set_arrays(arrays: Any, fields: Mapping[str, ArrayLike]) -> None:
    """Set point, cell or field data of a VTK grid, numbers or texts."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkStringArray

    for name, given in fields.items():
        values = np.ascontiguousarray(given)
        values = values.view(np.uint8) if values.dtype == bool else values  # VTK has no bool
        if values.dtype.kind == "U":
            array = vtkStringArray()
            for text in values.tolist():
                array.InsertNextValue(text)
        else:
            array = numpy_to_vtk(values, deep=True)
        array.SetName(name)
        arrays.AddArray(array)


def whole(ply: Ply) -> Ply:
    """The ply with its mirror images, whose cells and nodes follow its own; nodes on a plane of
    symmetry have none."""
    x, u, cells, fields = ply.x, ply.u, ply.cells, ply.fields
    for axis, place in ply.planes.items():
        mirror = np.where(np.arange(3) == axis, -1.0, 1.0)
        off, image = np.flatnonzero(abs(x[:, axis] - place) > SAME), np.arange(len(x))
        image[off] = len(x) + np.arange(len(off))
        x, u = (np.vstack([p, p[off] * mirror]) for p in (x, u))
        x[len(x) - len(off) :, axis] += 2 * place
        cells = np.vstack([cells, image[cells][:, ::-1]])  # turned round
        fields = {
            name: np.concatenate([v, v * mirror if v.shape[1:] == (3,) else v])
            for name, v in fields.items()
        }
    return Ply(x, u, cells, fields, {})


def in_frame(ply: Ply, frame: Frame | None) -> Ply:
    """The ply in other coordinates, if any, with vectors along their axes."""
    if frame is None:
        return ply
    fields = {n: v @ frame.axes if v.shape[1:] == (3,) else v for n, v in ply.fields.items()}
    return ply._replace(x=frame.inside(ply.x), u=ply.u @ frame.axes, fields=fields)


def check_field(name: str, *fields: Mapping) -> None:
    """Raise InputError for a `name` that none of the `fields` {name: values} of one number a place
    has."""
    arrays = [each for of_one in fields for each in of_one.items()]
    known = sorted({each for each, values in arrays if np.ndim(values) == 1})
    if name not in known:
        raise unknown_key(name, known, f"field {name}")


def plan_area(x: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Areas (m,) in plan of `triangles`, negative where clockwise."""
    p, q, r = x[triangles, :2].swapaxes(0, 1)
    return np.linalg.det(np.stack([q - p, r - p], 1)) / 2


def areas(corners: np.ndarray) -> np.ndarray:
    """Areas (m,) of cells with corners (m, 3 or 4, 3), as of triangles that share the first."""
    sides = corners[:, 1:] - corners[:, :1]
    return np.linalg.norm(np.cross(sides[:, :-1], sides[:, 1:]), axis=2).sum(1) / 2


def edge_sides(triangles: np.ndarray) -> np.ndarray:
    """Nodes (k, 2) of the sides that one of the `triangles` (m, 3) has alone, in its order."""
    sides = np.stack([triangles, np.roll(triangles, -1, 1)], 2).reshape(-1, 2)
    _, first, count = np.unique(np.sort(sides, 1), axis=0, return_index=True, return_counts=True)
    return sides[first[count == 1]]


def marked_planes(grid: Grid | Surface) -> dict[int, float]:
    """The planes of symmetry, as of a `Ply`, of the scene that a grid is of."""
    axes = [int(axis) for axis in grid.field_data.get(SYMMETRIC, ())]
    return dict(zip(axes, map(float, grid.field_data.get(PLACES, [0.0] * len(axes)))))


def mark_planes(grid: Grid | Surface, planes: Mapping[int, float]) -> None:
    """Note planes of symmetry, as of a `Ply`, in a grid."""
    set_arrays(grid.GetFieldData(), {SYMMETRIC: [*planes], PLACES: [*planes.values()]})


def planes_of(grid: Grid) -> dict[int, float]:
    """The planes of symmetry, as of a `Ply`, that the ply in a grid reaches."""
    low = grid.points.min(0)
    return {k: at for k, at in marked_planes(grid).items() if abs(low[k] - at) < SAME}


def _halved(grid):
    """The grid with quadrilaterals as halves along their shorter diagonal; of equal ones along that
    which ends nearest to low x, then y, whatever the order of the nodes."""
    quads = grid.cells_dict.get(pyvista.CellType.QUAD)  # a sheet has cells of one kind
    if quads is None:
        return grid
    x = grid.points[quads].round(6)
    apart = np.linalg.norm(x[:, :2] - x[:, 2:], axis=2)
    first = np.lexsort(np.moveaxis(x, -1, 0)[1::-1], axis=1)[:, 0] % 2
    equal = abs(apart[:, 0] - apart[:, 1]) < SAME
    start = np.where(equal, first, apart.argmin(1))
    nodes = np.take_along_axis(quads, (start[:, None] + np.arange(4)) % 4, 1)
    halves = nodes[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    triangles = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: halves}, grid.points)
    triangles.point_data.update(grid.point_data)
    triangles.field_data.update(grid.field_data)
    for name, values in grid.cell_data.items():
        triangles.cell_data[name] = np.repeat(values, 2, axis=0)
    return triangles


def ply_of(grid: Grid) -> Ply:
    """The ply in a grid, its nodes merged and its cells cut into triangles."""
    planes = planes_of(grid)
    grid = _halved(grid).triangulate().clean(tolerance=SAME)
    triangles = grid.cells_dict[pyvista.CellType.TRIANGLE].astype(np.int64)
    x = np.array(grid.points, dtype=float)
    x[abs(x) < SAME] = 0  # a path on a plane of symmetry must not miss the ply by rounding
    for axis, at in planes.items():
        x[abs(x[:, axis] - at) < SAME, axis] = at
    clockwise = plan_area(x, triangles) < 0
    triangles[clockwise] = triangles[clockwise, ::-1]
    fields = {name: np.asarray(values) for name, values in grid.cell_data.items()}
    return Ply(x, np.asarray(grid.point_data["u"], dtype=float), triangles, fields, planes)
