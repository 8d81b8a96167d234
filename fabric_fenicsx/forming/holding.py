"""The terms with which blank holders act on a blank."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..mechanics.contact.coulomb import Coulomb
from ..mechanics.contact.holder_pressure import BlankHolderPressure
from ..mechanics.contact.nodes import values_at
from ..mechanics.contact.sheet_contact import SheetContact
from ..mechanics.contact.tool_contact import Contact
from ..mechanics.load import EdgeTension
from ..mechanics.springs import Springs
from ..mechanics.term import Term
from ..runtime.errors import InputError
from ..runtime.fields import declared
from ..runtime.formatting import coordinates, rounded
from ..sheets.blank import Blank, Part
from ..sheets.stack import Stack
from ..tools.primitives import Plane
from ..tools.tool import Tool
from .flange import Flange
from .holders import (
    EDGES,
    ForceHolder,
    GapHolder,
    Grippers,
    Holder,
    PressureHolder,
    Region,
    SpringHolder,
    Where,
)
from .interface import Interface
from .stack import ends_of_all

FAR = 200  # mm, within which the flange is looked for


@dataclass(frozen=True)
class HolderSite:
    """The place where a blank holder acts: what it needs to make its terms.

    Parameters
    ----------
    name
        A name for the holder's tool.
    blank, centre, whole
        The flat blank in z = 0; the whole blank's centroid (2,) [mm]; False if only a quarter of it
        is modelled.
    die, up, thickness
        The tool on which the holder presses the blank, the direction (3,) towards it, and the
        thickness of all that lies between die and holder [mm].
    interface, friction
        How tools touch the blank, and the friction of tools.
    sheets, rims, against
        For a stack: names of its sheets, the lowest first; names of those that reach beyond all
        sheets below them; the contacts of each sheet with the next.
    warnings
        Those of the run, see `warn`.
    taken
        Of holders before this one: name, place, and function of points (3, n) to a mask (n,) of
        where they act there.

    Examples
    --------
    >>> class Cushion:
    ...     def terms(self, site):
    ...         return [ff.BlankHolderPressure(0.1, site.up, site.on_flange(), lag=site.lag)]
    >>> press = ff.Press.read("hemisphere").replace(holders={"rim": Cushion()})
    >>> [*press.holders]
    ['rim']
    """

    name: str
    blank: Blank
    centre: np.ndarray
    whole: bool
    die: Tool
    up: np.ndarray
    thickness: float
    interface: Interface
    friction: Coulomb
    warnings: list[str]
    sheets: Sequence[str] = ()
    rims: Sequence[str] = ()
    against: Sequence[SheetContact] = ()
    taken: list[tuple[str, str, Where]] = field(default_factory=list)

    @property
    def lag(self) -> float:
        """Share of areas and normal forces, by which these may lag behind the state."""
        return self.interface.lag

    def contact(self, tool: Tool, where: Where | None = None) -> Contact:
        """Contact with a tool of the holder, as that with the die; where: as in `Contact`."""
        return self.interface.contact(tool, self.friction, where)

    def warn(self, *sentences: str) -> None:
        """Add these sentences to the warnings of the run, each once."""
        self.warnings.extend(words for words in sentences if words not in self.warnings)

    def on_flange(self) -> Callable[[np.ndarray], np.ndarray]:
        """Function of positions (3, n) to the share (n,) of each that is on the die's flange."""
        return Flange(self.die, self.thickness, self.up[2], self.blank.extent())


def holder_terms(holder: Holder, site: HolderSite) -> list[Term]:
    """The terms of a holder."""
    listed = list(holder.terms(site))
    for term in listed:
        if isinstance(term, BlankHolderPressure) and term.direction @ site.up < 0:
            site.warn(
                f"the pressure of {site.name} is directed away from the die: towards it is "
                f"(0, 0, {site.up[2]:g})"
            )
    return list(listed)


@singledispatch
def terms_of(holder: Any, site: HolderSite) -> list[Term]:
    """The terms of a holder of the package."""
    raise NotImplementedError


@terms_of.register
def _pressure(holder: PressureHolder, site: HolderSite) -> list[Term]:
    """Terms of a `PressureHolder`; it presses a stack where all sheets lie on one another."""
    flange, where = site.on_flange(), _own_place(holder, site)
    site.warn(*loose_ends_warnings(flange, site))
    pressure = BlankHolderPressure(
        holder.pressure,
        site.up,
        (lambda x: flange(x) * where(x)) if where else flange,
        tool=Tool(Plane((0, 0, 0), site.up), name=site.name),
        lag=site.lag,
        against=site.against,
        friction=site.friction,
    )
    if not isinstance(site.blank, Stack):
        return [pressure]
    if site.up[2] < 0:
        raise InputError(
            f"holders.{site.name} presses a stack downwards on {site.die.name}; allowed is a die "
            "above the stack (turn the press over), or a holder that is a tool with a force"
        )
    # sheets that reach beyond the lowest one can't sink below the holder's face
    face = Tool(Plane(-site.thickness / 2 * site.up, site.up), name=f"{site.name}'s face")
    below = [site.contact(face, where).on(name) for name in site.rims[:1]]
    return [pressure.on(site.sheets[0]), *below]


