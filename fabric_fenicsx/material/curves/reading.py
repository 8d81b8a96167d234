"""Data sets from files: `sheet.toml` and a CSV file a test."""

import csv
import dataclasses
import difflib
import math
import re
import tomllib
from pathlib import Path

import numpy as np

from ...runtime.errors import InputError
from ...runtime.rules import unknown_key
from ..files import FIBRES, read_numbers, read_sheet_numbers
from ..laws.coupled import SHEAR, YARN
from ..units import UNITS, factors
from . import checks
from .forces import of_fabric, response
from .model import (
    COLUMNS,
    COMPACTION,
    KEYS,
    MIN_POINTS,
    STRAINS,
    TESTS,
    CompactionTest,
    Curve,
    Response,
    Sheet,
    Table,
    keys_of,
    unit_inside,
    units,
)

_LENGTH = factors("length")


def read(folder: Path | str) -> tuple[Sheet, tuple[Curve, ...]]:
    """Sheet, which has the tests of compaction, and curves of a data set; InputError by file, row
    and reason, also for two curves that contradict."""
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(
            f"{folder} is not a folder; allowed is one with a sheet.toml and a CSV file for each "
            "test"
        )
    sheet = read_sheet(folder / "sheet.toml")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".csv")
    if not paths:
        raise InputError(
            f"{folder} has no *.csv; allowed is a folder with a CSV file for each test"
        )
    tests = [_read_test(path, sheet.thickness) for path in paths]
    curves = tuple(test for test in tests if isinstance(test, Curve))
    checks.check_contradictions(curves, sheet.balanced)
    compaction = tuple(test for test in tests if isinstance(test, CompactionTest))
    checks.check_fibres(compaction, sheet)
    return dataclasses.replace(sheet, compaction=compaction), curves


def read_sheet(path: Path | str) -> Sheet:
    """Read `sheet.toml`: name, thickness_mm, density_g_per_cm3 or areal_weight_g_per_m2, balanced,
    and optional fibre_density_g_per_cm3, [assumed], [assumed.warp], [assumed.weft] with parameters
    as in a material file (d_MPa, p_min, ..). Raises InputError by file and key."""
    try:
        document = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is not valid TOML ({error})") from None
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})"
        ) from None
    try:
        name, balanced, assumed = (
            document.pop("name", ""),
            document.pop("balanced", None),
            document.pop("assumed", {}),
        )
        given = document.pop("units", {})
        if not isinstance(name, str):
            raise InputError(f"name is {name!r}; allowed is a text")
        if not isinstance(balanced, bool):
            raise InputError(
                f"balanced is {balanced!r}; allowed is true (warp and weft are equal) or false"
            )
        if not isinstance(assumed, dict) or not isinstance(given, dict):
            raise InputError("assumed or units is no table; allowed are tables")
        for kind, unit in given.items():
            if kind not in UNITS or unit not in UNITS[kind]:
                raise unknown_key(
                    unit, [u for us in UNITS.values() for u in us], f"units.{kind} {unit!r}"
                )
        numbers, weight = read_sheet_numbers(
            document, given, ("name", "balanced", "assumed", "units"), FIBRES
        )
        if "thickness" not in numbers:
            raise InputError(
                "missing thickness; allowed is thickness_mm = 1.2, for example: "
                "by it a force per width (N/mm) becomes a stress and an areal weight a density"
            )
        if "density" not in numbers:
            raise InputError(
                "missing density; allowed is density_g_per_cm3 or areal_weight_g_per_m2"
            )
        values: dict[str, float] = {}
        for yarn in ("warp", "weft"):
            table = assumed.pop(yarn, {})
            if balanced and table:
                raise InputError(
                    f"assumed.{yarn} is given for a balanced fabric; allowed is [assumed] for "
                    "both directions"
                )
            values |= {
                f"{yarn}.{k}": v
                for k, v in read_numbers(table, YARN, given, f"assumed.{yarn}.").items()
            }
        values = (
            read_numbers(assumed, {**YARN, **SHEAR}, given, "assumed.", ("warp", "weft")) | values
        )
        known = numbers["thickness"], numbers["density"], balanced, values, weight
        return Sheet(name, *known, numbers.get("fibre_density"))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def read_curve(path: Path | str, thickness: float) -> Curve:
    """Read and check one CSV file of a test in the sheet's plane; thickness [mm] of the sheet turns
    shear forces into stresses. InputError by file and row."""
    found = _read_test(path, thickness)
    if isinstance(found, CompactionTest):
        raise InputError(
            f"{path}: the test is {COMPACTION}, across the sheet; allowed is one in its plane"
        )
    return found


def _read_test(path, thickness):
    """The `Curve` or `CompactionTest` in a CSV file."""
    try:
        lines = Path(path).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read as text ({getattr(error, 'strerror', None) or error})"
        ) from None
    try:
        return _parse(Path(path).name, lines, thickness)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _fail(row, text):
    return InputError(f"row {row}: {text}")


