"""The places of the tools of a press before anything moves."""

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from ..runtime.collective_errors import on_root
from ..runtime.errors import InputError
from ..runtime.files import ending
from ..runtime.formatting import coordinates, rounded
from ..runtime.status import task
from ..tools.checks import FLANGE, MIN_SHARE, check_triangles, unit_doubt
from ..tools.files import CAD
from ..tools.surfaces import Offset, Reversed, Surface, Turned
from ..tools.tool import Tool
from ..tools.triangulated import TriangulatedSurface
from .checks import CHECK_PRESSURE, clearance_doubts, symmetry_doubts
from .laying import Laid
from .press_data import PressData
from .stages import Schedule
from .tools import PressTool

MAX_DISTANCE = 1e3  # sizes of the blank beyond a tool's radii, within which its face must be
TOUCH_TOLERANCE = 1e-9  # of the thickness: a tool so near touches the blank


@task("placing the tools")
def place_tools(press: PressData, laid: Laid) -> tuple[dict[str, Tool], Schedule, list[str]]:
    """The tools of a press {name: tool} in their places at its blank, what moves them, and doubts.
    Raises InputError, on all ranks, for tools that can't stand or move as given."""
    extent, comm = laid.blank.extent(), laid.blank.mesh.comm
    thickness, pressed = press.thickness(), press.thickness(CHECK_PRESSURE)
    blank = _FlatBlank(laid.flat_nodes(), np.asarray(extent)[:, :2], thickness, comm)
    surfaces, starts, doubts = dict[str, Surface](), dict[str, np.ndarray](), list[str]()
    dies, given = press.dies(), {name: press.tool(name) for name in press.tools}
    clearances = {name: given[name].surface.clearance or 1.2 * thickness for name in dies}
    usual_off = {of: max(0.0, clearances[name] - thickness) for name, of in dies.items()}
    for name in (n for n in press.tools if n not in dies):
        surfaces[name], more = _surface(name, given[name], blank)
        doubts += more
        touching = blank.touching(name, given[name], surfaces[name])
        starts[name] = _start(name, given[name], touching, usual_off.get(name, 0.0), thickness)
    for name, of in dies.items():
        face = face_of(surfaces[of], given[of].towards)
        _check_covered(of, face, blank, press.planes)
        check_clearance(f"tools.{name}.clearance", clearances[name], pressed, face)
        surfaces[name] = _turned(Reversed(Offset(face, clearances[name])), given[name])
        try:
            touching = blank.touching(name, given[name], surfaces[name])
            touching += blank.to_flange(given[name], surfaces[name], touching)
            starts[name] = _start(name, given[name], touching, 0.0, thickness)
        except InputError as error:
            raise InputError(
                f"tools.{name} can't be the die of {of}; allowed is the die of an open surface, as "
                f"double_dome or a file, not of a closed one, as a ball ({error})"
            ) from None
    reach = {
        of: float((starts[name] - starts[of]) @ given[of].towards) + clearances[name]
        for name, of in dies.items()
    }
    schedule = press.schedule(reach, thickness)
    tools = {}
    for name in press.tools:
        path, force = schedule.path(name, starts[name]), schedule.force(name, press.share)
        tools[name] = Tool(surfaces[name], path, force=force, name=name)
    doubts += on_root(
        comm,
        lambda: (
            clearance_doubts(press, tools, schedule, extent, pressed)
            + symmetry_doubts(press, tools, extent, thickness)
        ),
    )
    if len({tool.side for tool in given.values()}) == 1 and len(tools) > 1:
        side = next(iter(given.values())).side
        doubts.append(
            f"{' and '.join(tools)} stand {side} the blank, and only holders resist them: `side` "
            "says where a tool stands"
        )
    return tools, schedule, doubts


def check_clearance(path: str, clearance: float, pressed: float, surface: Surface) -> None:
    """InputError for a clearance below the `pressed` thickness or from the concave radius on."""
    radius = surface.radii[1]
    if clearance < pressed or clearance >= radius:
        raise InputError(
            f"{path} is {rounded(clearance, 6)}; allowed is from {rounded(pressed)} mm, the "
            f"blank's thickness under {CHECK_PRESSURE:g} MPa, to below {radius:g} mm, the tool's "
            "least concave radius"
        )


