"""Checks of a press: whether its tools leave room for the blank, and are symmetric if only a
part of the blank is modelled."""

from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from ..runtime.errors import InputError
from ..runtime.formatting import coordinates, rounded
from ..tools.checks import MIRRORED

CHECK_PRESSURE = 1.0  # MPa, under which the blank must fit between closed tools
POINTS_ACROSS = 60  # points across the blank at which the distance of two tools is found


def check_clearances(
    press: Any, laid: Any, placed: Any, pressed: float, warnings: list[str]
) -> None:
    """Raise InputError on all ranks if two tools of a `Press`, on either side of its blank, go
    through one another at the end of a stage; warn if they leave it less than its `pressed`
    thickness [mm].

    The place of tools that a force moves is not known, so they are left out.
    """
    wrong, comm, doubts = "", laid.blank.mesh.comm, list[str]()
    tools = [tool for tool in placed.tools.values() if not tool.force]
    low, high = laid.blank.extent()
    try:
        for pair in combinations(tools, 2) if comm.rank == 0 else ():
            same_side = len({press.tools[tool.name].side for tool in pair}) == 1
            names = {tool.name for tool in pair}
            of = next((of for name, of in press.dies().items() if {name, of} == names), "")
            if of and placed.schedule.closes_straight(of, *names - {of}):
                # where both are flat, in the middle
                distance = lambda load: (placed.schedule.distance(of, load), np.zeros(3))  # noqa: E731
            else:
                distance = partial(_least_distance, *pair, low, high)
            doubts += _doubts([t.name for t in pair], same_side, distance, placed.schedule, pressed)
    except InputError as error:
        wrong = str(error)
    wrong, doubts = comm.bcast((wrong, doubts))
    if wrong:
        raise InputError(wrong)
    warnings += doubts


def _doubts(names, same_side, distance, schedule, pressed):
    """Warnings of two tools that come too near at the ends of stages; InputError as in
    `check_clearances`. distance: function of the load factor to their distance and its place."""
    whens = ["before anything moves", *(f"at the end of {s.name}" for s in schedule.stages)]
    doubts: list[str] = []
    for load, when in zip(schedule.joints, whens):
        apart, place = distance(load)
        tools, at = f"tools {' and '.join(names)}", f"{when}, at {coordinates(place)} mm"
        through = f"{tools} go {rounded(-apart, 4)} mm through one another {at}"
        if apart < 0 and not same_side:
            raise InputError(
                f"{through}; allowed is a distance from {rounded(pressed, 4)} mm, the blank's "
                f"thickness under {CHECK_PRESSURE:g} MPa: less travel, or another place (`at`)"
            )
        if apart < 0 and load:
            return [*doubts, f"{through}: real ones can't"]
        if load and not same_side and apart < (1 - 1e-6) * pressed:
            doubts.append(
                f"{tools} are {rounded(apart, 4)} mm apart {at}, less than the blank's thickness "
                f"under {CHECK_PRESSURE:g} MPa, {rounded(pressed, 4)} mm: they crush it there"
            )
    return doubts


def _least_distance(one, two, low, high, load):
    """The least distance [mm] of two tools over the blank, and its place; inf if there is none."""
    x, other = _points(one, low, high, load), np.asarray(two.path(load))
    if not len(x):
        return np.inf, np.zeros(3)
    gap = two.surface.evaluate(x - other).gap
    gap = np.where(np.isfinite(gap), gap, np.inf)
    worst = int(gap.argmin())
    return float(gap[worst]), x[worst]


def _points(tool, low, high, load):
    """Points (n, 3) [mm] of a tool's surface over or under the blank at a load factor."""
    size, place = float((high - low).max()), np.asarray(tool.path(load))
    room = np.array([0.0, 0.0, 2 * size])
    points, _, _ = tool.surface.mesh(low - room - place, high + room - place, size / POINTS_ACROSS)
    x = points + place
    return x[((x >= low - 1e-6) & (x <= high + 1e-6))[:, :2].all(1)]


def symmetry_warnings(press: Any, laid: Any, placed: Any) -> list[str]:
    """A warning for each tool that is not its own mirror image in the planes of symmetry, within
    `MIRRORED` thicknesses, in its places at the start and at the end; on all ranks."""
    warnings: list[str] = []
    comm, (low, high) = laid.blank.mesh.comm, laid.blank.extent()
    for tool in placed.tools.values() if comm.rank == 0 else ():
        if tool.name in press.dies():  # it is as symmetric as its tool
            continue
        sideways = np.subtract(tool.path(1.0), tool.path(0.0))[:2].any()
        for load in (0.0, 1.0) if sideways else (0.0,):
            x, place = _points(tool, low, high, load), np.asarray(tool.path(load))
            if not len(x) or any(words.startswith(f"tools.{tool.name} ") for words in warnings):
                continue
            for axis in press.planes:
                mirror = 1.0 - 2.0 * np.eye(3)[axis]
                off = np.nan_to_num(abs(tool.surface.evaluate(x * mirror - place).gap))
                worst = int(off.argmax())
                if off[worst] > MIRRORED * placed.thickness:
                    warnings.append(
                        f"tools.{tool.name} is not its own mirror image in {'xy'[axis]} = 0: it is "
                        f"at {coordinates(x[worst])}, but {rounded(off[worst])} mm off "
                        f"{coordinates(x[worst] * mirror)}; so the {press.modelled} "
                        f"stands for {1 / press.share:g} mirrored ones; take the whole blank "
                        '(`symmetry = "none"`)'
                    )
                    break
    return comm.bcast(warnings)
