"""How a ply is held: blank holders, which are objects, and single nodes."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from reprlib import repr as shown
from typing import Any, ClassVar, Protocol

import numpy as np

from ..mechanics.contact.coulomb import Coulomb
from ..mechanics.contact.holder_pressure import BlankHolderPressure
from ..mechanics.contact.nodes import values_at
from ..mechanics.contact.sheet_contact import SheetContact
from ..mechanics.contact.tool_contact import Contact
from ..mechanics.load import EdgeTension
from ..mechanics.springs import Springs
from ..mechanics.term import Term
from ..runtime.errors import InputError
from ..runtime.fields import check_fields, declared, number
from ..runtime.formatting import coordinates, rounded
from ..runtime.rules import FROM_ZERO, POSITIVE
from ..sheets.blank import Blank, Part
from ..sheets.stack import Stack
from ..tools.primitives import Plane
from ..tools.tool import Tool
from ..tools.values import checked_vector
from .flange import Flange
from .regions import EDGES
from .stacking import least_corner

UP = np.array([0.0, 0.0, 1.0])
FAR = 200  # mm, over which the flange is sought
GROUP = "blank holder"  # of options
# above which a run warns
PRESSURE = 10.0, "pressures are in MPa (Pa over 1e6)"

Where = Callable[[np.ndarray], np.ndarray]  # function of points (3, n) [mm] to a mask (n,)


@dataclass(frozen=True)
class Rim:
    """The rim of the blank in a forming run, as a blank holder is told of it to make its terms.

    - blank: flat, in z = 0 at the die's flange; whole: whether it is no quarter
    - die: the tool that the holder presses the blank on, by default above it, and `up` (3,) the
      direction towards it; thickness: of all that lies between die and holder [mm]
    - friction: of tools; lag: how much may lag behind the state, as in `BlankHolderPressure`
    - penalty [N/mm^3], permitted [mm]: as in `Contact`
    - name: for the holder's tool; warnings: sentences, see `warn`
    - sheets: names of a stack's sheets, the lowest first; rims: of those that reach beyond all
      sheets below them; against: contacts of each sheet with the next. All empty without a stack
    """

    blank: Blank
    whole: bool
    die: Tool
    thickness: float
    friction: Coulomb
    lag: float
    penalty: float | None
    permitted: float | None
    name: str
    warnings: list[str]
    sheets: Sequence[str] = ()
    rims: Sequence[str] = ()
    against: Sequence[SheetContact] = ()
    up: np.ndarray = field(default_factory=UP.copy)

    def contact(self, tool: Tool, where: Where | None = None) -> Contact:
        """Contact with a tool of the holder, as that with punch and die; where: as in `Contact`."""
        return Contact(
            tool,
            penalty=self.penalty,
            permitted=self.permitted,
            friction=self.friction,
            where=where,
        )

    def warn(self, *sentences: str) -> None:
        """Have the run give these warnings, each once."""
        self.warnings.extend(words for words in sentences if words not in self.warnings)

    def on_flange(self) -> Callable[[np.ndarray], np.ndarray]:
        """Function of positions (3, n) to the share of each (n,) that lies beneath the flange."""
        return Flange(self.die, self.thickness, self.up[2])


class Holder(Protocol):
    """What holds the rim of a blank. Any object with this method does."""

    def terms(self, rim: Rim) -> list[Term]:
        """The terms by which it acts on the blank, new ones each time."""


class _Declared:
    """A holder with one number, declared by a field that is also an option."""

    where: Where | None

    def __post_init__(self) -> None:
        self._check()

    def _check(self):
        return check_fields(self, f"{{}} of `{type(self).__name__}`".format)

    def _checked_where(self, rim: Rim) -> Where | None:
        """`where`, if given, as a function that checks each mask. Warns of a doubtful number;
        InputError if no node of the flat blank is marked."""
        (field,), given, blank = declared(self), self.where, rim.blank
        rim.warn(*self._check())
        if getattr(self, field.name) == 0:
            rim.warn(f"{field.name} of `{type(self).__name__}` is 0: it does not hold the rim")
        if given is None:
            return None
        name, count = f"`where` of `{type(self).__name__}`", blank.V.dofmap.index_map.size_local

        def where(x):
            return values_at(given, x, name)

        if not blank.mesh.comm.allreduce(int(where(blank.coordinates()[:count].T).sum())):
            raise InputError(f"{name} marks no node; allowed is a mask that is true on some")
        return where


@dataclass(frozen=True)
class PressureHolder(_Declared):
    """A pressure [MPa] on what lies under the die's flange; on a stack where all sheets lie on one
    another. pressure: a number, or a function of the load factor, the share of the stroke.
    where: function of present positions (3, n) [mm] to a mask (n,), for a segment of a holder.
    Where segments overlap, their pressures add up. against: in a `Press`, the name of the tool on
    which it presses the blank."""

    OPTION: ClassVar[str] = "holder_pressure"

    pressure: float | Callable[[float], float] = number(
        2.0, FROM_ZERO, "pressure on what lies on the flange [MPa]", GROUP, PRESSURE
    )
    where: Where | None = None
    against: str = ""

    def _check(self):
        return [] if callable(self.pressure) else super()._check()

    def terms(self, rim: Rim) -> list[Term]:
        """As in `Holder`."""
        flange, where = rim.on_flange(), self._checked_where(rim)
        rim.warn(*loose_ends_warnings(flange, least_corner(rim.blank)))
        pressure = BlankHolderPressure(
            self.pressure,
            rim.up,
            (lambda x: flange(x) * where(x)) if where else flange,
            tool=Tool(Plane((0, 0, 0), rim.up), name=rim.name),
            lag=rim.lag,
            against=rim.against,
            friction=rim.friction,
        )
        if not isinstance(rim.blank, Stack):
            return [pressure]
        if rim.up[2] < 0:
            raise InputError(
                f"`PressureHolder` presses a stack downwards on {rim.die.name}; allowed is a die "
                "above the stack, so the press upside down, or a holder that is a tool with a force"
            )
        # what reaches beyond the lowest ply can't sink below the holder's face
        face = Tool(Plane(-rim.thickness / 2 * rim.up, rim.up), name=f"{rim.name}'s face")
        below = [rim.contact(face, where).on(name) for name in rim.rims[:1]]
        return [pressure.on(rim.sheets[0]), *below]


@dataclass(frozen=True)
class ForceHolder(_Declared):
    """A plate that pushes the blank to the die by a force on the whole ply [N]. where: function of
    points (3, n) [mm] of the flat blank to a mask (n,), the nodes that a segment touches. A node
    that several segments touch bears the forces of all. against: as in `PressureHolder`."""

    OPTION: ClassVar[str] = "holder_force"

    force: float = number(1e5, POSITIVE, "force on the whole ply [N]", GROUP)
    where: Where | None = None
    against: str = ""

    def terms(self, rim: Rim) -> list[Term]:
        """As in `Holder`."""
        force = self.force * (1.0 if rim.whole else 0.25)
        plate = Plane(-rim.thickness / 2 * rim.up, rim.up)
        tool = Tool(plate, force=lambda load: force * rim.up, name=rim.name)
        return [rim.contact(tool, self._checked_where(rim))]


@dataclass(frozen=True)
class GapHolder(_Declared):
    """A plate on the blank's other side, at a fixed distance from the die [mm], by default 1.1
    thicknesses. where: as in `ForceHolder`; against: as in `PressureHolder`."""

    OPTION: ClassVar[str] = "holder_gap"

    gap: float | None = number(
        None, POSITIVE, "distance of holder and die (1.1 thicknesses) [mm]", GROUP
    )
    where: Where | None = None
    against: str = ""

    def terms(self, rim: Rim) -> list[Term]:
        """As in `Holder`; InputError for a gap below half a thickness."""
        t = rim.thickness
        gap = self.gap or 1.1 * t
        if gap < 0.5 * t:
            raise InputError(
                f"gap of `GapHolder` is {gap:g}, which crushes the ply; allowed is from {t / 2:g} "
                "mm, half its thickness"
            )
        plate = Plane((t / 2 - gap) * rim.up, rim.up)
        tool = Tool(plate, name=rim.name)
        return [rim.contact(tool, self._checked_where(rim))]


@dataclass(frozen=True)
class Grippers(_Declared):
    """A pull [N/mm] at the edges of a rectangular blank, outwards and within its plane. edges:
    those that are gripped (`regions.EDGES`), by default all; where: as in `ForceHolder`, parts of
    them."""

    OPTION: ClassVar[str] = "gripper_tension"

    tension: float = number(5.0, FROM_ZERO, "pull at the edges of the ply [N/mm]", GROUP)
    where: Where | None = None
    edges: Sequence[str] = tuple(EDGES)

    def terms(self, rim: Rim) -> list[Term]:
        """As in `Holder`; InputError if no edge is gripped."""
        where, ends = self._checked_where(rim), rim.blank.extent()
        named = [EDGES[name] for name in self.edges]
        edges = [
            (_edge(axis, ends[end][axis], where), (2 * end - 1) * np.eye(3)[axis])
            for axis, end in named
            if end or rim.whole
        ]
        owned = rim.blank.V.dofmap.index_map.size_local
        x, comm = rim.blank.coordinates()[:owned].T, rim.blank.mesh.comm
        # not those of which only a corner is marked
        gripped = [each for each in edges if comm.allreduce(int(each[0](x).sum())) > 1]
        if not gripped:
            raise InputError(
                "`where` of `Grippers` marks no edge; allowed is a function that is true on at "
                "least one"
            )
        return [EdgeTension(self.tension, direction, edge) for edge, direction in gripped]


@dataclass(frozen=True)
class SpringHolder:
    """Springs, each of a `stiffness` [N/mm] and `preload` [N], that pull the blank outwards to
    fixed anchors `length` [mm] from it: along each of the `edges` (`regions.EDGES`) parallel ones,
    which count as one together, and one at each of the points `at` (x, y) [mm] of the flat blank,
    away from the origin. All are of the whole blank. On a stack the sheets share each spring."""

    stiffness: float = number(None, FROM_ZERO, "of each spring [N/mm]")
    preload: float = number(0.0, FROM_ZERO, "pull of each at the start [N]")
    length: float = number(100.0, POSITIVE, "of each at the start [mm]")
    edges: Sequence[str] = ()
    at: Sequence[Sequence[float]] = ()

    def __post_init__(self) -> None:
        check_fields(self, "{} of `SpringHolder`".format)
        points = [checked_vector("at of `SpringHolder`", each, True, 2) for each in self.at]
        if not (points or self.edges):
            raise InputError("`SpringHolder` holds nothing; allowed are `edges` or points `at`")

    def terms(self, rim: Rim) -> list[Term]:
        """As in `Holder`; InputError for a point that a quarter does not have."""
        ends, parts = rim.blank.extent(), list(rim.blank.parts.values()) or [rim.blank.whole]
        half = 1.0 if rim.whole else 0.5  # of what a plane of symmetry cuts
        found = [
            (_edge(axis, ends[end][axis], None), (2 * end - 1) * np.eye(3)[axis], half, name)
            for name, (axis, end) in ((name, EDGES[name]) for name in self.edges)
            if end or rim.whole
        ]
        for k, place in enumerate(self.at, 1):
            x = np.append(np.asarray(place, dtype=float), 0.0)
            if not rim.whole and (x < 0).any():
                raise InputError(
                    f"at of `SpringHolder` has the point {coordinates(x[:2])} mm, which is not in "
                    "the quarter; allowed are x and y from 0"
                )
            share = half ** int((x[:2] == 0).sum())
            near = nearest_nodes(parts, (x[0], x[1]))
            found.append((near, x / np.linalg.norm(x), share, f"point {k}"))
        return [
            Springs(
                where,
                share * self.stiffness,
                share * self.preload,
                arm=self.length * direction,
                name=f"{rim.name}, {name}",
            )
            for where, direction, share, name in found
        ]


PULLING = Grippers, SpringHolder  # which press the blank on nothing

# by their names on the command line
HOLDERS: dict[str, type] = {
    "pressure": PressureHolder,
    "force": ForceHolder,
    "gap": GapHolder,
    "grippers": Grippers,
}


def holders_of(given: Holder | Sequence[Holder]) -> list[Holder]:
    """The holder, or its segments, that a forming run is given; InputError for others, and none."""
    holders: list[Any] = list(given) if isinstance(given, (list, tuple)) else [given]
    for each in holders or [given]:
        if not holders or isinstance(each, type) or not callable(getattr(each, "terms", None)):
            raise InputError(
                f"`holder` is {each!r}; allowed is a holder, as `PressureHolder(2.0)` or an object "
                "with a method `terms(rim)`, or a list of one or more"
            )
    return holders


def terms_of(holder: Holder, rim: Rim) -> list[Term]:
    """The terms of a holder; InputError if its `terms` does not take a `Rim`, or gives others
    than one term or more in a list."""
    name = f"`terms` of holder `{type(holder).__name__}`"
    try:
        inspect.signature(holder.terms).bind(rim)
    except TypeError as error:
        raise InputError(
            f"{name} can't be called with a `Rim` ({error}); allowed is `def terms(self, rim)`"
        ) from None
    terms: Any = holder.terms(rim)
    listed = terms if isinstance(terms, (list, tuple)) else []
    if not listed or not all(isinstance(term, Term) for term in listed):
        found = f"one `{type(terms).__name__}`" if isinstance(terms, Term) else shown(terms)
        raise InputError(f"{name} gives {found}; allowed is a list of one or more terms")
    for term in listed:
        if isinstance(term, BlankHolderPressure) and term.direction @ rim.up < 0:
            rim.warn(
                f"the pressure of holder `{type(holder).__name__}` is directed away from the die: "
                f"towards it is (0, 0, {rim.up[2]:g})"
            )
    return list(listed)


def loose_ends_warnings(under: Callable[[np.ndarray], np.ndarray], corner: np.ndarray) -> list[str]:
    """A warning if a sheet ends on the x or y axis over the die's opening, where no holder presses
    it. under: as `Flange`; corner (2,): largest x and y of the sheet [mm]."""
    loose = []
    for name, axis, end in zip("xy", np.eye(3), corner):
        held = np.flatnonzero(under(axis[:, None] * (end + np.arange(FAR))))
        if not len(held):
            loose.append(f"at {name} = {rounded(end, 4)} mm, more than {FAR} mm from the flange")
        elif held[0]:
            loose.append(f"at {name} = {rounded(end, 4)} mm, {held[0]} mm from the flange")
    return [
        f"the smallest sheet ends over the die's opening {place}: the blank holder does not press "
        "it there"
        for place in loose
    ]


def nearest_nodes(
    parts: Sequence[Part], place: tuple[float, float]
) -> Callable[[np.ndarray], np.ndarray]:
    """Function of points (3, n) to a mask (n,) of one node of each part: the nearest to `place` (x,
    y) [mm], of several the one that is last by x and y."""
    found = []
    for part in parts:
        x = part.blank.coordinates()[: len(part.nodes)][part.nodes]
        away = np.hypot(*(x[:, :2] - place).T).round(6)
        order = np.lexsort((-x[:, 1], -x[:, 0], away))[:1]
        known = [(away[k], *-x[k]) for k in order]
        found.append(min(each for rank in part.blank.mesh.comm.allgather(known) for each in rank))
    nodes = -np.array(found)[:, 1:]
    return lambda x: (np.linalg.norm(x.T[:, None] - nodes, axis=2) < 1e-6).any(1)


def _edge(axis, place, where):
    """Function of points (3, n) to whether their coordinate along `axis` is `place` [mm], and
    `where` is true."""
    return lambda x: (abs(x[axis] - place) < 1e-6) & (where(x) if where else True)
