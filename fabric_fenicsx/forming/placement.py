"""The places of the tools of a press before anything moves."""

import dataclasses
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from ..runtime.errors import InputError
from ..runtime.files import ending
from ..runtime.formatting import coordinates, rounded
from ..runtime.status import task
from ..tools.checks import FLANGE, MIN_SHARE, check_triangles, unit_doubt
from ..tools.files import CAD
from ..tools.surfaces import Offset, Reversed, Surface, Turned
from ..tools.tool import Tool
from ..tools.triangulated import TriangulatedSurface
from ..tools.values import length_of
from .checks import CHECK_PRESSURE, check_clearances, symmetry_warnings
from .laying import Laid
from .press import Press
from .stages import Schedule
from .tools import DieOf, PressTool

MAX_DISTANCE = 1e3  # sizes of the blank beyond a tool's radii, within which its face must be
TOUCH_TOLERANCE = 1e-9  # of the thickness: a tool so near touches the blank


@dataclass(frozen=True)
class Placed:
    """Tools in their places: tools {name: `Tool`}, which the `schedule` moves, and the thickness of
    the blank without pressure [mm]."""

    tools: dict[str, Tool]
    schedule: Schedule
    thickness: float


@task("placing the tools")
def place(press: Press, laid: Laid, comm: MPI.Comm, warnings: list[str]) -> Placed:
    """The tools of a press in their places at its blank. Raises InputError, on all ranks, for tools
    that can't stand or move as given."""
    nodes, thickness, pressed = (
        laid.flat_nodes(),
        press.thickness(),
        press.thickness(CHECK_PRESSURE),
    )
    at, dies = Placement(nodes, thickness, comm, warnings, press.planes), press.dies()
    given = {name: tool.surface for name, tool in press.tools.items()}
    clearances = {
        name: surface.clearance or 1.2 * thickness
        for name, surface in given.items()
        if isinstance(surface, DieOf)
    }
    usual_off = {of: max(0.0, clearances[name] - thickness) for name, of in dies.items()}
    stood: dict[str, tuple[Surface, np.ndarray]] = {}
    for name in (n for n in press.tools if n not in dies):
        stood[name] = at.stand(name, press.tool(name), usual_off.get(name, 0.0))
    for name, of in dies.items():
        face = face_of(stood[of][0], press.tools[of].towards)
        at.check_matched(of, face, press.planes)
        check_clearance(f"tools.{name}.clearance", clearances[name], pressed, face)
        surface = Reversed(Offset(face, clearances[name]))
        try:
            die = dataclasses.replace(press.tool(name), surface=surface)
            stood[name] = at.stand(name, die, is_die=True)
        except InputError as error:
            raise InputError(
                f"tools.{name} can't be the die of {of}; allowed is the die of an open surface, as "
                f"double_dome or a file, not of a closed one, as a ball ({error})"
            ) from None
    reach = {
        of: float((stood[name][1] - stood[of][1]) @ press.tools[of].towards) + clearances[name]
        for name, of in dies.items()
    }
    schedule = press.schedule(reach, thickness)
    tools = {name: _tool(press, name, *stood[name], schedule) for name in press.tools}
    placed = Placed(tools, schedule, thickness)
    check_clearances(press, laid, placed, pressed, warnings)
    warnings += symmetry_warnings(press, laid, placed)
    sides = {tool.side for tool in press.tools.values()}
    if len(sides) == 1 and len(press.tools) > 1:
        warnings.append(
            f"{' and '.join(press.tools)} stand {next(iter(sides))} the blank, and only "
            "holders resist them: `side` says where a tool stands"
        )
    return placed


def _tool(press, name, surface, start, schedule):
    given, force = press.tools[name], None
    if given.force is not None:
        size = schedule.force(name)

        def force(load):
            return press.share * size(load) * given.towards

    return Tool(surface, schedule.path(name, start), force=force, name=name)


