"""The place where a blank holder acts, and the holders of a press on their places."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..mechanics.contact.coulomb import Coulomb
from ..mechanics.contact.nodes import values_at
from ..mechanics.contact.sheet_contact import SheetContact
from ..mechanics.contact.tool_contact import Contact
from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..sheets.blank import Blank
from ..tools.tool import Tool
from . import stack
from .flange import Flange
from .interface import Interface
from .laying import Laid
from .regions import EDGES, Region, Where


@dataclass(frozen=True, kw_only=True)
class HolderSite:
    """The place where a blank holder acts: what it needs to make its terms.

    Parameters
    ----------
    name
        A name for the holder's tool.
    laid, planes, share
        The blank as it is laid, the axes to which planes of symmetry are perpendicular, and the
        share of the whole blank that is modelled.
    die, up, thickness
        The tool on which the holder presses the blank, the direction (3,) towards it, and the
        thickness of all that lies between it and the holder [mm].
    interface, friction
        How tools touch the blank, and their friction.
    against
        Of a stack: the contacts of each sheet with the next.
    taken
        By holders before this one: {place: {name of a holder: where it acts there}}.

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
    laid: Laid
    planes: tuple[int, ...]
    share: float
    die: Tool
    up: np.ndarray
    thickness: float
    interface: Interface
    friction: Coulomb
    against: Sequence[SheetContact] = ()
    taken: dict[str, dict[str, Where]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

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

    def contact(self, tool: Tool, where: Where | None = None) -> Contact:
        """Contact with a tool of the holder, as that with the die; where: as in `Contact`."""
        penalty = self.interface.penalty
        return Contact(tool, penalty=penalty, friction=self.friction, where=where)

    def warn(self, *sentences: str) -> None:
        """Add these sentences to the warnings of the run."""
        self.warnings.extend(sentences)

    def on_flange(self) -> Flange:
        """Function of positions (3, n) to the share (n,) of each that is on the die's flange."""
        return Flange(self.die, self.thickness, self.up[2], self.blank.extent())

    def edges(self, names: Sequence[str]) -> Iterator[tuple[str, np.ndarray, Where]]:
        """The modelled ones of the edges: name, direction outwards (3,), and mask of points."""
        extent = self.blank.extent()
        for name in names:
            axis, end = EDGES[name]
            if end or axis not in self.planes:
                place = extent[end][axis]

                def edge(x, axis=axis, place=place):
                    return abs(x[axis] - place) < 1e-6

                yield name, (2 * end - 1) * np.eye(3)[axis], edge

    def gripped(self, name: str, edge: Where, where: Where | None) -> Where | None:
        """Where this holder acts on an edge; None if at most a corner is marked."""
        x, mask = self.laid.flat_nodes().T, self._checked(where)

        def grips(x):
            return edge(x) & mask(x)

        def nodes(mask):
            return self.blank.mesh.comm.allreduce(int(mask(x).sum()))

        if nodes(grips) <= 1:
            return None
        self._take(name, grips, nodes, 1, f"nodes of the edge {name}")
        return grips

    def pressed(self, where: Where | None) -> Where | None:
        """Function of points (3, n) to a mask (n,) of what this holder presses on the die's face
        and none before it does, None for all of it: a node at the common limit of two segments is
        the first one's. Raises InputError where they overlap by more than that."""
        blank, mask = self.laid.blanks[0], self._checked(where)
        x, flange = blank.midpoints(), self.on_flange()
        areas = np.where(flange(x) > 0, blank.areas() / self.share, 0.0)

        def area(mask):
            return blank.mesh.comm.allreduce(float(areas[mask(x)].sum()))

        others = self._take(f"face of {self.die.name}", mask, area, 0.0, "mm2 of the blank")
        if where is None and not others:
            return None
        return lambda x: np.all([mask(x), *(~other(x) for other in others)], axis=0)

    def _checked(self, where):
        """`where` of a holder, None for everywhere, as a function that checks each mask."""
        if where is None:
            return lambda x: np.ones(x.shape[1], dtype=bool)
        given, name = where.about(self.centre) if isinstance(where, Region) else where, self.path
        marked = int(values_at(given, self.laid.flat_nodes().T).sum())
        if not self.blank.mesh.comm.allreduce(marked):
            raise InputError(f"`where` of {name} marks no node; allowed is a mask true on some")
        return lambda x: values_at(given, x)

    def _take(self, place, mask, size, most, unit):
        """Note that the holder acts on a `place` where a mask is true; the masks of the holders
        before it there. Raises InputError where two overlap by more than `most`: they would act
        twice, and two plates or grippers can't be at one place; size: function of a mask."""
        earlier = self.taken.setdefault(place, {})
        others = list(earlier.values())
        for name, other in earlier.items():
            shared = size(lambda x, other=other: mask(x) & other(x))
            if shared > most:
                raise InputError(
                    f"holders.{name} and {self.path} overlap on {rounded(shared, 4)} {unit}, "
                    "where both would act; allowed are segments beside each other (`where`)"
                )
        earlier[self.name] = mask
        return others
