"""One CSV file of a test: its keys, its columns, and the curve in them."""

import difflib
import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...readers.text_tables import Problems, read_lines, table_of, values_of
from ...readers.units import factors
from ...runtime.errors import InputError
from ...runtime.rules import unknown_key
from . import checks
from .branch import from_zero, kept, loading_branch, way_back
from .forces import MEASURES, image_angle, of_fabric, response
from .model import (
    COLUMNS,
    KEYS,
    MIN_POINTS,
    STRAINS,
    TESTS,
    CompactionTest,
    Curve,
    Response,
    Sheet,
    Table,
    column_of,
    unit_inside,
    units,
)


class _Keys(NamedTuple):
    """The test that the keys of a file state: the yarns with free sides (0, 1 or None), columns
    that may be measured, a sentence on each column that the test cannot have, lengths [mm], and
    {key: (place, text)} of all keys that the others do not hold."""

    test: str
    free: int | None
    measured: tuple[str, ...]
    others: dict[str, str]
    lengths: dict[str, float]
    texts: dict[str, tuple[str, str]]


def read_test(path: Path, sheet: Sheet) -> Curve | CompactionTest:
    """The test in a CSV file, of a sheet. InputError by file and row, of all that is wrong."""
    problems = Problems()
    try:
        lines = read_lines(path, sheet.csv.get("encoding"))
        keys = _keys(_key_texts(lines, sheet.keys.get(path.name, {}), problems), problems)
        with problems:
            names = {*sheet.columns, *COLUMNS}
            delimiter = sheet.csv.get("delimiter")
            cells = table_of(
                lines, lambda name: bool({name, column_of(name)} & names), delimiter=delimiter
            )
            table, remarks = _table(cells, keys, sheet, problems)
        problems.stop()
        if keys.test == "compaction":
            return _compaction_test(path.name, table, keys, remarks)
        return _curve(path.name, table, keys, sheet.thickness, remarks)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _curve(file, table, keys, thickness, remarks):
    test, columns = TESTS[keys.test], table.columns
    _take_zero(table, keys)
    if {*test.image} & {*columns}:
        strains = np.column_stack([columns.pop(name) for name in test.image])
        columns["gamma"] = image_angle(strains, keys.texts["strain"][1], keys.test)
        table.header["gamma"] = unit_inside("gamma")
    given = {raw: column for raw, (column, _) in test.raw.items() if raw in columns}
    raw = {column: raw for raw, column in given.items() if column not in columns}
    moved = raw.get(test.strains[0], test.strains[0])
    table, notes = from_zero(table, moved, test.sign)
    runs = max(
        test.strains, key=lambda c: np.ptp(table.columns[raw.get(c, c)]) if table.rows else 0
    )
    whole = table
    table, left_out = loading_branch(whole, raw.get(runs, runs))
    notes, loose = notes + left_out, 0.0
    if "slack" in keys.texts:
        loose = _quantity("slack", keys.texts["slack"], units(moved), zero=True)
    if loose:
        table = kept(table, table.columns[moved] > loose)
        table.columns[moved] = table.columns[moved] - loose
    for column, machine in raw.items():
        values = table.columns[machine]
        table.columns[column] = of_fabric(machine, values, keys.test, keys.lengths, thickness)
        table.header[column] = unit_inside(column)
    columns = table.columns
    measured = [column for column in keys.measured if column in columns]
    if {"tau", "F_sh"} <= set(measured):
        raise InputError("both columns tau and F_sh are given; allowed is one of them")
    checks.check_length(table, MIN_POINTS)
    checks.check_values(keys.test, table, runs, measured)
    if len(raw) < len(given):
        notes += checks.angle_remarks(table, keys.lengths)
    notes += checks.origin_remarks(keys.test, table, moved, keys.texts)
    none = np.zeros(len(table.rows))
    strains = np.column_stack([none if c in measured else columns.get(c, none) for c in STRAINS])
    specimen, back = (keys.test, keys.lengths, thickness), None
    responses = [response(column, columns[column], strains[:, 2], *specimen) for column in measured]
    if keys.test in ("shear", "picture_frame"):  # of which loops tell friction
        less = way_back(whole, runs, table.rows[-1])
        if len(less.rows) >= MIN_POINTS:
            angles, (column,) = less.columns[runs] - loose, measured
            back = angles, response(column, less.columns[column], angles, *specimen)
            notes.append(f"friction is fitted to the way back, to row {less.rows[-1]}")
    return Curve(
        file,
        keys.test,
        strains,
        tuple(responses),
        np.array(table.rows),
        STRAINS.index(runs),
        keys.free,
        _noise(keys.texts.get("noise"), responses, thickness),
        keys.lengths,
        (*remarks, *notes),
        back,
        columns["displacement"] if "displacement" in raw.values() else None,
    )


