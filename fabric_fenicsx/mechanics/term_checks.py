"""Whether a term is what a scene can take, and gives arrays of the right shapes: errors name it."""

from collections.abc import Iterable, Sequence
from numbers import Real
from reprlib import repr as shown
from typing import TYPE_CHECKING, Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.constantvalue import ScalarValue, Zero
from ufl.corealg.traversal import unique_pre_traversal

from ..runtime.errors import InputError

if TYPE_CHECKING:
    from .term import Term

# of what every run tells beside the energies of terms
OF_A_RUN = "viscous", "external_work"
MOTIONS = "move", "turn", "lift", "slide", "stretch"  # that a term may resist


def check_kind(term: object) -> None:
    """InputError for what is no term."""
    if isinstance(term, type) or not hasattr(term, "bind"):
        raise InputError(
            f"a term of the scene is {shown(term)}; allowed are objects of `Term`, as "
            "`Membrane(fabric)`"
        )


def check_words(term: "Term") -> None:
    """InputError for names, units and motions that are none."""
    kind = term.energy_kind
    for what, text in (("name", term.name), ("energy_kind", "x" if kind is None else kind)):
        if not (isinstance(text, str) and text.strip()):
            raise InputError(
                f"`{what}` of a term of class {type(term).__name__} is {text!r}; allowed is "
                "a text that is not empty"
            )
    if kind in OF_A_RUN:
        raise InputError(
            f"`energy_kind` of term {term.name} is {kind}, which every run has for "
            "something else; allowed is another name"
        )
    if isinstance(term.resists, str) or not {*term.resists} <= {*MOTIONS}:
        raise InputError(
            f"`resists` of term {term.name} is {term.resists!r}; allowed is a tuple of "
            f"{', '.join(MOTIONS)}"
        )
    if not hasattr(term.units, "items"):
        raise InputError(
            f"`units` of term {term.name} is {term.units!r}; allowed is {{name of a field: unit}}"
        )


def check_form(term: "Term") -> None:
    """InputError for an `energy` that is no energy of the displacement, or of numbers that are not
    finite or make it 0."""
    form, of = term.energy, f"energy of term {term.name}"
    if form is None:
        return
    if not isinstance(form, ufl.Form):
        raise InputError(
            f"{of} is {shown(form)}, which is not integrated; "
            "allowed is a form, as `W * self.part.dx(degree)`"
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


def add_forces(term: "Term", f: np.ndarray) -> None:
    """Have the term add its forces to f (local dofs,); InputError if it gives them back instead."""
    given: Any = term.add_forces(f)  # type: ignore[func-returns-value]
    if given is not None:
        raise InputError(
            f"`add_forces` of term {term.name} returns something; allowed is to add to the array "
            "that it is given, as `f[dofs] += forces`"
        )


def one_number(term: "Term", method: str) -> float:
    """What the term's `stored`, `potential` or `work` gives; InputError for what is no number."""
    value: Any = getattr(term, method)()
    if not isinstance(value, Real):
        raise InputError(
            f"`{method}` of term {term.name} gives {shown(value)}; allowed is one number [N mm]"
        )
    return float(value)


def triplets(terms: Iterable["Term"], size: int, comm: MPI.Comm) -> list[np.ndarray]:
    """Rows, columns and values (k,) of the tangents of all terms, for a matrix of this size;
    InputError, on all ranks, for what is no such triplet."""
    found, wrong = [], ""
    for term in terms:
        given = term.tangent()
        reason = _wrong_triplets(given, size)
        if reason:
            wrong = wrong or (
                f"`tangent` of term {term.name} gives {reason}; allowed are rows, columns and "
                f"values, three arrays (k,), the first two of global degrees of freedom, 0 to "
                f"{size - 1}"
            )
        else:
            found.append([np.asarray(each) for each in given])
    if wrong := comm.allreduce(wrong, MPI.MAX):
        raise InputError(wrong)
    rows, cols, values = (np.concatenate(part) for part in zip(*found))
    return [rows.astype(np.int64), cols.astype(np.int64), values]


def _wrong_triplets(given: Any, size: int) -> str:
    """What is wrong with what `tangent` gives; "" if nothing is."""
    if not isinstance(given, (tuple, list)) or len(given) != 3:
        return shown(given)
    rows, cols, values = (np.asarray(each) for each in given)
    shapes = rows.shape, cols.shape, values.shape
    if rows.ndim != 1 or len({*shapes}) > 1:
        return f"arrays of shapes {', '.join(map(str, shapes))}"
    for numbers in (rows, cols):
        beyond = numbers[~((numbers >= 0) & (numbers < size))]
        if beyond.size:
            return f"the degree of freedom {beyond[0]}"
    return ""


def same_values(terms: Sequence["Term"], known: int, comm: MPI.Comm) -> np.ndarray:
    """Values (k,) of the tangents of all terms, at the `known` number of places; InputError, on all
    ranks, for another number."""
    values = np.concatenate([term.tangent()[2] for term in terms])
    wrong = ""
    if len(values) != known:
        names = ", ".join(term.name for term in terms if len(term.tangent()[2]))
        wrong = (
            f"`tangent` of one of the terms {names} gives other places than before; allowed are "
            "always the same, unless `pattern` counts up"
        )
    if wrong := comm.allreduce(wrong, MPI.MAX):
        raise InputError(wrong)
    return values
