"""Data sets from files: `sheet.toml`, and a CSV file a test with its keys, columns and curve."""

import dataclasses
import difflib
import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...core.errors import InputError
from ...core.files import ending
from ...core.rules import check_complete, unknown_key
from ...io.text_tables import Problems, read_lines, table_of, values_of
from ...io.units import factors
from ...material.files import (
    FIBRES,
    read_numbers,
    read_sheet_numbers,
    read_toml,
    take_table,
    take_units,
)
from ...material.laws.coupled import SHEAR, YARN
from . import checks
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


def read(path: Path | str) -> tuple[Sheet, tuple[Curve, ...]]:
    """Sheet, which has the tests of compaction, and curves of a data set: of a folder, or of one of
    its CSV files. InputError by file, row and reason, also for two curves that contradict."""
    path = Path(path)
    folder = path.parent if path.is_file() else path
    sheet = read_sheet(folder / "sheet.toml")
    named, tests, problems = sheet.keys, list[Curve | CompactionTest](), Problems()
    paths = sorted(p for p in folder.iterdir() if ending(p) in (".csv", ".tsv") or p.name in named)
    for each in paths if path in (folder, folder / "sheet.toml") else [path]:
        with problems:
            tests.append(_read_test(each, sheet))
    files = ", ".join(each.name for each in paths)
    allowed = 'a CSV file a test, or files of other names with a table [tests."NAME"] each in'
    problems += [] if paths else [f"{folder} has no *.csv; allowed is {allowed} sheet.toml"]
    for name in sorted({*named} - {each.name for each in paths}):
        lost = f"{folder / 'sheet.toml'}: tests.{name!r} is no file"
        problems.append(f"{lost}; allowed are {files}")
    curves = tuple(test for test in tests if isinstance(test, Curve))
    problems += checks.copies(curves)
    compaction = tuple(test for test in tests if isinstance(test, CompactionTest))
    allowed = "a line fibre_density_g_per_cm3 = 2.54 in sheet.toml, for example"
    for test in compaction:
        if test.response.column == "fibre_volume_fraction" and sheet.fibre_density is None:
            flaw = f"{test.file}: the column fibre_volume_fraction needs the fibres' density"
            problems.append(f"{flaw}; allowed is {allowed}")
    problems.stop()
    return dataclasses.replace(sheet, compaction=compaction), curves


def read_sheet(path: Path | str) -> Sheet:
    """Read `sheet.toml`: name, thickness_mm, density_g_per_cm3 or areal_weight_g_per_m2, balanced,
    and optional fibre_density_g_per_cm3, fibre_share, [assumed], [assumed.warp], [assumed.weft]
    with parameters as in a material file (d_MPa, p_min, ..), and [csv], [columns] and
    [tests."FILE"]. Raises InputError by file and key."""
    return read_toml(path, _sheet)


def _sheet(document):
    problems = Problems()
    name, balanced = str(document.pop("name", "")), document.pop("balanced", None)
    if not isinstance(balanced, bool):
        allowed = "true (warp and weft are equal) or false"
        problems.append(f"balanced is {balanced!r}; allowed is {allowed}")
    assumed, units = take_table(document, "assumed"), take_units(document)
    columns, csv, tests = (take_table(document, key) for key in ("columns", "csv", "tests"))
    signs = {"delimiter": (";", ",", "\t", " "), "decimal": (".", ","), "encoding": ()}
    keys = {file: take_table(tests, file) for file in [*tests]}
    of_files = [(f"tests.{file!r}", table, KEYS) for file, table in keys.items()]
    for where, table, known in [("columns", columns, columns), ("csv", csv, signs), *of_files]:
        for key, text in table.items():
            label, is_text = f"{where}.{key}", isinstance(text, str)
            if key not in known:
                problems.append(str(unknown_key(key, known, label)))
            elif not is_text:
                problems.append(f'{label} is {text!r}; allowed is a text, as "200 mm"')
            elif table is columns and text.split(" ")[0] not in COLUMNS:
                problems.append(str(unknown_key(text, COLUMNS, f"{label} {text!r}")))
            elif table is csv and signs[key] and text not in signs[key]:
                allowed = str(signs[key])[1:-1]
                problems.append(f"{label} is {text!r}; allowed is one of {allowed}")
    problems.stop()
    also = "name", "balanced", "assumed", "units"
    numbers, weight = read_sheet_numbers(document, units, also, FIBRES)
    needed = "as thickness_mm = 1.2, and density_g_per_cm3 or areal_weight_g_per_m2"
    check_complete(numbers, ("thickness", "density"), "", needed)
    yarns = () if balanced else ("warp", "weft")
    own = {yarn: take_table(assumed, yarn) for yarn in yarns}
    values = read_numbers(assumed, {**YARN, **SHEAR}, units, "assumed.", yarns)
    for yarn, table in own.items():
        own_numbers = read_numbers(table, YARN, units, f"assumed.{yarn}.")
        values |= {f"{yarn}.{key}": value for key, value in own_numbers.items()}
    stated: dict = {"keys": keys, "columns": columns, "csv": csv}
    return Sheet(name, balanced=balanced, assumed=values, areal_weight=weight, **stated, **numbers)


