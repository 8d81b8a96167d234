"""How sheets and tools touch: friction, how stiff the faces are, and the sheets of a stack."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..contact.coulomb import Coulomb
from ..contact.holder_pressure import BlankHolderPressure, lying
from ..contact.sheet_contact import SheetContact
from ..contact.tool_contact import Contact
from ..core.fields import KnowsItsFields, documented, flag, quantity
from ..core.rules import FROM_ZERO, POSITIVE
from ..energy.morley import Where
from ..energy.term import Term
from ..io.field import Field, of_place
from ..sheet.sheet import Sheet
from ..surfaces.tool import Tool
from .laying import Laid


@documented
@dataclass(frozen=True, kw_only=True)
class Interface(KnowsItsFields):
    """Contact of sheets with tools and with each other.

    Coefficients may be a `Field` of the place x, y, z where a tool is touched, in its initial
    first; of sheets on sheets see `Sheet.friction`. Forces between sheets may lag more. `penalty`
    makes faces of fabric rigid.

    Examples
    --------
    >>> ff.Interface(friction=0.2).metal_friction
    0.1
    """

    friction: float | Field = quantity(
        0.25, of_place(FROM_ZERO, "xyz"), "friction coefficient between fabric and tools"
    )
    metal_friction: float | Field = quantity(
        0.1, of_place(FROM_ZERO, "xyz"), "friction coefficient between metal and tools", "tools"
    )
    slip: float | None = quantity(
        None, POSITIVE, "elastic slip of sticking sheets, by default computed for each pair [mm]"
    )
    lag: float = quantity(
        0.0005,
        POSITIVE,
        "share of normal forces, and of areas under the holder, by which forces may lag",
    )
    penalty: float | None = quantity(
        None, POSITIVE, "contact stiffness of rigid faces (by default fabric is compacted) [N/mm^3]"
    )
    self: bool = flag("contact of each sheet with itself where a fold closes")

    @property
    def is_rigid(self) -> bool:
        """Whether fabric keeps its thickness under pressure."""
        return bool(self.penalty)

    @property
    def lag_of_faces(self) -> float:
        """Share of the forces between sheets by which those of their faces may differ: laminates
        do not settle with as little as friction allows."""
        return 20 * self.lag

    def coulomb(self, coefficient: float | Field | Mapping[str, float | Field]) -> Coulomb:
        """Friction with this coefficient, or with one for each sheet {name: coefficient}."""
        return Coulomb(coefficient, self.slip, self.lag)

    def on_tools(self, sheets: Sequence[Sheet]) -> Coulomb:
        """Friction of the sheets on tools; for each sheet separately if one is of metal."""
        if not any(sheet.metal for sheet in sheets):
            return self.coulomb(self.friction)
        if len(sheets) == 1:
            return self.coulomb(self.metal_friction)
        by_kind = {True: self.metal_friction, False: self.friction}
        return self.coulomb({sheet.name: by_kind[bool(sheet.metal)] for sheet in sheets})

    def between(self, laid: Laid, planes: Sequence[Where]) -> list[Term]:
        """Contact of each sheet with the next, and around smaller ones. planes: of symmetry."""
        extents, contacts = [blank.extent() for blank in laid.blanks], list[Term]()
        # how far each sheet reaches towards high and low x and y (sheets, 4) [mm]
        reach = np.array([[*high[:2], *-low[:2]] for low, high in extents])
        options: dict = {"penalty": self.penalty, "lag": self.lag_of_faces, "symmetric": planes}
        for i, j in sorted(combinations(range(len(reach)), 2), key=lambda pair: pair[1] - pair[0]):
            smaller = reach[i + 1 : j].max(0, initial=-np.inf) + 1e-6
            if j == i + 1 or (np.minimum(reach[i], reach[j]) > smaller).any():
                lower, upper = laid.sheets[i], laid.sheets[j]
                friction = self.coulomb(lower.friction_to(upper))
                contacts.append(SheetContact(lower.name, upper.name, friction=friction, **options))
        return contacts


def press_together(laid: Laid, terms: Sequence[Term], die: Tool | None) -> None:
    """Press the sheets of a stack together and onto the `die`, as the present pressures of holders
    do: sheets that do not touch at first resist nothing. Metal moves up as a whole, as it would not
    bend at the flange's end; of fabric, what lies below no other sheet moves to the die, too."""
    stack, sheets = laid.blank, laid.sheets
    holders = [t for t in terms if isinstance(t, BlankHolderPressure) and t.now]
    if not (laid.stack and holders):
        return
    on_top = next(t for t in terms if isinstance(t, Contact) and t.tool is die)
    names = [sheet.name for sheet in sheets]
    contacts = {term.sheets: term for term in terms if isinstance(term, SheetContact)}
    on_it = stack.parts[names[-1]].nodes
    depths = [on_top.depth_under(each.now)[on_it].max(initial=0.0) for each in holders]
    places = stack.coordinates()[: len(on_it)].T
    rises = np.tile(np.max(stack.mesh.comm.allgather(depths), axis=0)[:, None], len(on_it))
    shares = np.array([each.shares(places) for each in holders])
    if has_metal := any(sheet.metal for sheet in sheets):
        shares[:] = 1 / len(holders)
    u = stack.u.x.array.reshape(-1, 3)
    for k, name in reversed([*enumerate(names)]):
        at = np.flatnonzero(stack.parts[name].nodes)
        u[at, 2] = (shares * rises)[:, at].sum(0)
        if k:
            next_below = contacts[names[k - 1], name]
            between = np.array([[next_below.depth_under(each.now)] for each in holders])
            cells = stack.mesh.comm.allgather(laid.blanks[k].corners()[..., :2])
            lies = has_metal | lying(np.concatenate(cells), places[:2].T)
            rises += np.where(lies, between, sheets[k].thickness_under(0.0))
    stack.u.x.scatter_forward()
