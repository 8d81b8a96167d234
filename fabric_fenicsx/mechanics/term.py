"""What a term of a scene may do: a base class whose methods do nothing."""

import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np
import ufl
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc
from ufl.core.expr import Expr

from .. import dolfinx_compat as compat
from ..material.laws import Law
from ..material.laws.base import Material
from ..runtime.errors import InputError
from ..sheets.blank import Blank, Part
from .given import of_term
from .term_checks import check_form, check_words, one_number

if TYPE_CHECKING:
    from ..tools.tool import Tool

Triplets = tuple[np.ndarray, np.ndarray, np.ndarray]  # rows, columns and values of a sparse matrix
EMPTY = np.empty(0)
NO_TANGENT: Triplets = (np.empty(0, PETSc.IntType), np.empty(0, PETSc.IntType), EMPTY)


class SceneFacts(Protocol):
    """What a scene tells its terms."""

    blank: Blank

    @property
    def terms(self) -> Sequence["Term"]:
        """Those on the sheet, this one among them."""

    @property
    def fabric(self) -> Law | None:
        """What the sheet is made of, if one of the terms knows; of several the first."""

    def fabric_of(self, part: Part) -> Law | None:
        """The fabric of a part of the blank, if a term on it, or on all of the blank, knows."""

    def material_of(self, part: Part) -> Material | None:
        """The same of a part of fabric or of metal."""

    def at_nodes(self, of: Callable[[Material], float]) -> float | np.ndarray | None:
        """A number of the material: one, or where parts differ one for each owned node (nodes,);
        None if it is not known of each part."""