class _Keys(NamedTuple):
    """The test that the keys of a file state: the yarns with free sides (0, 1 or None), columns
    that may be measured, lengths [mm], and {key: (place, text)} of all keys."""

    test: str
    free: int | None
    measured: tuple[str, ...]
    lengths: dict[str, float]
    texts: dict[str, tuple[str, str]]


def _read_test(path: Path, sheet: Sheet) -> Curve | CompactionTest:
    """The test in a CSV file, of a sheet. InputError by file and row."""
    problems = Problems()
    try:
        lines = read_lines(path, sheet.csv.get("encoding"))
        keys = _keys(lines, sheet.keys.get(path.name, {}), problems)
        with problems:
            names, delimiter = {*sheet.columns, *COLUMNS}, sheet.csv.get("delimiter")
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
    if "zero" in keys.texts and "F" in columns:
        columns["F"] -= _quantity("zero", keys.texts["zero"], units("F"))
    if "exx" in columns:
        strains = np.column_stack([columns.pop(name) for name in test.image])
        columns["gamma"] = image_angle(strains, keys.texts["strain"][1], keys.test)
        table.header["gamma"] = unit_inside("gamma")
    given = {raw: column for raw, (column, _) in test.raw.items() if raw in columns}
    raw = {column: raw for raw, column in given.items() if column not in columns}
    moved = raw.get(test.strains[0], test.strains[0])
    table, notes = table.from_zero(moved, test.sign)
    checks.check_length(table, MIN_POINTS)
    runs = max(test.strains, key=lambda name: np.ptp(table.columns[raw.get(name, name)]))
    whole = table
    table, left_out = whole.loading_branch(raw.get(runs, runs))
    notes, loose = notes + left_out, 0.0
    if "slack" in keys.texts:
        loose = _quantity("slack", keys.texts["slack"], units(moved))
        table = table.kept(table.columns[moved] > loose) if loose else table
        table.columns[moved] = table.columns[moved] - loose
    for column, machine in raw.items():
        values = table.columns[machine]
        table.columns[column] = of_fabric(machine, values, keys.test, keys.lengths, thickness)
        table.header[column] = unit_inside(column)
    columns = table.columns
    measured = [column for column in keys.measured if column in columns]
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
        less = whole.way_back(runs, table.rows[-1])
        if len(less.rows) >= MIN_POINTS:
            angles, (column,) = less.columns[runs] - loose, measured
            back = angles, response(column, less.columns[column], angles, *specimen)
            notes.append(f"friction is fitted to the way back, to row {less.rows[-1]}")
    rows, noise = np.array(table.rows), _noise(keys.texts, responses, thickness)
    moved_by = columns["displacement"] if "displacement" in raw.values() else None
    what = file, keys.test, strains, tuple(responses), rows, STRAINS.index(runs), keys.free
    return Curve(*what, noise, keys.lengths, (*remarks, *notes), back, moved_by)


