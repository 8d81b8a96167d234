"""Tables of numbers in text files: cells between semicolons, tabs, commas or blanks; lines above
the header; units in the header or in the row below it. What is not stated is sniffed.
"""

import csv
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..runtime.errors import InputError

ENCODINGS = "utf-8-sig", "cp1252"
MAX_LISTED = 5  # cells of one fault that a message names
_WORKBOOKS = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"  # how files of Excel begin
_SPELLINGS = {"µm": "um", "μm": "um", "°": "deg", "N/mm²": "N/mm2", "g/m²": "g/m2"}
_HEADER = re.compile(r"\s*(.*?)\s*(?:[\[(]\s*(.*?)\s*[\])]|(?:/|\bin\b)\s*(\S+))?\s*")
_NUMBER = re.compile(r"\s*[+-]?[.,]?\d[\d.,]*(?:[eE][+-]?\d+)?\s*")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")


class Problems(list[str]):
    """Faults of a file, raised at once: `with problems:` keeps an InputError of its block, `stop`
    raises one of all that were kept."""

    def __enter__(self) -> "Problems":
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> bool:
        if isinstance(error, InputError):
            self.append(str(error))
            return True
        return False

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
    text, reason = "", ""
    try:
        data = Path(path).read_bytes()
        try:
            text = data.decode(encoding or ENCODINGS[0])
        except UnicodeDecodeError:
            if encoding:
                raise
            text = data.decode(ENCODINGS[1], errors="replace")
        if data.startswith(_WORKBOOKS):
            reason = "it is a workbook; save its sheet as CSV"
        elif "\0" in text or not text.strip():
            reason = "it has bytes that are no text in UTF-8" if text.strip() else "it is empty"
    except (OSError, ValueError, LookupError) as error:
        reason = getattr(error, "strerror", None) or str(error)
    if reason:
        raise InputError(f"cannot be read as text ({reason}); allowed is a CSV file in UTF-8")
    return text.splitlines()


def table_of(
    lines: Sequence[str],
    is_known: Callable[[str], bool],
    usual: Sequence[str] = (),
    delimiter: str | None = None,
) -> TextTable:
    """The table in lines, without comments; is_known: whether a column of a name is asked for;
    usual: names of the columns where no header has such a name. InputError by row where there is no
    table."""
    rows = [(row, text) for row, text in enumerate(lines, 1) if text.strip(" ,;\t")]
    # a spreadsheet puts a comment in quotes
    rows = [(row, text) for row, text in rows if not text.lstrip(' \t"').startswith("#")]
    top = first = -1
    for k, (_, text) in enumerate(rows):
        cells = _split(text, delimiter or _delimiter(text))
        if any(is_known(_parted(cell)[0]) for cell in cells):
            top = k
            break
        if first < 0 and sum(map(bool, map(_NUMBER.fullmatch, cells))) > 1:
            first = k
    if top < 0 and not usual:
        top = first - 1 if first >= 0 else len(rows) - 1
    if top < 0 and not (usual and rows):
        where = f"row {rows[0][0]}: there is no header above it" if rows else "there is no header"
        raise InputError(f"{where}; allowed is a line such as eps_a [%], sigma_a [MPa]")
    delimiter = delimiter or _delimiter(rows[max(top, 0)][1])
    split = [(row, _split(text, delimiter)) for row, text in rows]
    if top < 0:
        numbers, cells = map(list, zip(*split))
        return TextTable(0, [*usual], [None] * len(usual), numbers, cells)
    row, header = split[top]
    body = split[top + 1 :]
    header = header[: max((k for k, c in enumerate(header) if c.strip()), default=0) + 1]
    names, units = map(list, zip(*map(_parted, header)))
    if body and not any(re.match(r"\s*[+-]?[.,]?\d", cell) for cell in body[0][1]):
        units = _with_row_of_units(names, units, *body.pop(0))
    for _, cells in body:
        while len(cells) > len(header) and not cells[-1].strip():
            cells.pop()
    return TextTable(row, names, units, [row for row, _ in body], [cells for _, cells in body])