@terms_of.register
def _force(holder: ForceHolder, site: HolderSite) -> list[Term]:
    """Terms of a `ForceHolder`."""
    force = holder.force * (1.0 if site.whole else 0.25)
    plate = Plane(-site.thickness / 2 * site.up, site.up)
    tool = Tool(plate, force=lambda load: force * site.up, name=site.name)
    return [site.contact(tool, _at_plate(holder, site))]


@terms_of.register
def _gap(holder: GapHolder, site: HolderSite) -> list[Term]:
    """Terms of a `GapHolder`. Raises InputError for a gap below half a thickness."""
    t = site.thickness
    gap = holder.gap or 1.1 * t
    if gap < 0.5 * t:
        raise InputError(
            f"holders.{site.name}.gap is {gap:g}, which crushes the blank; allowed is from "
            f"{t / 2:g} mm, half its thickness"
        )
    tool = Tool(Plane((t / 2 - gap) * site.up, site.up), name=site.name)
    return [site.contact(tool, _at_plate(holder, site))]


@terms_of.register
def _gripper(holder: Grippers, site: HolderSite) -> list[Term]:
    """Terms of `Grippers`. Raises InputError if no edge is gripped."""
    where, ends = _checked_where(holder, site), site.blank.extent()
    owned = site.blank.V.dofmap.index_map.size_local
    x, comm = site.blank.coordinates()[:owned].T, site.blank.mesh.comm
    gripped: list[Term] = []
    for name in holder.edges:
        axis, end = EDGES[name]
        edge = _edge(axis, ends[end][axis], where)
        # not edges of which only a corner is marked
        if (end or site.whole) and comm.allreduce(int(edge(x).sum())) > 1:
            both = lambda other, edge=edge: int((edge(x) & other(x)).sum())  # noqa: E731
            _claim(site, name, edge, both, 1, f"nodes of the edge {name}")
            pull = EdgeTension(holder.tension, (2 * end - 1) * np.eye(3)[axis], edge)
            pull.name = f"{site.name}, {name}"
            gripped.append(pull)
    if not gripped:
        raise InputError(
            f"`where` of holders.{site.name} marks no edge; allowed is a function that is true on "
            "at least one"
        )
    return gripped


@terms_of.register
def _spring(holder: SpringHolder, site: HolderSite) -> list[Term]:
    """Terms of a `SpringHolder`. Raises InputError for a point that is not in the quarter."""
    ends, parts = site.blank.extent(), list(site.blank.parts.values()) or [site.blank.whole]
    half = 1.0 if site.whole else 0.5  # share of a spring in a plane of symmetry
    found = [
        (_edge(axis, ends[end][axis], None), (2 * end - 1) * np.eye(3)[axis], half, name)
        for name, (axis, end) in ((name, EDGES[name]) for name in holder.edges)
        if end or site.whole
    ]
    for k, place in enumerate(holder.at, 1):
        x = np.append(np.asarray(place, dtype=float), 0.0)
        if not site.whole and (x < 0).any():
            raise InputError(
                f"holders.{site.name}.at has the point {coordinates(x[:2])} mm, which is not in "
                "the quarter; allowed are x and y from 0"
            )
        share = half ** int((x[:2] == 0).sum())
        near = nearest_nodes(parts, (x[0], x[1]))
        away = x - np.append(site.centre, 0.0)
        if not (length := np.linalg.norm(away)):
            raise InputError(
                f"holders.{site.name}.at has the blank's centroid, {coordinates(x[:2])} mm, from "
                "which springs pull away; allowed are other points"
            )
        found.append((near, away / length, share, f"point {k}"))
    return [
        Springs(
            where,
            share * holder.stiffness,
            share * holder.preload,
            arm=holder.length * direction,
            name=f"{site.name}, {name}",
        )
        for where, direction, share, name in found
    ]


def _at_plate(holder, site):
    """Function of points of the flat blank to whether a plate touches them: on the die's flat face,
    since the plate has the die's opening, and where its segment is."""
    flange, where = site.on_flange(), _own_place(holder, site)
    return lambda x: (flange(x) > 0) & (where(x) if where else True)


