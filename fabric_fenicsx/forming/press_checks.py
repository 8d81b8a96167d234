"""Whether the tools of a press leave the blank room between them, and are as symmetric as a quarter
takes them to be."""

from itertools import combinations
from typing import Any

import numpy as np

from ..runtime.errors import InputError
from ..runtime.formatting import coordinates, rounded
from ..tools.checks import MIRRORED
from .punch import PRESSED

ACROSS = 60  # points across the blank, at which the distance of two tools is asked


def check_clearances(press: Any) -> None:
    """Raise InputError on all ranks if two tools of a `Press`, on either side of its blank, go
    through one another at the end of a stage; warn if they leave it less room than it needs.

    Of tools that a force moves the place is not known.
    """
    wrong, comm = "", press.comm
    tools = [tool for tool in press.rigid if not tool.force]
    try:
        for one, two in combinations(tools, 2) if comm.rank == 0 else ():
            press.warnings += _doubts(press, one, two)
    except InputError as error:
        wrong = str(error)
    wrong, press.warnings[:] = comm.bcast((wrong, press.warnings))
    if wrong:
        raise InputError(wrong)


def _doubts(press, one, two):
    """Sentences on two tools that come too near at the ends of stages; InputError as
    `check_clearances`."""
    same_side = press.tools[one.name].side == press.tools[two.name].side
    pressed = sum(ply.thickness_under(PRESSED) for ply in press.plies)
    whens = ["before anything moves", *(f"at the end of {s.name}" for s in press.course.stages)]
    low, high = press.extent
    found: list[str] = []
    for load, when in zip(press.course.joints, whens):
        distance, place = _least_distance(one, two, low, high, load)
        tools, at = f"tools {one.name} and {two.name}", f"{when}, at {coordinates(place)} mm"
        through = f"{tools} go {rounded(-distance, 4)} mm through one another {at}"
        if distance < 0 and not same_side:
            raise InputError(
                f"{through}; allowed is a distance from {rounded(pressed, 4)} mm, the blank's "
                f"thickness under {PRESSED:g} MPa: less travel, or another place (`at`)"
            )
        if distance < 0 and load:
            return [*found, f"{through}: real ones can't"]
        if load and not same_side and distance < (1 - 1e-6) * pressed:
            found.append(
                f"{tools} are {rounded(distance, 4)} mm apart {at}, less than the blank's "
                f"thickness under {PRESSED:g} MPa, {rounded(pressed, 4)} mm: they crush it there"
            )
    return found


def _least_distance(one, two, low, high, load):
    """The least distance [mm] of two tools over the blank at a load factor, and its place; it is
    infinite if the first has no point there."""
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
    points, _, _ = tool.surface.mesh(low - room - place, high + room - place, size / ACROSS)
    x = points + place
    return x[((x >= low - 1e-6) & (x <= high + 1e-6))[:, :2].all(1)]


def symmetry_warnings(press: Any) -> list[str]:
    """A sentence for each tool of a quarter that is not its own mirror image in x = 0 and y = 0, to
    `MIRRORED` of the thickness, where it stands at the start and at the end; on all ranks."""
    found: list[str] = []
    low, high = press.extent
    for tool in press.rigid if press.comm.rank == 0 and not press.full else ():
        for load in (0.0, 1.0):
            x, place = _points(tool, low, high, load), np.asarray(tool.path(load))
            if not len(x) or any(words.startswith(f"tool {tool.name} ") for words in found):
                continue
            for axis, mirror in enumerate(((-1, 1, 1), (1, -1, 1))):
                off = np.nan_to_num(abs(tool.surface.evaluate(x * mirror - place).gap))
                worst = int(off.argmax())
                if off[worst] > MIRRORED * press.thickness:
                    found.append(
                        f"tool {tool.name} is not its own mirror image in {'xy'[axis]} = 0: it is "
                        f"at {coordinates(x[worst])}, but {rounded(off[worst])} mm off "
                        f"{coordinates(x[worst] * mirror)}; so the quarter stands for four "
                        "mirrored ones; take the whole blank (`quarter = false`)"
                    )
                    break
    return press.comm.bcast(found)
