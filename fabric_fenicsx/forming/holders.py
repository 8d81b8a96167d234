"""Blank holders: objects that make the terms with which they act on the blank."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..material.files import Interval
from ..runtime.errors import InputError
from ..runtime.fields import check_fields, number
from ..runtime.rules import FINITE, FROM_ZERO, POSITIVE, shown, unknown_key
from ..tools.values import checked_vector

if TYPE_CHECKING:
    from ..mechanics.term import Term
    from .holding import HolderSite

# above which a run warns
PRESSURE = 10.0, "pressures are in MPa (Pa over 1e6)"
# edge of a rectangle around the blank -> axis, and which end of it
EDGES = {"low x": (0, 0), "high x": (0, 1), "low y": (1, 0), "high y": (1, 1)}
SAME = 1e-6  # mm or deg, by which rounding may put a node beyond a limit
# name of a coordinate -> function of points (3, n) to its values (n,)
MEASURES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "x": lambda x: x[0],
    "y": lambda x: x[1],
    "r": lambda x: np.hypot(x[0], x[1]),
    "angle": lambda x: np.degrees(np.arctan2(x[1], x[0])),
}
POLAR, AT = ("r", "angle"), "at"  # coordinates about a point, and the limit that names it
Where = Callable[[np.ndarray], np.ndarray]  # function of points (3, n) [mm] to a mask (n,)


@dataclass(frozen=True)
class Region:
    """Function of points (3, n) [mm] to a mask (n,), True where they lie within all `limits`.

    limits: {name: (low, high)} of x, y [mm], and of r [mm] and angle (to x) [deg], polar
    coordinates about the point `at` (x, y), by default the blank's centroid when a holder is built.
    Raises InputError for others.
    """

    limits: Mapping[str, Sequence[float]]

    def __post_init__(self) -> None:
        if not isinstance(self.limits, Mapping) or not self.limits:
            raise InputError(f"`where` is {shown(self.limits)}; allowed is a table, as x = [0, 50]")
        for name, ends in self.limits.items():
            if name == AT:
                checked_vector(f"`where`.{AT}", ends, size=2)
                continue
            if name not in MEASURES:
                raise unknown_key(name, (*MEASURES, AT), f"`where`.{name}")
            Interval(FINITE).check(f"`where`.{name}", ends)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The mask (n,)."""
        inside = np.ones(x.shape[1], dtype=bool)
        arm = x[:2] - np.reshape(self.limits.get(AT, (0.0, 0.0)), (2, 1))
        for name, (low, high) in ((n, ends) for n, ends in self.limits.items() if n != AT):
            over = MEASURES[name](arm if name in POLAR else x) - low + SAME
            over = over % 360 if name == "angle" else over
            inside &= (over >= 0) & (over <= high - low + 2 * SAME)
        return inside

    def about(self, centre: np.ndarray) -> Region:
        """The region with `at` (2,) [mm] unless it has its own."""
        return Region({AT: centre.tolist()} | dict(self.limits))


class Holder(Protocol):
    """What holds the rim of a blank: any object with this method.

    Examples
    --------
    >>> class Cushion:
    ...     def terms(self, site):
    ...         up = (0, 0, 1)
    ...         return [ff.BlankHolderPressure(0.25, up, site.on_flange(), lag=site.lag)]
    >>> press = ff.Press.read("double_dome").replace(holders={"cushion": Cushion()})
    """

    def terms(self, site: HolderSite) -> list[Term]:
        """The terms with which it acts on the blank, new ones in each call."""


class _Checked:
    """A holder of the package: its numbers are checked when it is made."""

    def __post_init__(self) -> None:
        self.doubts()

    def doubts(self) -> list[str]:
        """Warnings of numbers that seem to be in another unit."""
        return check_fields(self)

    def terms(self, site: HolderSite) -> list[Term]:
        """As in `Holder`."""
        from . import holding

        return holding.terms_of(self, site)


@dataclass(frozen=True)
class PressureHolder(_Checked):
    """A pressure on what lies on the flat face of the die, a tool that does not move.

    Parameters
    ----------
    pressure
        Number [MPa], or function of the load factor, 0 to 1 over the whole run.
    where
        Function of present positions (3, n) [mm] to a mask (n,): where a segment of a holder
        presses.
    against
        Name of the die, needed if several tools could be it.

    Raises
    ------
    InputError
        For a pressure below 0; when built, for segments that overlap.

    Examples
    --------
    >>> ff.PressureHolder(0.1, where=lambda x: x[0] > 0).pressure
    0.1
    """

    pressure: float | Callable[[float], float] = number(
        2.0, FROM_ZERO, "pressure on what lies on the flange [MPa]", doubt=PRESSURE
    )
    where: Where | None = None
    against: str = ""

    def doubts(self) -> list[str]:
        """As in `_Checked`; a function is not checked."""
        return [] if callable(self.pressure) else super().doubts()


