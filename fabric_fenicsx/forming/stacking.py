"""Plies laid on one another: their stack, and the terms of each and between them."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from mpi4py import MPI

from ..mechanics.contact.coulomb import Coulomb
from ..mechanics.contact.holder_pressure import BlankHolderPressure
from ..mechanics.contact.sheet_contact import SheetContact
from ..mechanics.contact.tool_contact import Contact
from ..mechanics.shell.membrane import Membrane
from ..mechanics.shell.metal import SheetMetal
from ..mechanics.shell.morley import Where
from ..mechanics.term import Term
from ..runtime.errors import InputError
from ..sheets.blank import Blank
from ..sheets.stack import Stack
from .plies import Ply


def lay(plies: Sequence[Ply], make: Callable[[Ply], Blank]) -> Stack:
    """The `Stack` of plies, the lowest first; `make` gives the blank of each.

    They lie on one another without pressure. The upper face of the last one is half of all
    thicknesses over z = 0, where the die lies. Raises InputError without any.
    """
    if not plies:
        raise InputError("`stack` has no ply; allowed are one or more")
    sheets = [(make(ply), ply.thickness_under(0.0), ply.name) for ply in plies]
    return Stack(sheets, -sum(thickness for _, thickness, _ in sheets) / 2)


def membranes(plies: Sequence[Ply]) -> list[Membrane]:
    """The membrane of each ply of fabric."""
    return [Membrane(ply.fabric).on(ply.name) for ply in plies if ply.fabric]


def metals(plies: Sequence[Ply], planes: Sequence[Where]) -> list[Term]:
    """The `SheetMetal` of each ply of metal; planes: of symmetry."""
    return [SheetMetal(ply.metal, symmetric=planes).on(ply.name) for ply in plies if ply.metal]


def between(
    stack: Stack,
    plies: Sequence[Ply],
    slip: float,
    lag: float,
    planes: Sequence[Where],
    penalty: float | None = None,
) -> list[Term]:
    """Contact with friction of each ply with the next, and of two plies with a smaller one between
    them. planes: of symmetry; slip, lag: as in `Coulomb`; penalty: as in `SheetContact`."""
    terms: list[Term] = []
    for lower, upper in _facing(stack, plies):
        names = lower.name, upper.name
        friction = Coulomb(lower.friction_to(upper), slip, lag)
        contact = SheetContact(
            *names, penalty=penalty, lag=lag, symmetric=planes, friction=friction
        )
        terms.append(contact)
    return terms


def neighbours(terms: Sequence[Term], plies: Sequence[Ply]) -> list[SheetContact]:
    """Of the terms those contacts that are of a ply and the next, the lowest first."""
    contacts = {term.sheets: term for term in terms if isinstance(term, SheetContact)}
    return [contacts[lower.name, upper.name] for lower, upper in pairwise(plies)]


def rims(stack: Stack, plies: Sequence[Ply]) -> list[str]:
    """Names of the plies that reach beyond all those below them, without the lowest one."""
    corners = np.array([sheet.blank.extent()[1][:2] for sheet in stack.sheets])
    below = np.maximum.accumulate(corners)
    beyond = (corners[1:] > below[:-1] + 1e-6).any(1)
    return [ply.name for ply, reaches in zip(plies[1:], beyond) if reaches]


def least_corner(blank: Blank) -> np.ndarray:
    """Largest x and y that all sheets of a blank reach (2,) [mm]."""
    sheets = [sheet.blank for sheet in blank.sheets] if isinstance(blank, Stack) else [blank]
    return np.min([sheet.extent()[1][:2] for sheet in sheets], axis=0)


def _facing(stack, plies):
    """Pairs of plies that may touch."""
    pairs = list(pairwise(plies))
    corner = {sheet.name: sheet.blank.extent()[1][:2] for sheet in stack.sheets}
    for lower, middle, upper in zip(plies, plies[1:], plies[2:]):
        least = np.minimum(corner[lower.name], corner[upper.name])
        if (least > corner[middle.name] + 1e-6).any():
            pairs.append((lower, upper))
    return pairs


def press(
    stack: Stack,
    pairs: Sequence[SheetContact],
    on_top: Contact,
    holders: Sequence[BlankHolderPressure],
    stiff: bool = False,
) -> None:
    """Displace the sheets towards the tool `on_top` of the last one, by as much as the holders'
    present pressures press them into it and into each other. pairs: contacts of each sheet with the
    next; stiff: whether there is metal, which goes up as a whole, as it would not bend at the
    flange's end."""
    names, comm = [sheet.name for sheet in stack.sheets], stack.mesh.comm
    on_it = stack.parts[names[-1]].nodes
    rises = np.zeros((len(holders), 1))
    for k, each in enumerate(holders):
        depth = float(on_top.depth_under(each.now)[on_it].max(initial=0.0))
        rises[k] = comm.allreduce(depth, MPI.MAX)
    places = stack.coordinates()[: len(on_it)].T
    shares = np.array([each.shares(places) for each in holders])
    if stiff:
        shares[:] = 1 / len(holders)
    u = stack.u.x.array.reshape(-1, 3)
    for k, name in reversed(list(enumerate(names))):
        at = np.flatnonzero(stack.parts[name].nodes)
        u[at, 2] = (shares[:, at] * rises).sum(0)
        if k:
            rises += [[pairs[k - 1].depth_under(each.now)] for each in holders]
    stack.u.x.scatter_forward()
