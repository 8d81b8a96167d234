"""Tables of TOML and the dataclasses that they describe, both ways."""

import dataclasses
import re
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import TypeVar

from .errors import InputError
from .rules import repr_short, unknown_key

Kind = TypeVar("Kind")
# of an entry that is no number, its field's metadata and the entry's path: the field's value
Convert = Callable[[object, Mapping, str], object]


def names_of(kind: type) -> list[str]:
    """Names of the fields of a dataclass that its table may have."""
    return [each.name for each in dataclasses.fields(kind) if each.init]


def as_table(value: object, path: str, allowed: str = "a table") -> dict:
    """A copy of the table at a path. Raises InputError for anything else."""
    if not isinstance(value, Mapping):
        raise InputError(f"{path} is {repr_short(value)}; expected {allowed}")
    return dict(value)


def as_list(value: object, path: str) -> list[dict]:
    """The tables [[path]]. Raises InputError for anything else, and for none."""
    tables = value if isinstance(value, list) and value else [[value]]
    return [as_table(each, path, f"a table [[{path}]] for each") for each in tables]


def key_of(keys: Collection[str], table: Mapping, path: str) -> str:
    """The key that tells of which kind a table is: the one that it has of `keys`."""
    found = [key for key in keys if key in table]
    if len(found) != 1:
        flaw = f"has {' and '.join(found)}" if found else "lacks an entry that says what it is"
        raise InputError(f"{path} {flaw}; expected one of {', '.join(keys)}")
    return found[0]


def read(kind: type[Kind], table: Mapping, path: str, convert: Convert) -> Kind:
    """The dataclass object that the table at a path describes. Raises InputError by path."""
    fields = {each.name: each for each in dataclasses.fields(kind) if each.init}  # type: ignore
    given = {}
    with located(path, fields):
        for key, value in table.items():
            if key not in fields:
                raise unknown_key(key, fields, f"{path}.{key}")
            meta, is_text = fields[key].metadata, fields[key].type in (str, "str")
            if is_text and not isinstance(value, str) and "choices" not in meta:
                raise InputError(f"{path}.{key} is {repr_short(value)}; expected a text")
            is_number = "rule" in meta and isinstance(value, (int, float))
            given[key] = value if is_number else convert(value, meta, f"{path}.{key}")
        return kind(**given)


@contextmanager
def located(path: str, names: Collection[str]) -> Iterator[None]:
    """Put the path of a table into messages: `x`, one of these names, becomes path.x."""
    try:
        yield
    except InputError as error:
        words = re.sub(f"`({'|'.join(names)})`", lambda m: f"{path}.{m[1]}", str(error))
        raise InputError(words if path in words else f"{path}: {words}") from None


def entries(owner: object) -> dict:
    """The fields of a dataclass object that differ from their defaults and from None."""
    found = {}
    for each in dataclasses.fields(owner):  # type: ignore[arg-type]
        value, usual = getattr(owner, each.name), each.default
        if each.default_factory is not dataclasses.MISSING:
            usual = each.default_factory()
        same = value is usual or (isinstance(value, type(usual)) and value == usual)
        if not (same or value is None):
            found[each.name] = value
    return found


def key_and_value(change: str) -> tuple[list[str], object]:
    """Names of the path and the value that a change "a.b.c=VALUE" gives; what is no value of TOML
    is a text."""
    key, equals, text = change.partition("=")
    names = key.strip().split(".")
    if not equals or not all(names):
        raise InputError(f"change {repr_short(change)} is not KEY=VALUE; expected e.g. blank.nx=8")
    with suppress(tomllib.TOMLDecodeError):
        return names, tomllib.loads(f"value = {text.strip()}")["value"]
    return names, text.strip()
