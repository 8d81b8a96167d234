"""Tables of numbers in text files as testing machines write them.

What is read: UTF-8 and Windows' Latin encoding (cp1252); cells between semicolons, tabs, commas or
blanks; decimal points or commas, and thousands' separators; lines above the header; units in the
header or in a row of their own. What can mean two numbers is refused.
"""

import csv
import math
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..runtime.errors import InputError

BLANKS = " "
DELIMITERS = ";", "\t", ",", BLANKS
GROUPS = "'’\u00a0\u202f "  # between thousands, besides the sign that marks no decimals
MOST_TOLD = 5  # cells of one fault that a message names
_WORKBOOKS = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"  # how files of Excel begin
_SPELLINGS = {"µm": "um", "μm": "um", "°": "deg", "N/mm²": "N/mm2", "g/m²": "g/m2"}
_HEADER = re.compile(r"\s*(.*?)\s*(?:[\[(]\s*(.*?)\s*[\])]|(?:/|\bin\b)\s*(\S+))?\s*")


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


def read_lines(path: str | os.PathLike[str]) -> list[str]:
    """The lines of a text file; InputError without the file's name where it is none."""
    text, reason = "", ""
    try:
        data = Path(path).read_bytes()
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", errors="replace")
        if data.startswith(_WORKBOOKS):
            reason = "it is a workbook; save its sheet as CSV"
        elif "\0" in text or not text.strip():
            reason = "it has bytes that are no text in UTF-8" if text.strip() else "it is empty"
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
    if reason:
        raise InputError(f"cannot be read as text ({reason}); allowed is a CSV file in UTF-8")
    return text.splitlines()


def table_of(
    lines: Sequence[str], is_known: Callable[[str], bool], usual: Sequence[str] = ()
) -> TextTable:
    """The table in lines, without comments; is_known: whether a column of a name is asked for;
    usual: names of the columns where no header has such a name. InputError by row where there is no
    table."""
    rows = [(row, text) for row, text in enumerate(lines, 1) if text.strip(" ,;\t")]
    # a spreadsheet puts a comment in quotes
    rows = [(row, text) for row, text in rows if not text.lstrip(' \t"').startswith("#")]
    stated = re.findall("^sep=(.)$", rows[0][1]) if rows else []
    rows = rows[1:] if stated else rows
    delimiter = stated[0] if stated else _delimiter(rows)
    split = [(row, _split(text, delimiter)) for row, text in rows]
    is_data = [sum(map(_is_number, cells)) >= 2 for _, cells in split]
    known = [k for k, (_, cells) in enumerate(split) if any(is_known(_parted(c)[0]) for c in cells)]
    if known:  # of several headers the first counts, so that no rows are lost above another one
        first = [*is_data, True].index(True, known[0] + 1)
        top = max(k for k in known if k < first)
    else:
        runs = [[*run] for flag, run in groupby(range(len(split)), is_data.__getitem__) if flag]
        first = max(runs, key=len)[0] if runs else len(split)
        if usual:
            below, cells = zip(*split[first:]) if split[first:] else ((), ())
            return TextTable(first - 1, [*usual], [None] * len(usual), [*below], [*cells])
        top = first - 1
        while top > 0 and _are_units(split[top][1]):
            top -= 1
    if top < 0 or (not known and _are_units(split[top][1])):
        where = f"row {split[0][0]}: there is no header above it" if split else "there is no header"
        raise InputError(f"{where}; allowed is a line such as eps_a [%], sigma_a [MPa]")
    row, header = split[top]
    body = split[top + 1 :]
    header = header[: max((k for k, c in enumerate(header) if c.strip()), default=0) + 1]
    names, units = map(list, zip(*map(_parted, header)))
    if body and top + 1 < first and not any(re.match(r"\s*[+-]?\d", c) for c in body[0][1]):
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


def _are_units(cells):
    """True if cells are units in brackets, or known ones without."""
    texts = [cell.strip() for cell in cells if cell.strip()]
    return bool(texts) and all(
        re.fullmatch(r"\[.*\]|\(.*\)|mm|cm|s|k?N|%|deg|rad|[kMG]?Pa", c) for c in texts
    )


def _split(text, delimiter):
    if delimiter == BLANKS:  # names may have single blanks, and one before their unit
        cells = text.split()
        wide = re.split(r"\s{2,}", text.strip())
        if all(map(_is_number, cells)):
            return cells
        return wide if len(wide) > 1 else re.split(r"\s+(?![\[(])", text.strip())
    return next(csv.reader([text], delimiter=delimiter, skipinitialspace=True))


