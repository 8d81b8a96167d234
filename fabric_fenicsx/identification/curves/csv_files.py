"""One CSV file of a test: its keys, its columns, and the curve in them."""

import difflib
import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...readers.text_tables import Problems, read_lines, rows_of, table_of, values_of
from ...readers.units import factors
from ...runtime.errors import InputError
from ...runtime.rules import unknown_key
from . import checks
from .branches import loading_branch, without_slack
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
    Stated,
    Table,
    column_of,
    keys_of,
    unit_inside,
    units,
)

_LENGTH = factors("length")


class _Said(NamedTuple):
    """What the keys of a file say: `keys` {key: (place, text)} without those that the others hold.
    others: what to say of columns that the test cannot have."""

    test: str
    free: int | None
    measured: tuple[str, ...]
    others: dict[str, str]
    lengths: dict[str, float]
    keys: dict[str, tuple[str, str]]


def read_test(path: Path | str, thickness: float, stated: Stated) -> Curve | CompactionTest:
    """The test in a CSV file, of a sheet of this thickness [mm]; stated: what `sheet.toml` says of
    the files. InputError by file and row, of all that is wrong."""
    try:
        return _parse(Path(path).name, read_lines(path), thickness, stated)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _parse(file, lines, thickness, stated):
    problems = Problems()
    said = _said(_keys(lines, stated.keys.get(file, {}), problems), problems)
    with problems:
        cells = table_of(
            rows_of(lines), lambda name: name in stated.columns or column_of(name) in COLUMNS
        )
        table, unread = _table(cells, said, stated.columns, thickness, problems)
    problems.stop()
    if said.test == COMPACTION:
        return _compaction_test(file, table, said, unread)
    return _curve(file, table, said, thickness, unread)


def _curve(file, table, said, thickness, remarks):
    test = TESTS[said.test]
    column, slack = _slack(table, said)
    if slack:
        table = without_slack(table, column, slack)
    _convert_raw(table, said, thickness)
    runs = max(test.strains, key=lambda column: np.ptp(table.columns[column] if table.rows else 0))
    table, left_out = loading_branch(table, runs)
    columns, rows = table.columns, table.rows
    found = [column for column in said.measured if column in columns]
    if {"tau", "F_sh"} <= set(found):
        raise InputError("both columns tau and F_sh are given; allowed is one of them")
    if len(rows) < MIN_POINTS:
        raise _fail(
            f"row {rows[-1] if rows else table.top}",
            f"the file ends after {len(rows)} points; allowed is {MIN_POINTS} or more",
        )
    checks.check_values(said.test, table, runs, found)
    strains = np.zeros((len(rows), 3))
    for column in (*test.strains, *test.optional):
        if column in columns:
            strains[:, STRAINS.index(column)] = columns[column]
    gamma = strains[:, 2]
    responses = [
        response(column, columns[column], gamma, said.test, said.lengths, thickness)
        for column in found
    ]
    return Curve(
        file,
        said.test,
        strains,
        tuple(responses),
        np.array(rows),
        STRAINS.index(runs),
        said.free,
        _noise(said.keys.get("noise"), responses, thickness),
        said.lengths,
        (*remarks, *left_out, *checks.doubted_angles(said.test, table)),
        slack,
    )


def _compaction_test(file, table, said, remarks):
    table, left_out = loading_branch(table, "pressure")
    checks.check_compaction(table)
    (column,) = (name for name in table.columns if name != "pressure")
    values = table.columns[column]
    response = Response(column, unit_inside(column), values, np.ones(len(values)))
    noise = _noise(said.keys.get("noise"), [response], math.nan)
    remarks = (*remarks, *left_out)
    pressure = table.columns["pressure"]
    return CompactionTest(file, pressure, response, np.array(table.rows), noise, remarks)


def _fail(place, text):
    return InputError(f"{place}: {text}")


# -- keys


