"""Roles that a term may have beside those of every `Term`.

Who needs one asks `isinstance(term, ROLE)`: a term has a role as soon as it has its methods and
attributes. Arrays and numbers are those of this rank's part, if nothing else is said.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
import ufl
from ufl.core.expr import Expr

from ..material.laws.base import Material
from ..tools.tool import Tool

# -- energy, forces and stiffness


@runtime_checkable
class Varied(Protocol):
    """Has derivatives of its `energy` that are cheaper than those that UFL finds."""

    def variations(self, v: Expr, w: Expr) -> tuple[ufl.Form, ufl.Form]:
        """First variation of `energy` in v, and second in v and w (UFL arguments)."""


@runtime_checkable
class StoresKinds(Protocol):
    """Stores energies of several kinds. A run then asks neither `stored` nor, unless the term also
    has a form, `energy_kind`."""

    def energies(self) -> dict[str | None, float]:
        """{kind: N mm}, always the same kinds on all ranks; None: minus the work of a load."""


@runtime_checkable
class Loaded(Protocol):
    """Knows forces beside which a residual is to be small. A load that is a form does without."""

    def applied_forces(self) -> np.ndarray:
        """(owned dofs,) [N]."""


@runtime_checkable
class Anticipates(Protocol):
    """Makes its next `tangent` fit the forces that are out of balance."""

    def anticipate(self, f: np.ndarray) -> None:
        """See the residual f (owned dofs,) [N] before `tangent` is asked for a correction."""


@runtime_checkable
class KeepsGaps(Protocol):
    """Can tell where a step may begin: with nodes as deep in a tool as they were before it."""

    def motion_to_gaps(self) -> np.ndarray:
        """Motion of the nodes from where they are, (owned dofs,) [mm]. After it, nodes that were
        pressed in the last accepted state are as deep in the tool as then, and no others are in
        it."""


@runtime_checkable
class DrivenByForce(Protocol):
    """Has a tool that may be moved by force, which makes the sheet softer."""

    def compliance(self) -> tuple[np.ndarray, float] | None:
        """c (owned dofs,) and k [N/mm], by which the tool takes c c^T / k from the tangent; None
        for a tool on a path."""


# -- load steps


@runtime_checkable
class Lagged(Protocol):
    """Holds something during a solve as it was before. Solutions are loose until that settles."""

    def update_lagged(self) -> bool:
        """After a solve: update what was held, if that is off by more than allowed; whether it
        was, so that the solve must be repeated. The same on all ranks."""


@runtime_checkable
class Remembers(Protocol):
    """Has a memory at nodes, which a checkpoint must keep."""

    def memory(self) -> dict[str, np.ndarray]:
        """What accepted states left, {name: array (owned nodes, k)}."""

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Take back what `memory` and `cell_memory` gave, at the displacement and load of then."""


@runtime_checkable
class RemembersCells(Protocol):
    """Has a memory in cells, which a checkpoint must keep."""

    def cell_memory(self) -> dict[str, np.ndarray]:
        """What accepted states left, {name: array (owned cells, k)}, by names that `memory` does
        not use."""

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """As in `Remembers`."""


# -- tools and materials


@runtime_checkable
class Pressing(Protocol):
    """Acts on the sheet by a tool."""

    tool: Tool

    def tool_force(self) -> np.ndarray:
        """Force of the tool on the sheet in the last accepted state, of all ranks, (3,) [N]."""


@runtime_checkable
class Touching(Pressing, Protocol):
    """Keeps the sheet off the tool's surface."""

    def check_start(self) -> None:
        """Raise InputError, on all ranks, if at load 0 the sheet or the tool is where no run can
        begin."""

    def may_press(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Points (k, 3) of the undeformed sheet [mm] and the tool's normals (k, 3) there, at the
        start and at full load."""


@runtime_checkable
class Rubbing(Protocol):
    """Holds points of the sheet by friction of a tool."""

    def rubbed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points of the undeformed sheet (k, 3) [mm], unit normals (k, 3) there, and the friction
        that each can bear in the accepted state, (k,) [N]."""


@runtime_checkable
class MadeOf(Protocol):
    """Knows what its part of the sheet is made of."""

    @property
    def made_of(self) -> Material:
        """A fabric or a metal."""


# -- output of a state, on all ranks; values as in `mechanics.output`


class GivesOutput(Protocol):
    """Has some of these methods, or functions of the term of these names in its `outputs`."""

    def history(self) -> Mapping[str, Any]:
        """Columns of history.csv, {column: number}, the same columns each time."""

    def summary(self) -> Mapping[str, Any]:
        """Entries of summary.json, {entry: what JSON can hold}, also at load 0."""

    def cell_fields(self) -> Mapping[str, Any]:
        """Fields on cells, {field: array (owned cells, ...)}."""

    def nodal_fields(self) -> Mapping[str, Any]:
        """Fields at nodes, {field: array (owned nodes,) or (owned nodes, k)}."""

    def warnings(self) -> list[str]:
        """Sentences on what speaks against a state though nothing failed."""

    def penetration_of_thickness(self) -> float:
        """Deepest overlap of sheet and tool, or of two sheets, in any accepted state, over the
        sheet's thickness, of all ranks."""

    def where_deepest(self) -> str:
        """Name and place of that overlap, in words."""


@runtime_checkable
class Strained(Protocol):
    """Knows how far yarns are stretched and shortened."""

    def overstretched(self, strain: float) -> float:
        """Share of the area, 0 to 1, in which yarns are stretched by more than the nominal
        `strain`, of all ranks."""

    def shortened(self, strain: float) -> float:
        """As `overstretched`, in which they are shortened by more."""


@runtime_checkable
class Prestressed(Protocol):
    """May have stress in the sheet as it lies, before load."""

    prestressed: bool