def _surface(name: str, tool: PressTool, blank: "_FlatBlank") -> tuple[Surface, list[str]]:
    """The tool's surface, read and turned, and doubts."""
    surface, words, doubts = tool.surface, f"tools.{name}.surface", list[str]()
    if isinstance(surface, (str, os.PathLike)):
        words = f"tools.{name}, {surface},"
        surface, doubts = _read(words, str(surface), tool.chord, blank)
    elif isinstance(surface, TriangulatedSurface):
        doubts = _triangle_doubts(words, surface, blank)
    elif not isinstance(surface, Surface):
        raise InputError(
            f"{words} is {surface!r}; allowed is a surface, as `Sphere(50)`, or a file's name"
        )
    return _turned(surface, tool), doubts


def _turned(surface, tool):
    return Turned(surface, tool.turn) if any(tool.turn) else surface


def _read(words, path, chord, blank):
    """The surface in a file, and doubts; a CAD model with a smaller `chord` if its facets are
    coarse."""
    is_model = ending(path) in CAD
    for finer in (1, 2, 5) if is_model else (1,):
        surface = TriangulatedSurface.read(path, chord / finer, comm=blank.comm)
        try:
            return surface, _triangle_doubts(words, surface, blank)
        except InputError as error:
            wrong = error
    raise InputError(f"{wrong}{', or a smaller `chord`' if is_model else ''}")


def _triangle_doubts(words, surface, blank):
    doubts = list[str]()
    size = float(np.ptp(surface.points, axis=0).max())
    if doubt := unit_doubt(size, blank.size, MIN_SHARE):
        raise InputError(f"{words} {doubt}; allowed is a surface in mm")
    check_triangles(surface, words, blank.thickness, doubts.append)
    return doubts


def _check_covered(name: str, surface: Surface, blank: "_FlatBlank", planes: Sequence[int]) -> None:
    """Raise InputError for the surface of triangles of a tool with a die that has an opening
    beneath the blank, or beneath its mirror images in `planes` of symmetry."""
    triangles, turn = _triangles(surface)
    if triangles is None:
        return
    low, high = blank.extent
    low = np.where(np.isin([0, 1], planes), -high, low)
    whole = float((high - low).max())
    middle = (triangles.points @ turn.T)[triangles.rim].mean(1)
    margin = 1e-6 * whole
    within = ((middle[:, :2] > low + margin) & (middle[:, :2] < high - margin)).all(1)
    if within.any():
        raise InputError(
            f"tools.{name} is open at {coordinates(middle[within.argmax()])} mm, beneath the blank;"
            f" allowed is a surface in mm that reaches beyond the blank of {rounded(whole, 4)} mm, "
            "without holes and cracks"
        )


def _start(name, tool, touching, usual_off, thickness):
    """The place of a tool's origin at the start (3,) [mm]. touching: z at which it touches the
    blank; usual_off: the default of its `off` [mm]. Raises InputError for a tool that would stand
    in the blank."""
    x, y, *z = tool.at
    if not z:
        off = usual_off if tool.off is None else tool.off
        return np.array([x, y, touching - off * tool.towards[2]])
    deep = (z[0] - touching) * tool.towards[2]
    if deep > FLANGE * thickness:
        raise InputError(
            f"tools.{name} cuts into the blank by {rounded(deep, 4)} mm before anything moves; "
            f"allowed is z of `at` {'up to' if tool.side == 'below' else 'from'} "
            f"{rounded(touching, 6)}, where it touches, or `at` without z"
        )
    return np.array([x, y, z[0]])