@dataclass(frozen=True)
class ForceHolder(_Checked):
    """A plate that a force pushes towards the die, with the blank between them.

    Parameters
    ----------
    force
        On the whole blank [N].
    where
        Function of points (3, n) [mm] of the flat blank to a mask (n,): the nodes that a segment
        touches.
    against
        As in `PressureHolder`.

    Raises
    ------
    InputError
        For a force that is not above 0; when built, for segments that overlap.

    Examples
    --------
    >>> ff.ForceHolder(2e4).force
    20000.0
    """

    force: float = number(1e5, POSITIVE, "force on the whole ply [N]")
    where: Where | None = None
    against: str = ""


@dataclass(frozen=True)
class GapHolder(_Checked):
    """A plate at a fixed distance from the die, on the other side of the blank.

    Parameters
    ----------
    gap
        Distance from the die [mm], by default 1.1 thicknesses.
    where, against
        As in `ForceHolder`.

    Raises
    ------
    InputError
        For a gap that is not above 0; when built, for one below half a thickness and for segments
        that overlap.

    Examples
    --------
    >>> ff.GapHolder().gap is None
    True
    """

    gap: float | None = number(None, POSITIVE, "distance of holder and die (1.1 thicknesses) [mm]")
    where: Where | None = None
    against: str = ""


@dataclass(frozen=True)
class Grippers(_Checked):
    """A pull at the edges of a rectangular blank, outwards and within its plane.

    Parameters
    ----------
    tension
        Pull per length of the edge [N/mm].
    where
        Function of points (3, n) [mm] of the flat blank to a mask (n,): parts of the edges.
    edges
        The edges that are gripped, some of "low x", "high x", "low y", "high y"; by default all.

    Raises
    ------
    InputError
        For a pull below 0 and edges of other names; when built, if no edge is gripped.

    Examples
    --------
    >>> ff.Grippers(3.0, edges=["low x", "high x"]).tension
    3.0
    """

    tension: float = number(5.0, FROM_ZERO, "pull at the edges of the ply [N/mm]")
    where: Where | None = None
    edges: Sequence[str] = tuple(EDGES)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_edges(self.edges)


@dataclass(frozen=True)
class SpringHolder(_Checked):
    """Springs that pull the blank outwards to fixed anchors; the sheets of a stack share each.

    Parameters
    ----------
    stiffness, preload
        Of each spring [N/mm], and its pull at the start [N], both for the whole blank.
    length
        Of each spring at the start [mm].
    edges
        Edges with parallel springs, which together count as one spring; named as in `Grippers`.
    at
        Points (x, y) [mm] of the flat blank with one spring each, which pulls away from the blank's
        centroid.

    Raises
    ------
    InputError
        For numbers out of range, and without edges and points.

    Examples
    --------
    >>> ff.SpringHolder(stiffness=0.5, preload=5, edges=["low x"]).length
    100.0
    """

    stiffness: float = number(None, FROM_ZERO, "of each spring [N/mm]")
    preload: float = number(0.0, FROM_ZERO, "pull of each at the start [N]")
    length: float = number(100.0, POSITIVE, "of each at the start [mm]")
    edges: Sequence[str] = ()
    at: Sequence[Sequence[float]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        check_edges(self.edges)
        if not isinstance(self.at, (list, tuple, np.ndarray)):
            raise InputError(f"`at` is {shown(self.at)}; allowed is a list of points (x, y)")
        for each in self.at:
            checked_vector("`at`", each, size=2)
        points = tuple(tuple(np.asarray(each).tolist()) for each in self.at)
        object.__setattr__(self, "at", points)  # as lists and arrays, so that holders compare
        if not (self.at or self.edges):
            raise InputError("a `SpringHolder` needs `edges` or points `at`")


PULLING = Grippers, SpringHolder  # holders that do not press the blank on a die


def check_edges(names: Any) -> None:
    """Raise InputError unless `names` is a list of some of `EDGES`."""
    if not isinstance(names, (list, tuple)) or any(each not in EDGES for each in names):
        raise InputError(f"`edges` is {shown(names)}; allowed is a list of some of {[*EDGES]}")


def holders_of(name: str, given: Holder | Sequence[Holder]) -> list[Holder]:
    """The holder of this name in a press, or its segments, as a list. Raises InputError for what
    is no holder, and for an empty list."""
    holders: list[Any] = list(given) if isinstance(given, (list, tuple)) else [given]
    for each in holders or [given]:
        if not holders or isinstance(each, type) or not callable(getattr(each, "terms", None)):
            raise InputError(
                f"holders.{name} is {shown(each)}; allowed is a holder, as `PressureHolder(2.0)` "
                "or an object with a method `terms(site)`, or a list of one or more"
            )
    return holders
