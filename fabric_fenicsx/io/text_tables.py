"""Tables of numbers in text files: lines above the header, and units in it or in the row below.

Cells stand between the first of these signs that the header has: semicolon, tab, comma; without
one between blanks. Decimals follow a comma if any number has one, else a point.
"""

import csv
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.errors import InputError

_SPELLINGS = {"µm": "um", "μm": "um", "°": "deg", "N/mm²": "N/mm2", "g/m²": "g/m2"}
_HEADER = re.compile(r"\s*(.*?)\s*(?:[\[(]\s*(.*?)\s*[\])]|(?:/|\bin\b)\s*(\S+))?\s*")
_NUMBER = re.compile(r"\s*[+-]?[.,]?\d[\d.,]*(?:[eE][+-]?\d+)?\s*")


class Problems(list[str]):
    """Faults of a file, raised at once: `with problems:` keeps an InputError of its block, `stop`
    raises one of all that were kept."""

    def __enter__(self) -> "Problems":
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        is_kept = isinstance(error, InputError)
        self += [str(error)] if is_kept else []
        return is_kept

    def stop(self) -> None:
        """InputError of all problems, if there are any."""
        if self:
            raise InputError("; ".join(dict.fromkeys(self)))


class TextTable(NamedTuple):
    """The cells below a header: its line number `top`, names and units (None where there is none)
    of the columns, and line numbers and cells of the rows."""

    top: int
    names: list[str]
    units: list[str | None]
    rows: list[int]
    cells: list[list[str]]