def _delimiter(lines):
    """The delimiter that gives most rows of two numbers or more, and then most numbers in them;
    without any such row, one that there is."""

    def score(delimiter):
        flags = [[*map(_is_number, _split(text, delimiter))] for _, text in lines]
        flags = [each for each in flags if sum(each) >= 2]
        return len(flags), sum(map(sum, flags)) / max(sum(map(len, flags)), 1)

    scores = {delimiter: score(delimiter) for delimiter in DELIMITERS}
    best = max(scores, key=lambda delimiter: scores[delimiter])
    present = (d for d in DELIMITERS[:3] if any(d in text for _, text in lines))
    return best if scores[best][0] else next(present, ",")


# by the sign for decimals: what may stand between thousands, and numbers
_GROUPING = {".": f"[{GROUPS},]", ",": f"[{GROUPS}.]"}
_NUMBERS = {
    mark: re.compile(
        rf"[+-]?(?:(?:[1-9]\d{{0,2}}(?:{between}\d{{3}})+|\d+)(?:[{mark}]\d*)?|[{mark}]\d+)"
        r"(?:[eE][+-]?\d+)?"
    )
    for mark, between in _GROUPING.items()
}


def _plain(cell):
    return cell.strip().replace("\u2212", "-")


def _is_number(cell):
    return any(pattern.fullmatch(_plain(cell)) for pattern in _NUMBERS.values())


def number(cell: str, decimal: str) -> float:
    """The number in a cell, nan where it has none; decimal: the sign before decimals."""
    if not _NUMBERS[decimal].fullmatch(_plain(cell)):
        return math.nan
    return float(re.sub(_GROUPING[decimal], "", _plain(cell)).replace(decimal, "."))


def decimal_signs(table: TextTable, wanted: Iterable[int]) -> list[str]:
    """The sign before decimals in each column, "." or ","; InputError where both could be meant in
    one of the columns `wanted`.

    A column of which alone it is not clear goes with the others, or has points.
    """
    columns, found = [], []
    for i in range(len(table.names)):
        cells = [(row, _plain(c[i])) for row, c in zip(table.rows, table.cells) if i < len(c)]
        columns.append([(row, cell) for row, cell in cells if _is_number(cell)])
        dot, comma = (sum(bool(p.fullmatch(c)) for _, c in cells) for p in _NUMBERS.values())
        found.append("" if dot == comma else "." if dot > comma else ",")
    others = {sign for sign in found if sign} or {"."}
    unsure = {".", ","} - (others if len(others) == 1 else set())
    for i in wanted:
        for row, cell in columns[i] if not found[i] else ():
            if unsure & {*cell}:
                either = f"{number(cell, ','):g} or {number(cell, '.'):g}"
                raise InputError(
                    f"row {row}: {cell} may mean {either}, as all numbers of its column have three "
                    "digits behind that sign; allowed is another number of decimals"
                )
    return [sign or min(others) for sign in found]


def values_of(
    table: TextTable, factors: Mapping[int, tuple[str, float]], problems: Problems
) -> dict[str, np.ndarray]:
    """The numbers of columns {number: (name, factor)}, {name: (n,)}, each times its factor.
    Problems of rows and cells go to `problems`, and a column's value there is nan."""
    signs = ["."] * len(table.names)
    with problems:
        signs = decimal_signs(table, factors)
    columns = {name: np.full(len(table.rows), math.nan) for name, _ in factors.values()}
    lengths: dict[int, list[str]] = {}
    wrong: list[str] = []
    for k, (row, cells) in enumerate(zip(table.rows, table.cells)):
        if len(cells) != len(table.names):
            lengths.setdefault(len(cells), []).append(f"row {row}")
            continue
        for i, (name, factor) in factors.items():
            columns[name][k] = number(cells[i], signs[i]) * factor
            if not math.isfinite(columns[name][k]):
                wrong.append(f"row {row}: {name} is {cells[i].strip()!r}")
    for length, rows in lengths.items():
        problems.append(
            f"{some(rows)}: there are {length} cells under {len(table.names)} columns; allowed "
            "is one number a column (a decimal comma needs semicolons or tabs between them)"
        )
    if wrong:
        problems.append(f"{some(wrong)}; allowed is a finite number")
    return columns


def some(texts: Sequence[str]) -> str:
    """The first texts of a list, and how many more there are."""
    more = len(texts) - MOST_TOLD
    return ", ".join(texts[:MOST_TOLD]) + (f" and {more} more" if more > 0 else "")
