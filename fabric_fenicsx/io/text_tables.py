"""Tables of numbers in text files: lines above the header, and units in it or in the row below.

Cells stand between the first of these signs that the header has: semicolon, tab, comma; without
one between blanks. Decimals follow a comma if any number has one, else a point.
"""

import csv
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.errors import InputError

_SPELLINGS = {"µm": "um", "μm": "um", "°": "deg", "N/mm²": "N/mm2", "g/m²": "g/m2", "": None}
_HEADER = re.compile(r"^\s*(.*?)\s*(?:[\[(]\s*(.*?)\s*[\])]|(?:/|\bin\b)\s*(\S+))?\s*$")
_NUMBER = re.compile(r"\s*[+-]?[.,]?\d[\d.,]*(?:[eE][+-]?\d+)?\s*")


class TextTable(NamedTuple):
    """The cells below a header: its line number `top`, names and units (None where there is none)
    of the columns, and line numbers and cells of the rows."""

    top: int
    names: list[str]
    units: list[str | None]
    rows: list[int]
    cells: list[list[str]]


def read_lines(path: str | os.PathLike[str], encoding: str | None = None) -> list[str]:
    """The lines of a text file, in UTF-8, UTF-16 with its mark, or Windows' Latin encoding unless
    another one is stated; InputError without the file's name where it is none."""
    try:
        data = Path(path).read_bytes()
        if data.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):  # as files of Excel begin
            raise ValueError("it is a workbook; save its sheet as CSV")
        marked = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
        try:
            text = data.decode(encoding or marked)
        except UnicodeDecodeError:
            if encoding:
                raise
            text = data.decode("cp1252", errors="replace")
        if "\0" in text or not text.strip():
            raise ValueError("it is not text in UTF-8" if text else "it is empty")
    except (OSError, ValueError, LookupError) as error:
        reason = getattr(error, "strerror", None) or error
        allowed = "CSV in UTF-8, or in UTF-16 with its byte order mark"
        raise InputError(f"cannot be read as text ({reason}); expected {allowed}") from None
    return text.splitlines()


def table_of(
    lines: Sequence[str],
    is_known: Callable[[str], bool],
    usual: Sequence[str] = (),
    delimiter: str | None = None,
) -> TextTable:
    """The table in lines, without comments; is_known: whether a column of a name is asked for;
    usual: names of the columns where no header has such a name. InputError where there is no
    table, or a row has other cells than it."""
    texts = {  # a spreadsheet puts a comment in quotes
        row: text
        for row, text in enumerate(lines, 1)
        if text.strip(" ,;\t") and not text.lstrip(' \t"').startswith("#")
    }
    split = {row: _split(text, delimiter or _delimiter(text)) for row, text in texts.items()}
    known = (k for k, cells in split.items() if any(is_known(_parted(cell)[0]) for cell in cells))
    numeric = [k for k, cells in split.items() if sum(map(bool, map(_NUMBER.fullmatch, cells))) > 1]
    above = [0, *(row for row in split if row < min(numeric, default=math.inf))]
    top = next(known, 0 if usual else above[-1])
    if not top and not (usual and split):
        allowed = "a line such as eps_a [%], sigma_a [MPa]"
        raise InputError(f"there is no header; expected {allowed}")
    header = split[top] if top else [*usual[: len(split[min(split)])]]
    while len(header) > 1 and not header[-1].strip():
        header.pop()
    names, units = map(list, zip(*map(_parted, header)))
    sign = delimiter or _delimiter(texts[top or min(texts)])
    body = {row: _split(text, sign) for row, text in texts.items() if row > top}
    below = min(body, default=0)
    if top and below and not any(re.match(r"\s*[+-]?[.,]?\d", cell) for cell in body[below]):
        for k, cell in enumerate(body.pop(below)[: len(units)]):
            unit = _unit(cell.strip(" []()"))
            if unit and unit != (units[k] or unit):
                two = f"{unit}, and {units[k]} in the header"
                raise InputError(f"row {below}: the unit of {names[k]} is {two}; expected one")
            units[k] = units[k] or unit
    for cells in body.values():
        while len(cells) > len(header) and not cells[-1].strip():
            cells.pop()
    odd = [f"row {row}: {len(c)} cells" for row, c in body.items() if len(c) != len(header)]
    if odd:
        raise InputError(
            f"{some(odd)} under {len(header)} columns; expected one number a column (a decimal "
            "comma needs semicolons or tabs between them)"
        )
    return TextTable(top, names, units, [*body], [*body.values()])


