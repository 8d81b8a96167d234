"""What terms tell of a state: columns of history.csv, entries of the summary, fields."""

import json
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np
from mpi4py import MPI

from ..runtime.errors import InputError
from .term import Term

# what a method of terms gives, where that is told, and the method's argument
TOLD = {
    "add_history": ("column", "history.csv", "row"),
    "add_summary": ("entry", "summary.json", "summary"),
    "add_cell_fields": ("field", "the sheet", "fields"),
    "add_nodal_fields": ("field", "the sheet", "fields"),
}
FIELDS = "add_cell_fields", "add_nodal_fields"
# what every sheet and every summary has without terms
OF_A_SHEET = "u", "yarn_coordinate_a", "yarn_coordinate_b", "rank", "part"
OF_A_SUMMARY = (
    *("study", "ranks", "converged", "stroke_reached", "reason", "element", "dofs", "cells"),
    *("terms", "steps_accepted", "steps_rejected", "newton_iterations", "energy", "reaction_N"),
    *("energy_imbalance", "energy_imbalance_largest", "branches", "quantities", "error"),
    *("warnings", "wall_s", "peak_memory_mib", "versions"),
)


class _Told(dict[str, Any]):
    """What one term tells; what terms before it told can be read in it by name."""

    def __init__(self, before: Mapping[str, Any]) -> None:
        self.before, self.read = before, set[str]()

    def __missing__(self, name: str) -> Any:
        value = self.before[name]
        self.read.add(name)
        return value

    def __contains__(self, name: object) -> bool:
        return super().__contains__(name) or name in self.before

    def get(self, name: str, default: Any = None) -> Any:
        return self[name] if name in self else default

    def setdefault(self, name: str, default: Any = None) -> Any:
        self[name] = self.get(name, default)
        return self[name]


def told_by(terms: Iterable[Term], method: str, taken: Collection[str] = ()) -> dict[str, Any]:
    """What `terms` add by their `method`, one of `TOLD`, where the names `taken` are already.
    Raises InputError for a term that gives one of these, or one of another term without reading
    it, and on all ranks for a field of another size than its cells or nodes."""
    noun, place, argument = TOLD[method]
    told: dict[str, Any] = {}
    givers: dict[str, str] = dict.fromkeys(taken, f"{place} has")
    for term in terms:
        mine = _Told(told)
        if getattr(term, method)(mine) is not None:
            raise InputError(
                f"`{method}` of term {term.name} returns something; allowed is to add to the "
                f"`{argument}` that it is given"
            )
        if method in FIELDS:
            check_arrays(term, method, mine)
        else:
            _check_values(term, method, mine)
        for name in mine:
            if name in givers and name not in mine.read:
                instead = (
                    f", or to read it in `{argument}` and give one value for both"
                    if name in told
                    else ""
                )
                raise InputError(
                    f"`{method}` of term {term.name} gives the {noun} {name}, which "
                    f"{givers[name]} already; allowed is another name{instead}"
                )
        told |= mine
        givers |= dict.fromkeys(mine, f"term {term.name} gives")
    return told


def check_arrays(term: Term, method: str, arrays: dict[str, Any]) -> None:
    """Make what a term's `method` gives arrays; InputError, on all ranks, for one of no numbers and
    for one of another size than the rank's cells or nodes."""
    whole, noun = term.blank.whole, "field" if method in FIELDS else "array"
    what, size = ("cells", whole.cells.size) if "cell" in method else ("nodes", whole.nodes.size)
    text = ""
    for name, given in arrays.items():
        values = arrays[name] = np.asarray(given)
        if values.shape[:1] != (size,) or values.dtype.kind not in "biuf":
            kind = f"shape {values.shape}" if values.dtype.kind in "biuf" else "no numbers"
            text = text or (
                f"`{method}` of term {term.name} gives the {noun} {name} with {kind}; allowed is "
                f"({size},) or ({size}, k), of the {what} that the rank owns"
            )
    if text := term.blank.mesh.comm.allreduce(text, MPI.MAX):
        raise InputError(text)


def _check_values(term, method, told):
    noun, place, _ = TOLD[method]
    for name, value in told.items():
        try:
            json.dumps(value)
        except (TypeError, ValueError) as error:
            raise InputError(
                f"`{method}` of term {term.name} gives the {noun} {name}, of type "
                f"{type(value).__name__}; allowed is what JSON can hold, as float(value)"
            ) from error
