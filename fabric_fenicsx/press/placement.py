"""The places of the tools of a press before the first step, and whether they leave room for it."""

from collections.abc import Mapping
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from ..core.collective_errors import on_root
from ..core.errors import InputError
from ..core.files import ending
from ..core.formatting import coordinates, rounded
from ..core.status import task
from ..surfaces.checks import FLANGE, MIN_SHARE, MIRRORED, check_triangles, unit_doubt
from ..surfaces.files import CAD
from ..surfaces.surfaces import Offset, Reversed, Surface, Turned
from ..surfaces.tool import Frame, Tool
from ..surfaces.triangulated import CUT_TOLERANCE, TriangulatedSurface
from .laying import Laid
from .press_data import PressData
from .stages import Schedule
from .tools import DieOf

CHECK_PRESSURE = 1.0  # MPa, under which the blank must fit between closed tools
POINTS_ACROSS = 60  # points across the blank at which the distance of two tools is found
TOUCH_TOLERANCE = 1e-9  # of the thickness: a tool so near touches the blank
MAX_OFF_ORIGIN = 4.0  # of its size, up to which a surface of triangles keeps its coordinates


@task("placing the tools")
def place_tools(press: PressData, laid: Laid) -> tuple[dict[str, Tool], Schedule, list[str]]:
    """The tools of a press {name: tool} in their places at its blank, what moves them, and doubts.
    Raises InputError, on all ranks, for tools that can't stand or move as given."""
    thickness, extent = press.thickness(), np.array(laid.blank.extent())
    given, dies = {name: press.tool(name) for name in press.tools}, press.dies()
    clearances = {name: die.clearance or 1.2 * thickness for name, die in dies.items()}
    usual_off = {d.tool: max(0.0, clearances[n] - thickness) for n, d in dies.items()}
    surfaces, starts, doubts = dict[str, Surface](), dict[str, np.ndarray](), list[str]()
    frames = dict[str, Frame]()
    for name in sorted(given, key=dies.__contains__):  # dies after their tools
        tool, surface = given[name], given[name].surface
        turn = Rotation.from_euler("xyz", tool.turn, degrees=True).as_matrix()
        if isinstance(surface, DieOf):
            punch, (middle, axes), face = surface.tool, frames[surface.tool], surfaces[surface.tool]
            inner, own = _triangles(face)
            if inner:
                if not len(inner.rim):  # of a closed body what looks towards the blank
                    inner = inner.face(own.T @ given[punch].towards)
                    face = Turned(inner, face.angles) if isinstance(face, Turned) else inner
                rim = (inner.points @ own.T + starts[punch])[inner.rim].mean(1)
                _check_covered(punch, rim, extent, press.planes)
            pressed = press.thickness(CHECK_PRESSURE)
            check_clearance(f"tools.{name}.clearance", clearances[name], pressed, face)
            frames[name] = Frame(middle, turn @ axes)
            surface = Reversed(Offset(face, clearances[name]))
        else:
            surface, more = _surface_of(name, tool, laid, thickness)
            doubts += more
            surface, middle = _about_middle(surface, tool.at, turn, press.planes)
            frames[name] = Frame(middle, turn)
        surfaces[name] = Turned(surface, tool.turn) if any(tool.turn) else surface
        origin, usual = frames[name].axes @ middle, usual_off.get(name, 0.0)
        starts[name] = _start(name, tool, surfaces[name], origin, laid, thickness, usual)
    reach = dict[str, float]()
    for name, die in dies.items():
        apart = float((starts[name] - starts[die.tool]) @ given[die.tool].towards)
        reach[die.tool] = apart + clearances[name]
    schedule, tools = press.schedule(reach, thickness), dict[str, Tool]()
    for name in given:
        path, force = schedule.path(name, starts[name]), schedule.force(name, press.share)
        tools[name] = Tool(surfaces[name], path, force=force, name=name)
        tools[name].home = frames[name]

    def checked():
        doubts = _clearance_doubts(press, tools, schedule, extent)
        return doubts + mirrored_tools(press, tools, extent, press.planes)

    return tools, schedule, doubts + on_root(laid.blank.mesh.comm, checked)