def _take_zero(table, keys):
    """Take a stated zero of the load cell off the force."""
    if "zero" in keys.texts and "F" in table.columns:
        place, text = keys.texts["zero"]
        sign = -1 if text.startswith("-") else 1
        size = _quantity("zero", (place, text.lstrip("-")), units("F"), zero=True)
        table.columns["F"] -= sign * size


def _compaction_test(file, table, keys, remarks):
    table, notes = from_zero(table, "pressure", 1)
    table, left_out = loading_branch(table, "pressure")
    column = next(name for name in table.columns if name != "pressure")
    checks.check_compaction(table, column)
    values = table.columns[column]
    response = Response(column, unit_inside(column), values, np.ones(len(values)))
    noise = _noise(keys.texts.get("noise"), [response], math.nan)
    rows, remarks = np.array(table.rows), (*remarks, *notes, *left_out)
    return CompactionTest(file, table.columns["pressure"], response, rows, noise, remarks)


# -- keys


def _key_texts(lines, stated, problems):
    """{key: (place, text)} of a file's comment lines, and of those that sheet.toml states."""
    texts = {key: ("sheet.toml", text) for key, text in stated.items()}
    for row, line in enumerate(lines, 1):
        match = re.match(r'[\s"]*#\s*(\w+)\s*:\s*(.*?)["\s,;]*$', line)
        if not match:
            continue
        key, value = match.groups()
        if key in texts:
            problems.append(f"row {row}: the key {key} is repeated; allowed is once")
        elif key in KEYS:
            texts[key] = f"row {row}", value
        elif difflib.get_close_matches(key, KEYS, 1, 0.75):
            problems.append(str(unknown_key(key, KEYS, f"row {row}: the key {key}")))
    return texts


def _keys(texts, problems):
    """The test that the texts of keys state; InputError of all problems if there is none."""
    place, name = texts.pop("test", ("", None))
    if name is None:
        problems.append(
            f"no line `# test: ...` states the test; allowed are {', '.join(TESTS)}, in the file "
            'or in its table [tests."NAME"] of sheet.toml'
        )
    elif name not in TESTS:
        problems.append(str(unknown_key(name, TESTS, f"{place}: test {name!r}")))
    if name not in TESTS:
        problems.stop()
    test, lengths = TESTS[name], {}
    allowed = ("noise", *test.all_keys)
    for key, (place, _) in texts.items():
        if key not in allowed:
            problems.append(
                f"{place}: the key {key} does not belong to the test {name}; allowed are "
                f"{', '.join(allowed)}"
            )
    for key in test.keys:
        if key not in texts:
            form = f"`# {key}: 200 mm`, for example"
            if key == "lateral":
                form = "`# lateral: held` (eps = 0 across) or `# lateral: free` (stress = 0)"
            problems.append(f"the test {name} needs a line for {key}; allowed is {form}")
    free, across, others = None, (), {}
    with problems:
        if "lateral" in test.keys and "lateral" in texts:
            free, across, others = _lateral(name, *texts.pop("lateral"))
    for key in test.all_keys:
        if key in texts and key not in ("slack", "zero", "strain"):
            with problems:
                lengths[key] = _quantity(key, texts[key], factors("length"))
    return _Keys(name, free, (*test.measured, *across), others, lengths, texts)


