"""Whether the tools of a press leave the blank room between them, and are as symmetric as a quarter
takes them to be."""

from itertools import combinations
from typing import Any

import numpy as np

from ..runtime.errors import InputError
from ..runtime.words import coordinates, rounded
from ..tools.checks import MIRRORED
from .punch import PRESSED

ACROSS = 60  # points across the blank, at which the distance of two tools is asked


def check_clearances(press: Any) -> None:
    """Raise InputError on all ranks if two tools of a `Press`, on either side of its blank, go
    through one another at the end of a stage; warn if they leave it less room than it needs.

    Of tools that a force moves the place is not known.
    """
    course, comm = press.course, press.comm
    tools = [tool for tool in press.rigid if not tool.force]
    low, high = press.extent
    pressed = sum(ply.thickness_under(PRESSED) for ply in press.plies)
    wrong = ""
    if comm.rank == 0:
        for one, two in combinations(tools, 2):
            below, above = (press.tools[each.name].side for each in (one, two))
            if wrong:
                continue
            for k, load in enumerate(course.joints):
                found = _least_distance(one, two, low, high, load)
                if not found or wrong:
                    break
                distance, place = found
                when = f"at the end of {course.stages[k - 1].name or f'stage {k}'}"
                when = when if k else "before anything moves"
                if below == above:
                    if distance < 0 and k:
                        press.warnings.append(
                            f"tools {one.name} and {two.name} go {rounded(-distance, 4)} mm "
                            f"through one another {when}, at {coordinates(place)} mm: real ones "
                            "can't"
                        )
                        break
                elif distance < 0:
                    wrong = (
                        f"tools {one.name} and {two.name} go {rounded(-distance, 4)} mm through "
                        f"one another {when}, at {coordinates(place)} mm; allowed is a distance "
                        f"from {rounded(pressed, 4)} mm, the blank's thickness under {PRESSED:g} "
                        "MPa: less travel, or another place (`at`)"
                    )
                elif k and distance < (1 - 1e-6) * pressed:
                    press.warnings.append(
                        f"tools {one.name} and {two.name} are {rounded(distance, 4)} mm apart "
                        f"{when}, at {coordinates(place)} mm, less than the blank's thickness "
                        f"under {PRESSED:g} MPa, {rounded(pressed, 4)} mm: they crush it there"
                    )
    wrong, press.warnings[:] = comm.bcast((wrong, press.warnings))
    if wrong:
        raise InputError(wrong)


def _least_distance(one, two, low, high, load):
    """The least distance [mm] of two tools over the blank at a load factor, and its place; None if
    the first has no point there."""
    x, other = _points(one, low, high, load), np.asarray(two.path(load))
    if not len(x):
        return None
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