def _with_row_of_units(names, units, row, cells):
    """The units of a header, or of the row below it where it has none."""
    below = [_unit(cell.strip(" []()")) for cell in cells] + [None] * len(units)
    for name, unit, other in zip(names, units, below):
        if unit and other and unit != other:
            units = f"{other}, and {unit} in the header"
            raise InputError(f"row {row}: the unit of {name} is {units}; allowed is one")
    return [unit or other for unit, other in zip(units, below)]


def _parted(cell):
    """Name and unit, None without one, in a cell of a header."""
    match = _HEADER.fullmatch(cell)
    name, *units = match.groups() if match else (cell.strip(), None)
    return name, _unit(next(filter(None, units), None))


def _unit(text):
    return _SPELLINGS.get(text, text) or None


def _split(text, delimiter):
    if delimiter == " ":
        return text.split()
    return next(csv.reader([text], delimiter=delimiter, skipinitialspace=True))


def _delimiter(text):
    """The delimiter of a line; blanks only between numbers, as names may have some."""
    if sure := next((sign for sign in ";\t" if sign in text), ""):  # a comma may be a decimal one
        return sure
    blank = " " if all(map(_NUMBER.fullmatch, text.split())) else ""
    try:
        return csv.Sniffer().sniff(text, "," + blank).delimiter
    except csv.Error:
        return blank or ","


def number(cell: str, decimal: str) -> float:
    """The number in a cell, nan where it has none; decimal: the sign before decimals."""
    text = cell.strip().replace("\u2212", "-")
    if "_" in text or (decimal == "," and "." in text):
        return math.nan
    try:
        return float(text.replace(decimal, "."))
    except ValueError:
        return math.nan


def _decimal(table, factors):
    """The sign before decimals, "." or ","; InputError where columns do not have the same one, or
    where commas may stand between thousands."""
    cells = [
        (row, name, cells[i].strip())
        for i, (name, _) in factors.items()
        for row, cells in zip(table.rows, table.cells)
        if i < len(cells) and _NUMBER.fullmatch(cells[i])
    ]
    points, commas = (
        [each for each in cells if mark in each[2] and other not in each[2]]
        for mark, other in (".,", ",.")
    )
    if points and commas:
        (row, name, cell), (there, other, point) = commas[0], points[0]
        raise InputError(
            f"row {row}: {name} is {cell!r}, with a decimal comma, and {other} in row {there} is "
            f"{point!r}, with a point; allowed is one of both in a file"
        )
    if commas and all(_THOUSANDS.fullmatch(cell) for *_, cell in commas):
        row, name, cell = commas[0]
        raise InputError(
            f"row {row}: {name} is {cell!r}, which may mean {cell.replace(',', '.')} or "
            f"{cell.replace(',', '')}; allowed is a point before decimals"
        )
    return "," if commas else "."


def values_of(
    table: TextTable,
    factors: Mapping[int, tuple[str, float]],
    problems: Problems,
    decimal: str | None = None,
) -> dict[str, np.ndarray]:
    """The numbers of columns {number: (name, factor)}, {name: (n,)}, each times its factor.
    Problems of rows and cells go to `problems`, and a column's value there is nan."""
    columns = {name: np.full(len(table.rows), math.nan) for name, _ in factors.values()}
    try:
        decimal = decimal or _decimal(table, factors)
    except InputError as error:
        problems.append(str(error))
        return columns
    lengths: dict[int, list[str]] = {}
    wrong: list[str] = []
    for k, (row, cells) in enumerate(zip(table.rows, table.cells)):
        if len(cells) != len(table.names):
            lengths.setdefault(len(cells), []).append(f"row {row}")
            continue
        for i, (name, factor) in factors.items():
            columns[name][k] = number(cells[i], decimal) * factor
            if not math.isfinite(columns[name][k]):
                wrong.append(f"row {row}: {name} is {cells[i].strip()!r}")
    for length, rows in lengths.items():
        problems.append(
            f"{some(rows)}: there are {length} cells under {len(table.names)} columns; allowed "
            "is one number a column (a decimal comma needs semicolons or tabs between them)"
        )
    if wrong:
        problems.append(f"{some(wrong)}; allowed is a finite number, as 1058.5")
    return columns


def some(texts: Sequence[str]) -> str:
    """The first texts of a list, and how many more there are."""
    more = len(texts) - MAX_LISTED
    return ", ".join(texts[:MAX_LISTED]) + (f" and {more} more" if more > 0 else "")