def _lateral(name, place, lateral):
    """The yarns with free sides (0, 1 or None), columns that may be measured besides, and a
    sentence on a column that is 0, for the text of the key `lateral`."""
    if lateral not in ("held", "free"):
        raise InputError(f"{place}: lateral is {lateral!r}; allowed is held or free")
    across, held = "ba"["ab".index(name[-1])], lateral == "held"
    zero, measured = (f"eps_{across}", f"sigma_{across}")[:: 1 if held else -1]
    text = (
        f"lateral: {lateral} says that {zero} is 0, but there is a column {zero}; allowed is "
        f"`# lateral: {'free' if held else 'held'}`, or the test biaxial if it was prescribed"
    )
    return None if held else "ab".index(name[-1]), (measured,), {zero: text}


def _quantity(key, stated, factors, zero=False):
    """The number of a text with a unit, in that of the factors' first; zero: if 0 is allowed."""
    place, text = stated
    match = re.fullmatch(r"\s*([-+.,\deE]+)\s*(\S+)\s*", text)
    try:
        value = float(match[1].replace(",", ".")) * factors[match[2]] if match else math.nan
    except (KeyError, ValueError):
        value = math.nan
    if not 0 < value < math.inf and not (zero and value == 0):
        least = "of at least 0" if zero else "above 0"
        allowed = f"a number {least} with one of the units {', '.join(factors)}"
        raise InputError(f"{place}: {key} is {text!r}; allowed is {allowed}")
    return value


def _noise(stated, responses, thickness):
    if stated is None:
        return None
    place, text = stated
    if match := re.fullmatch(r"([.,\deE+-]+)\s*%\s*of\s*(maximum|value)", text):
        size = _quantity("noise", (place, f"{match[1]} %"), {"%": 0.01})
        if size >= 1:
            raise InputError(
                f"{place}: noise is {text!r}, which leaves nothing measured; allowed is below 100 %"
            )
        return match[2], size
    if len(responses) > 1 or "%" in text:
        raise InputError(
            f"{place}: noise is {text!r}; allowed is `2 % of maximum` or `2 % of value`, "
            "or a number with a unit if one column is measured"
        )
    return "absolute", _quantity("noise", stated, units(responses[0].column, thickness))


# -- columns


def _table(cells, keys, sheet, problems):
    """The `Table` of a file's cells, and a sentence on each column that is not read."""
    place, factors, header, unknown = f"row {cells.top}", {}, {}, []
    test, named = TESTS[keys.test], sheet.columns
    allowed = (*test.strains, *test.optional, *keys.measured, *test.image, *test.raw)
    counts = [cells.names[: i + 1].count(name) for i, name in enumerate(cells.names)]
    names = [f"{name} {n}" if name and n > 1 else name for name, n in zip(cells.names, counts)]
    stated = {named[name] for name in names if name in named}
    for i, (name, unit) in enumerate(zip(names, cells.units)):
        column, *other = re.findall(r"[^\s\[\]]+", named.get(name, column_of(name))) or [name]
        is_second = name not in named and (column in stated or counts[i] > 1)
        if column not in COLUMNS or is_second:
            unknown.append((name, cells.names[i]))
            continue
        with problems:
            if column in header:
                raise InputError(
                    f"{place}: the column {column} is repeated; allowed is once (a line `{name} = "
                    f'"{column}"` in [columns] of sheet.toml says which one counts)'
                )
            header[column] = (other or [unit])[0]
            _check_column(place, column, header[column], keys, allowed)
            factors[i] = column, units(column, sheet.thickness)[header[column]]
    present = set(header) | {column for raw, (column, _) in test.raw.items() if raw in header}
    if by_image := {*test.image} & {*header}:
        present |= {"gamma"}
    missing = [column for column in test.strains if column not in present]
    missing += [column for column in test.image if by_image and column not in header]
    missing += [] if set(test.measured) & present else [" or ".join(test.measured)]
    wrong = [name for name, _ in unknown]
    if not missing:  # one that may be misspelled
        once = [name for name, own in unknown if name == own and name not in COLUMNS]
        wrong = [name for name in once if difflib.get_close_matches(name, allowed, 1)]
    if wrong:
        problems.append(f"{place}: {_unknown(wrong, allowed)}")
    elif missing:
        problems.append(
            f"{place}: the column {missing[0]} is missing, which the test {keys.test} needs"
        )
    _check_raw(place, keys, header, problems)
    while cells.rows and not any(
        cells.cells[-1][i].strip() for i in factors if i < len(cells.cells[-1])
    ):
        cells.rows.pop(), cells.cells.pop()  # of a longer test beside this one
    columns = values_of(cells, factors, problems, sheet.csv.get("decimal"))
    unread = [_unread(*each) for each in unknown if each[0]]
    return Table(columns, header, cells.rows, cells.top), unread