def check_clearance(path: str, clearance: float, pressed: float, surface: Surface) -> None:
    """InputError for a clearance below the `pressed` thickness or from the concave radius on."""
    radius = surface.radii[1]
    if clearance < pressed:
        raise InputError(
            f"{path} is {rounded(clearance, 6)}, less than the blank's thickness under "
            f"{CHECK_PRESSURE:g} MPa; allowed is from {rounded(pressed)} mm"
        )
    if clearance >= radius:
        raise InputError(
            f"{path} is {rounded(clearance, 6)}, which is not below the tool's least concave radius"
            f"; allowed is from {rounded(pressed)} to below {radius:g} mm"
        )


class Placement:
    """Brings tools to a flat blank, whose nodes of this rank are at x (n, 3) [mm] in z = 0.

    thickness: of the blank [mm]; warnings: list to which warnings are added; planes: of symmetry.
    Raises InputError, on all ranks, for a tool that can't stand where it should.
    """

    def __init__(
        self,
        x: np.ndarray,
        thickness: float,
        comm: MPI.Comm,
        warnings: list[str],
        planes: Sequence[int] = (),
    ) -> None:
        self._x, self._t, self._comm, self._warnings = x, thickness, comm, warnings
        low, high = (
            getattr(np, least)(comm.allgather(getattr(x, least)(0, initial=start)), axis=0)
            for least, start in (("min", np.inf), ("max", -np.inf))
        )
        self._low, self._high = low[:2], high[:2]
        self._middle = (self._low + self._high) / 2
        self._middle[list(planes)] = 0.0
        self._size = float((self._high - self._low).max())

    def surface(self, name: str, tool: PressTool) -> Surface:
        """The tool's surface, read and turned, with its face towards the blank."""
        surface, file = tool.surface, f"tools.{name}.surface"
        if isinstance(surface, (str, os.PathLike)):
            file = f"tools.{name}, {surface},"
            surface = self._read(file, str(surface), tool.chord)
        elif not isinstance(surface, Surface):
            raise InputError(
                f"{file} is {surface!r}; allowed is a surface, as `Sphere(50)`, or a file's name"
            )
        elif isinstance(surface, TriangulatedSurface):
            self._check_units(file, surface)
            check_triangles(surface, file, self._t, self._warnings.append)
        if any(tool.turn):
            surface = Turned(surface, tool.turn)
        return surface

    def _read(self, name, path, chord):
        """The surface in a file; of a CAD model with a smaller `chord` if its facets are coarse."""
        is_model = ending(path) in CAD
        for finer in (1, 2, 5) if is_model else (1,):
            surface = TriangulatedSurface.read(path, chord / finer, comm=self._comm)
            doubts: list[str] = []
            self._check_units(name, surface)
            words = f"{name.split(',')[0]} with chord = {chord / finer:g}" if is_model else name
            try:
                check_triangles(surface, words, self._t, doubts.append)
            except InputError as error:
                wrong = error
            else:
                self._warnings += doubts
                return surface
        raise InputError(f"{wrong}{', or a smaller `chord`' if is_model else ''}")

    def _check_units(self, name, surface):
        size = float(np.ptp(surface.points, axis=0).max())
        if doubt := unit_doubt(size, self._size, MIN_SHARE):
            raise InputError(f"{name} {doubt}; allowed is a surface in mm")

    def check_matched(self, name: str, surface: Surface, planes: Sequence[int] = ()) -> None:
        """Raise InputError for the surface of triangles of a tool with a die that has an opening
        beneath the blank, or beneath its mirror images in `planes` of symmetry."""
        triangles, turn = _triangles(surface)
        if triangles is None:
            return
        low, high = np.where(np.isin([0, 1], planes), -self._high, self._low), self._high
        whole, x = float((high - low).max()), triangles.points @ turn.T
        needed = f"a surface in mm that reaches beyond the blank of {rounded(whole, 4)} mm"
        middle = x[triangles.rim].mean(1)
        margin = 1e-6 * whole
        within = (middle[:, :2] > low + margin) & (middle[:, :2] < high - margin)
        if within.all(1).any():
            place = coordinates(middle[within.all(1).argmax()])
            raise InputError(
                f"tools.{name} is open at {place} mm, beneath the blank; allowed is {needed}, "
                "without holes and cracks"
            )

    def stand(
        self, name: str, tool: PressTool, usual_off: float = 0.0, is_die: bool = False
    ) -> tuple[Surface, np.ndarray]:
        """The tool's surface, and the place of its origin at the start (3,) [mm]; usual_off: the
        default of its `off` [mm]; is_die: it is a die, whose flat face lies on the blank."""
        surface = self.surface(name, tool)
        start = np.append(np.asarray(tool.at, dtype=float)[:2], 0.0)
        touching = self._touching(name, tool, surface, start)
        if touching is None and _of_triangles(surface) is not None:
            turned = _turned_round(surface)
            touching = self._touching(name, tool, turned, start)
            if touching is not None:
                surface = turned
                self._warnings.append(
                    f"tools.{name}: the normals of its surface point away from the blank, so it "
                    "was turned round"
                )
        if touching is None:
            raise InputError(
                f"tools.{name} has its body between its face and the blank, which is "
                f"{'above' if tool.side == 'below' else 'below'} it; allowed is the other side, or "
                f"turn = [180, 0, 0]{_added(tool)}"
            )
        if is_die:
            touching += self._to_flange(surface, start + [0, 0, touching], tool.towards[2])
        if length_of(tool.at) == 3:
            z = float(np.asarray(tool.at)[2])
            self._check_height(name, tool, z, touching)
        else:
            z = touching - (usual_off if tool.off is None else tool.off) * tool.towards[2]
        self._doubt_back(name, tool, surface)
        return surface, start + [0, 0, z]

    def _touching(self, name, tool, surface, start):
        """The height (z) of the tool's origin at which it touches the blank, None if its body is on
        the wrong side. The tool moves by its least distance each time, so it never cuts in."""
        up, away, between = tool.towards[2], self._size, np.empty((0, 3))
        points = _of_triangles(surface)
        if points is None:
            far = MAX_DISTANCE * self._size + sum(r for r in surface.radii if np.isfinite(r))
        else:
            far = 4 * (abs(points).max() + self._size)
        while self._least(surface, start, -up * away, between)[0] <= 0:
            if away >= far:
                return None
            away = min(2 * away, far)
        for _ in range(500):
            gap, place, top = self._least(surface, start, -up * away, between)
            if abs(gap) < TOUCH_TOLERANCE * self._t:
                return -up * away
            away -= gap
            # the tool's top may lie between nodes
            if (self._low <= top).all() and (top <= self._high).all():
                between = np.vstack([between, [*top, 0.0]])[-10:]
            if away < -far:
                break
        raise InputError(self._beside(name, tool, surface, place))

    def _to_flange(self, surface, place, towards):
        """Distance along z [mm] by which a die that touches the blank must move so that its flat
        face at the blank's edge lies on it: facets of a fillet may bulge out of this face."""
        side = np.linspace(0, 1, 21)
        ends = np.array([self._low, self._high])
        along = self._low + side[:, None] * (self._high - self._low)
        edges = [np.column_stack([along[:, 0], 0 * side + y]) for y in ends[:, 1]]
        edges += [np.column_stack([0 * side + x, along[:, 1]]) for x in ends[:, 0]]
        x = np.vstack(edges)
        nearest = surface.evaluate(np.column_stack([x, 0 * x[:, 0]]) - place)
        gap = nearest.gap - self._t / 2
        flat = (abs(nearest.normal[:, 2]) > 0.99) & (abs(gap) < FLANGE * self._t)
        return towards * float(np.median(gap[flat])) if flat.any() else 0.0

    def _least(self, surface, start, height, between):
        """The least gap [mm] of all ranks between the blank's face, at its nodes and at points
        `between` them (k, 3), and a tool with its origin at this height; the place of the least
        gap, and the place (x, y) of the tool's top, by the curvature there."""
        places = np.vstack([self._x, between])
        nearest = surface.evaluate(places - (start + [0, 0, height]))
        gap = np.where(np.isfinite(nearest.gap), nearest.gap - self._t / 2, np.inf)
        mine: tuple[float, list[float], list[float]] = (np.inf, [], [])
        if len(gap):
            i = int(gap.argmin())
            bend, slope = nearest.curvature[i][:2, :2], nearest.normal[i][:2]
            top = places[i][:2] - np.linalg.lstsq(bend, slope, rcond=1e-9)[0]
            mine = float(gap[i]), places[i].tolist(), top.tolist()
        return min(self._comm.allgather(mine))

    def _beside(self, name, tool, surface, place):
        points = _of_triangles(surface)
        at = np.asarray(tool.at[:2], dtype=float)
        reach = np.zeros((1, 2)) if points is None else points[:, :2]
        low, high = at + reach.min(0), at + reach.max(0)
        words = f"tools.{name} does not meet the blank when it is moved along z"
        if away := np.linalg.norm(np.maximum(0, np.maximum(self._low - high, low - self._high))):
            words += f", {rounded(float(away), 6)} mm beside it"
        if points is not None:
            shift = at + self._middle - (low + high) / 2
            words += (
                f": it reaches from {coordinates(low)} to {coordinates(high)} mm, the blank from "
                f"{coordinates(self._low)} to {coordinates(self._high)} mm"
            )
            if np.linalg.norm(shift - at) > 1e-3 * self._size:
                over = ", ".join(rounded(float(each), 6) for each in shift)
                return f"{words}; allowed is a tool over it, as with at = [{over}]"
            return f"{words}; allowed is one in mm that is over the blank (is it in cm or inches?)"
        return f"{words}, nearest to {coordinates(place)}; allowed is `at` that puts it there"

    def _check_height(self, name, tool, z, touching):
        """Raise InputError for a tool that would stand in the blank."""
        deep = (z - touching) * tool.towards[2]
        if deep > FLANGE * self._t:
            raise InputError(
                f"tools.{name} cuts into the blank by {rounded(deep, 4)} mm before anything moves; "
                f"allowed is z of `at` {'up to' if tool.side == 'below' else 'from'} "
                f"{rounded(touching, 6)}, where it touches, or `at` without z"
            )

    def _doubt_back(self, name, tool, surface):
        """Warn of a tool from CAD whose flat back looks towards the blank."""
        inner, turn = _triangles(surface)
        if inner is None or len(inner.rim):  # what is open has no back
            return
        points = inner.points @ turn.T
        z = tool.towards[2] * points[:, 2]
        size = float(np.ptp(points, axis=0).max())
        near = z > z.max() - 1e-3 * size
        extent = float(np.ptp(points[near][:, :2], axis=0).max()) if near.any() else 0.0
        back = z < z.min() + 1e-3 * size
        behind = float(np.ptp(points[back][:, :2], axis=0).max()) if back.any() else 0.0
        if extent > 0.98 * size and behind < 0.5 * extent and np.ptp(z) > 0.05 * size:
            self._warnings.append(
                f"tools.{name} has a flat face towards the blank and its shape on the other side: "
                f"turn = [180, 0, 0]{_added(tool)} would turn it over"
            )


def _added(tool):
    return " on top of its own turn" if any(tool.turn) else ""


def _turned_round(surface: Any) -> Surface:
    """A surface of triangles with its body on the other side."""
    if isinstance(surface, Turned):
        return Turned(_turned_round(surface.surface), surface.angles)
    return surface.turned_round()


def face_of(surface: Any, towards: np.ndarray) -> Surface:
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
