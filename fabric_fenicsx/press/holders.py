"""Blank holders: each kind is one class, with its numbers and the terms with which it acts."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import ClassVar, Protocol

import numpy as np

from ..contact.holder_pressure import BlankHolderPressure, LineBead
from ..core.errors import InputError
from ..core.fields import KnowsItsFields, check_fields, documented, flag, quantity
from ..core.formatting import coordinates, rounded
from ..core.rules import FROM_ZERO, POSITIVE, repr_short
from ..energy.load import EdgeTension
from ..energy.springs import Springs
from ..energy.term import Term
from ..surfaces.primitives import Plane
from ..surfaces.surfaces import checked_vector
from ..surfaces.tool import Tool
from .site import HolderSite, Region, Where

# edge of a rectangle around the blank -> axis, and which end of it
EDGES = {"low x": (0, 0), "high x": (0, 1), "low y": (1, 0), "high y": (1, 1)}

OFF_BLANK = 0.01  # of its size, up to which a point off the blank stands for one on its edge


class Holder(Protocol):
    """Blank holder: any object with this method.

    Examples
    --------
    >>> class Cushion:
    ...     def terms(self, site):
    ...         return [ff.BlankHolderPressure(0.25, site.up, site.on_flange(), lag=site.lag)]
    >>> press = ff.Press.read("double_dome").replace(holders={"cushion": Cushion()})
    """

    def terms(self, site: HolderSite) -> list[Term]:
        """The terms with which it acts on the blank, new ones in each call."""


def _where(points):
    """A field: where a segment of a holder acts, in a file by the table of a `Region`."""
    text = f"function of {points} (3, n) [mm] to a mask (n,); segments must not overlap"
    return field(default=None, metadata={"help": text, "table": Region})


def _option(default, text):
    return field(default=default, metadata={"help": text})


class Kind(KnowsItsFields):
    """A kind of holder of the package: a dataclass whose first field is its key in a file."""

    presses: ClassVar[bool] = True  # the blank on a die; otherwise it pulls

    def __post_init__(self) -> None:
        super().__post_init__()
        edges = getattr(self, "edges", ())
        if not isinstance(edges, (list, tuple)) or any(each not in EDGES for each in edges):
            raise InputError(
                f"`edges` is {repr_short(edges)}; expected a list of some of {[*EDGES]}"
            )


@documented
@dataclass(frozen=True)
class PressureHolder(Kind):
    """A pressure on the part of the blank that lies on the flat face of a die that does not move: a
    number, or a function of the load factor, 0 to 1 over the whole run. In a stack it acts at each
    place on the sheet nearest to the holder.

    Examples
    --------
    >>> ff.PressureHolder(0.1, where=lambda x: x[0] > 0).pressure
    0.1
    """

    pressure: float | Callable[[float], float] = quantity(
        *(2.0, FROM_ZERO, "pressure on the part of the blank on the flange [MPa]"),
        doubt=(10.0, "pressures are in MPa (Pa over 1e6)"),
    )
    where: Where | None = _where("present positions")
    against: str = _option("", "name of the die, needed if several tools could be it")
    full_stack: bool = flag("only where all sheets overlap, as a rigid plate presses")

    def __post_init__(self) -> None:
        if not callable(self.pressure):
            super().__post_init__()

    def terms(self, site: HolderSite) -> list[Term]:
        if not callable(self.pressure):
            site.warn(*check_fields(self, lambda name: f"holders.{site.name}.{name}"))
        if self.pressure == 0:
            site.warn(f"holders.{site.name}.pressure is 0, so it does not hold the edge")
        flange, where = site.on_flange(), _pressed(site, self.where)
        site.warn(*_loose_ends(site))
        pressure = BlankHolderPressure(
            self.pressure,
            site.up,
            (lambda x: flange(x) * where(x)) if where else flange,
            lag=site.lag,
            full_stack=self.full_stack,
            friction=site.friction,
            borne=flange,
        )
        if site.laid.stack and site.up[2] < 0:
            raise InputError(
                f"holders.{site.name} presses a stack downwards on {site.die.name}; expected a "
                "die above the stack, or a holder that is a tool with a force"
            )
        if not (self.full_stack and site.laid.stack):
            return [pressure]
        # sheets that reach beyond the lowest one can't sink below the holder's face
        face = Tool(Plane(-site.thickness / 2 * site.up, site.up), name=f"{site.name}'s face")
        return [pressure, site.contact(face, where).on(site.laid.sheets[1].name)]


@documented
@dataclass(frozen=True)
class ForceHolder(Kind):
    """A plate that a force pushes towards the die, with the blank between them.

    Examples
    --------
    >>> ff.ForceHolder(2e4).force
    20000.0
    """

    force: float = quantity(1e5, POSITIVE, "force on the whole ply [N]")
    where: Where | None = _where("points of the flat blank")
    against: str = _option("", "name of the die, needed if several tools could be it")

    def terms(self, site: HolderSite) -> list[Term]:
        return _plate(site, site.thickness / 2, self.where, self.force * site.share)


@documented
@dataclass(frozen=True)
class GapHolder(Kind):
    """A plate at a fixed distance from the die, on the other side of the blank. When built, raises
    InputError for a gap below half a thickness.

    Examples
    --------
    >>> ff.GapHolder().gap is None
    True
    """

    gap: float | None = quantity(
        None, POSITIVE, "distance between holder and die (1.1 thicknesses) [mm]"
    )
    where: Where | None = _where("points of the flat blank")
    against: str = _option("", "name of the die, needed if several tools could be it")

    def terms(self, site: HolderSite) -> list[Term]:
        t = site.thickness
        gap = self.gap or 1.1 * t
        if gap < 0.5 * t:
            flaw = f"holders.{site.name}.gap is {gap:g}, which crushes the blank"
            raise InputError(f"{flaw}; expected from {t / 2:g} mm, half its thickness")
        return _plate(site, gap - t / 2, self.where)


@documented
@dataclass(frozen=True)
class Grippers(Kind):
    """An outward, in-plane line load at the edges of a rectangular blank. When built, raises
    InputError if no edge is gripped.

    Examples
    --------
    >>> ff.Grippers(3.0, edges=["low x", "high x"]).tension
    3.0
    """

    tension: float = quantity(5.0, FROM_ZERO, "tension at the edges of the ply [N/mm]")
    where: Where | None = _where("points of the flat blank")
    edges: Sequence[str] = _option(tuple(EDGES), "edges that are gripped")
    presses: ClassVar[bool] = False

    def terms(self, site: HolderSite) -> list[Term]:
        if self.tension == 0:
            site.warn(f"holders.{site.name}.tension is 0, so it does not hold the edge")
        pulls, x, mask = list[Term](), site.laid.flat_nodes().T, site.mask(self.where)
        nodes = np.ones(x.shape[1])
        for name, outwards, edge in _edges(site, self.edges):
            if site.total(nodes, edge(x), mask(x)) > 1:  # more than a corner
                grips = lambda x, edge=edge: edge(x) & mask(x)  # noqa: E731
                site.take(name, grips, x, nodes, f"nodes of the edge {name}", most=1)
                pulls.append(EdgeTension(self.tension, outwards, grips))
                pulls[-1].name = f"{site.name}, {name}"
        if not pulls:
            raise InputError(
                f"`where` of holders.{site.name} selects no edge; expected a mask that does"
            )
        return pulls


@documented
@dataclass(frozen=True)
class SpringHolder(Kind):
    """Springs that pull the blank outwards to fixed anchors; sheets of a stack share them. When
    built, raises InputError for a point beyond a plane of symmetry.

    Examples
    --------
    >>> ff.SpringHolder(stiffness=0.5, preload=5, edges=["low x"]).length
    100.0
    """

    stiffness: float = quantity(None, FROM_ZERO, "of each spring, for the whole blank [N/mm]")
    preload: float = quantity(0.0, FROM_ZERO, "initial force of each, for the whole blank [N]")
    length: float = quantity(100.0, POSITIVE, "initial length of each [mm]")
    edges: Sequence[str] = _option((), "edges with parallel springs, which count as one spring")
    at: Sequence[Sequence[float]] = _option(
        (),
        "points (x, y) [mm] of the flat blank with one spring each, away from its centroid, "
        "needed without `edges`",
    )
    presses: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        places = self.at if np.iterable(self.at) else [self.at]
        points = tuple(tuple(checked_vector("`at`", each, size="two").tolist()) for each in places)
        object.__setattr__(self, "at", points)  # so that holders compare
        if not (points or self.edges):
            raise InputError("a `SpringHolder` needs `edges` or points `at`")

    def terms(self, site: HolderSite) -> list[Term]:
        planes, at = [*site.planes], [*site.planes.values()]
        springs: list[Term] = []

        def add(name, where, share, outwards):
            stiffness, preload = share * self.stiffness, share * self.preload
            arm, name = self.length * outwards, f"{site.name}, {name}"
            springs.append(Springs(where, stiffness, preload, arm=arm, name=name))

        for name, outwards, edge in _edges(site, self.edges):  # cut by planes across the edge
            add(name, edge, 0.5 ** sum(not outwards[axis] for axis in planes), outwards)
        for k, place in enumerate(np.array(self.at).reshape(-1, 2), 1):
            away = place - site.centre
            if (place[planes] < at).any() or not away.any():
                raise InputError(
                    f"holders.{site.name}.at has the point {coordinates(place)} mm; expected "
                    "points on the modelled part, but the blank's centroid, from which springs "
                    "pull away"
                )
            if (off := site.laid.distance(place)) > OFF_BLANK * max(site.laid.sides):
                where = f"{coordinates(place)} mm, {rounded(off)} mm off the blank"
                flaw = f"holders.{site.name}.at has the point {where}"
                raise InputError(f"{flaw}; expected points on it")
            share, near = 0.5 ** int((place[planes] == at).sum()), site.laid.nearest_nodes(place)
            add(f"point {k}", near, share, np.append(away, 0.0) / np.linalg.norm(away))
        return springs


@documented
@dataclass(frozen=True)
class BeadHolder(Kind):
    """An equivalent drawbead on the flange of the die, see `LineBead`. When built, raises
    InputError for a line off the flange.

    Examples
    --------
    >>> ff.BeadHolder({"line": [[0, 90], [60, 90]], "restraint": 2.0}).bead["restraint"]
    2.0
    """

    bead: Mapping = _option(
        None, "`line`, two or more points (x, y) [mm], and `restraint`, force per length [N/mm]"
    )
    against: str = _option("", "name of the die, needed if several tools could be it")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.bead, Mapping) or self.bead.keys() != {"line", "restraint"}:
            flaw = f"`bead` is {repr_short(self.bead)}"
            raise InputError(f"{flaw}; expected a table of `line` and `restraint`")
        LineBead(**self.bead)  # raises what is wrong with them

    def terms(self, site: HolderSite) -> list[Term]:
        bead = LineBead(**self.bead, name=site.name, law=site.interface.coulomb(1.0))
        x = np.pad(bead.points(), ((0, 0), (0, 1)))
        x = x[(x[:, [*site.planes]] >= [*site.planes.values()]).all(1)]
        if len(off := x[site.on_flange()(x.T) == 0]):
            raise InputError(
                f"holders.{site.name}.bead leaves the flange of {site.die.name} at "
                f"{coordinates(off[0, :2])} mm; expected a line on its flat face"
            )
        return [bead]


# entry of a file -> the kind of holder that has it
HOLDERS: Mapping[str, type[Kind]] = {
    fields(kind)[0].name: kind
    for kind in (PressureHolder, ForceHolder, GapHolder, Grippers, SpringHolder, BeadHolder)
}


def segments(name: str, given: Holder | Sequence[Holder]) -> list[Holder]:
    """The holder of this name in a press, or its segments, as a list. Raises InputError for what
    is no holder, and for an empty list."""
    holders: list = list(given) if isinstance(given, (list, tuple)) else [given]
    if not holders or not all(callable(getattr(each, "terms", None)) for each in holders):
        raise InputError(
            f"holders.{name} is {repr_short(given)}; expected a holder, as `PressureHolder(2.0)` "
            "or an object with a method `terms(site)`, or a list of one or more"
        )
    return holders


def _pressed(site, where):
    """Function of points (3, n) to a mask (n,) of what a holder presses on the die's face and none
    before it does, None for all of it: a node at the common limit of two segments is the first
    one's. Raises InputError where they overlap by more than that."""
    blank, mask = site.laid.blanks[0], site.mask(where)
    x = blank.midpoints()
    areas = np.where(site.on_flange()(x) > 0, blank.areas() / site.share, 0.0)
    others = site.take(f"face of {site.die.name}", mask, x, areas, "mm2 of the blank")
    if where is None and not others:
        return None
    return lambda x: np.all([mask(x), *(~other(x) for other in others)], axis=0)


