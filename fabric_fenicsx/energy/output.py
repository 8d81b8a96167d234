"""Output of terms: columns of history.csv, entries of summary.json, fields."""

import json
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, NamedTuple, NoReturn

import numpy as np
from mpi4py import MPI

from ..core.errors import InputError
from ..core.files import plain
from ..sheet.blank import Part
from .term import Term, overrides

Content = Any  # a number, an array, or what JSON can hold


class Value(NamedTuple):
    """A value that a term returns from `history`, `summary`, `cell_fields` or `nodal_fields`.

    Parameters
    ----------
    value : number, array, or what JSON can hold
        A function is called with all merged values, {name: value}, and replaced by its
        result.
    unit : str
        Unit of a field.
    merge : callable, optional
        Function that merges the value of earlier terms with this one; without it no two terms
        may return the same name.

    Examples
    --------
    >>> ff.Value(np.zeros(3), "MPa").unit
    'MPa'
    """

    value: Content
    unit: str = ""
    merge: Callable[[Content, Content], Content] | None = None


class Fields(dict[str, np.ndarray]):
    """Fields {name: array (cells, ...) or (nodes, ...)}, with their `units` {name: unit}."""

    def __init__(self, values: Mapping[str, Value]) -> None:
        super().__init__({name: field.value for name, field in values.items()})
        self.units = {name: field.unit for name, field in values.items() if field.unit}

    def __missing__(self, name: str) -> NoReturn:
        raise InputError(
            f"field {name} is unknown; expected {', '.join(self)}; fields at nodes are in "
            "`result.grid.point_data`"
        )


def least(value: Content, unit: str = "") -> Value:
    """Value, a number or an array, merged as the least of all terms, entry by entry; with the
    unit of a field.

    Examples
    --------
    >>> gap = ff.least(0.2)
    >>> gap.merge(0.5, gap.value)
    0.2
    """
    return Value(value, unit, np.minimum if isinstance(value, np.ndarray) else min)


def largest(value: Content, unit: str = "") -> Value:
    """Value merged as the largest of all terms: a number, or an array (n,) or (n, 3), of
    which the numbers or vectors of the largest size; NaN has none. With the unit of a field.

    Examples
    --------
    >>> slip = ff.largest(np.array([1.0, -3.0]), "mm")
    >>> slip.merge(np.array([-2.0, 0.5]), slip.value).tolist()
    [-2.0, -3.0]
    """
    return Value(value, unit, _larger if isinstance(value, np.ndarray) else max)


def total(value: Content, unit: str = "") -> Value:
    """Value, a number or an array, merged as the sum over the terms; the sum over ranks is
    the term's. With the unit of a field.

    Examples
    --------
    >>> pull = ff.total(2.0)
    >>> pull.merge(0.5, pull.value)
    2.5
    """
    return Value(value, unit, lambda before, now: before + now)


def last(value: Content, unit: str = "") -> Value:
    """Value of which that of the last term counts."""
    return Value(value, unit, lambda before, now: now)


def joined(value: Mapping[str, Content]) -> Value:
    """A dict that has the entries of all terms."""
    return Value(value, "", lambda before, now: {**before, **now})


def on_part(part: Part, values: np.ndarray, unit: str = "") -> Value:
    """A field by its `values` (cells, ...) in the cells of a part; cells of no part get NaN, or 0
    in whole numbers. Where parts overlap, that of the last term counts."""
    if part.is_whole:
        return last(values, unit)

    def over(before, now):
        both = before.copy()
        both[part.cells] = now[part.cells]
        return both

    return Value(part.spread(values), unit, over)


def merged(terms: Iterable[Term], method: str, taken: Collection[str] = ()) -> dict[str, Value]:
    """Output of `terms` by their `method`, merged.

    Raises InputError for one of the names `taken`, for a name that two terms give without a rule,
    for what differs between ranks, and for a field of another size than the rank's cells or nodes.
    """
    places = {"history": ("column", "history.csv"), "summary": ("entry", "summary.json")}
    noun, place = places.get(method, ("field", "the sheet"))
    checked = arrays if noun == "field" else _same_on_ranks
    values: dict[str, Value] = {}
    givers = dict.fromkeys(taken, f"{place} has")
    for term in (term for term in terms if overrides(term, method)):
        output = getattr(term, method)().items()
        rules = {k: v if isinstance(v, Value) else Value(v) for k, v in output}
        plain_ones = {k: rule.value for k, rule in rules.items() if not callable(rule.value)}
        answers = checked(term, method, plain_ones)
        for name, (value, unit, merge) in rules.items():
            before, value = values.get(name), answers.get(name, value)
            if before and merge:
                value = merge(before.value, value)
            elif name in givers:
                rule = ", or a rule that merges both, as `largest(value)`" if before else ""
                raise InputError(
                    f"`{method}` of term {term.name} returns the {noun} {name}, which "
                    f"{givers[name]} already; choose another name{rule}"
                )
            values[name], givers[name] = Value(value, unit, merge), f"term {term.name} returns"
    known = {name: field.value for name, field in values.items()}
    return {
        name: field._replace(value=field.value(known)) if callable(field.value) else field
        for name, field in values.items()
    }


def arrays(term: Term, method: str, answer: Mapping[str, Content]) -> dict[str, np.ndarray]:
    """Answer of a term's `method` as arrays; InputError, on all ranks, for what is no number and
    for another size than the rank's cells or nodes."""
    whole, result, flaw = term.blank.whole, {k: np.asarray(v) for k, v in answer.items()}, ""
    size = whole.cells.size if "cell" in method else whole.nodes.size
    for name, values in result.items():
        kind = f"shape {values.shape}" if values.dtype.kind in "biuf" else "no numbers"
        if not flaw and (values.shape[:1] != (size,) or kind == "no numbers"):
            flaw = (
                f"`{method}` of term {term.name} returns {name} with {kind}; expected ({size},) "
                f"or ({size}, k), of what the rank owns"
            )
    if flaw := term.blank.mesh.comm.allreduce(flaw, MPI.MAX):
        raise InputError(flaw)
    return result


def _larger(before, now):
    sizes = [abs(v) if v.ndim == 1 else np.linalg.norm(v, axis=1) for v in (before, now)]
    kept = (sizes[0] > sizes[1]) | np.isnan(sizes[1])
    return np.where(kept if now.ndim == 1 else kept[:, None], before, now)


def _same_on_ranks(term, method, answer):
    texts = dict.fromkeys(term.blank.mesh.comm.allgather(json.dumps(plain(answer))))
    if len(texts) > 1:
        raise InputError(
            f"`{method}` of term {term.name} returns {' and '.join(texts)} on different ranks; "
            "expected the same on all, e.g. `self.blank.mesh.comm.allreduce(number)`, the sum"
        )
    return answer
