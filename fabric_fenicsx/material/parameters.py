"""Numbers with rules, of which laws and materials are made."""

import copy
import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self


@dataclass(frozen=True)
class Parameters:
    """Numbers with rules: `rules` names those fields that are checked, and how."""

    rules: ClassVar[Mapping[str, Any]] = {}

    def __post_init__(self) -> None:
        for name, rule in self.rules.items():
            object.__setattr__(self, name, rule.check(name, getattr(self, name)))

    def symbols(self, make: Callable[[float], Any]) -> Self:
        """A copy, not checked, of which each number v of the energy is make(v); so make may give
        UFL constants. Densities and compaction have no part in it; thickness comes last."""
        new = copy.copy(self)
        for field in sorted(dataclasses.fields(self), key=lambda field: field.name == "thickness"):
            value = getattr(self, field.name)
            if field.name in ("density", "fibre_density", "compaction"):
                continue
            if isinstance(value, float):
                object.__setattr__(new, field.name, make(value))
            elif isinstance(value, Parameters):
                object.__setattr__(new, field.name, value.symbols(make))
        return new