def check_clearance(path: str, clearance: float, pressed: float, surface: Surface) -> None:
    """InputError for a clearance below the `pressed` thickness or from the concave radius on."""
    if not pressed <= clearance < surface.radii[1]:
        raise InputError(
            f"{path} is {rounded(clearance, 6)}; expected from {rounded(pressed)} mm, the "
            f"blank's thickness under {CHECK_PRESSURE:g} MPa, to below {surface.radii[1]:g} mm, "
            "the tool's least concave radius"
        )


def _surface_of(name, tool, laid, thickness):
    """The tool's surface, read, and doubts; of a CAD model whose facets are coarse one of a smaller
    `chord`."""
    surface, is_own = tool.surface, isinstance(tool.surface, Surface)
    words = f"tools.{name}.surface" if is_own else f"tools.{name}, {surface},"
    finest, size = 1 if is_own or ending(surface) not in CAD else 5, laid.blank.sides()[:2].max()
    for finer in (1, 2, 5):
        if not is_own:
            chord, comm = tool.chord / finer, laid.blank.mesh.comm
            body = tool.body or ()
            surface = TriangulatedSurface.read(tool.surface, chord, comm=comm, body=body)
        if not isinstance(surface, TriangulatedSurface):
            break
        try:
            if doubt := unit_doubt(float(np.ptp(surface.points, axis=0).max()), size, MIN_SHARE):
                raise InputError(f"{words} {doubt}; expected a surface in mm")
            return surface, check_triangles(surface, words, thickness)
        except InputError as error:
            if finer == finest:
                smaller = ", or a smaller `chord`" if finer > 1 else ""
                raise InputError(f"{error}{smaller}") from None
    return surface, []


def _about_middle(surface, at, axes, planes):
    """A surface of triangles about its own middle if that lies far from its origin, where rounding
    would count, and whole if it is cut at planes of symmetry; the middle (3,). Others stay. at,
    axes: of its coordinates (2 or 3,) and (3, 3), as columns."""
    middle, cuts = np.zeros(3), []
    if not isinstance(surface, TriangulatedSurface):
        return surface, middle
    low, high = surface.points.min(0), surface.points.max(0)
    if max(abs(low).max(), abs(high).max()) > MAX_OFF_ORIGIN * (high - low).max():
        middle = (low + high) / 2
    for axis, place in planes.items():
        cuts.append(np.append(axes[axis], place - at[axis] - axes[axis] @ middle))
        off = (surface.points - middle) @ cuts[-1][:3] - cuts[-1][3]
        if not min(abs(off.min()), abs(off.max())) < CUT_TOLERANCE < np.ptp(off):
            cuts.pop()
    return (surface.moved(-middle, cuts) if middle.any() or cuts else surface), middle


def _check_covered(name, rim, extent, planes):
    """Raise InputError for the surface of a tool with a die that has its `rim` (n, 3) beneath the
    blank, or beneath its mirror images in `planes` of symmetry."""
    low, high = extent[:, :2]
    low = np.array([2 * planes[k] - high[k] if k in planes else low[k] for k in (0, 1)])
    whole = float((high - low).max())
    margin = 1e-6 * whole
    within = ((rim[:, :2] > low + margin) & (rim[:, :2] < high - margin)).all(1)
    if within.any():
        raise InputError(
            f"tools.{name} is open at {coordinates(rim[within.argmax()])} mm, under the blank;"
            f" expected a surface in mm that reaches beyond the blank of {rounded(whole, 4)} mm, "
            "without holes and cracks"
        )


def _start(name, tool, surface, origin, laid, thickness, usual):
    """The place of the origin of a tool's surface, `origin` (3,) off `at`, at the start (3,) [mm];
    usual: the default of its `start_distance` [mm]. Raises InputError for one that would stand in
    the blank."""
    (x, y, *z), up = np.add(tool.at, origin[: len(tool.at)]), tool.towards[2]
    touching = _touching(name, up, (x, y), surface, laid, thickness)
    if isinstance(tool.surface, DieOf):
        touching += up * _to_flange(surface, (x, y, touching), laid.blank.extent(), thickness)
    away = usual if tool.start_distance is None else tool.start_distance
    height = z[0] if z else touching - away * up
    deep = (height - touching) * up
    if deep > FLANGE * thickness:
        raise InputError(
            f"tools.{name} cuts into the blank by {rounded(deep, 4)} mm before the first step; "
            f"expected z of `at` {'up to' if tool.side == 'below' else 'from'} "
            f"{rounded(touching - origin[2], 6)}, where it touches, or `at` without z"
        )
    return np.array([x, y, height])


