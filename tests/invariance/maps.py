"""Moves of whole scenes: each sheet's own mesh, moved, in a file; tools and holders with it."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field

import meshio
import numpy as np
import pyvista
from scipy.spatial.transform import Rotation

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.press.holders import EDGES, Region

KINDS = {"triangle": "triangle", "quadrilateral": "quad"}
MIRROR = np.diag([-1.0, 1.0, 1.0])


def about_z(deg):
    """Matrix (3, 3) of a turn about z."""
    return Rotation.from_euler("z", deg, degrees=True).as_matrix()


@dataclass(frozen=True)
class Map:
    """A place x goes to `axes` x + `shift`. lifted: z of the sheet in its file [mm]; renumbered:
    its cells and nodes are in another order."""

    shift: Sequence[float] = (0.0, 0.0)
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    lifted: float = 0.0
    renumbered: bool = False

    def __call__(self, x):
        return x @ self.axes.T + [*self.shift, 0.0]

    def then(self, other):
        """This map, and then the other."""
        shift, axes = other(np.append(self.shift, 0.0))[:2], other.axes @ self.axes
        more = self.lifted or other.lifted, self.renumbered or other.renumbered
        return Map(shift, axes, *more)

    def back(self, x):
        return (x - [*self.shift, 0.0]) @ self.axes

    @property
    def reverses(self):
        """Whether angles in plan turn the other way."""
        return np.linalg.det(self.axes[:2, :2]) < 0

    @property
    def is_over(self):
        """Whether up becomes down."""
        return self.axes[2, 2] < 0

    def angle(self, deg):
        """The angle in plan of a direction that was at `deg`."""
        rad = np.radians(deg)
        x = self.axes @ np.stack([np.cos(rad), np.sin(rad), 0.0 * rad])
        return np.degrees(np.arctan2(x[1], x[0])).round(9)

    def field(self, value, to=lambda value: value):
        """A number, or a field there, whose values become others by `to`."""
        if not isinstance(value, ff.Field):
            return value if value is None else float(to(value))
        places = lambda *x: np.stack(np.broadcast_arrays(*x, *[0.0] * (3 - len(x))), 1)  # noqa: E731
        return lambda *x: to(value.at(self.back(places(*x))))

    def yarns(self, sheet):
        """Fields of a sheet's yarns."""
        between = {n: getattr(sheet, n) for n in ("yarn_angle", "weave_angle")}
        if self.reverses:
            between = {n: None if v is None else 180.0 - v for n, v in between.items()}
        return {"fibre_angle": self.field(sheet.fibre_angle, self.angle)} | between


def moved_sheet(sheet, blank, file, map):
    """The sheet with its own mesh, moved, in a file."""
    mesh = blank.mesh
    cells = compat.geometry_dofmap(mesh)[: mesh.topology.index_map(2).size_local]
    kind, cells = compat.cell_name(mesh), cells[:, blank.around]
    x = map(mesh.geometry.x * [1.0, 1.0, 0.0]) + [0.0, 0.0, map.lifted]
    if map.reverses:
        cells = cells[:, ::-1]
    if map.renumbered:
        rng = np.random.default_rng(1)
        order = rng.permutation(len(x))
        x, cells = x[order], np.argsort(order)[rng.permutation(cells)]
        cells = np.roll(cells, 1, axis=1)
    meshio.write(file, meshio.Mesh(x, {KINDS[kind]: cells}))
    sides = ("length", "width", "side", "outline", "size", "nx", "ny", "layer")
    none = {name: None for name in sides if hasattr(sheet, name)}
    none["pattern"] = type(sheet).pattern
    fields = ("thickness", "temperature", "friction") if hasattr(sheet, "thickness") else ()
    moved = {name: map.field(getattr(sheet, name)) for name in fields}
    return dataclasses.replace(sheet, mesh=str(file), **none | map.yarns(sheet) | moved)


def moved_tool(tool, map, file):
    """The tool there; one of triangles is mirrored in its file."""
    side = {"below": "above", "above": "below"}[tool.side] if map.is_over else tool.side
    if isinstance(tool.surface, ff.DieOf):
        return dataclasses.replace(tool, side=side)
    at = tool.at or (0.0, 0.0)
    at = map(np.append(at, [0.0] * (3 - len(at))))[: len(at)]
    turn, surface = Rotation.from_euler("xyz", tool.turn, degrees=True).as_matrix(), tool.surface
    if np.linalg.det(map.axes) < 0:  # shapes are their own mirror images in x = 0
        turn = turn @ MIRROR
        if str(surface).endswith(".stl"):
            surface = str(file.with_suffix(".stl"))
            pyvista.read(tool.surface).flip_x(point=(0, 0, 0)).flip_faces().save(surface)
    turn = Rotation.from_matrix(map.axes @ turn).as_euler("xyz", degrees=True).round(9)
    return dataclasses.replace(tool, surface=surface, at=at, turn=turn, side=side)


def moved_holder(holder, map, centre):
    """A holder there; its places by functions, but for polar ones of a map that only moves."""
    if isinstance(holder, list | tuple):
        return [moved_holder(each, map, centre) for each in holder]
    changes = {}
    where = getattr(holder, "where", None)
    only_moves = np.array_equal(map.axes, np.eye(3))
    if where is not None and not (only_moves and isinstance(where, Region)):
        where = where.about(centre) if isinstance(where, Region) else where
        changes["where"] = lambda x: where(map.back(x.T).T)
    if getattr(holder, "edges", ()):
        names = {end: name for name, end in EDGES.items()}
        ways = [map.axes[:, axis] * (2 * end - 1) for axis, end in [EDGES[n] for n in holder.edges]]
        axes = [int(abs(way).argmax()) for way in ways]
        changes["edges"] = [names[k, int(way[k] > 0)] for k, way in zip(axes, ways)]
    if getattr(holder, "at", ()):
        changes["at"] = [map(np.append(each, 0.0))[:2] for each in holder.at]
    return dataclasses.replace(holder, **changes) if changes else holder


def moved_press(press, map, folder):
    """The press, as one that was built elsewhere."""
    built = press.build()
    files = (folder / f"sheet_{k}.vtu" for k in range(len(press.sheets)))
    laid = zip(press.sheets, built.laid.blanks, files)
    sheets = [moved_sheet(*each, map) for each in laid]
    friction = map.field(press.interface.friction)
    return press.replace(
        interface=dataclasses.replace(press.interface, friction=friction),
        sheets=sheets[::-1] if map.is_over else sheets,
        tools={n: moved_tool(tool, map, folder / n) for n, tool in press.tools.items()},
        holders={n: moved_holder(h, map, built.laid.centre) for n, h in press.holders.items()},
    )
