"""The tools of a press as data: what each is, and where it stands before anything moves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..readers.field import Field, of_place
from ..runtime.errors import InputError
from ..runtime.fields import KnowsItsFields, choice, documented, number
from ..runtime.rules import FROM_ZERO, POSITIVE
from ..tools.surfaces import Surface
from ..tools.values import checked_vector, length_of

SIDES = {"below": 1.0, "above": -1.0}  # of the blank -> the direction along z from there to it


@documented
@dataclass(frozen=True)
class DieOf(KnowsItsFields):
    """The die of another tool, in place of a surface of its own.

    Parameters
    ----------
    tool
        Name of the other tool, which is on the other side of the blank.

    Raises
    ------
    InputError
        For a clearance that is not above 0.

    Examples
    --------
    >>> ff.PressTool(ff.DieOf("punch"), side="above").surface.tool
    'punch'
    """

    tool: str
    clearance: float | None = number(
        None, POSITIVE, "distance from the tool (1.2 thicknesses of the blank) [mm]"
    )


@documented
@dataclass(frozen=True)
class PressTool(KnowsItsFields):
    """A tool of a press.

    Parameters
    ----------
    surface
        Its surface; or the name of a file with triangles or a CAD model [mm]; or `DieOf` another
        tool.
    at
        Place of the origin of its surface, (x, y, z) or (x, y) [mm], by default (0, 0), of a die
        that of its tool. Without z the tool is moved along z until it touches the blank, and then
        back by the distance `off`.
    turn
        Angles (3,) about x, then y, then z [deg], by which it is turned about its origin.

    Raises
    ------
    InputError
        For values that are not allowed.

    Examples
    --------
    >>> ff.PressTool(ff.Sphere(50), side="above").towards
    array([ 0.,  0., -1.])
    """

    surface: Surface | str | DieOf
    side: str = choice("below", tuple(SIDES), "below or above the blank, which is then up or down")
    at: Sequence[float] | None = None
    off: float | None = number(
        None,
        FROM_ZERO,
        "distance from the blank at the start (0; with a die the clearance minus the blank's "
        "thickness, so that tools that close touch it everywhere at once) [mm]",
    )
    turn: Sequence[float] = (0.0, 0.0, 0.0)
    force: float | None = number(
        None, POSITIVE, "towards the whole blank from the start (none: stages move the tool) [N]"
    )
    friction: float | Field | None = number(
        None, of_place(FROM_ZERO, "xyz"), "coefficient to the blank (that of the `Interface`)"
    )
    chord: float = number(0.1, POSITIVE, "largest distance of triangles from a CAD model [mm]")

    def __post_init__(self) -> None:
        super().__post_init__()
        checked_vector("`turn`", self.turn)
        if self.at is not None:
            checked_vector("`at`", self.at, size=2 if length_of(self.at) == 2 else 3)
        for name in ("at", "turn"):  # as lists and arrays, so that tools compare
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, tuple(np.asarray(value).tolist()))
        if self.off is not None and length_of(self.at) == 3:
            raise InputError("`off` is not allowed beside a z in `at`")

    @property
    def towards(self) -> np.ndarray:
        """The direction from it to the blank (3,)."""
        return np.array([0.0, 0.0, SIDES[self.side]])