def _keys(lines, stated, problems):
    """{key: (place, text)} of a file's comment lines, and of those that sheet.toml states."""
    keys = {key: ("sheet.toml", text) for key, text in stated.items()}
    for row, line in enumerate(lines, 1):
        match = re.match(r'[\s"]*#\s*(\w+)\s*:\s*(.*?)["\s,;]*$', line)
        if not match:
            continue
        key, value = match.groups()
        if key in keys:
            problems.append(f"row {row}: the key {key} is repeated; allowed is once")
        elif key in KEYS:
            keys[key] = f"row {row}", value
        elif near := difflib.get_close_matches(key, KEYS, 1, 0.75):
            hint = f"(did you mean {near[0]}?); allowed are {', '.join(KEYS)}"
            problems.append(f"row {row}: the key {key} is unknown {hint}")
    return keys


def _said(keys, problems):
    """What the keys say, as `_Said`; InputError of all problems if the test is not known."""
    with problems:
        name = _test_of(keys)
        test = TESTS[name]
        known = ("noise", *keys_of(test))
        for key, (place, _) in keys.items():
            if key not in known:
                problems.append(
                    f"{place}: the key {key} does not belong to the test {name}; allowed are "
                    f"{', '.join(known)}"
                )
        for key in test.keys:
            if key not in keys:
                form = f"`# {key}: 200 mm`, for example"
                if key == "lateral":
                    form = "`# lateral: held` (eps = 0 across) or `# lateral: free` (stress = 0)"
                problems.append(f"the test {name} needs a line for {key}; allowed is {form}")
        free, lateral, others = None, (), {}
        with problems:
            free, lateral, others = _lateral(keys, name)
        lengths = {}
        for key in keys_of(test):
            if key in keys and key != "slack":
                with problems:
                    lengths[key] = _quantity(key, keys[key], _LENGTH)
        return _Said(name, free, (*test.measured, *lateral), others, lengths, keys)
    problems.stop()


def _test_of(keys):
    """The name of the test, taken out of the keys."""
    if "test" not in keys:
        raise InputError(
            f"no line `# test: ...` states the test; allowed are {', '.join(TESTS)}, in the file "
            'or in its table [tests."NAME"] of sheet.toml'
        )
    place, name = keys.pop("test")
    if name not in TESTS:
        raise _fail(place, str(unknown_key(name, TESTS, f"test {name!r}")))
    return name


def _lateral(keys, name):
    """What the key `lateral`, taken out of the keys, says: the yarns with free sides (0, 1 or
    None), columns that may be measured besides, and what to say of a column that is 0."""
    if "lateral" not in keys or "lateral" not in TESTS[name].keys:
        return None, (), {}
    place, lateral = keys.pop("lateral")
    if lateral not in ("held", "free"):
        raise _fail(place, f"lateral is {lateral!r}; allowed is held or free")
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


def _quantity(key, given, factors):
    place, text = given
    match = re.fullmatch(r"\s*([-+.,\deE]+)\s*(\S+)\s*", text)
    try:
        value = float(match[1].replace(",", ".")) * factors[match[2]] if match else math.nan
    except (KeyError, ValueError):
        value = math.nan
    if not 0 < value < math.inf:
        allowed = ", ".join(factors)
        raise _fail(
            place, f"{key} is {text!r}; allowed is a number above 0 with one of the units {allowed}"
        )
    return value


def _noise(given, responses, thickness):
    if given is None:
        return None
    place, text = given
    if match := re.fullmatch(r"([.,\deE+-]+)\s*%\s*of\s*(maximum|value)", text):
        size = _quantity("noise", (place, f"{match[1]} %"), {"%": 0.01})
        if size >= 1:
            raise _fail(
                place, f"noise is {text!r}, which leaves nothing measured; allowed is below 100 %"
            )
        return match[2], size
    if len(responses) > 1 or "%" in text:
        raise _fail(
            place,
            f"noise is {text!r}; allowed is `2 % of maximum` or `2 % of value`, "
            "or a number with a unit if one column is measured",
        )
    return "absolute", _quantity("noise", given, units(responses[0].column, thickness))


# -- columns