def _touching(name, up, place, surface, laid, thickness):
    """The height (z) of the tool's origin at which it touches the flat blank. It moves by its least
    distance each time, so it never cuts in. Raises InputError, on all ranks, for a tool that does
    not meet the blank, or only with its back."""
    x, (low, high) = laid.flat_nodes(), np.array(laid.blank.extent())[:, :2]
    first = size = float((high - low).max())

    def least(away):
        """The least gap of all ranks, the normal there towards the blank, and the tool's top."""
        seen = x - [*place, -up * away]
        some = surface.evaluate(seen, 0.0).gap.argsort()[:1]  # of rough gaps
        reach = surface.evaluate(seen[some]).gap.max(initial=-np.inf)  # what is further counts not
        nearest = surface.evaluate(seen, reach if reach > 0 else np.inf)
        gaps = np.where(np.isfinite(nearest.gap), nearest.gap - thickness / 2, np.inf)
        local = [np.inf, [], 0.0, []]
        if len(gaps):
            i = int(gaps.argmin())
            bend, slope = nearest.curvature[i][:2, :2], nearest.normal[i]
            top = x[i][:2] - np.linalg.lstsq(bend, slope[:2], rcond=1e-9)[0]
            local = [float(gaps[i]), x[i].tolist(), up * float(slope[2]), top.tolist()]
        gap, _, facing, top = min(laid.blank.mesh.comm.allgather(local))  # of equal ones the first
        return gap, facing, np.array(top)

    while (sides := least(first))[0] <= 0 or sides[1] < 0:  # in the body, or beyond it
        first *= 2
        if first > 1e7:  # mm
            raise InputError(
                f"tools.{name} has its body between its face and the blank; use the other "
                "side, turn = [180, 0, 0] on top of its own turn, triangles whose normals point "
                "out of the body, or the die of an open surface, as double_dome"
            )
    away, rounding = first, 1e-9 * size
    for _ in range(500):
        gap, _, top = least(away)
        if abs(gap) < TOUCH_TOLERANCE * thickness:
            return -up * away
        away -= gap
        if (low - rounding <= top).all() and (top <= high + rounding).all():
            x = np.vstack([x, [*top, 0.0]])  # the top is between nodes
        if away < -first:
            break
    inner, own = _triangles(surface)
    reach = place + ((inner.points if inner else np.zeros((1, 3))) @ own.T)[:, :2]
    beside = np.maximum(0, np.maximum(low - reach.max(0), reach.min(0) - high))
    raise InputError(
        f"tools.{name} does not meet the blank when it is moved along z, "
        f"{rounded(float(np.linalg.norm(beside)), 6)} mm beside it; expected `at` that puts "
        "it there, and a surface in mm"
    )


def _to_flange(surface, origin, extent, thickness):
    """Distance along its normal [mm] by which a die that touches the blank must move so that its
    flat face at the blank's edge lies on it: facets of a fillet may bulge out of this face."""
    low, high = np.array(extent)
    share = np.linspace(0, 1, 21)[:, None]
    along = [low + share * (high - low) * axis for axis in np.eye(3)[:2]]
    edges = np.vstack([*along, *(low + high - each for each in along)]) * (1, 1, 0)
    nearest = surface.evaluate(edges - np.array(origin))
    gap = nearest.gap - thickness / 2
    flat = (abs(nearest.normal[:, 2]) > 0.99) & (abs(gap) < FLANGE * thickness)
    return float(np.median(gap[flat])) if flat.any() else 0.0


def _triangles(surface):
    """The triangles of a surface, None for others, and what turns them into their place (3, 3)."""
    turn = np.eye(3)
    if isinstance(surface, Turned):
        turn, surface = surface.back(turn), surface.surface
    return (surface if isinstance(surface, TriangulatedSurface) else None), turn


