"""The places of the tools of a press before anything moves, and whether they leave room for it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from mpi4py import MPI

from ..core.collective_errors import on_root
from ..core.errors import InputError
from ..core.files import ending
from ..core.formatting import coordinates, rounded
from ..core.status import task
from ..surfaces.checks import FLANGE, MIN_SHARE, MIRRORED, check_triangles, unit_doubt
from ..surfaces.files import CAD
from ..surfaces.surfaces import Offset, Reversed, Surface, Turned
from ..surfaces.tool import Tool
from ..surfaces.triangulated import TriangulatedSurface
from .laying import Laid
from .press_data import PressData
from .stages import Schedule
from .tools import DieOf

CHECK_PRESSURE = 1.0  # MPa, under which the blank must fit between closed tools
POINTS_ACROSS = 60  # points across the blank at which the distance of two tools is found
TOUCH_TOLERANCE = 1e-9  # of the thickness: a tool so near touches the blank


@task("placing the tools")
def place_tools(press: PressData, laid: Laid) -> tuple[dict[str, Tool], Schedule, list[str]]:
    """The tools of a press {name: tool} in their places at its blank, what moves them, and doubts.
    Raises InputError, on all ranks, for tools that can't stand or move as given."""
    thickness, pressed = press.thickness(), press.thickness(CHECK_PRESSURE)
    extent, comm = np.array(laid.blank.extent()), laid.blank.mesh.comm
    blank = _FlatBlank(laid.flat_nodes(), extent, thickness, comm)
    given, dies = {name: press.tool(name) for name in press.tools}, press.dies()
    clearances = {name: die.clearance or 1.2 * thickness for name, die in dies.items()}
    usual_off = {d.tool: max(0.0, clearances[n] - thickness) for n, d in dies.items()}
    surfaces, starts, doubts = dict[str, Surface](), dict[str, np.ndarray](), list[str]()
    for name in sorted(given, key=dies.__contains__):  # dies after their tools
        tool, surface = given[name], given[name].surface
        if isinstance(surface, DieOf):
            face = _face_of(surfaces[surface.tool], given[surface.tool].towards)
            _check_covered(surface.tool, face, extent, press.planes)
            check_clearance(f"tools.{name}.clearance", clearances[name], pressed, face)
            surface = Reversed(Offset(face, clearances[name]))
        else:
            surface, more = _surface_of(name, tool, blank)
            doubts += more
        surfaces[name] = Turned(surface, tool.turn) if any(tool.turn) else surface
        starts[name] = blank.start(name, tool, surfaces[name], usual_off.get(name, 0.0))
    reach = dict[str, float]()
    for name, die in dies.items():
        apart = float((starts[name] - starts[die.tool]) @ given[die.tool].towards)
        reach[die.tool] = apart + clearances[name]
    schedule, tools = press.schedule(reach, thickness), dict[str, Tool]()
    for name in given:
        path, force = schedule.path(name, starts[name]), schedule.force(name, press.share)
        tools[name] = Tool(surfaces[name], path, force=force, name=name)

    def checked():
        doubts = _clearance_doubts(press, tools, schedule, extent)
        return doubts + mirrored_tools(press, tools, extent, press.planes)

    return tools, schedule, doubts + on_root(comm, checked)


def check_clearance(path: str, clearance: float, pressed: float, surface: Surface) -> None:
    """InputError for a clearance below the `pressed` thickness or from the concave radius on."""
    if not pressed <= clearance < surface.radii[1]:
        raise InputError(
            f"{path} is {rounded(clearance, 6)}; allowed is from {rounded(pressed)} mm, the "
            f"blank's thickness under {CHECK_PRESSURE:g} MPa, to below {surface.radii[1]:g} mm, "
            "the tool's least concave radius"
        )


def _surface_of(name, tool, blank):
    """The tool's surface, read, and doubts; of a CAD model whose facets are coarse one of a smaller
    `chord`."""
    surface, words = tool.surface, f"tools.{name}.surface"
    if isinstance(surface, Surface):
        return surface, _triangle_doubts(words, surface, blank)
    words, is_model = f"tools.{name}, {surface},", ending(surface) in CAD
    for finer in (1, 2, 5) if is_model else (1,):
        read = TriangulatedSurface.read(surface, tool.chord / finer, comm=blank.comm)
        try:
            return read, _triangle_doubts(words, read, blank)
        except InputError as error:
            wrong = error
    raise InputError(f"{wrong}{', or a smaller `chord`' if is_model else ''}")


def _triangle_doubts(words, surface, blank):
    if not isinstance(surface, TriangulatedSurface):
        return []
    size = float(np.ptp(surface.points, axis=0).max())
    if doubt := unit_doubt(size, blank.size, MIN_SHARE):
        raise InputError(f"{words} {doubt}; allowed is a surface in mm")
    return check_triangles(surface, words, blank.thickness)