def _parted(cell):
    """Name and unit, None without one, in a cell of a header."""
    ((name, *units),) = _HEADER.findall(cell)
    return name, _unit("".join(units))


def _unit(text):
    return _SPELLINGS.get(text, text)


def _delimiter(text):
    return next((sign for sign in ";\t," if sign in text), " ")


def _split(text, delimiter):
    if delimiter == " ":  # but not before a unit in brackets
        return re.split(r"\s+(?![\[(])", text.strip())
    return next(csv.reader([text], delimiter=delimiter, skipinitialspace=True))


def values_of(
    table: TextTable, factors: Mapping[int, tuple[str, float]], decimal: str | None = None
) -> dict[str, np.ndarray]:
    """The numbers of columns {number: (name, factor)}, {name: (n,)}, each times its factor.
    InputError by row, of all that is wrong; decimal: the sign before decimals, if it is stated."""
    columns = [[cells[i].strip() for cells in table.cells] for i in factors]
    found = [
        (f"row {row}: {name} is {cell!r}", cell)
        for (name, _), column in zip(factors.values(), columns)
        for row, cell in zip(table.rows, column)
    ]
    sign = "," if any("," in cell and _NUMBER.fullmatch(cell) for _, cell in found) else "."
    signed = [(words, cell) for words, cell in found if sign in cell and _NUMBER.fullmatch(cell)]
    grouped = re.compile(rf"[+-]?[1-9]\d{{0,2}}([{sign}]\d{{3}})+")
    is_unclear = signed and all(grouped.fullmatch(cell) for _, cell in signed)
    if not decimal and is_unclear and (sign == "," or any(map(_has_jump, columns))):
        words, cell = signed[0]
        meant = f"{cell.replace(',', '.')} or {cell.replace(sign, '')}"
        allowed = "decimal points in all rows, and no thousands separators"
        raise InputError(f"{words}, which may mean {meant}; expected {allowed}")
    decimal = decimal or sign
    # Python would take underscores between thousands
    signs = str.maketrans({"\u2212": "-", "_": "?", ".": "?"} | {decimal: "."})
    numbers = [number_of(cell.translate(signs)) for _, cell in found]
    if wrong := [words for (words, _), number in zip(found, numbers) if not math.isfinite(number)]:
        raise InputError(
            f"{some(wrong)}; expected a finite number, as 1058{decimal}5, with the same sign "
            "before all decimals and no thousands separators"
        )
    values = np.reshape(numbers, (len(factors), len(table.rows)))
    return {name: factor * column for (name, factor), column in zip(factors.values(), values)}


def _has_jump(cells):
    """Whether a number is next to a whole one that is nearer to it without its point: 1.185 after
    875, by a factor of more than the root of 1000."""
    return any(
        "." in cell and "." not in whole and abs(number_of(whole)) > 31.6 * abs(number_of(cell))
        for cell, whole in [*pairwise(cells), *pairwise(cells[::-1])]
    )


def number_of(text: str) -> float:
    """The number that a text is, nan if it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def columns_of(
    table: TextTable, units: Mapping[str, Mapping[str | None, float]], optional: Sequence[str] = ()
) -> dict[str, np.ndarray]:
    """The numbers of columns by their names, {name: (n,)}; units: {name: {unit: factor}}, in which
    None stands for no unit; optional: those that may be missing. InputError by row, of all that is
    wrong."""
    factors = {}
    for name, known in units.items():
        k = table.names.index(name) if name in table.names else -1
        if k >= 0 and table.units[k] in known:
            factors[k] = name, known[table.units[k]]
        elif k >= 0 or name not in optional:
            flaw = f"the unit of {name} is {table.units[k]}" if k >= 0 else f"no column {name}"
            words = ", ".join(unit for unit in known if unit)
            raise InputError(f"row {table.top}: {flaw}; expected one in {words}")
    return values_of(table, factors)


def some(texts: Sequence[str]) -> str:
    """The first five texts of a list, and how many more there are."""
    return ", ".join(texts[:5]) + (f" and {len(texts) - 5} more" if len(texts) > 5 else "")