def _unread(name, first):
    """A sentence on a column that is not read, as the next of the name `first`."""
    text = f"column {name!r} is not read"
    if name == first or column_of(first) not in COLUMNS:
        return text
    line = f'a line `"{name}" = "{column_of(first)}"` in [columns] of sheet.toml'
    return f"{text}, which is the next {first!r}; {line} reads it in place of the first"


def _check_column(place, column, unit, keys, allowed):
    """InputError for a column that the test does not have, or without a known unit."""
    if column in keys.others:
        raise InputError(f"{place}: {keys.others[column]}")
    if column not in allowed:
        raise InputError(
            f"{place}: the column {column} does not belong to the test {keys.test}; "
            f"allowed are {', '.join(allowed)}"
        )
    if unit is None:
        raise InputError(
            f"{place}: the column {column} has no unit; allowed is {column} "
            f"[{unit_inside(column)}], for example, or a row of units below"
        )
    if unit not in units(column):
        raise unknown_key(unit, units(column), f"{place}: unit [{unit}] of column {column}")


def _unknown(names, allowed):
    """A sentence on columns of these names."""
    line = f'a line `{names[0]} = "{allowed[-1]}"` in [columns] of sheet.toml, for example'
    if len(names) == 1:
        return f"{unknown_key(names[0], allowed, f'column {names[0]!r}')}, or {line}"
    columns = ", ".join(map(repr, names))
    return f"columns {columns} are unknown; allowed are {', '.join(allowed)}, or {line}"


def _check_raw(place, keys, header, problems):
    """Problems of columns as a machine or a camera writes them, and of the keys they need."""
    test = TESTS[keys.test]
    if {*test.image} & {*header}:
        if "gamma" in header:
            columns = f"{place}: both columns gamma and {test.image[-1]}"
            problems.append(f"{columns} are given; allowed is one of them")
        if (measure := keys.texts.get("strain", ("", "not stated"))[1]) not in MEASURES:
            allowed = ", ".join(f"`# strain: {name}`" for name in MEASURES)
            problems.append(f"{place}: the strain of exx is {measure}; allowed is {allowed}")
    for raw, (column, key) in test.raw.items():
        if raw in header and column in header and keys.test != "bias_extension":
            problems.append(
                f"{place}: both columns {column} and {raw} are given; allowed is one of them"
            )
        if raw in header and key not in (*keys.texts, *test.keys):
            unit = "N/mm" if raw == "F" else "%"
            problems.append(
                f"{place}: the column {raw} needs the strip's {key}; allowed is a line "
                f"`# {key}: 50 mm`, or the column {column} [{unit}]"
            )