def _check_covered(name, surface, extent, planes):
    """Raise InputError for the surface of triangles of a tool with a die that has an opening
    beneath the blank, or beneath its mirror images in `planes` of symmetry."""
    triangles, turn = _triangles(surface)
    if triangles is None:
        return
    low, high = extent[:, :2]
    low = np.where(np.isin([0, 1], planes), -high, low)
    whole = float((high - low).max())
    margin, middle = 1e-6 * whole, (triangles.points @ turn.T)[triangles.rim].mean(1)
    within = ((middle[:, :2] > low + margin) & (middle[:, :2] < high - margin)).all(1)
    if within.any():
        raise InputError(
            f"tools.{name} is open at {coordinates(middle[within.argmax()])} mm, beneath the blank;"
            f" allowed is a surface in mm that reaches beyond the blank of {rounded(whole, 4)} mm, "
            "without holes and cracks"
        )


@dataclass(frozen=True)
class _FlatBlank:
    """A flat blank to which tools are brought: nodes x (n, 3) of this rank in z = 0, corners
    `extent` (2, 3), thickness [mm]."""

    x: np.ndarray
    extent: np.ndarray
    thickness: float
    comm: MPI.Comm

    @property
    def size(self) -> float:
        """The longer side [mm]."""
        return float(np.ptp(self.extent[:, :2], axis=0).max())

    def _touching(self, name, tool, surface):
        """The height (z) of the tool's origin at which it touches the blank. It moves by its least
        distance each time, so it never cuts in. Raises InputError, on all ranks, for a tool that
        does not meet the blank, or only with its back."""
        place, up, (triangles, turn) = np.array(tool.at)[:2], tool.towards[2], _triangles(surface)
        away, between, rounding = self.size, np.empty((0, 3)), 1e-9 * self.size
        points = (np.zeros((1, 3)) if triangles is None else triangles.points) @ turn.T
        radii = sum(r for r in surface.radii if np.isfinite(r))
        far = 1e3 * self.size + radii + abs(points).max()  # how far away its face may be
        while self._least(surface, [*place, -up * away], between)[0] <= 0:
            away *= 2
            if away > far:
                raise InputError(
                    f"tools.{name} has its body between its face and the blank; allowed is the "
                    "other side, turn = [180, 0, 0] on top of its own turn, triangles whose "
                    "normals point out of the body, or the die of an open surface, as double_dome"
                )
        low, high = self.extent[:, :2]
        for _ in range(500):
            gap, top = self._least(surface, [*place, -up * away], between)
            if abs(gap) < TOUCH_TOLERANCE * self.thickness:
                return -up * away
            away -= gap
            if (low - rounding <= top).all() and (top <= high + rounding).all():
                between = np.vstack([between, [*top, 0.0]])[-10:]  # the top is between nodes
            if away < -far:
                break
        reach = place + points[:, :2]
        beside = np.maximum(0, np.maximum(low - reach.max(0), reach.min(0) - high))
        raise InputError(
            f"tools.{name} does not meet the blank when it is moved along z, "
            f"{rounded(float(np.linalg.norm(beside)), 6)} mm beside it; allowed is `at` that puts "
            "it there, and a surface in mm"
        )

    def _to_flange(self, tool, surface, touching):
        """Distance along z [mm] by which a die that touches the blank must move so that its flat
        face at the blank's edge lies on it: facets of a fillet may bulge out of this face."""
        low, high = self.extent
        share = np.linspace(0, 1, 21)[:, None]
        along = [low + share * (high - low) * axis for axis in np.eye(3)[:2]]
        edges = np.vstack([*along, *(low + high - each for each in along)]) * (1, 1, 0)
        nearest = surface.evaluate(edges - [*tool.at[:2], touching])
        gap = nearest.gap - self.thickness / 2
        flat = (abs(nearest.normal[:, 2]) > 0.99) & (abs(gap) < FLANGE * self.thickness)
        return tool.towards[2] * float(np.median(gap[flat])) if flat.any() else 0.0

    def start(self, name, tool, surface, usual=0.0):
        """The place of a tool's origin at the start (3,) [mm]. usual: the default of its
        `start_distance` [mm]. Raises InputError for one that would stand in the blank."""
        touching = self._touching(name, tool, surface)
        if isinstance(tool.surface, DieOf):
            touching += self._to_flange(tool, surface, touching)
        x, y, *z = tool.at
        away = usual if tool.start_distance is None else tool.start_distance
        height = z[0] if z else touching - away * tool.towards[2]
        deep = (height - touching) * tool.towards[2]
        if deep > FLANGE * self.thickness:
            raise InputError(
                f"tools.{name} cuts into the blank by {rounded(deep, 4)} mm before anything moves; "
                f"allowed is z of `at` {'up to' if tool.side == 'below' else 'from'} "
                f"{rounded(touching, 6)}, where it touches, or `at` without z"
            )
        return np.array([x, y, height])

    def _least(self, surface, origin, between):
        """The least gap [mm] of all ranks between the blank's face, at its nodes and at points
        `between` them (k, 3), and a tool with this origin; and the place (x, y) of the tool's top,
        by the curvature there."""
        places = np.vstack([self.x, between])
        nearest = surface.evaluate(places - origin)
        gap = np.where(np.isfinite(nearest.gap), nearest.gap - self.thickness / 2, np.inf)
        local: tuple[float, list[float], list[float]] = (np.inf, [], [])
        if len(gap):
            i = int(gap.argmin())
            bend, slope = nearest.curvature[i][:2, :2], nearest.normal[i][:2]
            top = places[i][:2] - np.linalg.lstsq(bend, slope, rcond=1e-9)[0]
            local = float(gap[i]), places[i].tolist(), top.tolist()
        least, _, top = min(self.comm.allgather(local))  # of equal gaps that of the first place
        return least, np.array(top)


