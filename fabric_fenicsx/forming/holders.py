"""Blank holders: each kind is one class, with its numbers and the terms with which it acts."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from ..material.files import Interval
from ..runtime.errors import InputError
from ..runtime.fields import KnowsItsFields, check_fields, documented, number
from ..runtime.formatting import coordinates
from ..runtime.rules import FINITE, FROM_ZERO, POSITIVE, shown, unknown_key
from ..tools.primitives import Plane
from ..tools.tool import Tool
from ..tools.values import checked_vector

if TYPE_CHECKING:
    from ..mechanics.term import Term
    from .site import HolderSite

# mechanics are imported when terms are made: a press is read without them

MAX_PRESSURE = 10.0, "pressures are in MPa (Pa over 1e6)"  # above which a run warns
# edge of a rectangle around the blank -> axis, and which end of it
EDGES = {"low x": (0, 0), "high x": (0, 1), "low y": (1, 0), "high y": (1, 1)}
LIMIT_TOLERANCE = 1e-6  # mm or deg, by which rounding may put a node beyond a limit
# name of a coordinate -> function of points (3, n) to its values (n,)
MEASURES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "x": lambda x: x[0],
    "y": lambda x: x[1],
    "r": lambda x: np.hypot(x[0], x[1]),
    "angle": lambda x: np.degrees(np.arctan2(x[1], x[0])),
}
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
            if name == "at":
                checked_vector("`where`.at", ends, size=2)
                continue
            if name not in MEASURES:
                raise unknown_key(name, (*MEASURES, "at"), f"`where`.{name}")
            Interval(FINITE).check(f"`where`.{name}", ends)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The mask (n,)."""
        inside = np.ones(x.shape[1], dtype=bool)
        arm = x[:2] - np.reshape(self.limits.get("at", (0.0, 0.0)), (2, 1))
        for name, (low, high) in ((n, ends) for n, ends in self.limits.items() if n != "at"):
            polar = name in ("r", "angle")
            over = MEASURES[name](arm if polar else x) - low + LIMIT_TOLERANCE
            over = over % 360 if name == "angle" else over
            inside &= (over >= 0) & (over <= high - low + 2 * LIMIT_TOLERANCE)
        return inside

    def about(self, centre: np.ndarray) -> Region:
        """The region with `at` (2,) [mm] unless it has its own."""
        return Region({"at": centre.tolist()} | dict(self.limits))


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


class Kind(KnowsItsFields):
    """A kind of holder of the package: a dataclass whose first field is its key in a file."""

    presses: ClassVar[bool] = True  # the blank on a die; otherwise it pulls

    @classmethod
    def key(cls) -> str:
        """The entry of a file that tells the kind."""
        return dataclasses.fields(cls)[0].name  # type: ignore[arg-type]


@documented
@dataclass(frozen=True)
class PressureHolder(Kind):
    """A pressure on what lies on the flat face of the die, a tool that does not move: a number, or
    a function of the load factor, 0 to 1 over the whole run.

    Parameters
    ----------
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
        2.0, FROM_ZERO, "pressure on what lies on the flange [MPa]", doubt=MAX_PRESSURE
    )
    where: Where | None = None
    against: str = ""

    def __post_init__(self) -> None:
        if not callable(self.pressure):
            super().__post_init__()

    def terms(self, site: HolderSite) -> list[Term]:
        """As in `Holder`; a stack is pressed where all its sheets lie on one another."""
        from ..mechanics.contact.holder_pressure import BlankHolderPressure

        if not callable(self.pressure):
            site.warn(*check_fields(self, lambda name: f"{site.path}.{name}"))
            site.warn_of_zero("pressure", self.pressure)
        flange, where = site.on_flange(), site.claim_face(self.where)
        site.warn_of_loose_ends(flange)
        pressure = BlankHolderPressure(
            self.pressure,
            site.up,
            (lambda x: flange(x) * where(x)) if where else flange,
            tool=Tool(Plane((0, 0, 0), site.up), name=site.name),
            lag=site.lag,
            against=site.against,
            friction=site.friction,
            borne=flange,
        )
        if not site.sheets:
            return [pressure]
        if site.up[2] < 0:
            raise InputError(
                f"{site.path} presses a stack downwards on {site.die.name}; allowed is a die "
                "above the stack (turn the press over), or a holder that is a tool with a force"
            )
        # sheets that reach beyond the lowest one can't sink below the holder's face
        face = Tool(Plane(-site.thickness / 2 * site.up, site.up), name=f"{site.name}'s face")
        below = [site.contact(face, where).on(name) for name in site.rims[:1]]
        return [pressure.on(site.sheets[0]), *below]


@documented
@dataclass(frozen=True)
class ForceHolder(Kind):
    """A plate that a force pushes towards the die, with the blank between them.

    Parameters
    ----------
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

    def terms(self, site: HolderSite) -> list[Term]:
        """As in `Holder`."""
        force = self.force * site.press.share
        plate = Plane(-site.thickness / 2 * site.up, site.up)
        tool = Tool(plate, force=lambda load: force * site.up, name=site.name)
        return [site.contact(tool, site.at_plate(self.where))]