def _parse(file, lines, thickness):
    keys, lines = _keys(lines)
    name, noise = _test_of(keys), keys.pop("noise", None)
    free, lateral, others = _lateral(keys, name)
    test = TESTS[name]
    lengths = {key: _quantity(key, row, text, _LENGTH) for key, (row, text) in keys.items()}
    table = _table(lines, name, (*test.measured, *lateral), others, thickness)
    if name == COMPACTION:
        return _compaction_test(file, table, noise)
    _convert_raw(table, name, lengths, thickness)
    columns, rows = table.columns, table.rows
    found = [column for column in (*test.measured, *lateral) if column in columns]
    if {"tau", "F_sh"} <= set(found):
        raise InputError("both columns tau and F_sh are given; allowed is one of them")
    if len(rows) < MIN_POINTS:
        raise _fail(
            rows[-1] if rows else table.top,
            f"the file ends after {len(rows)} points; allowed is {MIN_POINTS} or more",
        )
    runs = max(test.strains, key=lambda column: np.ptp(columns[column]))
    checks.check_values(name, table, runs, found)
    strains = np.zeros((len(rows), 3))
    for column in (*test.strains, *test.optional):
        if column in columns:
            strains[:, STRAINS.index(column)] = columns[column]
    responses = [
        response(column, columns[column], strains[:, 2], name, lengths, thickness)
        for column in found
    ]
    return Curve(
        file,
        name,
        strains,
        tuple(responses),
        np.array(rows),
        STRAINS.index(runs),
        free,
        _noise(noise, responses, thickness),
        lengths,
    )


def _compaction_test(file, table, noise):
    checks.check_compaction(table)
    (column,) = (name for name in table.columns if name != "pressure")
    values = table.columns[column]
    response = Response(column, unit_inside(column), values, np.ones(len(values)))
    stated = _noise(noise, [response], math.nan)
    return CompactionTest(file, table.columns["pressure"], response, np.array(table.rows), stated)


def _test_of(keys):
    """The name of the test, taken out of the keys; InputError for keys that it does not have, or
    lacks."""
    if "test" not in keys:
        raise InputError(f"no line `# test: ...` states the test; allowed are {', '.join(TESTS)}")
    row, name = keys.pop("test")
    if name not in TESTS:
        raise _fail(row, str(unknown_key(name, TESTS, f"test {name!r}")))
    known = ("noise", *keys_of(TESTS[name]))
    for key, (row, _) in keys.items():
        if key not in known:
            raise _fail(
                row,
                f"the key {key} does not belong to the test {name}; allowed are {', '.join(known)}",
            )
    if missing := [key for key in TESTS[name].keys if key not in keys]:
        form = f"`# {missing[0]}: 200 mm`, for example"
        if missing[0] == "lateral":
            form = "`# lateral: held` (eps = 0 across) or `# lateral: free` (stress = 0 across)"
        raise InputError(f"the test {name} needs a line for {missing[0]}; allowed is {form}")
    return name


def _lateral(keys, name):
    """What the key `lateral`, taken out of the keys, says: the yarns with free sides (0, 1 or
    None), columns that may be measured besides, and what to say of a column that is 0."""
    if "lateral" not in keys:
        return None, (), {}
    row, lateral = keys.pop("lateral")
    if lateral not in ("held", "free"):
        raise _fail(row, f"lateral is {lateral!r}; allowed is held or free")
    across = "b" if name[-1] == "a" else "a"
    strain, stress = f"eps_{across}", f"sigma_{across}"
    zero, measured, other = (
        (strain, stress, "free") if lateral == "held" else (stress, strain, "held")
    )
    words = (
        f"lateral: {lateral} says that {zero} is 0, but there is a column {zero}; "
        f"allowed is `# lateral: {other}`, or the test biaxial if it was prescribed"
    )
    return "ab".index(name[-1]) if lateral == "free" else None, (measured,), {zero: words}


def _convert_raw(table, name, lengths, thickness):
    """Add to the table what follows from what a machine writes."""
    for raw, (column, key) in TESTS[name].raw.items():
        if raw not in table.columns:
            continue
        if key not in lengths:
            unit = "N/mm" if raw == "F" else "%"
            raise _fail(
                table.top,
                f"the column {raw} needs the strip's {key}; allowed is a line `# {key}: 50 mm`, "
                f"or the column {column} [{unit}]",
            )
        table.columns[column] = of_fabric(raw, table.columns[raw], name, lengths, thickness)
        table.header[column] = unit_inside(column)


