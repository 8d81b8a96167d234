"""The punch of a forming run, given as a surface or a file, and its distance from the die."""

import os
from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI

from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..tools.checks import check_own_punch, check_punch, mirror_warning
from ..tools.double_dome import DoubleDome
from ..tools.surfaces import Surface, radii_of
from ..tools.triangulated import TriangulatedSurface

PRESSED = 1.0  # MPa, under which a ply must fit between the closed tools


def punch_of(
    given: Any,
    chord: float,
    extent: tuple[np.ndarray, np.ndarray],
    thickness: float,
    full: bool,
    comm: MPI.Comm,
    warn: Callable[[str], None],
) -> tuple[Surface, float]:
    """The surface of a punch that is `given` as one or as a file's name, checked, and how high it
    rises [mm] beneath a ply, or unless `full` a quarter, of that extent and thickness [mm].

    chord: as in `TriangulatedSurface.read`. Calls `warn` with a sentence for what can only be
    doubted. Raises InputError for what is neither, or can't be a punch.
    """
    name, surface = "`punch`", given
    if isinstance(given, (str, os.PathLike)):
        name, surface = f"`punch` {given}", TriangulatedSurface.read(str(given), chord, comm=comm)
    elif not isinstance(given, Surface):
        kind = given.__name__ if isinstance(given, type) else type(given).__name__
        raise InputError(
            f"`punch` is {'the class' if isinstance(given, type) else 'a'} {kind}; allowed is a "
            "surface, as `DoubleDome()`, or a file's name"
        )
    low, high = (corner[:2] for corner in extent)
    half = np.maximum(abs(low), abs(high))
    if isinstance(surface, TriangulatedSurface):
        surface = check_punch(surface, name, half, thickness, warn)
        top = float(surface.points[:, 2].max())
    elif isinstance(surface, DoubleDome):
        top = surface.depth
    else:
        top = check_own_punch(surface, low, high, thickness)
    if not full and (words := mirror_warning(surface, name, half, top, thickness)):
        warn(f"{words}; take the whole ply (`full`)")
    return surface, top


def clearance_of(asked: float | None, thickness: float, pressed: float, surface: Surface) -> float:
    """Distance of punch and die [mm], by default 1.2 thicknesses without pressure. Raises
    InputError for one that is less than the `pressed` thickness, or leaves the die's bulges no
    radius."""
    clearance, radius = asked or 1.2 * thickness, radii_of(surface)[1]
    if clearance < pressed:
        raise InputError(
            f"`clearance` {clearance:g} is less than the thickness of ply or stack under "
            f"{PRESSED:g} MPa; allowed is from {rounded(pressed)} mm"
        )
    if clearance >= radius:
        usual = "" if asked else ", 1.2 thicknesses,"
        raise InputError(
            f"`clearance` {clearance:g}{usual} leaves the die no radius where the punch is hollow; "
            f"allowed is from {rounded(pressed)} to below {radius:g} mm, the least radius there"
        )
    return clearance