def _compaction_test(file, table, keys, remarks):
    table, notes = table.from_zero("pressure", 1)
    table, left_out = table.loading_branch("pressure")
    (column,) = {*table.columns} - {"pressure"}
    checks.check_length(table, 4)  # to tell three numbers
    checks.check_values(keys.test, table, "pressure", [column])
    values = table.columns[column]
    response = Response(column, unit_inside(column), values, np.ones(len(values)))
    noise, remarks = _noise(keys.texts, [response], math.nan), (*remarks, *notes, *left_out)
    return CompactionTest(file, table.columns["pressure"], response, noise, remarks)


def _keys(lines, stated, problems):
    """The keys of a file's comment lines, and of those that sheet.toml states; InputError of all
    problems if there is no test."""
    texts = {key: ("sheet.toml", text) for key, text in stated.items()}
    for row, line in enumerate(lines, 1):
        match = re.match(r'[\s"]*#\s*(\w+)\s*:\s*(.*?)["\s,;]*$', line)
        key, value = match.groups() if match else ("", "")
        if key in texts:
            problems.append(f"row {row}: the key {key} is repeated; allowed is once")
        elif key in KEYS:
            texts[key] = f"row {row}", value
        elif difflib.get_close_matches(key, KEYS, 1, 0.75):
            problems.append(str(unknown_key(key, KEYS, f"row {row}: the key {key}")))
    place, name = texts.pop("test", ("", ""))
    if name not in TESTS:
        where = 'in the file or in its table [tests."NAME"] of sheet.toml'
        no_test = f"no line `# test: ...` states the test; allowed are {', '.join(TESTS)}, {where}"
        unknown = unknown_key(name, TESTS, f"{place}: test {name!r}")
        problems.append(str(unknown) if name else no_test)
        problems.stop()
    test = TESTS[name]
    allowed = ("noise", *test.keys, *test.more)
    for key, (place, _) in texts.items():
        if key not in allowed:
            label = f"{place}: the key {key} of the test {name}"
            problems.append(str(unknown_key(key, allowed, label)))
    for key in test.keys:
        if key not in texts:
            example = f"`# {key}: {'free` or `held' if key == 'lateral' else '200 mm'}`"
            problems.append(f"the test {name} needs a line for {key}; allowed is {example}")
    place, lateral = texts.get("lateral", ("", "held"))
    if lateral not in ("held", "free"):
        problems.append(f"{place}: lateral is {lateral!r}; allowed is held or free")
    problems.stop()
    lengths = {
        key: _quantity(key, text, factors("length"))
        for key, text in texts.items()
        if key not in ("noise", "lateral", "slack", "zero", "strain")
    }
    free, measured = None, test.measured
    if "lateral" in texts:  # of test uniaxial_a or uniaxial_b
        along = "ab".index(name[-1])
        free = along if lateral == "free" else None
        measured += (f"{'sigma' if free is None else 'eps'}_{'ba'[along]}",)
    return _Keys(name, free, measured, lengths, texts)


def _quantity(key, stated, factors):
    """The number of a text with a unit, in that of the factors' first: above 0, of slack also 0,
    and of a zero of any sign."""
    place, text = stated
    match = re.fullmatch(r"\s*([-+.,\deE]+)\s*(\S+)\s*", text)
    try:
        value = float(match[1].replace(",", ".")) * factors[match[2]] if match else math.nan
    except (KeyError, ValueError):
        value = math.nan
    if not (0 < value or (key == "slack" and value == 0) or key == "zero") or math.isnan(value):
        least = {"zero": "", "slack": " from 0"}.get(key, " above 0")
        allowed = f"a number{least} with one of the units {', '.join(factors)}"
        raise InputError(f"{place}: {key} is {text!r}; allowed is {allowed}")
    return value


def _noise(texts, responses, thickness):
    """Kind and size of the stated noise, None if there is none."""
    if "noise" not in texts:
        return None
    place, text = texts["noise"]
    if match := re.fullmatch(r"([.,\deE+-]+)\s*%\s*of\s*(maximum|value)", text):
        return match[2], _quantity("noise", (place, f"{match[1]} %"), {"%": 0.01})
    if len(responses) > 1 or "%" in text:
        raise InputError(
            f"{place}: noise is {text!r}; allowed is `2 % of maximum` or `2 % of value`, "
            "or a number with a unit if one column is measured"
        )
    return "absolute", _quantity("noise", texts["noise"], units(responses[0].column, thickness))