@dataclass(frozen=True)
class _FlatBlank:
    """A flat blank to which tools are brought: nodes x (n, 3) of this rank in z = 0, corners
    `extent` (2, 2), thickness [mm]."""

    x: np.ndarray
    extent: np.ndarray
    thickness: float
    comm: MPI.Comm

    @property
    def size(self) -> float:
        """The longer side [mm]."""
        return float((self.extent[1] - self.extent[0]).max())

    def touching(self, name: str, tool: PressTool, surface: Surface) -> float:
        """The height (z) of the tool's origin at which it touches the blank. It moves by its least
        distance each time, so it never cuts in. Raises InputError, on all ranks, for a tool that
        does not meet the blank, or only with its back."""
        start, up = np.array([*tool.at[:2], 0.0]), tool.towards[2]
        away, between, points = self.size, np.empty((0, 3)), _of_triangles(surface)
        if points is None:
            far = MAX_DISTANCE * self.size + sum(r for r in surface.radii if np.isfinite(r))
        else:
            far = 4 * (abs(points).max() + self.size)
        while self._least(surface, start, -up * away, between)[0] <= 0:
            if away >= far:
                raise InputError(
                    f"tools.{name} has its body between its face and the blank, which is "
                    f"{'above' if tool.side == 'below' else 'below'} it; allowed is the other "
                    "side, turn = [180, 0, 0] beyond its present turn, or triangles whose normals "
                    "point out of the body"
                )
            away = min(2 * away, far)
        for _ in range(500):
            gap, place, top = self._least(surface, start, -up * away, between)
            if abs(gap) < TOUCH_TOLERANCE * self.thickness:
                return -up * away
            away -= gap
            low, high = self.extent + [[-1e-9 * self.size], [1e-9 * self.size]]
            if (low <= top).all() and (top <= high).all():  # it may lie between nodes
                between = np.vstack([between, [*top, 0.0]])[-10:]
            if away < -far:
                break
        raise InputError(self._beside(name, tool, points, place))

    def to_flange(self, tool: PressTool, surface: Surface, touching: float) -> float:
        """Distance along z [mm] by which a die that touches the blank must move so that its flat
        face at the blank's edge lies on it: facets of a fillet may bulge out of this face."""
        low, high = self.extent
        share = np.linspace(0, 1, 21)[:, None]
        along = low + share * (high - low)
        corners = [[along[:, 0], np.full(21, y)] for y in (low[1], high[1])]
        corners += [[np.full(21, x), along[:, 1]] for x in (low[0], high[0])]
        x = np.column_stack([np.hstack(corners).T, np.zeros(84)])
        nearest = surface.evaluate(x - [*tool.at[:2], touching])
        gap = nearest.gap - self.thickness / 2
        flat = (abs(nearest.normal[:, 2]) > 0.99) & (abs(gap) < FLANGE * self.thickness)
        return tool.towards[2] * float(np.median(gap[flat])) if flat.any() else 0.0

    def _least(self, surface, start, height, between):
        """The least gap [mm] of all ranks between the blank's face, at its nodes and at points
        `between` them (k, 3), and a tool with its origin at this height; the place of the least
        gap, and the place (x, y) of the tool's top, by the curvature there."""
        places = np.vstack([self.x, between])
        nearest = surface.evaluate(places - (start + [0, 0, height]))
        gap = np.where(np.isfinite(nearest.gap), nearest.gap - self.thickness / 2, np.inf)
        mine: tuple[float, list[float], list[float]] = (np.inf, [], [])
        if len(gap):
            i = int(gap.argmin())
            bend, slope = nearest.curvature[i][:2, :2], nearest.normal[i][:2]
            top = places[i][:2] - np.linalg.lstsq(bend, slope, rcond=1e-9)[0]
            mine = float(gap[i]), places[i].tolist(), top.tolist()
        return min(self.comm.allgather(mine))

    def _beside(self, name, tool, points, place):
        at, (low, high) = np.array(tool.at[:2]), self.extent
        reach = np.zeros((1, 2)) if points is None else points[:, :2]
        ends = at + reach.min(0), at + reach.max(0)
        words = f"tools.{name} does not meet the blank when it is moved along z"
        if away := np.linalg.norm(np.maximum(0, np.maximum(low - ends[1], ends[0] - high))):
            words += f", {rounded(float(away), 6)} mm beside it"
        return (
            f"{words}, nearest to {coordinates(place)}: it reaches from {coordinates(ends[0])} to "
            f"{coordinates(ends[1])} mm, the blank from {coordinates(low)} to {coordinates(high)} "
            "mm; allowed is `at` that puts it there, and a surface in mm"
        )


def face_of(surface: Surface, towards: np.ndarray) -> Surface:
    """The face of a closed surface of triangles that looks `towards` the blank (3,), with the walls
    within it; other surfaces as they are."""
    inner, turn = _triangles(surface)
    if inner is None or len(inner.rim):
        return surface
    face = inner.face(turn.T @ towards)
    return Turned(face, surface.angles) if isinstance(surface, Turned) else face


def _triangles(surface: Surface) -> tuple[TriangulatedSurface | None, np.ndarray]:
    """The triangles of a surface, None for others, and what turns them into their place (3, 3)."""
    turn = np.eye(3)
    if isinstance(surface, Turned):
        turn, surface = surface.back(turn), surface.surface
    return (surface if isinstance(surface, TriangulatedSurface) else None), turn


def _of_triangles(surface: Surface) -> np.ndarray | None:
    """Points (n, 3) of a surface of triangles in its place [mm], None for other surfaces."""
    triangles, turn = _triangles(surface)
    return None if triangles is None else triangles.points @ turn.T
