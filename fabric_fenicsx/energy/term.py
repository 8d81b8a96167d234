"""A term of a scene, an energy or a load on its sheet, and the checks of its answers."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from copy import copy
from functools import partial
from reprlib import repr as repr_short
from typing import Protocol, Self

import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc
from ufl.core.expr import Expr

from ..core.errors import InputError
from ..io.field import Field
from ..material.laws.base import Material
from ..sheet.blank import Blank, Part
from ..surfaces.tool import Tool
from .fingerprint import of_attributes

Triplets = tuple[np.ndarray, np.ndarray, np.ndarray]  # rows, columns and values of a sparse matrix
NO_TANGENT: Triplets = (np.empty(0, PETSc.IntType), np.empty(0, PETSc.IntType), np.empty(0))


class SceneFacts(Protocol):
    """A scene as its terms see it."""

    blank: Blank

    @property
    def terms(self) -> Sequence[Term]:
        """All terms on the blank, in the given order."""


def overrides(term: Term, method: str) -> bool:
    """True if a term has a `method` of its own instead of that of `Term`."""
    of_type, base = (getattr(kind, method, None) for kind in (type(term), Term))
    return method in vars(term) or of_type is not base


class Term:
    """An energy or a load on the scene's sheet; a subclass overrides what it needs.

    Unless stated otherwise, arrays and numbers are those of this rank's part. Degrees of freedom
    are those of `blank.u`: components along the axes of the blank's frame.

    Attributes
    ----------
    name : str
        Name in summaries and errors.
    energy_kind : str or None
        Kind under which the energy is summed: KIND_energy_Nmm in history.csv, KIND in the `energy`
        of summary.json; None for loads. The package has strain, bending, contact, friction,
        yarn_friction, metal and plastic; choose another kind to list your own term separately.
    resists : tuple of str
        Rigid motions of the sheet that the term may resist: "move" and "turn", or only those out of
        its plane, "lift", or within it, "slide"; "stretch" if the term alone can hold the sheet
        together, though it is not a form. A scene with a free rigid motion is rejected.
    energy : ufl.Form or None
        Form in `blank.u`, integrated by `part.dx(degree)` or `part.ds(edge, degree)` [N mm]; for a
        load, minus its work. None if `stored`, `add_forces` and `tangent` take its place.
    pattern : object
        A value that changes when the rows and columns of `tangent` change, e.g. a counter.
    tool : Tool or None
        Tool through which the term acts on the sheet.
    prestressed : bool
        True if the unloaded sheet may have stress.
    blank, part : Blank, Part
        The sheet and the part of it that the term is on, known in `set_up`. `blank.mesh.comm` is
        the MPI communicator, `blank.V.dofmap.index_map` numbers the nodes.
    fields : mapping
        {name: (`Field`, places (n, 3), its values (n,) there)} of quantities that vary in space.
    thickness_field : Field or None
        Thickness of the part's material [mm] if it varies in space.
    fingerprint : dict
        Attributes before `set_up` as plain data, with which a checkpoint must agree.
    unbound : Term
        The term before `set_up`, which another scene may copy.

    Examples
    --------
    >>> import ufl
    >>> class Bedding(ff.Term):
    ...     name = energy_kind = "bedding"
    ...
    ...     def set_up(self, scene):
    ...         u = scene.blank.u
    ...         self.energy = 0.5 * 0.05 * ufl.inner(u, u) * self.part.dx(2)
    >>> strip = ff.Blank.rectangle(20, 10, nx=2)
    >>> scene = ff.Scene(strip, [ff.Membrane(ff.load("komeili")), Bedding()], ff.clamped_ends(0.1))
    >>> sorted(scene.energies())
    ['bedding', 'strain']
    """

    name = "term"
    energy_kind: str | None = None
    resists: tuple[str, ...] = ()
    energy: ufl.Form | None = None
    pattern: object = 0
    prestressed = False
    thickness_field: Field | None = None
    fields: Mapping[str, tuple[Field, np.ndarray, np.ndarray]] = {}
    tool: Tool | None = None
    blank: Blank
    part: Part
    part_name = ""
    fingerprint: dict[str, object]
    unbound: Self
    # weak, as circles of solver objects end at another time on each rank
    bound_to: weakref.ref[SceneFacts] | None = None

    def on(self, part: str) -> Self:
        """The term itself, restricted to the part of the blank of this name, a sheet of a stack
        or a patch."""
        self.part_name = part
        self.name = f"{self.name} of {part}"
        return self

    def set_up(self, scene: SceneFacts) -> None:
        """Make what needs the sheet; `blank` and `part` are known."""

    @property
    def material(self) -> Material | None:
        """Fabric or metal of the term's part of the sheet."""
        return None

    # -- energy, forces and stiffness

    def stored(self) -> float:
        """Energy that is no form [N mm]; for a load, minus its work."""
        return 0.0

    def energies(self) -> dict[str | None, float]:
        """Energies that are no form, {kind: N mm}, the same kinds each time; None: minus the work
        of a load. A term of several kinds overrides this instead of `stored`."""
        return {self.energy_kind: self.stored()}

    def add_forces(self, f: np.ndarray) -> None:
        """Add the derivative of the energies to f (local dofs,), ghosts included [N]."""

    def tangent(self) -> Triplets:
        """Second derivative of the energies [N/mm]: rows, columns (k,), GLOBAL degrees of freedom,
        the same ones as long as `pattern` is the same, and values (k,), to be summed."""
        return NO_TANGENT

    def preconditioner(self) -> Triplets:
        """As `tangent`, nearly, at fewer places: a preconditioner, with `add_remainder`."""
        return self.tangent()

    def add_remainder(self, v: np.ndarray, f: np.ndarray) -> None:
        """Add to f (owned dofs,), along v, what `tangent` has beyond the last `preconditioner`."""

    def variations(self, v: Expr, w: Expr) -> Sequence[ufl.Form]:
        """First variation of the form `energy` in v, and second in v and w (UFL arguments)."""
        first = ufl.derivative(self.energy, self.blank.u, v)
        return first, ufl.derivative(first, self.blank.u, w)

    def applied_forces(self) -> np.ndarray:
        """Forces of a load or tool that is no form (owned dofs,) [N], to compare residuals with."""
        raise NotImplementedError

    def use_secant_stiffness(self, f: np.ndarray) -> None:
        """Give the next `tangent` by secants to where the residual f (owned dofs,) [N] leads."""

    def compliance(self) -> tuple[np.ndarray, float] | None:
        """c (owned dofs,), k [N/mm] of a tool moved by force: the tangent less c c^T / k counts."""
        return None

    # -- load steps

    def check_start(self) -> None:
        """Raise InputError, on all ranks, if at load 0 sheet or tool are where no run can begin."""

    def set_load(self, load: float) -> None:
        """Set the load factor, and go back to the last accepted state in all else."""

    def on_prediction(self) -> None:
        """See the predicted state with which a step's solution begins, to hold what is there."""

    def update_lagged(self) -> bool:
        """Update, after a solve, what was held in it, if that is off; true on all ranks if so."""
        return False

    def contact_prediction(self) -> np.ndarray:
        """Motion of the nodes (owned dofs,) [mm] with which a step begins: those that a tool
        pressed in the last accepted state are then as deep in it as there, and no others are in
        it."""
        raise NotImplementedError

    def accept(self) -> None:
        """Take the present state as the last accepted one."""

    def reject(self) -> None:
        """Forget states of which `work` was asked since the last accepted one."""

    def work(self) -> float:
        """Work of a load or tool since the last accepted state [N mm]."""
        return 0.0

    def memory(self) -> dict[str, np.ndarray]:
        """Memory of accepted states for a checkpoint, {name: array (owned nodes, k)}."""
        return {}

    def cell_memory(self) -> dict[str, np.ndarray]:
        """Memory in cells, {name: array (owned cells, k)}, by names that `memory` does not use."""
        return {}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Take back `memory` and `cell_memory`, at the displacement and load of then."""

    # -- contact

    def tool_force(self) -> np.ndarray:
        """Force of the tool on the sheet in the last accepted state, of all ranks, (3,) [N]."""
        raise NotImplementedError

    def may_press(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Points (k, 3) of the undeformed sheet [mm] and normals (k, 3) there of a tool that keeps
        the sheet off its surface, at the start and at full load."""
        raise NotImplementedError

    def rubbed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points of the undeformed sheet (k, 3) [mm] that friction of a tool holds, unit normals
        (k, 3) there, and the friction that each can bear in the accepted state, (k,) [N]."""
        raise NotImplementedError

    def penetration_of_thickness(self) -> float:
        """Deepest overlap with a tool or sheet in any accepted state, over the thickness."""
        return 0.0

    def where_deepest(self) -> str:
        """The tool or sheet that was so deep in the sheet, and where, as text."""
        return ""

    # -- output: {name: value or `Value`}, the same names each time

    def history(self) -> Mapping[str, object]:
        """Columns of history.csv, numbers that are the same on all ranks."""
        return {}

    def summary(self) -> Mapping[str, object]:
        """Entries of summary.json, the same on all ranks, also at load 0."""
        return {}

    def cell_fields(self) -> Mapping[str, object]:
        """Fields on cells, arrays (owned cells, ...)."""
        return {}

    def nodal_fields(self) -> Mapping[str, object]:
        """Fields at nodes, arrays (owned nodes,) or (owned nodes, k)."""
        return {}

    def warnings(self) -> list[str]:
        """Sentences on what speaks against the state though nothing failed."""
        return []


def bind(term: Term, scene: SceneFacts) -> None:
    """Put a term into its scene, once, and set it up.

    Raises InputError for what is no term, for one that is in another scene or twice in this one,
    for a part that the blank does not have, for an energy that is none, and what `set_up` raises.
    """
    if not isinstance(term, Term):
        raise InputError(
            f"a term of the scene is {repr_short(term)}; expected objects of `Term`, as "
            "`Membrane(fabric)`"
        )
    elsewhere = term.bound_to is not None and term.bound_to() is not scene
    if elsewhere or sum(other is term for other in scene.terms) > 1:
        place = "in another scene already" if elsewhere else "in the scene twice"
        raise InputError(f"term {term.name} is {place}; each scene needs terms of its own")
    if term.bound_to is not None:
        return
    term.unbound, term.fingerprint = copy(term), of_attributes(term)
    term.bound_to, term.blank = weakref.ref(scene), scene.blank
    term.part = scene.blank.part(term.part_name)
    term.set_up(scene)
    form, u, flaw, has = term.energy, term.blank.u, "", partial(overrides, term)
    is_energy = isinstance(form, ufl.Form) and not form.arguments() and u in form.coefficients()
    of = f"energy of term {term.name}"
    if form is not None and not is_energy:
        flaw = f"{of} is {repr_short(form)}; expected the energy itself in `blank.u`, from which "
        flaw += "forces and stiffness follow, integrated: `W * self.part.dx(degree)`"
    elif form and term.part_name and "everywhere" in [i.subdomain_id() for i in form.integrals()]:
        flaw = f"{of}, which is on a part, is integrated over the whole sheet; it needs "
        flaw += "`self.part.dx(degree)` instead of `ufl.dx`"
    elif (has("memory") or has("cell_memory")) and not has("recall"):
        flaw = f"term {term.name} has a memory and needs `recall` to restore it"
    elif term.energy_kind is None and not has("work"):
        if form is not None or (has("stored") and not has("energies")):
            flaw = f"term {term.name} stores an energy and needs an `energy_kind`, its column in "
            flaw += "history.csv, or, as a load, `work`"
    if flaw:
        raise InputError(flaw)


def check_answers(term: Term) -> None:
    """Ask a term for energy, forces and tangent where the sheet is; InputError, on all ranks, for
    forces that are not added, and for places outside of the matrix."""
    blank, comm = term.blank, term.blank.mesh.comm
    for kind in {term.energy_kind, *term.energies()} & {"viscous", "external_work"}:
        raise InputError(
            f"term {term.name} has the kind of energy {kind}; expected another name, as every "
            "run has this for something else"
        )
    alone = np.zeros_like(blank.u.x.array)
    returned: object = term.add_forces(alone)  # type: ignore[func-returns-value]
    before = 1.0 + abs(alone).max(initial=0.0)
    term.add_forces(after := np.full_like(alone, before))
    lost = abs(after - alone - before).max(initial=0.0) > 1e-6 * before
    if comm.allreduce(bool(lost or returned is not None), MPI.LOR):
        raise InputError(
            f"`add_forces` of term {term.name} returns a value, or overwrites forces of other "
            "terms; it must add to the given array, as `f[dofs] += forces`"
        )
    size = blank.V.dofmap.index_map.size_global * blank.mesh.geometry.dim
    rows, cols, values = map(np.asarray, term.tangent())
    inside = all(((numbers >= 0) & (numbers < size)).all() for numbers in (rows, cols))
    is_right = rows.shape == cols.shape == values.shape and inside
    if comm.allreduce(not is_right, MPI.LOR):  # PETSc would write past its arrays
        raise InputError(
            f"`tangent` of term {term.name} returns entries outside the matrix;"
            f" expected three arrays (k,): rows and columns from 0 to {size - 1}, and values"
        )
