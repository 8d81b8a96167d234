"""Blank holders: each kind is one class, with its numbers and the terms with which it acts."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import ClassVar, Protocol

import numpy as np

from ..contact.holder_pressure import BlankHolderPressure
from ..core.errors import InputError
from ..core.fields import KnowsItsFields, check_fields, documented, quantity
from ..core.formatting import coordinates, rounded
from ..core.rules import FROM_ZERO, POSITIVE, repr_short
from ..energy.load import EdgeTension
from ..energy.springs import Springs
from ..energy.term import Term
from ..surfaces.primitives import Plane
from ..surfaces.tool import Tool
from ..surfaces.values import checked_vector
from .site import EDGES, HolderSite, Region, Where

OFF_BLANK = 0.01  # of its size, up to which a point off the blank stands for one on its edge


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


def _mask():
    """A field: function of points (3, n) [mm] to a mask (n,), in a file a table of a `Region`."""
    return field(default=None, metadata={"table": Region})


class Kind(KnowsItsFields):
    """A kind of holder of the package: a dataclass whose first field is its key in a file."""

    presses: ClassVar[bool] = True  # the blank on a die; otherwise it pulls

    def __post_init__(self) -> None:
        super().__post_init__()
        edges = getattr(self, "edges", ())
        if not isinstance(edges, (list, tuple)) or any(each not in EDGES for each in edges):
            raise InputError(
                f"`edges` is {repr_short(edges)}; allowed is a list of some of {[*EDGES]}"
            )


@documented
@dataclass(frozen=True)
class PressureHolder(Kind):
    """A pressure on what lies on the flat face of the die, a tool that does not move: a number, or
    a function of the load factor, 0 to 1 over the whole run.

    Parameters
    ----------
    where
        Function of present positions (3, n) [mm] to a mask (n,): where a segment of a holder
        presses. Segments must not overlap.
    against
        Name of the die, needed if several tools could be it.

    Examples
    --------
    >>> ff.PressureHolder(0.1, where=lambda x: x[0] > 0).pressure
    0.1
    """

    pressure: float | Callable[[float], float] = quantity(
        *(2.0, FROM_ZERO, "pressure on what lies on the flange [MPa]"),
        doubt=(10.0, "pressures are in MPa (Pa over 1e6)"),
    )
    where: Where | None = _mask()
    against: str = ""

    def __post_init__(self) -> None:
        if not callable(self.pressure):
            super().__post_init__()

    def terms(self, site: HolderSite) -> list[Term]:
        """As in `Holder`; a stack is pressed where all its sheets lie on one another."""
        if not callable(self.pressure):
            site.warn(*check_fields(self, lambda name: f"{site.path}.{name}"))
        if self.pressure == 0:
            site.warn(f"{site.path}.pressure is 0: it does not hold the rim")
        flange, where = site.on_flange(), site.pressed(self.where)
        site.warn(*site.loose_ends())
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
                "above the stack, or a holder that is a tool with a force"
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
        touches. Segments must not overlap.
    against
        As in `PressureHolder`.

    Examples
    --------
    >>> ff.ForceHolder(2e4).force
    20000.0
    """

    force: float = quantity(1e5, POSITIVE, "force on the whole ply [N]")
    where: Where | None = _mask()
    against: str = ""

    def terms(self, site: HolderSite) -> list[Term]:
        """As in `Holder`."""
        return [_plate(site, site.thickness / 2, self.where, self.force * site.share)]


@documented
@dataclass(frozen=True)
class GapHolder(Kind):
    """A plate at a fixed distance from the die, on the other side of the blank.

    Parameters
    ----------
    where, against
        As in `ForceHolder`.

    Examples
    --------
    >>> ff.GapHolder().gap is None
    True
    """

    gap: float | None = quantity(
        None, POSITIVE, "distance of holder and die (1.1 thicknesses) [mm]"
    )
    where: Where | None = _mask()
    against: str = ""

    def terms(self, site: HolderSite) -> list[Term]:
        """As in `Holder`. Raises InputError for a gap below half a thickness."""
        t = site.thickness
        gap = self.gap or 1.1 * t
        if gap < 0.5 * t:
            flaw = f"{site.path}.gap is {gap:g}, which crushes the blank"
            raise InputError(f"{flaw}; allowed is from {t / 2:g} mm, half its thickness")
        return [_plate(site, gap - t / 2, self.where)]


