"""Materials as files hold them."""

import dataclasses
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Self

import tomli_w

from ..runtime.rules import Rule, check_complete, unknown_key
from .compaction import compaction_of
from .files import FIBRES, SHEET, read_sheet_numbers, read_toml, write_whole
from .parameters import Parameters


class Material(Parameters):
    """Parameters of a sheet's material that a file holds; a subclass says what in `table`, and
    reads it in `from_document`. thickness: of the sheet [mm]."""

    thickness: float

    def thickness_under(self, pressure: float) -> float:
        """Thickness of the sheet between faces that press it [MPa], in mm."""
        return self.thickness

    def assumed_values(self) -> dict[str, str]:
        """Numbers that act and that no test has determined, {name: value with unit}."""
        return {}

    @property
    def label(self) -> str:
        """The material's name in sentences."""
        return getattr(self, "name", "") or getattr(self, "law", "material")

    def replace(self, **changes: Any) -> Self:
        """A changed copy; InputError for an unknown name."""
        own = [field.name for field in dataclasses.fields(self)]
        for key in changes:
            if key not in own:
                raise unknown_key(key, own, f"replace: {key}")
        return dataclasses.replace(self, **changes)

    def table(self) -> dict[str, Any]:
        """The content of a material file."""
        raise NotImplementedError

    @classmethod
    def from_document(cls, document: dict[str, Any], folder: Path) -> Self:
        """The material of a TOML document that lies in `folder`; InputError by field."""
        raise NotImplementedError

    def dumps(self, remarks: Iterable[str] = ()) -> str:
        """The TOML text, which reads back as an equal object; remarks: comment lines at its top."""
        return "".join(f"# {line}\n" for line in remarks) + tomli_w.dumps(self.table())

    def to_toml(self, path: str | os.PathLike[str], remarks: Iterable[str] = ()) -> None:
        """Write the file whole or not at all, with `remarks` as comments; InputError where it
        cannot be written."""
        write_whole(path, self.dumps(remarks))

    @classmethod
    def from_toml(cls, path: str | os.PathLike[str]) -> Self:
        """Read a file written by hand or by `to_toml`; InputError with file, field and what is
        allowed."""
        return read_toml(path, lambda document: cls.from_document(document, Path(path).parent))


def sheet_fields(
    document: dict[str, Any],
    units: Mapping[str, str],
    also: tuple[str, ...] = (),
    rules: Mapping[str, Rule] | None = None,
) -> dict[str, Any]:
    """The fields that every law has, and the numbers of `rules`, from what a law leaves of a TOML
    document; units: of its table [units], also: keys that the law took. Raises InputError by key,
    and for a number that is missing."""
    fields = {"name": document.pop("name", ""), "compaction": compaction_of(document, units)}
    fields |= {"assumed": document.pop("assumed", ())}
    known, rules = (*also, *fields), rules or {}
    fields |= read_sheet_numbers(document, units, known, {**FIBRES, **rules})[0]
    check_complete(fields, (*SHEET, *rules), "", "at the top of the file")
    return fields
