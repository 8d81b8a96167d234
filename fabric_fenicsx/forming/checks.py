"""Checks of a press: whether its tools leave room for the blank, and are symmetric if only a
part of the blank is modelled."""

from collections.abc import Mapping
from functools import partial
from itertools import combinations

import numpy as np

from ..runtime.errors import InputError
from ..runtime.formatting import coordinates, rounded
from ..tools.checks import MIRRORED
from ..tools.tool import Tool
from .press_data import PressData
from .stages import Schedule

CHECK_PRESSURE = 1.0  # MPa, under which the blank must fit between closed tools
POINTS_ACROSS = 60  # points across the blank at which the distance of two tools is found


def clearance_doubts(
    press: PressData,
    tools: Mapping[str, Tool],
    schedule: Schedule,
    extent: np.ndarray,
    pressed: float,
) -> list[str]:
    """Sentences on tools that leave the blank, with corners `extent` (2, 3) [mm], less than its
    `pressed` thickness [mm] at the end of a stage. Raises InputError for two on either side of it
    that go through one another. The place of tools that a force moves is not known."""
    doubts: list[str] = []
    if len(sides := {press.tools[name].side for name in tools}) == 1 < len(tools):
        doubts.append(
            f"{' and '.join(tools)} stand {sides.pop()} the blank, and only holders resist them: "
            "`side` says where a tool stands"
        )
    whens = ["before anything moves", *(f"at the end of {s.name}" for s in schedule.stages)]
    for one, two in combinations([tool for tool in tools.values() if not tool.force], 2):
        opposite = press.tools[one.name].side != press.tools[two.name].side
        distance = _distance_of(press, schedule, one, two, extent)
        for load, when in zip(schedule.joints, whens):
            apart, place = distance(load)
            both = f"tools {one.name} and {two.name}"
            at = f"{when}, at {coordinates(place)} mm"
            if apart < 0 and (opposite or load):
                flaw = f"{both} go {rounded(-apart, 4)} mm through one another {at}"
                if opposite:
                    raise InputError(
                        f"{flaw}; allowed is a distance from {rounded(pressed, 4)} mm, the blank's "
                        f"thickness under {CHECK_PRESSURE:g} MPa: less travel, or another place "
                        "(`at`)"
                    )
                doubts.append(f"{flaw}: real ones can't")
                break
            if load and opposite and apart < (1 - 1e-6) * pressed:
                doubts.append(
                    f"{both} are {rounded(apart, 4)} mm apart {at}, less than the blank's "
                    f"thickness under {CHECK_PRESSURE:g} MPa, {rounded(pressed, 4)} mm: they crush "
                    "it there"
                )
    return doubts


def _distance_of(press, schedule, one, two, extent):
    """Function of the load factor to the least distance of two tools over the blank [mm], and its
    place."""
    for name, die in press.dies().items():
        if {name, die.tool} == {one.name, two.name} and schedule.closes_straight(die.tool, name):
            # where both are flat, in the middle
            return lambda load: (schedule.distance(die.tool, load), np.zeros(3))
    return partial(_least_distance, one, two, extent)


def _least_distance(one, two, extent, load):
    """The least distance [mm] of two tools over the blank, and its place; inf if there is none."""
    x = _points(one, extent, load)
    gap = two.surface.evaluate(x - np.asarray(two.path(load))).gap
    gap = np.append(np.where(np.isfinite(gap), gap, np.inf), np.inf)
    worst = int(gap.argmin())
    return float(gap[worst]), np.vstack([x, np.zeros(3)])[worst]


def _points(tool, extent, load):
    """Points (n, 3) [mm] of a tool's surface over or under the blank at a load factor."""
    low, high = extent
    size, place = float((high - low).max()), np.asarray(tool.path(load))
    room = np.array([0.0, 0.0, 2 * size])
    points, _, _ = tool.surface.mesh(low - room - place, high + room - place, size / POINTS_ACROSS)
    x = points + place
    return x[((x >= low - 1e-6) & (x <= high + 1e-6))[:, :2].all(1)]


def symmetry_doubts(
    press: PressData, tools: Mapping[str, Tool], extent: np.ndarray, thickness: float
) -> list[str]:
    """A sentence on each tool that is not its own mirror image in the planes of symmetry, within
    `MIRRORED` thicknesses, in its places at the start and at the end."""
    doubts: dict[str, str] = {}
    for tool, load in ((tool, load) for tool in tools.values() for load in (0.0, 1.0)):
        sideways = np.subtract(tool.path(1.0), tool.path(0.0))[:2].any()
        if tool.name in press.dies() or (load and not sideways):  # as symmetric as its tool
            continue
        x, place = _points(tool, extent, load), np.asarray(tool.path(load))
        for axis in press.planes if len(x) else ():
            mirror = 1.0 - 2.0 * np.eye(3)[axis]
            off = np.nan_to_num(abs(tool.surface.evaluate(x * mirror - place).gap))
            worst = int(off.argmax())
            if off[worst] > MIRRORED * thickness and tool.name not in doubts:
                doubts[tool.name] = (
                    f"tools.{tool.name} is not its own mirror image in {'xy'[axis]} = 0: it is at "
                    f"{coordinates(x[worst])}, but {rounded(off[worst])} mm off "
                    f"{coordinates(x[worst] * mirror)}; so the {press.modelled} stands for "
                    f"{1 / press.share:g} mirrored ones; take the whole blank "
                    '(`symmetry = "none"`)'
                )
    return list(doubts.values())
