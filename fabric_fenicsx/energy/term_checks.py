"""Checks of terms: as a scene takes them, once before a run, and in `check_derivatives`."""

import weakref
from copy import copy
from reprlib import repr as repr_short

import numpy as np
import ufl
from mpi4py import MPI

from ..core.errors import InputError
from .fingerprint import of_attributes
from .term import SceneFacts, Term, overrides


def bind(term: Term, scene: SceneFacts) -> None:
    """Put a term into its scene, once, and set it up.

    Raises InputError for what is no term, for one that is in another scene or twice in this one,
    for a part that the blank does not have, for an energy that is none, and what `set_up` raises.
    """
    if not isinstance(term, Term):
        raise InputError(
            f"a term of the scene is {repr_short(term)}; allowed are objects of `Term`, as "
            "`Membrane(fabric)`"
        )
    elsewhere = term.bound_to is not None and term.bound_to() is not scene
    if elsewhere or sum(each is term for each in scene.terms) > 1:
        place = "in another scene already" if elsewhere else "in the scene twice"
        raise InputError(f"term {term.name} is {place}; each scene needs terms of its own")
    if term.bound_to is not None:
        return
    term.unbound, term.fingerprint = copy(term), of_attributes(term)
    term.bound_to, term.blank = weakref.ref(scene), scene.blank
    term.part = scene.blank.part(term.part_name)
    term.set_up(scene)
    if term.energy is not None:
        _check_form(term)
    if any(overrides(term, name) for name in ("memory", "cell_memory")):
        if not overrides(term, "recall"):
            raise InputError(f"term {term.name} has a memory and needs `recall`, which takes it")
    stores = overrides(term, "stored") and not overrides(term, "energies")
    stores = (stores or term.energy is not None) and not overrides(term, "work")
    if stores and term.energy_kind is None:
        raise InputError(
            f"term {term.name} stores an energy and needs an `energy_kind`, its column in "
            "history.csv, or, as a load, `work`"
        )


def _check_form(term):
    """InputError for an `energy` that is none of the displacement, or not of the term's part."""
    form, of = term.energy, f"energy of term {term.name}"
    is_energy = isinstance(form, ufl.Form) and not form.arguments()
    if not is_energy or term.blank.u not in form.coefficients():
        raise InputError(
            f"{of} is {repr_short(form)}; allowed is the energy itself in `blank.u`, from which "
            "forces and stiffness follow, integrated: `W * self.part.dx(degree)`"
        )
    if term.part_name and any(each.subdomain_id() == "everywhere" for each in form.integrals()):
        raise InputError(
            f"{of}, which is on a part, is integrated over the whole sheet; it needs "
            "`self.part.dx(degree)` in place of `ufl.dx`"
        )


def check_answers(term: Term) -> None:
    """Ask a term for energy, forces and tangent where the sheet is; InputError, on all ranks, for
    forces that are not added, and for places outside of the matrix."""
    blank, comm = term.blank, term.blank.mesh.comm
    for kind in {term.energy_kind, *term.energies()} & {"viscous", "external_work"}:
        raise InputError(
            f"term {term.name} has the kind of energy {kind}; allowed is another name, as every "
            "run has this for something else"
        )
    alone = np.zeros_like(blank.u.x.array)
    returned: object = term.add_forces(alone)  # type: ignore[func-returns-value]
    before = 1.0 + abs(alone).max(initial=0.0)
    after = np.full_like(alone, before)
    term.add_forces(after)
    lost = abs(after - alone - before).max(initial=0.0) > 1e-6 * before
    if comm.allreduce(bool(lost or returned is not None), MPI.LOR):
        raise InputError(
            f"`add_forces` of term {term.name} returns something, or loses what other terms added; "
            "allowed is to add to the array that it is given, as `f[dofs] += forces`"
        )
    size = blank.V.dofmap.index_map.size_global * blank.mesh.geometry.dim
    rows, cols, values = (np.asarray(each) for each in term.tangent())
    numbers = np.append(rows, cols)
    wrong = rows.shape != values.shape or cols.shape != values.shape
    wrong = wrong or not ((numbers >= 0) & (numbers < size)).all()
    if comm.allreduce(wrong, MPI.LOR):  # PETSc would write past its arrays
        raise InputError(
            f"`tangent` of term {term.name} gives other places than rows and columns of the matrix;"
            f" allowed are three arrays (k,): rows and columns from 0 to {size - 1}, and values"
        )