def _own_place(holder, site):
    """Function of points (3, n) to a mask (n,) of what this holder presses and none before it does,
    None for all: a node at the common limit of two segments is the first one's. Raises InputError
    where they overlap by more than that."""
    given, flange = _checked_where(holder, site), site.on_flange()
    blank = site.blank.sheets[0].blank if isinstance(site.blank, Stack) else site.blank
    x, areas = blank.midpoints(), blank.areas() * (1 if site.whole else 4)
    where = given or (lambda x: np.ones(x.shape[1], dtype=bool))

    def overlap(other):
        return float(areas[where(x) & other(x) & (flange(x) > 0)].sum())

    place, unit = f"the face of {site.die.name}", "mm2 of the blank"
    if others := _claim(site, place, where, overlap, 0.0, unit):
        return lambda x: where(x) & ~np.any([other(x) for other in others], axis=0)
    return given


def _claim(site, place, where, overlap, allowed, unit):
    """Note that a holder acts on a `place` where a function says so; those of the holders before it
    there. Raises InputError where two overlap by more than `allowed`, as they would act twice and
    two plates or grippers can't be at one place; overlap: function of another holder's function to
    this rank's share of it."""
    earlier = {name: other for name, at, other in site.taken if at == place}
    for name, other in earlier.items():
        shared = site.blank.mesh.comm.allreduce(overlap(other))
        if shared > allowed:
            raise InputError(
                f"holders.{name} and holders.{site.name} overlap on {rounded(shared, 4)} {unit}, "
                "where both would act; allowed are segments beside each other (`where`)"
            )
    site.taken.append((site.name, place, where))
    return list(earlier.values())


def _checked_where(holder: Any, site: HolderSite) -> Where | None:
    """`where` of a holder, if given, as a function that checks each mask. Warns of doubtful
    numbers. Raises InputError if no node of the flat blank is marked."""
    (field, *_), given, blank = declared(holder), holder.where, site.blank
    if isinstance(given, Region):
        given = given.about(site.centre)
    site.warn(
        *(
            words.replace("`", f"holders.{site.name}.", 1).replace("`", "")
            for words in holder.doubts()
        )
    )
    if getattr(holder, field.name) == 0:
        site.warn(f"holders.{site.name}.{field.name} is 0: it does not hold the rim")
    if given is None:
        return None
    name, count = f"`where` of holders.{site.name}", blank.V.dofmap.index_map.size_local

    def where(x):
        return values_at(given, x)

    if not blank.mesh.comm.allreduce(int(where(blank.coordinates()[:count].T).sum())):
        raise InputError(f"{name} marks no node; allowed is a mask that is true on some")
    return where


def loose_ends_warnings(under: Callable[[np.ndarray], np.ndarray], site: HolderSite) -> list[str]:
    """A warning for each end of the smallest sheet, on the axes through its centre, that lies over
    the die's opening, where no holder presses it; under: as `Flange`."""
    loose = []
    for axis, name, way, end in ends_of_all(site.blank, site.whole):
        x = np.append(site.centre, 0.0)[:, None] + np.zeros(FAR)
        x[axis] = end + way * np.arange(FAR)
        pressed = np.flatnonzero(under(x))
        if not len(pressed):
            loose.append(f"at {name} = {rounded(end, 4)} mm, more than {FAR} mm from the flange")
        elif pressed[0]:
            loose.append(f"at {name} = {rounded(end, 4)} mm, {pressed[0]} mm from the flange")
    return [
        f"the smallest sheet ends over the die's opening {place}: the blank holder does not press "
        "it there"
        for place in loose
    ]


def nearest_nodes(parts: Sequence[Part], place: ArrayLike) -> Callable[[np.ndarray], np.ndarray]:
    """Function of points (3, n) to a mask (n,) of one node of each part: the nearest to `place` (x,
    y) [mm]; of equally near ones the one with the largest x, then y."""
    found = []
    for part in parts:
        x = part.blank.coordinates()[: len(part.nodes)][part.nodes]
        away = np.hypot(*(x[:, :2] - np.asarray(place)).T).round(6)
        order = np.lexsort((-x[:, 1], -x[:, 0], away))[:1]
        known = [(away[k], *-x[k]) for k in order]
        found.append(min(each for rank in part.blank.mesh.comm.allgather(known) for each in rank))
    nodes = -np.array(found)[:, 1:]
    return lambda x: (np.linalg.norm(x.T[:, None] - nodes, axis=2) < 1e-6).any(1)


def _edge(axis, place, where):
    """Function of points (3, n) to whether their coordinate along `axis` is `place` [mm] and
    `where` is True."""
    return lambda x: (abs(x[axis] - place) < 1e-6) & (where(x) if where else True)