def _keys(lines):
    """The keys of comment lines as {key: (row, value)}, and the other lines as (row, line)."""
    keys, table = {}, []
    for row, line in enumerate(lines, 1):
        if not line.strip(" ,;\t"):
            continue
        if not line.lstrip().startswith("#"):
            table.append((row, line))
        elif match := re.match(r"\s*#\s*(\w+)\s*:\s*(.*?)[\s,;]*$", line):
            key, value = match.groups()
            if key in keys:
                raise _fail(row, f"the key {key} is repeated; allowed is once")
            if key in KEYS:
                keys[key] = row, value
            elif near := difflib.get_close_matches(key, KEYS, 1, 0.75):
                hint = f"(did you mean {near[0]}?); allowed are {', '.join(KEYS)}"
                raise _fail(row, f"the key {key} is unknown {hint}")
    return keys, table


def _table(lines, name, measured, others, thickness):
    """The `Table` of lines (row, text); measured: columns that the test may have measured; others:
    what to say of columns that it cannot have."""
    if not lines:
        raise InputError("there is no header; allowed is a line such as eps_a [%], sigma_a [MPa]")
    (top, text), *body = lines
    delimiter = ";" if ";" in text else ","
    header: dict[str, str] = {}
    for cell in next(csv.reader([text], delimiter=delimiter)):
        column, unit = _column(top, cell, name, measured, others)
        if column in header:
            raise _fail(top, f"the column {column} is repeated; allowed is once")
        header[column] = unit
    _check_header(top, name, header)
    factors = {column: units(column, thickness)[unit] for column, unit in header.items()}
    values = [
        _numbers(row, next(csv.reader([text], delimiter=delimiter)), factors) for row, text in body
    ]
    columns = dict(zip(header, np.array(values).reshape(-1, len(header)).T))
    return Table(columns, header, [row for row, _ in body], top)


def _column(top, cell, name, measured, others):
    """Name and unit of a column, from its cell in the header."""
    test = TESTS[name]
    allowed = (*test.strains, *test.optional, *measured, *test.raw)
    match = re.fullmatch(r"\s*(\w+)\s*(?:\[\s*(.+?)\s*\])?\s*", cell)
    column, unit = match.groups() if match else (cell.strip(), None)
    if column not in COLUMNS:
        raise _fail(top, str(unknown_key(column, allowed, f"column {column!r}")))
    if column in others:
        raise _fail(top, others[column])
    if column not in allowed:
        raise _fail(
            top,
            f"the column {column} does not belong to the test {name}; allowed are "
            f"{', '.join(allowed)}",
        )
    if unit is None:
        raise _fail(
            top,
            f"the column {column} has no unit; allowed is {column} [{unit_inside(column)}], "
            "for example",
        )
    if unit not in units(column):
        raise _fail(top, str(unknown_key(unit, units(column), f"unit [{unit}] of column {column}")))
    return column, unit


def _check_header(top, name, header):
    """InputError for a header that lacks a column, or tells one twice."""
    test, told = TESTS[name], set(header)
    for raw, (column, _) in test.raw.items():
        if raw in header and column in header:
            raise _fail(top, f"both columns {column} and {raw} are given; allowed is one of them")
        told |= {column} if raw in header else set()
    missing = [column for column in test.strains if column not in told]
    if not set(test.measured) & told:
        missing.append(" or ".join(test.measured))
    if missing:
        raise _fail(top, f"the column {missing[0]} is missing, which the test {name} needs")


def _numbers(row, cells, factors):
    """Values of a row, each times the factor of its column."""
    if len(cells) != len(factors):
        raise _fail(
            row,
            f"there are {len(cells)} cells under {len(factors)} columns; "
            "allowed is one number a column, with a decimal point",
        )
    found = []
    for cell, (column, factor) in zip(cells, factors.items()):
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise _fail(
                row,
                f"{column} is {cell.strip()!r}; allowed is a finite number with a decimal point",
            )
        found.append(value * factor)
    return found


def _quantity(key, row, text, factors):
    match = re.fullmatch(r"\s*([-+.\deE]+)\s*(\S+)\s*", text)
    try:
        value = float(match[1]) * factors[match[2]] if match else math.nan
    except (KeyError, ValueError):
        value = math.nan
    if not 0 < value < math.inf:
        allowed = ", ".join(factors)
        raise _fail(
            row,
            f"{key} is {text!r}; allowed is a number above 0 with one of the units {allowed}",
        )
    return value


def _noise(given, responses, thickness):
    if given is None:
        return None
    row, text = given
    if match := re.fullmatch(r"([.\deE+-]+)\s*%\s*of\s*(maximum|value)", text):
        size = _quantity("noise", row, f"{match[1]} %", {"%": 0.01})
        if size >= 1:
            raise _fail(
                row, f"noise is {text!r}, which leaves nothing measured; allowed is below 100 %"
            )
        return match[2], size
    if len(responses) > 1 or "%" in text:
        raise _fail(
            row,
            f"noise is {text!r}; allowed is `2 % of maximum` or `2 % of value`, "
            "or a number with a unit if one column is measured",
        )
    return "absolute", _quantity("noise", row, text, units(responses[0].column, thickness))