def _plate(site, depth, where, force=0.0):
    """Contact with a plate whose face is so far below the blank's middle, as seen from the die: it
    touches what lies on the die's flat face, since it has the die's opening."""
    flange, mask = site.on_flange(), _pressed(site, where)
    push = (lambda load: force * site.up) if force else None
    tool = Tool(Plane(-depth * site.up, site.up), force=push, name=site.name)
    return [site.contact(tool, lambda x: (flange(x) > 0) & (mask(x) if mask else True))]


def _edges(site: HolderSite, names: Iterable[str]) -> Iterator[tuple[str, np.ndarray, Where]]:
    """The modelled ones of the edges: name, direction outwards (3,), and mask of points."""
    for name in names:
        axis, end = EDGES[name]
        if end or axis not in site.planes:
            place = site.blank.extent()[end][axis]
            mask = lambda x, axis=axis, place=place: abs(x[axis] - place) < 1e-6  # noqa: E731
            yield name, (2 * end - 1) * np.eye(3)[axis], mask


def _loose_ends(site):
    """A sentence on each end of the smallest sheet, on the axes through the blank's centre, that
    lies over the die's opening, where no blank holder presses it."""
    extents = np.array([blank.extent() for blank in site.laid.blanks])
    flange, doubts = site.on_flange(), []
    for _, outwards, _ in _edges(site, EDGES):
        end, across = (extents @ outwards).max(1).min(), 1 - abs(outwards)
        if not flange((across * [*site.centre, 0.0] + end * outwards)[:, None])[0]:
            doubts.append(
                f"the smallest sheet ends over the die's opening at {'xy'[int(across.argmin())]} = "
                f"{rounded(float(end * outwards.sum()), 4)} mm, where the blank holder does not "
                "press it"
            )
    return doubts
