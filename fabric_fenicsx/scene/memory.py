"""Memory of terms: their history in accepted states, for checkpoints and for unloading."""

from collections.abc import Iterable, Mapping

import numpy as np

from ..core.errors import InputError
from ..energy.output import arrays
from ..energy.term import Term
from ..energy.work import STATES

OF_CELLS = "cells "  # begins the names of arrays in cells


def memory_of(terms: Iterable[Term]) -> dict[str, np.ndarray]:
    """Memory of `terms`, {name: array (owned nodes, k)}, or (owned cells, k) where the name begins
    with `OF_CELLS`; then follow the term's number and its own name for the array."""
    return {
        f"{place}{i} {key}": values
        for i, term in enumerate(terms)
        for (place, key), values in _memory(term).items()
    }


def rescale_loads(memory: Mapping[str, np.ndarray], share: float) -> None:
    """Multiply the load factors of states in a scene's `memory`, as of `Work`, by `share`."""
    for name, values in memory.items():
        if name == "supports":
            values.reshape(-1, STATES, 4)[:, :, 1] *= share
        elif name.endswith(" work"):
            values.reshape(len(values), STATES, -1)[:, :, 1] *= share


def recall(term: Term, number: int, memory: dict[str, np.ndarray]) -> None:
    """Give a term back its part of `memory`. Raises InputError, on all ranks, if it did not take
    it."""
    given = {key: memory[f"{place}{number} {key}"] for place, key in _memory(term)}
    term.recall(given)
    lost = []
    for (_, key), values in _memory(term).items():
        scale = np.abs(given[key]).max(initial=0.0, where=np.isfinite(given[key]))
        if not np.allclose(values, given[key], 1e-9, 1e-9 * scale, equal_nan=True):
            lost.append(key)
    if lost := term.blank.mesh.comm.allreduce(lost):
        raise InputError(
            f"`recall` of term {term.name} leaves {lost[0]} other than it was given; allowed is to "
            "take back all that `memory` and `cell_memory` give"
        )


def _memory(term):
    """Arrays by (beginning of their name, own name)."""
    return {
        (place, key): values
        for place, method in (("", "memory"), (OF_CELLS, "cell_memory"))
        for key, values in arrays(term, method, getattr(term, method)()).items()
    }
