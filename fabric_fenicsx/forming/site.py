"""The place where a blank holder acts, and the holders of a press on their places."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..mechanics.contact.coulomb import Coulomb
from ..mechanics.contact.holder_pressure import BlankHolderPressure
from ..mechanics.contact.nodes import values_at
from ..mechanics.contact.sheet_contact import SheetContact
from ..mechanics.contact.tool_contact import Contact
from ..mechanics.term import Term
from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..runtime.rules import unknown_key
from ..sheets.blank import Blank
from ..tools.tool import Tool
from . import stack
from .flange import Flange
from .holders import EDGES, Holder, Region, Where, holders_of
from .interface import Interface
from .laying import Laid
from .placement import Placed
from .press import Press

MAX_OPENING = 200  # mm, within which the flange is looked for from the blank's edge


@dataclass(frozen=True)
class HolderSite:
    """The place where a blank holder acts: what it needs to make its terms.

    Parameters
    ----------
    name
        A name for the holder's tool.
    press, laid
        The press, and its blank as it is laid.
    die
        The tool on which the holder presses the blank.
    between
        Of a stack: the contacts of its sheets.
    warnings
        Those of the run, see `warn`.
    claims
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
    press: Press
    laid: Laid
    die: Tool
    between: Sequence[Term]
    warnings: list[str]
    claims: list[tuple[str, str, Where]]

    @property
    def path(self) -> str:
        """Of the holder, in messages."""
        return f"holders.{self.name}"

    @property
    def blank(self) -> Blank:
        """The flat blank, in z = 0."""
        return self.laid.blank

    @property
    def centre(self) -> np.ndarray:
        """The whole blank's centroid (2,) [mm]."""
        return self.laid.centre

    @property
    def planes(self) -> tuple[int, ...]:
        """Axes to which the planes of symmetry are perpendicular."""
        return self.press.planes

    @property
    def up(self) -> np.ndarray:
        """The direction (3,) towards the die."""
        return -self.press.tools[self.die.name].towards

    @property
    def thickness(self) -> float:
        """Thickness of all that lies between die and holder [mm]."""
        return self.press.thickness()

    @property
    def interface(self) -> Interface:
        """How tools touch the blank."""
        return self.press.interface

    @property
    def friction(self) -> Coulomb:
        """The friction of tools."""
        return self.interface.on_tools(self.laid.sheets)

    @property
    def lag(self) -> float:
        """Share of areas and normal forces, by which these may lag behind the state."""
        return self.interface.lag

    @property
    def sheets(self) -> list[str]:
        """Names of the sheets of a stack, the lowest first."""
        return [sheet.name for sheet in self.laid.sheets] if self.laid.stack else []

    @property
    def rims(self) -> list[str]:
        """Names of the sheets of a stack that reach beyond all sheets below them."""
        return stack.rims(self.laid.stack, self.laid.sheets) if self.laid.stack else []

    @property
    def against(self) -> list[SheetContact]:
        """The contacts of each sheet of a stack with the next."""
        return stack.neighbours(self.between, self.laid.sheets) if self.laid.stack else []

    def contact(self, tool: Tool, where: Where | None = None) -> Contact:
        """Contact with a tool of the holder, as that with the die; where: as in `Contact`."""
        penalty = self.interface.penalty
        return Contact(tool, penalty=penalty, friction=self.friction, where=where)

    def warn(self, *sentences: str) -> None:
        """Add these sentences to the warnings of the run, each once."""
        self.warnings.extend(words for words in sentences if words not in self.warnings)

    def warn_of_zero(self, field: str, value: float) -> None:
        """Warn of a holder that does not hold."""
        if value == 0:
            self.warn(f"{self.path}.{field} is 0: it does not hold the rim")

    def warn_of_loose_ends(self, flange: Flange) -> None:
        """Warn of each end of the smallest sheet, on the axes through its centre, that lies over
        the die's opening, where no holder presses it."""
        low, high = (np.array(end) for end in zip(*(each.extent() for each in self.laid.blanks)))
        ends = [(axis, 1, high[:, axis].min()) for axis in (0, 1)]
        # there is no low end where a plane of symmetry is
        ends += [(axis, -1, low[:, axis].max()) for axis in (0, 1) if axis not in self.planes]
        for axis, way, end in ends:
            x = np.append(self.centre, 0.0)[:, None] + np.zeros(MAX_OPENING)
            x[axis] = end + way * np.arange(MAX_OPENING)
            pressed = np.flatnonzero(flange(x))
            if len(pressed) and not pressed[0]:
                continue
            away = f"{pressed[0]} mm" if len(pressed) else f"more than {MAX_OPENING} mm"
            self.warn(
                f"the smallest sheet ends over the die's opening at {'xy'[axis]} = "
                f"{rounded(end, 4)} mm, {away} from the flange: the blank holder does not press it "
                "there"
            )

    def on_flange(self) -> Flange:
        """Function of positions (3, n) to the share (n,) of each that is on the die's flange."""
        return Flange(self.die, self.thickness, self.up[2], self.blank.extent())

    def edges(self, names: Sequence[str]) -> list[tuple[str, np.ndarray, Where]]:
        """The modelled ones of the edges: name, direction outwards (3,), and mask of points."""
        extent, edges = self.blank.extent(), list[tuple[str, np.ndarray, Where]]()
        for name in names:
            axis, end = EDGES[name]
            place = extent[end][axis]
            if end or axis not in self.planes:

                def edge(x, axis=axis, place=place):
                    return abs(x[axis] - place) < 1e-6

                edges.append((name, (2 * end - 1) * np.eye(3)[axis], edge))
        return edges

    def checked(self, where: Where | None) -> Where | None:
        """`where` of a holder, if given, as a function that checks each mask. Raises InputError if
        no node of the flat blank is marked."""
        if where is None:
            return None
        given = where.about(self.centre) if isinstance(where, Region) else where
        x, name = self.laid.flat_nodes().T, f"`where` of {self.path}"

        def mask(x):
            return values_at(given, x)

        if not self.blank.mesh.comm.allreduce(int(mask(x).sum())):
            raise InputError(f"{name} marks no node; allowed is a mask that is true on some")
        return mask

    def claim_edge(self, name: str, edge: Where, where: Where | None) -> Where | None:
        """Where a gripper acts on an edge, None if at most a corner is marked."""
        x, comm = self.laid.flat_nodes().T, self.blank.mesh.comm

        def gripped(x):
            return edge(x) & (where(x) if where else True)

        if comm.allreduce(int(gripped(x).sum())) <= 1:
            return None
        both = lambda other: int((gripped(x) & other(x)).sum())  # noqa: E731
        self._claim(name, gripped, both, 1, f"nodes of the edge {name}")
        return gripped

    def claim_face(self, where: Where | None) -> Where | None:
        """Function of points (3, n) to a mask (n,) of what this holder presses and none before it
        does, None for all: a node at the common limit of two segments is the first one's. Raises
        InputError where they overlap by more than that."""
        given, flange, blank = self.checked(where), self.on_flange(), self.laid.blanks[0]
        x, areas = blank.midpoints(), blank.areas() / self.press.share
        mask = given or (lambda x: np.ones(x.shape[1], dtype=bool))

        def overlap(other):
            return float(areas[mask(x) & other(x) & (flange(x) > 0)].sum())

        place = f"the face of {self.die.name}"
        if others := self._claim(place, mask, overlap, 0.0, "mm2 of the blank"):
            return lambda x: mask(x) & ~np.any([other(x) for other in others], axis=0)
        return given

    def at_plate(self, where: Where | None) -> Where:
        """Function of points of the flat blank to whether a plate touches them: on the die's flat
        face, since the plate has the die's opening, and where its segment is."""
        flange, mask = self.on_flange(), self.claim_face(where)
        return lambda x: (flange(x) > 0) & (mask(x) if mask else True)

    def _claim(self, place, where, overlap, most, unit):
        """Note that the holder acts on a `place` where a function says so; the functions of the
        holders before it there. Raises InputError where two overlap by more than `most`: they would
        act twice, and two plates or grippers can't be at one place; overlap: function of another
        holder's function to this rank's share of it."""
        earlier = {name: other for name, at, other in self.claims if at == place}
        for name, other in earlier.items():
            shared = self.blank.mesh.comm.allreduce(overlap(other))
            if shared > most:
                raise InputError(
                    f"holders.{name} and {self.path} overlap on {rounded(shared, 4)} {unit}, "
                    "where both would act; allowed are segments beside each other (`where`)"
                )
        self.claims.append((self.name, place, where))
        return list(earlier.values())


