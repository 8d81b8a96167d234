"""How a ply is held: blank holders, which are objects, and single nodes."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from ..mechanics.contact.coulomb import Coulomb
from ..mechanics.contact.holder_pressure import BlankHolderPressure
from ..mechanics.contact.sheet_contact import SheetContact
from ..mechanics.contact.tool_contact import Contact
from ..mechanics.load import EdgeTension
from ..mechanics.term import Term
from ..runtime.errors import InputError
from ..runtime.fields import check_fields, number
from ..runtime.rules import FINITE, FROM_ZERO, POSITIVE
from ..sheets.blank import Blank, Part
from ..sheets.stack import Stack
from ..tools.primitives import Plane
from ..tools.tool import Tool
from .stacking import least_corner

UP = np.array([0.0, 0.0, 1.0])
FAR = 200  # mm, over which the flange is sought
RINGS = 2.0, 4.0, 6.0  # mm about a place, in which the die must be flat for it to be held
GROUP = "blank holder"  # of options
# above which a run warns
PRESSURE = 100.0, "pressures are in MPa (Pa over 1e6)"

Where = Callable[[np.ndarray], np.ndarray]  # function of points (3, n) [mm] to a mask (n,)


@dataclass(frozen=True)
class Press:
    """What a forming run tells a blank holder, so that it can make its terms.

    - blank: flat, in z = 0 under the die's flange; whole: whether it is no quarter
    - die: the tool above the blank; thickness: of all that lies between die and holder [mm]
    - friction: of tools; lag: how much may lag behind the state, as in `BlankHolderPressure`
    - penalty [N/mm^3], permitted [mm]: as in `Contact`
    - name: for the holder's tool; warnings: sentences, to be added to
    - sheets: names of a stack's sheets, the lowest first; rims: of those that reach beyond all
      sheets below them; against: contacts of each sheet with the next. All empty without a stack
    """

    blank: Blank
    whole: bool
    die: Tool
    thickness: float
    friction: Coulomb
    lag: float
    penalty: float
    permitted: float | None
    name: str
    warnings: list[str]
    sheets: Sequence[str] = ()
    rims: Sequence[str] = ()
    against: Sequence[SheetContact] = ()

    def contact(self, tool: Tool, where: Where | None = None) -> Contact:
        """Contact with a tool of the holder, as that with punch and die; where: as in `Contact`."""
        return Contact(
            tool,
            penalty=self.penalty,
            permitted=self.permitted,
            friction=self.friction,
            where=where,
        )

    def on_flange(self) -> Callable[[np.ndarray], np.ndarray]:
        """Function of positions (n, 3) to the share of each (n,) that lies beneath the flange."""
        return on_flange(self.die, self.thickness)


class Holder(Protocol):
    """What holds the rim of a blank. Any object with this method does."""

    def terms(self, press: Press) -> list[Term]:
        """The terms by which it acts on the blank, new ones each time."""


class _Declared:
    """A holder with one number, declared by a field that is also an option."""

    def __post_init__(self) -> None:
        self._check()

    def _check(self):
        return check_fields(self, f"{{}} of `{type(self).__name__}`".format)


@dataclass(frozen=True)
class PressureHolder(_Declared):
    """A pressure [MPa] on what lies under the die's flange; on a stack where all sheets lie on one
    another. where: function of positions (3, n) [mm] to a mask (n,), for a segment of a holder."""

    OPTION: ClassVar[str] = "holder_pressure"

    pressure: float = number(
        2.0, FROM_ZERO, "pressure on what lies on the flange [MPa]", GROUP, PRESSURE
    )
    where: Where | None = None

    def terms(self, press: Press) -> list[Term]:
        """As in `Holder`."""
        flange, where = press.on_flange(), self.where
        found = [*self._check(), *loose_ends_warnings(flange, least_corner(press.blank))]
        press.warnings.extend(words for words in found if words not in press.warnings)
        pressure = BlankHolderPressure(
            self.pressure,
            UP,
            (lambda x: flange(x) * where(x.T)) if where else flange,
            tool=Tool(Plane((0, 0, 0), UP), name=press.name),
            lag=press.lag,
            against=press.against,
            friction=press.friction,
        )
        if not isinstance(press.blank, Stack):
            return [pressure]
        # what reaches beyond the lowest ply can't sink below the holder's face
        face = Tool(Plane((0, 0, -press.thickness / 2), UP), name=f"{press.name}'s face")
        below = [press.contact(face, where).on(name) for name in press.rims[:1]]
        return [pressure.on(press.sheets[0]), *below]


@dataclass(frozen=True)
class ForceHolder(_Declared):
    """A plate below the blank that is pushed up by a force on the whole ply [N]. where: function of
    points (3, n) [mm] of the flat blank to a mask (n,), the nodes that a segment touches."""

    OPTION: ClassVar[str] = "holder_force"

    force: float = number(1e5, FROM_ZERO, "force on the whole ply [N]", GROUP)
    where: Where | None = None

    def terms(self, press: Press) -> list[Term]:
        """As in `Holder`."""
        force = self.force * (1.0 if press.whole else 0.25)
        plate = Plane((0, 0, -press.thickness / 2), UP)
        tool = Tool(plate, force=lambda load: force * UP, name=press.name)
        return [press.contact(tool, self.where)]


@dataclass(frozen=True)
class GapHolder(_Declared):
    """A plate below the blank at a fixed distance from the die [mm], by default 1.1 thicknesses.
    where: as in `ForceHolder`."""

    OPTION: ClassVar[str] = "holder_gap"

    gap: float | None = number(
        None, POSITIVE, "distance of holder and die (1.1 thicknesses) [mm]", GROUP
    )
    where: Where | None = None

    def terms(self, press: Press) -> list[Term]:
        """As in `Holder`; InputError for a gap below half a thickness."""
        t = press.thickness
        gap = self.gap or 1.1 * t
        if gap < 0.5 * t:
            raise InputError(
                f"gap of `GapHolder` is {gap:g}, which crushes the ply; allowed is from {t / 2:g} "
                "mm, half its thickness"
            )
        plate = Plane((0, 0, t / 2 - gap), UP)
        return [press.contact(Tool(plate, name=press.name), self.where)]


@dataclass(frozen=True)
class Grippers(_Declared):
    """A pull [N/mm] at the edges of a rectangular blank, outwards and within its plane. where: as
    in `ForceHolder`, edges that are gripped."""

    OPTION: ClassVar[str] = "gripper_tension"

    tension: float = number(5.0, FINITE, "pull at the edges of the ply [N/mm]", GROUP)
    where: Where | None = None

    def terms(self, press: Press) -> list[Term]:
        """As in `Holder`; InputError if no edge is gripped."""
        low, high = press.blank.extent()
        edges = [
            (_edge(axis, place, self.where), sign * np.eye(3)[axis])
            for axis in (0, 1)
            for place, sign in ((low[axis], -1.0), (high[axis], 1.0))
            if sign > 0 or press.whole
        ]
        owned = press.blank.V.dofmap.index_map.size_local
        x, comm = press.blank.coordinates()[:owned].T, press.blank.mesh.comm
        # not those of which only a corner is marked
        gripped = [each for each in edges if comm.allreduce(int(each[0](x).sum())) > 1]
        if not gripped:
            raise InputError(
                "`where` of `Grippers` marks no edge; allowed is a function that is true on at "
                "least one"
            )
        return [EdgeTension(self.tension, direction, edge) for edge, direction in gripped]


# by their names on the command line
HOLDERS: dict[str, type] = {
    "pressure": PressureHolder,
    "force": ForceHolder,
    "gap": GapHolder,
    "grippers": Grippers,
}


def holders_of(given: Holder | Sequence[Holder]) -> list[Holder]:
    """The holder, or its segments, that a forming run is given; InputError for other objects."""
    holders: list[Any] = list(given) if isinstance(given, (list, tuple)) else [given]
    for each in holders:
        if isinstance(each, type) or not callable(getattr(each, "terms", None)):
            raise InputError(
                f"`holder` is {each!r}; allowed is a holder, as `PressureHolder(2.0)`, or a list "
                "of several"
            )
    return holders


def on_flange(die: Tool, thickness: float) -> Callable[[np.ndarray], np.ndarray]:
    """Function of places (n, 3) to the share of each (n,) that lies beneath the die's flange: 0 at
    its end, 1 from `RINGS` inwards. thickness: of all that lies between die and holder [mm]."""
    angles = np.arange(8) * math.pi / 4
    shifts = np.array(
        [(r * math.cos(a), r * math.sin(a), 0) for r, a in itertools.product(RINGS, angles)]
    )

    def share(x):
        at = (x * (1, 1, 0) + shifts[:, None]).reshape(-1, 3)
        gap, normal, _ = die.evaluate(at, reach=thickness)
        flat = (abs(gap - thickness / 2) < 1e-3 * thickness) & (normal[:, 2] < -0.999)
        return np.clip(2 * flat.reshape(len(shifts), -1).sum(0) / len(shifts) - 1, 0, 1)

    return share


def loose_ends_warnings(under: Callable[[np.ndarray], np.ndarray], corner: np.ndarray) -> list[str]:
    """A warning if a sheet ends on the x or y axis over the die's opening, where no holder presses
    it. under: as `on_flange` gives it; corner (2,): largest x and y of the sheet [mm]."""
    loose = []
    for name, axis, end in zip("xy", np.eye(3), corner):
        held = np.flatnonzero(under((end + np.arange(FAR))[:, None] * axis))
        if not len(held):
            loose.append(f"at {name} = {end:.4g} mm, more than {FAR} mm from the flange")
        elif held[0]:
            loose.append(f"at {name} = {end:.4g} mm, {held[0]} mm from the flange")
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
