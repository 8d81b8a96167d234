"""Checks of terms: as a scene takes them, once before a run, and in `check_derivatives`."""

import inspect
import weakref
from copy import copy
from difflib import get_close_matches
from numbers import Real
from reprlib import repr as shown
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.constantvalue import ScalarValue, Zero
from ufl.corealg.traversal import unique_pre_traversal

from ..runtime.errors import InputError
from .fingerprint import of_attributes
from .output import asked
from .term import SceneFacts, Term, overrides

OF_A_RUN = "viscous", "external_work"  # energies that a run has beside those of terms
MOTIONS = "move", "turn", "lift", "slide", "stretch"  # that a term may resist


def bind(term: Term, scene: SceneFacts) -> None:
    """Put a term into its scene, once, and set it up.

    Raises InputError for what is no term, for one that is in another scene or twice in this one,
    for a part that the blank does not have, for names, an energy or forces that are none, and what
    `set_up` raises.
    """
    if not isinstance(term, Term):
        raise InputError(
            f"a term of the scene is {shown(term)}; allowed are objects of `Term`, as "
            "`Membrane(fabric)`"
        )
    if term.bound_to is not None:
        if term.bound_to() is not scene:
            raise InputError(
                f"term {term.name} is in another scene already; each scene needs terms of its own"
            )
        return
    _check_names(term)
    if sum(each is term for each in scene.terms) > 1:
        raise InputError(f"term {term.name} is in the scene twice; two alike must be two objects")
    kept = [method for method in ("memory", "cell_memory") if overrides(term, method)]
    if overrides(term, "recall") != bool(kept):
        has, lacks = (kept[0], "recall") if kept else ("recall", "memory")
        raise InputError(f"`{has}` of term {term.name} needs `{lacks}`")
    unbound = copy(term)
    term.fingerprint = of_attributes(term)
    term.unbound = unbound
    term.bound_to, term.blank = weakref.ref(scene), scene.blank
    term.part = scene.blank.part(term.part_name)
    try:
        term.set_up(scene)
    except Exception as error:
        _explain(error, term, scene.blank.mesh.geometry.dim)
        raise
    if term.energy is not None:
        _check_form(term)
    if term.energy is None and not overrides(term, "add_forces"):
        raise InputError(f"term {term.name} needs `self.energy`, set in `set_up`, or `add_forces`")
    one_kind = overrides(term, "stored") and not overrides(term, "energies")
    stores = term.energy is not None or one_kind
    if term.energy_kind is None and stores and not overrides(term, "work"):
        raise InputError(
            f"term {term.name} stores an energy and needs an `energy_kind`, its column in "
            "history.csv, or, as a load, `work`"
        )


def _check_names(term):
    if not (isinstance(term.name, str) and term.name.strip()):
        raise InputError(
            f"`name` of a term of class {type(term).__name__} is {term.name!r}; allowed is "
            "a text that is not empty"
        )
    if term.energy_kind is not None:
        _check_kind(term, "energy_kind", term.energy_kind)
    if isinstance(term.resists, str) or not {*term.resists} <= {*MOTIONS}:
        raise InputError(
            f"`resists` of term {term.name} is {term.resists!r}; allowed is a tuple of "
            f"{', '.join(MOTIONS)}"
        )


def _check_kind(term, where, kind):
    if not (isinstance(kind, str) and kind.isidentifier()) or kind in OF_A_RUN:
        raise InputError(
            f"`{where}` of term {term.name} is {kind!r}; allowed is a name of letters, digits and "
            f"_, other than {' and '.join(OF_A_RUN)}, which every run has for something else"
        )


def misspelt(term: Term) -> list[str]:
    """Warnings of a term's methods whose names are nearly those that a run asks for."""
    known = {name.replace("ies", "y"): name for name in vars(Term)}
    found = []
    for name, _ in inspect.getmembers(type(term), callable):
        if name[0] == "_" or name in known.values():
            continue
        if near := get_close_matches(name.replace("ies", "y"), known, 1, 0.81):
            meant = f"a run asks for `{known[near[0]]}`, not for this"
            found.append(f"term {term.name} has `{name}`; {meant}")
    return found