def _plate(site, depth, where, force=0.0):
    """Contact with a plate whose face is so far below the blank's middle, as seen from the die: it
    touches what lies on the die's flat face, since it has the die's opening."""
    flange, mask = site.on_flange(), site.pressed(where)
    push = (lambda load: force * site.up) if force else None
    tool = Tool(Plane(-depth * site.up, site.up), force=push, name=site.name)
    return site.contact(tool, lambda x: (flange(x) > 0) & (mask(x) if mask else True))


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

    Examples
    --------
    >>> ff.Grippers(3.0, edges=["low x", "high x"]).tension
    3.0
    """

    tension: float = quantity(5.0, FROM_ZERO, "pull at the edges of the ply [N/mm]")
    where: Where | None = _mask()
    edges: Sequence[str] = tuple(EDGES)
    presses: ClassVar[bool] = False

    def terms(self, site: HolderSite) -> list[Term]:
        """As in `Holder`. Raises InputError if no edge is gripped."""
        if self.tension == 0:
            site.warn(f"{site.path}.tension is 0: it does not hold the rim")
        pulls: list[Term] = []
        for name, outwards, edge in site.edges(self.edges):
            if gripped := site.gripped(name, edge, self.where):
                pulls.append(EdgeTension(self.tension, outwards, gripped))
                pulls[-1].name = f"{site.name}, {name}"
        if not pulls:
            raise InputError(f"`where` of {site.path} marks no edge; allowed is a mask of one")
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
        centroid; needed without `edges`.

    Examples
    --------
    >>> ff.SpringHolder(stiffness=0.5, preload=5, edges=["low x"]).length
    100.0
    """

    stiffness: float = quantity(None, FROM_ZERO, "of each spring, for the whole blank [N/mm]")
    preload: float = quantity(0.0, FROM_ZERO, "pull of each at the start, for the whole blank [N]")
    length: float = quantity(100.0, POSITIVE, "of each at the start [mm]")
    edges: Sequence[str] = ()
    at: Sequence[Sequence[float]] = ()
    presses: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        places = self.at if np.iterable(self.at) else [self.at]
        points = tuple(tuple(checked_vector("`at`", each, size="two").tolist()) for each in places)
        object.__setattr__(self, "at", points)  # so that holders compare
        if not (points or self.edges):
            raise InputError("a `SpringHolder` needs `edges` or points `at`")

    def terms(self, site: HolderSite) -> list[Term]:
        """As in `Holder`. Raises InputError for a point beyond a plane of symmetry."""
        planes = list(site.planes)
        springs: list[Term] = []
        for name, outwards, edge in site.edges(self.edges):
            cut = sum(not outwards[axis] for axis in planes)  # by planes across the edge
            springs.append(self._spring(site, name, edge, 0.5**cut, outwards))
        for k, place in enumerate(np.array(self.at).reshape(-1, 2), 1):
            away = place - site.centre
            if (place[planes] < 0).any() or not away.any():
                raise InputError(
                    f"{site.path}.at has the point {coordinates(place)} mm; allowed are points on "
                    "the modelled part, but the blank's centroid, from which springs pull away"
                )
            if (off := site.laid.distance(place)) > OFF_BLANK * max(site.laid.sides):
                where = f"{coordinates(place)} mm, {rounded(off)} mm off the blank"
                raise InputError(f"{site.path}.at has the point {where}; allowed are points on it")
            share, near = 0.5 ** int((place[planes] == 0).sum()), site.laid.nearest_nodes(place)
            outwards = np.append(away, 0.0) / np.linalg.norm(away)
            springs.append(self._spring(site, f"point {k}", near, share, outwards))
        return springs

    def _spring(self, site, name, where, share, direction):
        arm, name = self.length * direction, f"{site.name}, {name}"
        stiffness, preload = share * self.stiffness, share * self.preload
        return Springs(where, stiffness, preload, arm=arm, name=name)


# entry of a file -> the kind of holder that has it
HOLDERS: Mapping[str, type[Kind]] = {
    fields(kind)[0].name: kind
    for kind in (PressureHolder, ForceHolder, GapHolder, Grippers, SpringHolder)
}


def segments(name: str, given: Holder | Sequence[Holder]) -> list[Holder]:
    """The holder of this name in a press, or its segments, as a list. Raises InputError for what
    is no holder, and for an empty list."""
    holders: list = list(given) if isinstance(given, (list, tuple)) else [given]
    if not holders or not all(callable(getattr(each, "terms", None)) for each in holders):
        raise InputError(
            f"holders.{name} is {repr_short(given)}; allowed is a holder, as `PressureHolder(2.0)` "
            "or an object with a method `terms(site)`, or a list of one or more"
        )
    return holders