def _face_of(surface, towards):
    """The face of a closed surface of triangles that looks `towards` the blank (3,), with the walls
    within it; other surfaces as they are."""
    inner, turn = _triangles(surface)
    if inner is None or len(inner.rim):
        return surface
    face = inner.face(turn.T @ towards)
    return Turned(face, surface.angles) if isinstance(surface, Turned) else face


def _triangles(surface):
    """The triangles of a surface, None for others, and what turns them into their place (3, 3)."""
    turn = np.eye(3)
    if isinstance(surface, Turned):
        turn, surface = surface.back(turn), surface.surface
    return (surface if isinstance(surface, TriangulatedSurface) else None), turn


# -- checks of tools in their places


def _clearance_doubts(press, tools, schedule, extent):
    """Sentences on tools that leave the blank, with corners `extent` (2, 3) [mm], less than its
    thickness under pressure at the end of a stage. Raises InputError for two on either side of it
    that go through one another. The place of tools that a force moves is not known."""
    below, above = (
        [name for name, tool in press.tools.items() if tool.side == side]
        for side in ("below", "above")
    )
    pressed, doubts = press.thickness(CHECK_PRESSURE), list[str]()
    thickness = f"the blank's thickness under {CHECK_PRESSURE:g} MPa, {rounded(pressed, 4)} mm"
    whens = ["before anything moves", *(f"at the end of {s.name}" for s in schedule.stages)]
    straight = {
        frozenset((die.tool, name)): die.tool
        for name, die in press.dies().items()
        if schedule.closes_straight(die.tool, name)
    }
    pairs = [pair for pair in product(below, above) if not any(tools[n].force for n in pair)]
    for pair, (load, when) in product(pairs, zip(schedule.joints, whens)):
        apart, place = np.inf, np.zeros(3)
        if punch := straight.get(frozenset(pair)):  # where both are flat, in the middle
            apart = schedule.distance(punch, load)
        elif len(x := _points(tools[pair[0]], extent, load)):
            gap = _gap(tools[pair[1]], x, load)
            apart, place = gap.min(), x[gap.argmin()]
        words, at = f"tools {' and '.join(pair)}", f"{when}, at {coordinates(place)} mm"
        if apart < 0:
            raise InputError(
                f"{words} go {rounded(-apart, 4)} mm through one another {at}; allowed is a "
                f"distance from {thickness}: less travel, or another place (`at`)"
            )
        if load and apart < (1 - 1e-6) * pressed:
            crushed = f"less than {thickness}: they crush it there"
            doubts.append(f"{words} are {rounded(apart, 4)} mm apart {at}, {crushed}")
    return doubts


def _gap(tool, x, load):
    """Gaps (n,) of points (n, 3) to a tool at a load factor [mm], inf where it has none."""
    gap = tool.surface.evaluate(x - tool.path(load)).gap
    return np.where(np.isfinite(gap), gap, np.inf)


def _points(tool, extent, load):
    """Points (n, 3) [mm] of a tool's surface over or under the blank at a load factor."""
    low, high = extent
    size, place = float((high - low).max()), np.asarray(tool.path(load))
    room = np.array([0.0, 0.0, 2 * size])
    points, _, _ = tool.surface.mesh(low - room - place, high + room - place, size / POINTS_ACROSS)
    x = points + place
    return x[((x >= low - 1e-6) & (x <= high + 1e-6))[:, :2].all(1)]


def mirrored_tools(
    press: PressData, tools: Mapping[str, Tool], extent: np.ndarray, planes: Sequence[int]
) -> list[str]:
    """A sentence on each tool that is not its own mirror image in the `planes`, within `MIRRORED`
    thicknesses, in its places at start and end. extent (2, 3): corners of the blank [mm]."""
    doubts, thickness = dict[str, str](), press.thickness()
    alone = [tool for name, tool in tools.items() if name not in press.dies()]
    for tool, load, axis in product(alone, (0.0, 1.0), planes):
        x, mirror = _points(tool, extent, load), 1.0 - 2.0 * np.eye(3)[axis]
        off = np.nan_to_num(abs(tool.surface.evaluate(x * mirror - tool.path(load)).gap))
        if tool.name not in doubts and off.max(initial=0.0) > MIRRORED * thickness:
            worst = int(off.argmax())
            doubts[tool.name] = (
                f"tools.{tool.name} is not its own mirror image in {'xy'[axis]} = 0: it is at "
                f"{coordinates(x[worst])}, but {rounded(off[worst])} mm off "
                f"{coordinates(x[worst] * mirror)}; so the {press.modelled} stands for "
                f'{1 / press.share:g} mirrored ones; take the whole blank (`symmetry = "none"`)'
            )
    return list(doubts.values())
