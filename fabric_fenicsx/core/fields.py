"""Declared fields of dataclasses: one rule for what Python and the command line may give."""

import dataclasses
import inspect
import math
import re
from collections.abc import Callable
from typing import Any, Self, TypeVar

from .errors import InputError
from .rules import Rule, unknown_key

Kind = TypeVar("Kind", bound=type)


class KnowsItsFields:
    """Base of dataclasses that check their fields, and name the nearest where one is unknown."""

    def __new__(cls, *_: object, **given: object) -> Self:
        """A new object. Raises InputError for a keyword that is no field."""
        known = [each.name for each in dataclasses.fields(cls) if each.init]  # type: ignore[arg-type]
        for name in given:
            if name not in known:
                raise unknown_key(name, known, f"field `{name}` of {cls.__name__}")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        check_fields(self)


def declared(owner: Any) -> list[dataclasses.Field]:
    """The fields of a dataclass or an object of one that have a help text, so an option."""
    return [each for each in dataclasses.fields(owner) if "help" in each.metadata]


def documented(kind: Kind) -> Kind:
    """A dataclass whose docstring has its declared fields among the parameters, by their help and
    rule, and the error for other values."""
    doc = inspect.getdoc(kind) or ""
    head, *rest = re.split(r"(?=\n\n(?:Raises|References|Examples)\n)", doc, maxsplit=1)
    head += "" if "\nParameters\n" in head else "\n\nParameters\n----------"
    for each in sorted(declared(kind), key=lambda each: bool(each.kw_only)):
        is_usual = each.default in (None, (), "", dataclasses.MISSING)
        usual = "" if is_usual else f" (default: {each.default})"
        rule = each.metadata.get("rule")
        of: Any = rule.kind if isinstance(rule, Rule) else each.type
        name = f"{each.name} : {of.__name__}" if isinstance(of, type) else each.name
        allowed = f"; {rule.allowed}" if isinstance(rule, Rule) else ""
        head += f"\n{name}\n    {each.metadata['help']}{usual}{allowed}"
    if "\nRaises\n" not in doc:
        head += "\n\nRaises\n------\nInputError\n    For a value that is not allowed."
    kind.__doc__ = "".join([head, *rest])
    return kind


def check_fields(owner: object, label: Callable[[str], str] = "`{}`".format) -> list[str]:
    """Give the declared fields of a dataclass object the kind of number that their rules ask for;
    sentences on values that are doubtful. label: what messages call a field of that name. Raises
    InputError for a value that is not allowed."""
    doubts = []
    for each in declared(owner):
        value, meta, name = getattr(owner, each.name), each.metadata, label(each.name)
        may_be_none = each.default is None or "None" in str(each.type) or "rule" not in meta
        if value is None and may_be_none:
            continue
        if "rule" in meta:
            value = meta["rule"].check(name, value)
            object.__setattr__(owner, each.name, value)
            most, hint = meta["doubt"] or (math.inf, "")
            if isinstance(value, (int, float)) and value > most:
                doubts.append(f"{name} is {value:g}, which is large: {hint}")
        choices = ("true", "false") if "switch" in meta else meta.get("choices", ())
        is_one = isinstance(value, bool) if "switch" in meta else value in choices
        if choices and not is_one:
            raise InputError(f"{name} is {value!r}; expected one of {', '.join(choices)}")
    return doubts


def quantity(
    default: float | None,
    rule: Rule,
    text: str,
    group: str = "test",
    doubt: tuple[float, str] | None = None,
) -> Any:
    """A field: a number by `rule`; text: what it is, group: of options. None stands
    for a default that depends on other fields, which the text then tells. doubt: a value above
    which a run warns, and a hint at the unit."""
    return _field(default, text, group, rule=rule, doubt=doubt)


def choice(default: str | None, allowed: tuple[str, ...], text: str, group: str = "test") -> Any:
    """A field: one of some words."""
    return _field(default, text, group, choices=allowed)


def flag(text: str, group: str = "test") -> Any:
    """A field: off unless asked for."""
    return _field(False, text, group, switch=True)


def path(default: str | None, words: str, metavar: str, group: str = "test") -> Any:
    """A field: a name, as of a file."""
    return _field(default, words, group, metavar=metavar)


def _field(default, words, group, **meta):
    return dataclasses.field(default=default, metadata={"help": words, "group": group} | meta)