def _table(cells, said, named, thickness, problems):
    """The `Table` of a file's cells, and a sentence on columns that are not read."""
    place, factors, header = f"row {cells.top}", {}, {}
    allowed = _allowed(said)
    unknown: list[str] = []
    means = {name: column_of(name) for name in cells.names} | _named(cells, named)
    for i, (name, unit) in enumerate(zip(cells.names, cells.units)):
        column, *other = re.findall(r"[^\s\[\]]+", means[name]) or [name]
        is_second = column != name and name not in named and column in map(named.get, named)
        if column not in COLUMNS or is_second:
            unknown.append(name)
            continue
        with problems:
            if column in header:
                raise _fail(
                    place,
                    f"the column {column} is repeated; allowed is once (a line `{name} = "
                    f'"{column}"` in [columns] of sheet.toml says which one counts)',
                )
            header[column] = (other or [unit])[0]
            _check_column(place, column, header[column], said, allowed)
            factors[i] = column, units(column, thickness)[header[column]]
    missing = _missing(said, header)
    near = [name for name in unknown if difflib.get_close_matches(name, allowed, 1)]
    if told := unknown if missing and unknown else near:
        problems.append(f"{place}: {_unknown(told, allowed)}")
    elif missing:
        problems.append(
            f"{place}: the column {missing[0]} is missing, which the test {said.test} needs"
        )
    _check_raw(place, said, header, problems)
    columns = values_of(cells, factors, problems)
    unread = [f"column {name!r} is not read" for name in unknown if name]
    return Table(columns, header, cells.rows, cells.top), unread


def _allowed(said):
    test = TESTS[said.test]
    return (*test.strains, *test.optional, *said.measured, *test.raw)


def _named(cells, named):
    """What sheet.toml says that the columns of a file mean."""
    return {name: named[name] for name in cells.names if name in named}


def _check_column(place, column, unit, said, allowed):
    """InputError for a column that the test does not have, or without a known unit."""
    if column in said.others:
        raise _fail(place, said.others[column])
    if column not in allowed:
        raise _fail(
            place,
            f"the column {column} does not belong to the test {said.test}; allowed are "
            f"{', '.join(allowed)}",
        )
    if unit is None:
        raise _fail(
            place,
            f"the column {column} has no unit; allowed is {column} [{unit_inside(column)}], "
            "for example, or a row of units below",
        )
    if unit not in units(column):
        raise _fail(
            place, str(unknown_key(unit, units(column), f"unit [{unit}] of column {column}"))
        )


def _unknown(names, allowed):
    """What to say of columns of these names."""
    line = f'a line `{names[0]} = "{allowed[-1]}"` in [columns] of sheet.toml, for example'
    if len(names) == 1:
        words = str(unknown_key(names[0], allowed, f"column {names[0]!r}"))
        return f"{words}, or {line}"
    told = ", ".join(map(repr, names))
    return f"columns {told} are unknown; allowed are {', '.join(allowed)}, or {line}"


def _missing(said, header):
    """Columns that a header lacks, in words."""
    test = TESTS[said.test]
    told = set(header) | {column for raw, (column, _) in test.raw.items() if raw in header}
    missing = [column for column in test.strains if column not in told]
    if not set(test.measured) & told:
        missing.append(" or ".join(test.measured))
    return missing


def _check_raw(place, said, header, problems):
    """Problems of columns as a machine writes them, and of the strip's sizes that they need."""
    for raw, (column, key) in TESTS[said.test].raw.items():
        if raw in header and column in header:
            problems.append(
                f"{place}: both columns {column} and {raw} are given; allowed is one of them"
            )
        if raw in header and key not in (*said.keys, *TESTS[said.test].keys):
            unit = "N/mm" if raw == "F" else "%"
            problems.append(
                f"{place}: the column {raw} needs the strip's {key}; allowed is a line "
                f"`# {key}: 50 mm`, or the column {column} [{unit}]"
            )


def _convert_raw(table, said, thickness):
    """Add to the table what follows from what a machine writes."""
    for raw, (column, _) in TESTS[said.test].raw.items():
        if raw in table.columns:
            values = table.columns[raw]
            table.columns[column] = of_fabric(raw, values, said.test, said.lengths, thickness)
            table.header[column] = unit_inside(column)


def _slack(table, said):
    """The column that runs in the file, and the slack that is stated in it."""
    test = TESTS[said.test]
    raw = {column: raw for raw, (column, _) in test.raw.items() if raw in table.columns}
    column = raw.get(test.strains[0], test.strains[0])
    given = said.keys.get("slack")
    return column, _quantity("slack", given, units(column)) if given else 0.0