@documented
@dataclass(frozen=True)
class GapHolder(Kind):
    """A plate at a fixed distance from the die, on the other side of the blank.

    Parameters
    ----------
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

    def terms(self, site: HolderSite) -> list[Term]:
        """As in `Holder`. Raises InputError for a gap below half a thickness."""
        t = site.thickness
        gap = self.gap or 1.1 * t
        if gap < 0.5 * t:
            raise InputError(
                f"{site.path}.gap is {gap:g}, which crushes the blank; allowed is from "
                f"{t / 2:g} mm, half its thickness"
            )
        tool = Tool(Plane((t / 2 - gap) * site.up, site.up), name=site.name)
        return [site.contact(tool, site.at_plate(self.where))]


@documented
@dataclass(frozen=True)
class Grippers(Kind):
    """A pull at the edges of a rectangular blank, outwards and within its plane.

    Parameters
    ----------
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
    presses: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_edges(self.edges)

    def terms(self, site: HolderSite) -> list[Term]:
        """As in `Holder`. Raises InputError if no edge is gripped."""
        from ..mechanics.load import EdgeTension

        site.warn_of_zero("tension", self.tension)
        where = site.checked(self.where)
        pulls: list[Term] = []
        for name, outwards, edge in site.edges(self.edges):
            gripped = site.claim_edge(name, edge, where)
            if gripped:
                pulls.append(EdgeTension(self.tension, outwards, gripped))
                pulls[-1].name = f"{site.name}, {name}"
        if not pulls:
            raise InputError(
                f"`where` of {site.path} marks no edge; allowed is a function that is true on at "
                "least one"
            )
        return pulls


@documented
@dataclass(frozen=True)
class SpringHolder(Kind):
    """Springs that pull the blank outwards to fixed anchors; the sheets of a stack share each.

    Parameters
    ----------
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

    stiffness: float = number(None, FROM_ZERO, "of each spring, for the whole blank [N/mm]")
    preload: float = number(0.0, FROM_ZERO, "pull of each at the start, for the whole blank [N]")
    length: float = number(100.0, POSITIVE, "of each at the start [mm]")
    edges: Sequence[str] = ()
    at: Sequence[Sequence[float]] = ()
    presses: ClassVar[bool] = False

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

    def terms(self, site: HolderSite) -> list[Term]:
        """As in `Holder`. Raises InputError for a point beyond a plane of symmetry."""
        planes = list(site.planes)
        springs: list[Term] = []
        for name, way, edge in site.edges(self.edges):
            cut = sum(not way[axis] for axis in planes)  # by planes across the edge
            springs.append(self._spring(site, name, edge, 0.5**cut, way))
        for k, place in enumerate(self.at, 1):
            x = np.append(np.asarray(place, dtype=float), 0.0)
            if beyond := " and ".join("xy"[axis] for axis in planes if x[axis] < 0):
                raise InputError(
                    f"{site.path}.at has the point {coordinates(x[:2])} mm, beyond a plane of "
                    f"symmetry; allowed is {beyond} from 0"
                )
            away = x - np.append(site.centre, 0.0)
            if not (length := np.linalg.norm(away)):
                raise InputError(
                    f"{site.path}.at has the blank's centroid, {coordinates(x[:2])} mm, from which "
                    "springs pull away; allowed are other points"
                )
            share, near = 0.5 ** int((x[planes] == 0).sum()), site.laid.nearest_nodes(x[:2])
            springs.append(self._spring(site, f"point {k}", near, share, away / length))
        return springs

    def _spring(self, site, name, where, share, direction):
        from ..mechanics.springs import Springs

        return Springs(
            where,
            share * self.stiffness,
            share * self.preload,
            arm=self.length * direction,
            name=f"{site.name}, {name}",
        )


KINDS: tuple[type[Kind], ...] = PressureHolder, ForceHolder, GapHolder, Grippers, SpringHolder


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
