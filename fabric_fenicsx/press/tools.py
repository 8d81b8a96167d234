"""The tools of a press as data: what each is, and where it stands before the first step."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from inspect import signature
from typing import NamedTuple

import numpy as np

from ..core.errors import InputError
from ..core.fields import KnowsItsFields, choice, documented, quantity
from ..core.rules import COUNT, FROM_ZERO, POSITIVE, check_complete, repr_short, unknown_key
from ..core.tables import located, names_of
from ..io.field import Field, of_place
from ..material.files import Several
from ..surfaces.double_dome import DoubleDome
from ..surfaces.primitives import Block, Cylinder, Plane, Plate, Sphere, Torus
from ..surfaces.surfaces import Surface, Turned, checked_vector


@documented
@dataclass(frozen=True)
class DieOf(KnowsItsFields):
    """The die of another tool, instead of a surface of its own.

    Parameters
    ----------
    tool
        Name of the other tool, which is on the other side of the blank.

    Examples
    --------
    >>> ff.PressTool(ff.DieOf("punch"), side="above").surface.tool
    'punch'
    """

    tool: str
    clearance: float | None = quantity(
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
        Position of the origin of its surface, (x, y, z) or (x, y) [mm], by default (0, 0), of a die
        that of its tool. Without z the tool is moved along z until it touches the blank, and then
        back by `start_distance`.
    turn
        Angles (3,) about x, then y, then z [deg], by which it is turned about its origin.
    body
        Number, or numbers, of its solids in a CAD model of several, from 1.

    Examples
    --------
    >>> ff.PressTool(ff.Sphere(50), side="above").towards
    array([ 0.,  0., -1.])
    """

    surface: Surface | str | DieOf
    side: str = choice("below", ("below", "above"), "below or above the blank")
    at: Sequence[float] | None = None
    start_distance: float | None = quantity(
        None,
        FROM_ZERO,
        "distance from the blank at the start (0; with a die the clearance minus the blank's "
        "thickness, so that tools that close touch it everywhere at once) [mm]",
    )
    turn: Sequence[float] = (0.0, 0.0, 0.0)
    force: float | None = quantity(
        None, POSITIVE, "initial force towards the whole blank (none: stages move the tool) [N]"
    )
    friction: float | Field | None = quantity(
        None,
        of_place(FROM_ZERO, "xyz"),
        "friction coefficient with the blank (that of the `Interface`)",
    )
    chord: float = quantity(0.1, POSITIVE, "maximum distance of triangles from a CAD model [mm]")
    body: int | Sequence[int] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, size in (("turn", "three"), ("at", "two or three")):
            if (value := getattr(self, name)) is not None:  # a tuple, so that tools compare
                value = tuple(checked_vector(f"`{name}`", value, size=size).tolist())
                object.__setattr__(self, name, value)
        if self.body is not None:
            if not isinstance(self.surface, (str, os.PathLike)):
                raise InputError("`body` is allowed only for the `file` of a CAD model")
            object.__setattr__(self, "body", Several(COUNT).check("`body`", self.body))
        if not isinstance(self.surface, (Surface, str, os.PathLike, DieOf)):
            flaw = f"`surface` is {repr_short(self.surface)}"
            raise InputError(f"{flaw}; expected a surface, a file's name, or `DieOf` a tool")
        if self.start_distance is not None and len(self.at or ()) == 3:
            raise InputError("`start_distance` is not allowed together with z in `at`")

    @property
    def towards(self) -> np.ndarray:
        """The direction from it to the blank (3,)."""
        return np.array([0.0, 0.0, 1.0 if self.side == "below" else -1.0])


class Shape(NamedTuple):
    """A kind of surface that a press file names, with the numbers `keys`; its face is up, its
    origin at `PressTool.at`. make: its class, with the other arguments."""

    make: partial
    keys: tuple[str, ...]

    def read(self, table: Mapping[str, float], path: str, side: str) -> Surface:
        """The surface of a table at a path, turned over on a `side` above. Raises InputError."""
        if other := next((key for key in table if key not in self.keys), ""):
            raise unknown_key(other, (*self.keys, *names_of(PressTool)[1:]), f"{path}.{other}")
        needed = (p.name for p in signature(self.make).parameters.values() if p.default is p.empty)
        check_complete(table, needed, f"{path}.", f"in [{path}]")
        with located(path, ()):
            surface: Surface = self.make(**table)
        return Turned(surface, (180.0, 0.0, 0.0)) if side == "above" else surface

    def entries(self, surface: Surface, side: str) -> dict[str, float] | None:
        """The table that is read as this surface, None if there is none."""
        inner = surface.surface if side == "above" and isinstance(surface, Turned) else surface
        if type(inner) is not self.make.func:
            return None
        table = {key: np.asarray(getattr(inner, key)).tolist() for key in self.keys}
        return table if self.read(table, "", side) == surface else None


SHAPES = {
    "sphere": Shape(partial(Sphere), ("radius",)),
    "cylinder": Shape(partial(Cylinder, point=(0, 0, 0), axis=(0, 1, 0)), ("radius", "axis")),
    "plane": Shape(partial(Plane, point=(0, 0, 0), normal=(0, 0, 1)), ()),
    "torus": Shape(partial(Torus, centre=(0, 0, 0), axis=(0, 0, 1)), ("ring", "tube")),
    "plate": Shape(partial(Plate), ("length", "width", "corner", "entry")),
    "block": Shape(partial(Block), ("length", "width", "height", "radius", "corner")),
    "double_dome": Shape(partial(DoubleDome), tuple(names_of(DoubleDome))),
}