def hold(
    press: Press, laid: Laid, placed: Placed, between: Sequence[Term], warnings: list[str]
) -> tuple[dict[str, list[Term]], Tool | None]:
    """{name of a holder or segment: its terms}, and the last tool on which one presses."""
    held, claims, on_die = dict[str, list[Term]](), list[tuple[str, str, Where]](), None
    holder: Any
    for name, given in press.holders.items():
        for k, holder in enumerate(holders_of(name, given)):
            segment = name if k == 0 else f"{name} {k + 1}"
            die = _die_of(segment, holder, press, laid, placed)
            site = HolderSite(segment, press, laid, die, between, warnings, claims)
            if segment in press.pressures() and not placed.schedule.is_constant(segment):
                holder = dataclasses.replace(holder, pressure=placed.schedule.pressure(segment))
            held[segment] = _terms_of(holder, site)
            on_die = die if getattr(holder, "presses", True) else on_die
            for term in held[segment]:
                if isinstance(term, BlankHolderPressure) and term.direction @ site.up < 0:
                    site.warn(
                        f"the pressure of {segment} is directed away from the die: towards it is "
                        f"(0, 0, {site.up[2]:g})"
                    )
    return held, on_die


def _terms_of(holder, site):
    """The terms of a holder. Pressures without a tool of their own get its name."""
    terms = holder.terms(site)
    if not isinstance(terms, (list, tuple)) or not all(isinstance(each, Term) for each in terms):
        kind = type(terms).__name__
        raise InputError(f"{site.path}: `terms` returns {kind}; allowed is a list of terms")
    unnamed = [term.tool for term in terms if term.tool and term.tool.name == term.name]
    for k, tool in enumerate(unnamed, 1):
        tool.name = site.name if len(unnamed) == 1 else f"{site.name}, {k}"
    return list(terms)


