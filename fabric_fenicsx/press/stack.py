"""Sheets laid on one another: the terms of each and between them."""

from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np

from ..contact.holder_pressure import BlankHolderPressure
from ..contact.sheet_contact import SheetContact
from ..contact.tool_contact import Contact
from ..energy.morley import Where
from ..energy.term import Term
from ..sheet.sheet import Sheet
from ..surfaces.tool import Tool
from .interface import Interface
from .laying import Laid

REACH_TOLERANCE = 1e-6  # mm by which a sheet reaches beyond another


def between(laid: Laid, interface: Interface, planes: Sequence[Where]) -> list[Term]:
    """Contact of each sheet with the next, and of two around smaller ones. planes: of symmetry."""
    pairs, reach = list(pairwise(laid.sheets)), _reach(laid)
    for i, j in combinations(range(len(reach)), 2):
        smaller = reach[i + 1 : j].max(0, initial=-np.inf) + REACH_TOLERANCE
        if j > i + 1 and (np.minimum(reach[i], reach[j]) > smaller).any():
            pairs.append((laid.sheets[i], laid.sheets[j]))
    return [
        SheetContact(
            lower.name,
            upper.name,
            penalty=interface.penalty,
            lag=interface.lag_of_faces,
            symmetric=planes,
            friction=interface.coulomb(lower.friction_to(upper)),
        )
        for lower, upper in pairs
    ]


def neighbours(terms: Sequence[Term], sheets: Sequence[Sheet]) -> list[SheetContact]:
    """The contacts among the terms between each sheet and the next, the lowest first."""
    contacts = {term.sheets: term for term in terms if isinstance(term, SheetContact)}
    return [contacts[lower.name, upper.name] for lower, upper in pairwise(sheets)]


def rims(laid: Laid) -> list[str]:
    """Names of the sheets that reach beyond all those below them, without the lowest one."""
    reach = _reach(laid)
    below = np.maximum.accumulate(reach)
    beyond = (reach[1:] > below[:-1] + REACH_TOLERANCE).any(1)
    return [s.name for s, reaches in zip(laid.sheets[1:], beyond) if reaches]


def _reach(laid):
    """How far each sheet reaches towards high and low x and y (sheets, 4) [mm]."""
    extents = [blank.extent() for blank in laid.blanks]
    return np.array([[*high[:2], *-low[:2]] for low, high in extents])


def press(laid: Laid, terms: Sequence[Term], die: Tool | None) -> None:
    """Press the sheets of a stack together and onto the `die`, as the present pressures of holders
    do: sheets that do not touch at first resist nothing. Metal moves up as a whole, as it would not
    bend at the flange's end; of fabric, what lies below no other sheet moves to the die, too."""
    stack, sheets = laid.blank, laid.sheets
    holders = [t for t in terms if isinstance(t, BlankHolderPressure) and t.now]
    if not (laid.stack and holders):
        return
    on_top = next(t for t in terms if isinstance(t, Contact) and t.tool is die)
    pairs, names = neighbours(terms, sheets), [sheet.name for sheet in sheets]
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
            between = np.array([[pairs[k - 1].depth_under(each.now)] for each in holders])
            lies = has_metal | laid.covers(k, places)
            rises += np.where(lies, between, sheets[k].thickness_under(0.0))
    stack.u.x.scatter_forward()
