"""The double dome of dimensions that a user gives."""

import dataclasses
from collections.abc import Iterable, Mapping

from ..errors import InputError
from ..tools import DoubleDome

DIMENSIONS = tuple(each.name for each in dataclasses.fields(DoubleDome))


def dome_of(pairs: Mapping[str, float] | Iterable[str], **usual: float) -> DoubleDome:
    """The `DoubleDome` with dimensions {name: value} or texts NAME=VALUE, else the `usual` ones.
    Raises InputError for what is neither."""
    given = dict(usual)
    if isinstance(pairs, Mapping):
        pairs = [f"{key}={value!r}" for key, value in pairs.items()]
    for pair in pairs:
        key, _, value = pair.partition("=")
        try:
            given[key] = float(value)
        except ValueError:
            where = f"`dome` {pair} has no number after its name"
            raise InputError(f"{where}; allowed is NAME=VALUE") from None
        if key not in DIMENSIONS:
            raise InputError(
                f"`dome` {pair} names no dimension; allowed are {', '.join(DIMENSIONS)}"
            )
    return DoubleDome(**given)
