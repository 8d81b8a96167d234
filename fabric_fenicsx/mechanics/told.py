"""What terms tell of a state: columns of history.csv, entries of the summary, fields."""

from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np
from mpi4py import MPI

from ..errors import InputError
from .term import Term

# what a method of terms gives, where that is told, and the method's argument
TOLD = {
    "add_history": ("column", "history.csv", "row"),
    "add_summary": ("entry", "summary.json", "summary"),
    "add_cell_fields": ("field", "the sheet", "fields"),
    "add_nodal_fields": ("field", "the sheet", "fields"),
}


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
        getattr(term, method)(mine)
        _check_sizes(term, method, mine)
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


def _check_sizes(term: Term, method: str, fields: Mapping[str, Any]) -> None:
    blank = term.blank
    sizes = {
        "add_cell_fields": ("cells", blank.whole.cells.size),
        "add_nodal_fields": ("nodes", blank.whole.nodes.size),
    }
    if method not in sizes:
        return
    what, size = sizes[method]
    wrong = {name: np.shape(v) for name, v in fields.items() if np.shape(v)[:1] != (size,)}
    text = "".join(
        f"`{method}` of term {term.name} gives the field {name} with shape {shape}; allowed is "
        f"({size},) or ({size}, k), of the {what} that the rank owns"
        for name, shape in list(wrong.items())[:1]
    )
    if text := blank.mesh.comm.allreduce(text, MPI.MAX):
        raise InputError(text)
