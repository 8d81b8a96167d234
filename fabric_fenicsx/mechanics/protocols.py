"""Protocols of contact with tools and sheets, beside the methods of every `Term`.

Whoever needs it asks `isinstance(term, PROTOCOL)`: having the methods is enough. Arrays and numbers
are those of this rank's part, if nothing else is said.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from ..tools.tool import Tool


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


class Penetrated(Protocol):
    """Lets sheet and tool, or two sheets, overlap a little; by methods or `Term.outputs`."""

    def penetration_of_thickness(self) -> float:
        """Deepest overlap of sheet and tool, or of two sheets, in any accepted state, over the
        sheet's thickness, of all ranks."""

    def where_deepest(self) -> str:
        """The tool or sheet that was so deep in the sheet, and where, as text."""
