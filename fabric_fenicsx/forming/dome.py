"""The double dome of dimensions that a user gives."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

from ..runtime.errors import InputError
from ..tools.double_dome import DoubleDome

DIMENSIONS = tuple(each.name for each in dataclasses.fields(DoubleDome))


def dome_of(pairs: Mapping[str, float] | Iterable[str], **usual: float) -> DoubleDome:
    """The `DoubleDome` with dimensions {name: value} or texts NAME=VALUE, else the `usual` ones.
    Raises InputError, which lists all that is wrong with names and values."""
    given: dict[str, Any] = dict(usual)
    form = "`dome`"
    if isinstance(pairs, Mapping):
        given |= {str(name): value for name, value in pairs.items()}
    else:
        form += " NAME=VALUE"
        for pair in pairs:
            name, _, value = pair.partition("=")
            given[name] = _number(value)
    try:
        return DoubleDome(**given)
    except InputError as error:
        raise InputError(f"{form}: {error}") from None


def _number(text):
    """What a text says as a number, or the text."""
    try:
        return float(text)
    except ValueError:
        return text