def _die_of(name: str, holder: Holder, press: Press, laid: Laid, placed: Placed) -> Tool:
    """The tool on which a holder presses the blank."""
    tools, path = placed.tools, f"holders.{name}"
    asked = getattr(holder, "against", "")
    if asked and asked not in tools:
        raise unknown_key(asked, tools, f"{path}.against {asked}")
    still = [n for n in tools if not placed.schedule.is_moved(n)]
    if asked and asked not in still:
        raise InputError(
            f"{path}.against is {asked}, which moves; allowed is a tool that stands still, or "
            "a holder that is a tool with a force"
        )
    flat = [n for n in ([asked] if asked else still) if _is_flat(tools[n], press, laid)]
    if not getattr(holder, "presses", True):
        return tools[(flat or list(tools))[0]]
    if not flat:
        which = f"{asked} has" if asked else "no tool that stands still has"
        raise InputError(
            f"{path} has nothing to press the blank on: {which} a flat face on it; allowed is "
            "a tool with one, or a holder that is a tool with a force"
        )
    if len(flat) > 1:
        raise InputError(
            f"{path} needs `against`, the name of the tool that it presses the blank on: "
            f"{' or '.join(flat)}"
        )
    return tools[flat[0]]


def _is_flat(tool, press, laid):
    up = -press.tools[tool.name].towards[2]
    share = Flange(tool, press.thickness(), up, laid.blank.extent())(laid.flat_nodes().T)
    return bool(laid.blank.mesh.comm.allreduce(int((share > 0).sum())))
