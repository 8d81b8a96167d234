"""A term of a scene: an energy or a load on its sheet."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np
import ufl
from petsc4py import PETSc

from ..runtime.errors import InputError
from ..sheets.blank import Blank, Part

Triplets = tuple[np.ndarray, np.ndarray, np.ndarray]  # rows, columns and values of a sparse matrix
NO_TANGENT: Triplets = (np.empty(0, PETSc.IntType), np.empty(0, PETSc.IntType), np.empty(0))


class SceneFacts(Protocol):
    """What a scene tells its terms: its blank, and the terms on it, the one that asks among
    them."""

    blank: Blank

    @property
    def terms(self) -> Sequence[Term]:
        """In the order in which they were given."""


class Term:
    """An energy or a load on the scene's sheet.

    An own term overrides what it needs of this class. Whatever else a term can do, as holding
    something during a solve, telling fields or keeping a memory, is a role: it has the methods of
    one of the Protocols in `mechanics.roles`, and so is asked for them.

    Arrays and numbers are those of this rank's part, if nothing else is said. Degrees of freedom
    are those of `blank.u`: components along the axes of the blank's frame.

    - name: what summaries and errors call it
    - energy_kind: under which its energy is added up: KIND_energy_Nmm in history.csv, KIND in the
      `energy` of summary.json; None for loads. Only the sum of a kind is told, as "strain" of
      several membranes; so an own term has a kind of its own, unless its energy is to be counted
      among that of others. The package's kinds are strain, bending, contact, friction, metal and
      plastic
    - resists: rigid motions of the sheet that it may resist: "move" and "turn", or only those out
      of its plane, "lift", or within it, "slide"; "stretch" if it alone can hold the sheet
      together, though it is no form. Motions that neither supports nor terms hold are refused
    - energy: a UFL form in `blank.u`, integrated over the sheet by `self.part.dx(degree)` or over
      an edge by `self.part.ds(edge, degree)` [N mm]; for a load, minus its work. None if the term
      is no form: it then has `stored`, `add_forces` and `tangent`
    - pattern: a number that changes when the places of `tangent` do
    - blank: the sheet, known in `set_up`; `blank.mesh.comm` is the MPI communicator, and
      `blank.V.dofmap.index_map` numbers the nodes; part: what of it the term is on; part_name: its
      name, see `on`
    - given: what the attributes were before `set_up`, as plain data; a checkpoint must agree in it
    - outputs: {method: function of the term}, for methods of roles that give output but are written
      beside the class
    - unbound: the term as it was then, of which another scene may take a copy
    """

    name = "term"
    energy_kind: str | None = None
    resists: tuple[str, ...] = ()
    energy: ufl.Form | None = None
    pattern = 0
    outputs: Mapping[str, Callable[[Any], Any]] = {}
    blank: Blank
    part: Part
    part_name = ""
    given: dict[str, Any]
    unbound: Self
    # weak, as circles of solver objects end at another time on each rank
    bound_to: weakref.ref[SceneFacts] | None = None

    if not TYPE_CHECKING:

        def __getattr__(self, name):
            when = ", which is known in `set_up`" if name in ("blank", "part") else ""
            raise AttributeError(f"{type(self).__name__} has no attribute `{name}`{when}")

    def on(self, part: str) -> Self:
        """Restrict the term to a part of the blank: a sheet of a stack, or a patch; itself.
        InputError for what is no name, and where it is on a part already."""
        if self.part_name or not (isinstance(part, str) and part):
            raise InputError(
                f"term {self.name} is put on {part!r}; allowed is the name of one part, once"
            )
        self.part_name = part
        self.name = f"{self.name} of {part}"
        return self

    def set_up(self, scene: SceneFacts) -> None:
        """Make what needs the sheet; `blank` and `part` are known."""

    def stored(self) -> float:
        """Energy that is no form [N mm]; for a load, minus its work."""
        return 0.0

    def add_forces(self, f: np.ndarray) -> None:
        """Add the derivative of `stored` to f (local dofs,), ghosts included [N]."""

    def tangent(self) -> Triplets:
        """Second derivative of `stored` [N/mm]: rows, columns (k,), GLOBAL degrees of freedom, the
        same ones as long as `pattern` is the same, and values (k,), to be summed."""
        return NO_TANGENT

    def set_load(self, load: float) -> None:
        """Set the load factor, and go back to the last accepted state in all else."""

    def accept(self) -> None:
        """Take the present state as the last accepted one."""

    def work(self) -> float:
        """Work of a load or tool since the last accepted state [N mm]."""
        return 0.0