def read_lines(path: str | os.PathLike[str], encoding: str | None = None) -> list[str]:
    """The lines of a text file, in UTF-8 or Windows' Latin encoding unless another one is stated;
    InputError without the file's name where it is none."""
    try:
        data = Path(path).read_bytes()
        if data.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):  # as files of Excel begin
            raise ValueError("it is a workbook; save its sheet as CSV")
        try:
            text = data.decode(encoding or "utf-8-sig")
        except UnicodeDecodeError:
            if encoding:
                raise
            text = data.decode("cp1252", errors="replace")
        if "\0" in text or not text.strip():
            raise ValueError("it has bytes that are no text in UTF-8" if text else "it is empty")
    except (OSError, ValueError, LookupError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be read as text ({reason}); allowed is CSV in UTF-8") from None
    return text.splitlines()


def table_of(
    lines: Sequence[str],
    is_known: Callable[[str], bool],
    usual: Sequence[str] = (),
    delimiter: str | None = None,
) -> TextTable:
    """The table in lines, without comments; is_known: whether a column of a name is asked for;
    usual: names of the columns where no header has such a name. InputError where there is no
    table."""
    # a spreadsheet puts a comment in quotes
    texts = [
        (row, text)
        for row, text in enumerate(lines, 1)
        if text.strip(" ,;\t") and not text.lstrip(' \t"').startswith("#")
    ]
    split = [(row, _split(text, delimiter or _delimiter(text))) for row, text in texts]
    known = (k for k, (_, cells) in enumerate(split) if any(is_known(_parted(c)[0]) for c in cells))
    top = next(known, -1)
    if top < 0 and usual and split:
        names = [*usual[: len(split[0][1])]]
        return TextTable(0, names, [None] * len(names), *map(list, zip(*split)))
    if top < 0:  # what stands above the first row of numbers
        counts = (sum(map(bool, map(_NUMBER.fullmatch, cells))) for _, cells in split)
        top = next((k for k, count in enumerate(counts) if count > 1), len(split)) - 1
    if top < 0:
        raise InputError("there is no header; allowed is a line such as eps_a [%], sigma_a [MPa]")
    row, header = split[top]
    delimiter = delimiter or _delimiter(texts[top][1])
    body = [(row, _split(text, delimiter)) for row, text in texts[top + 1 :]]
    header = header[: max((k for k, c in enumerate(header) if c.strip()), default=0) + 1]
    names, units = map(list, zip(*map(_parted, header)))
    if body and not any(re.match(r"\s*[+-]?[.,]?\d", cell) for cell in body[0][1]):
        below, cells = body.pop(0)
        for k, cell in enumerate(cells[: len(units)]):
            unit = _unit(cell.strip(" []()"))
            if unit and unit != (units[k] or unit):
                two = f"{unit}, and {units[k]} in the header"
                raise InputError(f"row {below}: the unit of {names[k]} is {two}; allowed is one")
            units[k] = units[k] or unit
    for _, cells in body:
        while len(cells) > len(header) and not cells[-1].strip():
            cells.pop()
    return TextTable(row, names, units, [row for row, _ in body], [cells for _, cells in body])


def _parted(cell):
    """Name and unit, None without one, in a cell of a header."""
    match = _HEADER.fullmatch(cell)
    name, *units = match.groups() if match else (cell.strip(), None)
    return name, _unit(next(filter(None, units), None))


def _unit(text):
    return _SPELLINGS.get(text, text) or None


def _delimiter(text):
    return next((sign for sign in ";\t," if sign in text), " ")


def _split(text, delimiter):
    if delimiter == " ":
        return text.split()
    return next(csv.reader([text], delimiter=delimiter, skipinitialspace=True))


def values_of(
    table: TextTable,
    factors: Mapping[int, tuple[str, float]],
    problems: Problems,
    decimal: str | None = None,
) -> dict[str, np.ndarray]:
    """The numbers of columns {number: (name, factor)}, {name: (n,)}, each times its factor.
    Problems of rows and cells go to `problems`, and a column's value there is nan."""
    columns = {name: np.full(len(table.rows), math.nan) for name, _ in factors.values()}
    odd, wrong, found = list[str](), list[str](), []
    for k, (row, cells) in enumerate(zip(table.rows, table.cells)):
        if len(cells) == len(table.names):
            found += [(k, *factors[i], cells[i].strip()) for i in factors]
        else:
            odd.append(f"row {row}: {len(cells)} cells")
    if odd:
        problems.append(
            f"{some(odd)} under {len(table.names)} columns; allowed is one number a column (a "
            "decimal comma needs semicolons or tabs between them)"
        )
    commas = [each for each in found if "," in each[-1] and _NUMBER.fullmatch(each[-1])]
    grouped = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
    if not decimal and commas and all(grouped.fullmatch(cell) for *_, cell in commas):
        k, name, _, cell = commas[0]
        problems.append(
            f"row {table.rows[k]}: {name} is {cell!r}, which may mean {cell.replace(',', '.')} or "
            f"{cell.replace(',', '')}; allowed is a point before decimals, and no sign between "
            "thousands"
        )
        return columns
    decimal = decimal or ("," if commas else ".")
    # Python would take underscores between thousands
    signs = str.maketrans({"\u2212": "-", "_": "?", ".": "?"} | {decimal: "."})
    for k, name, factor, cell in found:
        with suppress(ValueError):
            columns[name][k] = float(cell.translate(signs)) * factor
        if not math.isfinite(columns[name][k]):
            wrong.append(f"row {table.rows[k]}: {name} is {cell!r}")
    if wrong:
        problems.append(
            f"{some(wrong)}; allowed is a finite number, as 1058{decimal}5, with the same sign "
            "before all decimals and none between thousands"
        )
    return columns


def columns_of(
    table: TextTable, units: Mapping[str, Mapping[str | None, float]], optional: Sequence[str] = ()
) -> dict[str, np.ndarray]:
    """The numbers of columns by their names, {name: (n,)}; units: {name: {unit: factor}}, in which
    None stands for no unit; optional: those that may be missing. InputError by row, of all that is
    wrong."""
    factors, problems = {}, Problems()
    for name, known in units.items():
        k = table.names.index(name) if name in table.names else -1
        if k >= 0 and table.units[k] in known:
            factors[k] = name, known[table.units[k]]
        elif k >= 0 or name not in optional:
            flaw = f"the unit of {name} is {table.units[k]}" if k >= 0 else f"no column {name}"
            words = ", ".join(unit for unit in known if unit)
            raise InputError(f"row {table.top}: {flaw}; allowed is one in {words}")
    values = values_of(table, factors, problems)
    problems.stop()
    return values


def some(texts: Sequence[str]) -> str:
    """The first five texts of a list, and how many more there are."""
    return ", ".join(texts[:5]) + (f" and {len(texts) - 5} more" if len(texts) > 5 else "")