def _clearance_doubts(press, tools, schedule, extent):
    """Sentences on tools that leave the blank, with corners `extent` (2, 3) [mm], less than its
    thickness under pressure at the end of a stage. Raises InputError for two on either side of it
    that go through one another. The place of tools that a force moves is not known."""
    pressed, doubts = press.thickness(CHECK_PRESSURE), list[str]()
    thickness = f"the blank's thickness under {CHECK_PRESSURE:g} MPa, {rounded(pressed, 4)} mm"
    whens = ["before the first step", *(f"at the end of {s.name}" for s in schedule.stages)]
    straight = {
        frozenset((die.tool, name)): die.tool
        for name, die in press.dies().items()
        if schedule.closes_straight(die.tool, name)
    }
    still = [name for name in tools if not tools[name].force]
    below, above = ([n for n in still if press.tools[n].side == s] for s in ("below", "above"))
    for pair, (load, when) in product(product(below, above), zip(schedule.joints, whens)):
        apart, place = np.inf, np.zeros(3)
        if punch := straight.get(frozenset(pair)):  # where both are flat, in the middle
            apart = schedule.distance(punch, load)
        elif len(x := _points(tools[pair[0]], extent, load)):
            gap = tools[pair[1]].surface.evaluate(x - tools[pair[1]].path(load)).gap
            gap = np.nan_to_num(gap, nan=np.inf)
            apart, place = gap.min(), x[gap.argmin()]
        words, at = f"tools {' and '.join(pair)}", f"{when}, at {coordinates(place)} mm"
        if apart < 0:
            raise InputError(
                f"{words} overlap by {rounded(-apart, 4)} mm {at}; expected a "
                f"distance from {thickness}: less travel, or another place (`at`)"
            )
        if load and apart < (1 - 1e-6) * pressed:
            crushed = f"less than {thickness}: they crush the blank there"
            doubts.append(f"{words} are {rounded(apart, 4)} mm apart {at}, {crushed}")
    return doubts


def _points(tool, extent, load):
    """Points (n, 3) [mm] of a tool's surface over or under the blank at a load factor."""
    low, high = extent
    size, place = float((high - low).max()), np.asarray(tool.path(load))
    room = np.array([0.0, 0.0, 2 * size])
    points, _, _ = tool.surface.mesh(low - room - place, high + room - place, size / POINTS_ACROSS)
    x = points + place
    return x[((x >= low - 1e-6) & (x <= high + 1e-6))[:, :2].all(1)]


def mirrored_tools(
    press: PressData, tools: Mapping[str, Tool], extent: np.ndarray, planes: Mapping[int, float]
) -> list[str]:
    """A sentence on each tool that is not its own mirror image in the `planes`, within `MIRRORED`
    thicknesses, in its places at start and end. extent (2, 3): corners of the blank [mm]."""
    doubts, thickness = dict[str, str](), press.thickness()
    alone = [tool for name, tool in tools.items() if name not in press.dies() and planes]
    ways = [np.subtract(tool.path(1.0), tool.path(0.0)) for tool in alone]
    loads = [(0.0, 1.0) if way[:2].any() else (0.0,) for way in ways]
    known = [(t, at, _points(t, extent, at)) for t, each in zip(alone, loads) for at in each]
    for (tool, load, x), (axis, place) in product(known, planes.items()):
        images = np.where(np.arange(3) == axis, 2 * place - x, x)
        off = np.nan_to_num(abs(tool.surface.evaluate(images - tool.path(load)).gap))
        if tool.name not in doubts and off.max(initial=0.0) > MIRRORED * thickness:
            worst = int(off.argmax())
            doubts[tool.name] = (
                f"tools.{tool.name} is not symmetric about {'xy'[axis]} = {place:g}: it is "
                f"at {coordinates(x[worst])}, but {rounded(off[worst])} mm off "
                f"{coordinates(images[worst])}; so the {press.modelled} represents "
                f'{1 / press.share:g} mirrored ones; use the whole blank (`symmetry = "none"`)'
            )
    return list(doubts.values())