def _table(cells, keys, sheet, problems):
    """The `Table` of a file's cells, and a sentence on each column that is not read."""
    place, factors, header, unread = f"row {cells.top}", {}, dict[str, str](), list[str]()
    test, named = TESTS[keys.test], sheet.columns
    allowed = (*test.strains, *test.optional, *keys.measured, *test.image, *test.raw)
    counts = [cells.names[: i + 1].count(name) for i, name in enumerate(cells.names)]
    names = [f"{name} {n}" if name and n > 1 else name for name, n in zip(cells.names, counts)]
    stated = {named[name] for name in names if name in named}
    for i, (name, unit) in enumerate(zip(names, cells.units)):
        column, *other = re.findall(r"[^\s\[\]]+", named.get(name, column_of(name))) or [name]
        is_second = name not in named and (column in stated or counts[i] > 1)
        if column not in COLUMNS or is_second:
            unread += [name] if name else []
            continue
        unit, known = (other or [unit])[0], units(column, sheet.thickness)
        if column in header:
            once = (
                f'(a line `{name} = "{column}"` in [columns] of sheet.toml says which one counts)'
            )
            problems.append(f"{place}: the column {column} is repeated; allowed is once {once}")
        elif column not in allowed:
            label = f"{place}: column {column} of {keys.test}"
            problems.append(str(unknown_key(column, allowed, label)))
        elif unit not in known:
            example = f"{column} [{unit_inside(column)}], for example, or a row of units below"
            none = f"{place}: the column {column} has no unit; allowed is {example}"
            label = f"{place}: unit [{unit}] of column {column}"
            problems.append(str(unknown_key(unit, known, label)) if unit else none)
        else:
            factors[i] = column, known[unit]
        header.setdefault(column, unit)
    problems += [f"{place}: {words}" for words in _of_columns(keys, header, unread)]
    while cells.rows and not any(
        cells.cells[-1][i].strip() for i in factors if i < len(cells.cells[-1])
    ):
        cells.rows.pop(), cells.cells.pop()  # of a longer test beside this one
    columns = values_of(cells, factors, problems, sheet.csv.get("decimal"))
    sentences = [f"column {name!r} is not read; see [columns] of sheet.toml" for name in unread]
    return Table(columns, header, cells.rows, cells.top), sentences


def _of_columns(keys, header, unread):
    """Sentences on columns that are missing or too many, and on keys that they need."""
    test = TESTS[keys.test]
    by_image = [name for name in test.image if name in header]
    made = {column for raw, (column, _) in test.raw.items() if raw in header}
    made |= {"gamma"} if by_image else set()
    needed = [(name,) for name in (*test.strains, *(test.image if by_image else ()))]
    for names in (*needed, test.measured):
        if not {*names} & {*header, *made}:
            yield f"the column {' or '.join(names)} is missing, which the test {keys.test} needs"
            if wrong := ", ".join(map(repr, unread)):
                line = f'a line `NAME = "{names[0]}"` in [columns] of sheet.toml'
                yield f"columns {wrong} are unknown; allowed are {', '.join(COLUMNS)}, or {line}"
            break
    pairs = [(column, raw) for raw, (column, _) in test.raw.items() if column != "gamma"]
    pairs += [("gamma", "exx"), ("tau", "F_sh"), ("thickness", "fibre_volume_fraction")]
    for pair in pairs:
        if {*pair} <= {*header}:
            yield f"both columns {' and '.join(pair)} are given; allowed is one of them"
    measure = keys.texts.get("strain", ("", "not stated"))[1]
    if by_image and measure not in MEASURES:
        allowed = ", ".join(f"`# strain: {name}`" for name in MEASURES)
        yield f"the strain of exx is {measure}; allowed is {allowed}"
    for raw, (column, key) in test.raw.items():
        if raw in header and key not in keys.texts:
            allowed = f"a line `# {key}: 50 mm`, or the column {column}"
            yield f"the column {raw} needs the strip's {key}; allowed is {allowed}"