def _explain(error, term, gdim):
    """Replace messages of UFL and DOLFINx by clearer ones."""
    if "nsupported dtype" in str(error):
        raise InputError(
            f"term {term.name} holds a number in `fem.Constant` that is no float; allowed "
            "is `fem.Constant(self.blank.mesh, float(k))`"
        ) from error
    if gdim == 2 and ("out of bounds" in str(error) or "out of range" in str(error)):
        raise InputError(
            f"term {term.name} asks for more than the {gdim} components that vectors have on "
            "a sheet in its plane; a third needs a blank made with `spatial=True`"
        ) from error


def _check_form(term):
    """InputError for an `energy` that is none of the displacement, that is not of the term's part,
    and for numbers in it that are not finite or make it 0."""
    form, of = term.energy, f"energy of term {term.name}"
    if not isinstance(form, ufl.Form):
        raise InputError(
            f"{of} is {shown(form)}, which is not integrated; a form is `W * self.part.dx(degree)`"
        )
    if form.arguments():
        raise InputError(
            f"{of} has test or trial functions; allowed is the energy itself, from which forces "
            "and stiffness follow"
        )
    held = "allowed is a finite number, held by `fem.Constant(self.blank.mesh, k)` if it may be 0"
    if all(isinstance(each.integrand(), Zero) for each in form.integrals()):
        raise InputError(f"{of} is 0, as one of its numbers is; {held}")
    for integral in form.integrals():
        for node in unique_pre_traversal(integral.integrand()):
            if isinstance(node, (fem.Constant, ScalarValue)):
                number = node.value if isinstance(node, fem.Constant) else node._value
                if not np.isfinite(number).all():
                    raise InputError(f"{of} holds {number}; {held}")
    if term.blank.u not in form.coefficients():
        raise InputError(
            f"{of} does not depend on the displacement; allowed is a form in `blank.u`"
        )
    if term.part_name and any(each.subdomain_id() == "everywhere" for each in form.integrals()):
        raise InputError(
            f"term {term.name} is on a part, but its energy is integrated over the whole "
            "sheet; it needs `self.part.dx(degree)` in place of `ufl.dx`"
        )


def check_answers(term: Term) -> None:
    """Ask a term for energy, forces and tangent where the sheet is; InputError, on all ranks, for
    what is no number, no triplet, or is returned in place of being added."""
    blank, comm = term.blank, term.blank.mesh.comm
    size = blank.V.dofmap.index_map.size_global * blank.mesh.geometry.dim
    check_number(term, "stored", term.stored())
    for kind, value in asked(term, "energies", "kind").items():
        if kind is not None:
            _check_kind(term, "energies", kind)
        check_number(term, "energies", value)
    given: Any = term.add_forces(np.zeros_like(blank.u.x.array))  # type: ignore[func-returns-value]
    if given is not None:
        raise InputError(
            f"`add_forces` of term {term.name} returns something; allowed is to add to the array "
            "that it is given, as `f[dofs] += forces`"
        )
    wrong = _wrong_triplets(term.tangent(), size)
    if wrong := comm.allreduce(wrong, MPI.MAX):
        raise InputError(
            f"`tangent` of term {term.name} gives {wrong}; allowed are rows, columns and values, "
            f"three arrays (k,), the first two of global degrees of freedom, 0 to {size - 1}"
        )


def check_number(term: Term, method: str, value: Any) -> None:
    """InputError for a `value` of a term's `method` that is no number."""
    if not isinstance(value, Real):
        raise InputError(
            f"`{method}` of term {term.name} gives {shown(value)}; allowed is one number [N mm]"
        )


def _wrong_triplets(given: Any, size: int) -> str:
    """Fault in the answer of `tangent`, "" if there is none."""
    if not isinstance(given, (tuple, list)) or len(given) != 3:
        return shown(given)
    rows, cols, values = (np.asarray(each) for each in given)
    shapes = rows.shape, cols.shape, values.shape
    if rows.ndim != 1 or len({*shapes}) > 1:
        return f"arrays of shapes {', '.join(map(str, shapes))}"
    numbers = np.append(rows, cols)
    beyond = numbers[~((numbers >= 0) & (numbers < size))]
    return f"the degree of freedom {beyond[0]}" if beyond.size else ""