class Term:
    """A term of a scene: an energy or a load, on the scene's sheet.

    An own term overrides what it needs. The scene asks every term for everything, so what a term
    returns here is all that solver, history.csv, summary and fields ever know of it. Arrays and
    numbers are those of this rank's part, if nothing else is said. Degrees of freedom are those
    of `blank.u`: components along the axes of the blank's frame.

    - name: what summaries and errors call it
    - energy_kind: under which its energy is added up: KIND_energy_Nmm in history.csv, KIND in the
      `energy` of summary.json; None of loads. Of terms with the same kind only the sum is told, as
      "strain" of several membranes; so an own term has a kind of its own, unless its energy is to
      be counted among that of others. The package's own kinds are strain, bending, contact and
      friction, and of metal metal and plastic
    - resists: rigid motions of the sheet that it may resist: "move" and "turn", or only those out
      of its plane, "lift", or within it, "slide"; "stretch" if it alone can hold the sheet
      together, though it is no form. Motions that neither supports nor terms hold are refused
    - fabric: what the sheet is made of, if this is the term that knows
    - units: of the arrays that it adds to fields, {name: unit}
    - prestressed: whether the sheet has stress as it lies, before load
    - energy: a UFL form in `blank.u`, integrated over the sheet by `self.part.dx(degree)` or over
      an edge by `self.part.ds(edge, degree)` [N mm], minus the work of a load; None of terms that
      are no form, which have `stored`, `add_forces` and `tangent` instead
    - blank: the sheet, from `set_up` on; part: what of it the term is on; given: what the
      attributes were before, as plain data, in which a checkpoint must agree
    - part_name: of the blank's part that it is restricted to, see `on`
    - pattern: a number that changes when the places of `tangent` do
    - rough: tolerance of solves as long as `update_lagged` still takes something anew; 0: that
      which is asked of the state
    """

    name = "term"
    energy_kind: str | None = None
    resists: tuple[str, ...] = ()
    fabric: Law | None = None
    units: Mapping[str, str] = {}
    prestressed: bool = False
    energy: ufl.Form | None = None
    blank: Blank
    part: Part
    given: dict[str, Any]
    pattern = 0
    rough = 0.0
    part_name: str = ""
    # weak, as circles of solver objects end at another time on each rank
    _scene: weakref.ref | None = None
    _of_load: Any = None  # first variation, compiled

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

    def bind(self, scene: SceneFacts) -> None:
        """Tell the term its scene, once; `set_up` then does the rest.

        Raises InputError for a term that is in another scene or twice in this one, for a part that
        the blank does not have, and what `set_up` raises.
        """
        known = self._scene
        if known is not None:
            if known() is not scene:
                raise InputError(
                    f"term {self.name} is in another scene already; "
                    "allowed is a term in one scene, so each scene needs its own"
                )
            return
        check_words(self)
        if sum(term is self for term in scene.terms) > 1:
            raise InputError(
                f"term {self.name} is in the scene twice; allowed is a term once, so two that act "
                "alike are two objects"
            )
        self.given = of_term(self)
        self._scene, self.blank = weakref.ref(scene), scene.blank
        self.part = scene.blank.part(self.part_name)
        try:
            self.set_up(scene)
        except Exception as error:
            gdim = scene.blank.mesh.geometry.dim
            if "nsupported dtype" in str(error):  # DOLFINx's words
                raise InputError(
                    f"term {self.name} holds a number in `fem.Constant` that is no float; allowed "
                    "is `fem.Constant(self.blank.mesh, float(k))`"
                ) from error
            if gdim == 3 or "out of bounds" not in str(error) and "out of range" not in str(error):
                raise
            raise InputError(
                f"term {self.name} asks for more than the {gdim} components that vectors have on "
                "a sheet in its plane; allowed are these, or a blank made with `spatial=True`"
            ) from error
        check_form(self)
        if self.part_name and self.energy is not None:
            everywhere = [i for i in self.energy.integrals() if i.subdomain_id() == "everywhere"]
            if everywhere:
                raise InputError(
                    f"term {self.name} is on a part, but its energy is integrated over the whole "
                    "sheet; allowed is `self.part.dx(degree)` in place of `ufl.dx`"
                )
        own = type(self)
        forces = own.add_forces is not Term.add_forces
        if self.energy is None and not forces:
            raise InputError(
                f"term {self.name} has neither an energy nor forces; allowed is `self.energy` in "
                "`set_up`, or `add_forces`"
            )
        stores = self.energy is not None and own.work is Term.work  # otherwise a load
        if self.energy_kind is None and (stores or own.stored is not Term.stored):
            raise InputError(
                f"term {self.name} stores an energy that has no name; allowed is an `energy_kind`, "
                "its column in history.csv, or `work`, and `potential` for `stored`, of a load"
            )

    def set_up(self, scene: SceneFacts) -> None:
        """Make what needs the sheet; `blank` is known."""

    @property
    def made_of(self) -> Material | None:
        """Fabric or metal of the sheet, if this is the term that knows."""
        return self.fabric

    # -- energy, forces [N] and stiffness [N/mm]

    def variations(self, v: Expr, w: Expr) -> tuple[ufl.Form, ufl.Form]:
        """First variation of `energy` in v, and second in v and w (UFL arguments)."""
        first = ufl.derivative(self.energy, self.blank.u, v)
        return first, ufl.derivative(first, self.blank.u, w)

    def stored(self) -> float:
        """Energy that is no form [N mm]."""
        return 0.0

    def stored_by_kind(self) -> dict[str, float]:
        """`stored` by kinds, the same ones on all ranks, {kind: N mm}: of `energy_kind` alone, if a
        term does not tell more."""
        return {self.energy_kind: one_number(self, "stored")} if self.energy_kind else {}

    def potential(self) -> float:
        """Of loads that are no form: minus their work [N mm]."""
        return 0.0

    def add_forces(self, f: np.ndarray) -> None:
        """Add the derivative of `stored` and `potential` to f (local dofs,), ghosts included."""

    def tangent(self) -> Triplets:
        """Second derivative of `stored` and `potential`: rows, columns (k,), GLOBAL degrees of
        freedom, the same ones as long as `pattern` is the same, and values (k,), to be summed."""
        return NO_TANGENT

    def anticipate(self, f: np.ndarray) -> None:
        """See the residual f (owned dofs,) before `tangent` is asked for the next correction."""

    def compliance(self) -> tuple[np.ndarray, float] | None:
        """Of a tool moved by force: c (owned dofs,) and k, by which it takes c c^T / k from the
        tangent."""
        return None

    def applied_forces(self) -> np.ndarray:
        """Forces (owned dofs,), beside which a residual is to be small: those of a load that is a
        form, if a term does not tell others [N]."""
        if self.energy is None or self.energy_kind is not None:
            return EMPTY
        if self._of_load is None:
            v, w = ufl.TestFunction(self.blank.V), ufl.TrialFunction(self.blank.V)
            self._of_load = compat.form(self.variations(v, w)[0])
        f = fem_petsc.assemble_vector(self._of_load)
        f.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        return -f.array

    # -- load steps

    def check_start(self) -> None:
        """Raise InputError, on all ranks, if at load 0 the sheet or a tool is where no run can
        begin."""

    def may_press(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of tools without friction: points (k, 3) of the undeformed sheet [mm] and the tool's
        normals (k, 3) there, at the start and at full load."""
        return []

    def at(self, load: float) -> None:
        """Set the load factor, and go back to the last accepted state in all else."""

    def update_lagged(self) -> bool:
        """After a solve: update what was held during it, if that is off by more than allowed;
        whether it was, so that the solve must be repeated. The same on all ranks."""
        return False

    def accept(self) -> None:
        """Take the present state as the last accepted one."""

    def work(self) -> float:
        """Work of a load or tool since the last accepted state [N mm]."""
        return 0.0

    def memory(self) -> dict[str, np.ndarray]:
        """What accepted states left, {name: array (owned nodes, k)}, for a checkpoint."""
        return {}

    def cell_memory(self) -> dict[str, np.ndarray]:
        """The same of cells, {name: array (owned cells, k)}, with names of its own."""
        return {}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Take back what `memory` and `cell_memory` gave, at the displacement and load of then."""

    # -- results

    def material(self) -> str:
        """What the sheet is made of, if this term knows, as a material file's text."""
        return self.made_of.dumps() if self.made_of is not None else ""

    def add_history(self, row: dict[str, Any]) -> None:
        """Add columns to a row of history.csv, the same ones each time, of all ranks; their names
        must be none that the row has without terms. `row` holds the columns of the terms before
        it: a term that gives one of them anew must have read it, as
        `row[name] = max(value, row.get(name, 0.0))` does; otherwise the run ends in InputError."""

    def add_summary(self, summary: dict[str, Any]) -> None:
        """Add facts, of all ranks, to summary.json (what JSON can hold), also of the state at load
        0; their names as in `add_history`."""

    def add_cell_fields(self, fields: dict[str, np.ndarray]) -> None:
        """Add arrays (owned cells, ...) to the fields of the terms before it; their names as in
        `add_history`."""

    def add_nodal_fields(self, fields: dict[str, np.ndarray]) -> None:
        """Add arrays (owned nodes,) or (owned nodes, k) to the fields of the terms before it;
        their names as in `add_history`."""

    def tools(self) -> "tuple[Tool, ...]":
        """Tools whose surface the sheet may touch."""
        return ()

    def tool_force(self, tool: "Tool") -> np.ndarray:
        """Force of `tool` on the sheet in the last accepted state, of all ranks, (3,) [N]."""
        return np.zeros(3)

    # -- what a result is judged by, of all ranks

    def penetration_of_thickness(self) -> float:
        """How deep a tool was in the sheet in any accepted state, over the sheet's thickness."""
        return 0.0

    def where_deepest(self) -> str:
        """In words, what was so deep in the sheet, and where."""
        return self.name

    def overstretched(self, strain: float) -> float:
        """Share of the sheet's area, 0 to 1, in which yarns are stretched by more than `strain`."""
        return 0.0

    def warnings(self) -> list[str]:
        """What speaks against the present state though nothing failed, in words."""
        return []
