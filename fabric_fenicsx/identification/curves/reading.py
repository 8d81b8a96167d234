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
from ...core.rules import FINITE, FROM_ZERO, POSITIVE, check_complete, unknown_key
from ...io.text_tables import number_of, read_lines, table_of, values_of
from ...io.units import factors
from ...material import files
from ...material.laws.coupled import SHEAR, YARN
from . import checks, model
from .model import TESTS, CompactionTest, Curve, Response, Sheet, Table, unit_inside, units


def read(path: Path | str) -> tuple[Sheet, tuple[Curve, ...]]:
    """Sheet, which has the tests of compaction, and curves of a data set: of a folder, or of one of
    its CSV files. InputError by file, row and reason, also for two curves that contradict."""
    path = Path(path)
    folder = path.parent if path.is_file() else path
    sheet = read_sheet(folder / "sheet.toml")
    found = (p.name for p in folder.iterdir() if ending(p) in (".csv", ".tsv"))
    names = sorted({*found} | {name for name in sheet.keys if (folder / name).exists()})
    tests, problems = list[Curve | CompactionTest](), list[str]()
    if not names:
        allowed = 'a CSV file a test, or files of other names with a table [tests."NAME"] each in'
        problems.append(f"{folder} has no *.csv; expected {allowed} sheet.toml")
    for name in sorted({*sheet.keys} - {*names}):
        lost = f"{folder / 'sheet.toml'}: tests.{name!r} is no file"
        problems.append(f"{lost}; expected {', '.join(names)}")
    for name in names if path in (folder, folder / "sheet.toml") else [path.name]:
        try:
            tests.append(_read_test(folder / name, sheet))
        except InputError as error:
            problems.append(f"{folder / name}: {error}")
    curves = tuple(test for test in tests if isinstance(test, Curve))
    _refuse([*problems, *checks.copies(curves)])
    compaction = tuple(test for test in tests if isinstance(test, CompactionTest))
    return dataclasses.replace(sheet, compaction=compaction), curves


def _refuse(problems):
    """InputError of all problems, if there are any."""
    if problems:
        raise InputError("; ".join(dict.fromkeys(problems)))


def read_sheet(path: Path | str) -> Sheet:
    """Read `sheet.toml`: name, thickness_mm, density_g_per_cm3 or areal_weight_g_per_m2, balanced,
    and optional fibre_density_g_per_cm3, fibre_share, [assumed], [assumed.warp], [assumed.weft]
    with parameters as in a material file (d_MPa, p_min, ..), and [csv], [columns] and
    [tests."FILE"]. Raises InputError by file and key."""
    return files.read_toml(path, _sheet)


def _sheet(document):
    name, balanced = str(document.pop("name", "")), document.pop("balanced", None)
    if not isinstance(balanced, bool):
        allowed = "true (warp and weft are equal) or false"
        raise InputError(f"balanced is {balanced!r}; expected {allowed}")
    assumed, units = files.take_table(document, "assumed"), files.take_units(document)
    columns, csv, tests = (files.take_table(document, key) for key in ("columns", "csv", "tests"))
    keys = {file: files.take_table(tests, file) for file in [*tests]}
    signs = {"delimiter": (";", ",", "\t", " "), "decimal": (".", ","), "encoding": ()}
    tables = {"columns": columns, "csv": csv} | {f"tests.{file!r}": keys[file] for file in keys}
    for label, table in tables.items():
        for key, text in table.items():
            if table is csv and key not in signs:
                raise unknown_key(key, signs, f"csv.{key}")
            choices = signs[key] if table is csv else ()
            if not isinstance(text, str):
                raise InputError(f'{label}.{key} is {text!r}; expected a text, as "200 mm"')
            if table is columns and text.split(" ")[0] not in model.COLUMNS:
                raise unknown_key(text, model.COLUMNS, f"columns.{key} {text!r}")
            if choices and text not in choices:
                one = ", ".join(map(repr, choices))
                raise InputError(f"csv.{key} is {text!r}; expected one of {one}")
    also = "name", "balanced", "assumed", "units"
    numbers, weight = files.read_sheet_numbers(document, units, also, files.FIBRES)
    needed = "as thickness_mm = 1.2, and density_g_per_cm3 or areal_weight_g_per_m2"
    check_complete(numbers, ("thickness", "density"), "", needed)
    yarns, values = () if balanced else ("warp", "weft"), dict[str, float]()
    for yarn in yarns:
        own = files.read_numbers(files.take_table(assumed, yarn), YARN, units, f"assumed.{yarn}.")
        values |= {f"{yarn}.{key}": value for key, value in own.items()}
    values |= files.read_numbers(assumed, {**YARN, **SHEAR}, units, "assumed.", yarns)
    stated: dict = {"keys": keys, "columns": columns, "csv": csv, "areal_weight": weight}
    return Sheet(name, balanced=balanced, assumed=values, **stated, **numbers)


class _Keys(NamedTuple):
    """The test that the keys of a file state: the yarns with free sides (0, 1 or None), columns
    that may be measured, lengths [mm], {key: (place, text)} of all keys, and sentences on lines
    that are not read."""

    test: str
    free: int | None
    measured: tuple[str, ...]
    lengths: dict[str, float]
    texts: dict[str, tuple[str, str]]
    unread: list[str]


def _read_test(path, sheet):
    """The `Curve` or `CompactionTest` in a CSV file, of a sheet. InputError by row."""
    lines = read_lines(path, sheet.csv.get("encoding"))
    keys = _keys(lines, sheet.keys.get(path.name, {}))
    table, remarks = _table(lines, keys, sheet)
    if keys.test == "compaction":
        return _compaction_test(path.name, table, keys, sheet, remarks)
    return _curve(path.name, table, keys, sheet.thickness, remarks)


def _curve(file, table, keys, thickness, remarks):
    test, columns = TESTS[keys.test], table.columns
    if "zero" in keys.texts and "F" in columns:
        columns["F"] -= _quantity("zero", keys.texts["zero"], units("F"))
    if "exx" in columns:
        strains = np.column_stack([columns.pop(name) for name in test.image])
        columns["gamma"] = model.image_angle(strains, keys.texts["strain"][1], keys.test)
        table.header["gamma"] = unit_inside("gamma")
    given = {raw: column for raw, (column, _) in test.raw.items() if raw in columns}
    raw = {column: raw for raw, column in given.items() if column not in columns}
    moved = raw.get(test.strains[0], test.strains[0])
    table, notes = table.from_zero(moved, test.sign)
    checks.check_length(table, model.MIN_POINTS)
    runs = max(test.strains, key=lambda name: np.ptp(table.columns[raw.get(name, name)]))
    whole = table
    table, left_out = whole.loading_branch(raw.get(runs, runs))
    notes, loose = notes + left_out, 0.0
    if "slack" in keys.texts:
        loose = _quantity("slack", keys.texts["slack"], units(moved))
        table = table.kept(table.columns[moved] > loose) if loose else table
        table.columns[moved] = table.columns[moved] - loose
    for column, machine in raw.items():
        values, lengths = table.columns[machine], keys.lengths
        if keys.test == "bias_extension":
            values = model.bias_angle(values, lengths["height"], lengths["width"])
        else:
            values = values / (
                lengths["width"] * thickness if machine == "F" else lengths["length"]
            )
        table.columns[column], table.header[column] = values, unit_inside(column)
    columns = table.columns
    measured = [column for column in keys.measured if column in columns]
    checks.check_length(table, model.MIN_POINTS)
    checks.check_values(keys.test, table, runs, measured)
    if len(raw) < len(given):
        notes += checks.angle_remarks(table, keys.lengths)
    notes += checks.origin_remarks(keys.test, table, moved, keys.texts)
    none = np.zeros(len(table.rows))
    strains = np.column_stack(
        [none if c in measured else columns.get(c, none) for c in model.STRAINS]
    )
    specimen, back = (keys.test, keys.lengths, thickness), None
    responses = [
        model.response(column, columns[column], strains[:, 2], *specimen) for column in measured
    ]
    if keys.test in ("shear", "picture_frame"):  # of which loops tell friction
        less = whole.way_back(runs, table.rows[-1])
        if len(less.rows) >= model.MIN_POINTS:
            angles, (column,) = less.columns[runs] - loose, measured
            back = angles, model.response(column, less.columns[column], angles, *specimen)
            notes.append(f"friction is fitted to the unloading branch, up to row {less.rows[-1]}")
    rows, noise = np.array(table.rows), _noise(keys.texts, responses, thickness)
    moved_by = columns["displacement"] if "displacement" in raw.values() else None
    what = file, keys.test, strains, tuple(responses), rows, model.STRAINS.index(runs), keys.free
    return Curve(*what, noise, keys.lengths, (*remarks, *notes), back, moved_by)


def _compaction_test(file, table, keys, sheet, remarks):
    table, notes = table.from_zero("pressure", 1)
    table, left_out = table.loading_branch("pressure")
    (column,) = {*table.columns} - {"pressure"}
    if column == "fibre_volume_fraction" and sheet.fibre_density is None:
        allowed = "a line fibre_density_g_per_cm3 = 2.54 in sheet.toml, for example"
        raise InputError(f"the column {column} needs the fibres' density; expected {allowed}")
    checks.check_length(table, 4)  # to tell three numbers
    checks.check_values(keys.test, table, "pressure", [column])
    values = table.columns[column]
    response = Response(column, unit_inside(column), values, np.ones(len(values)))
    noise, remarks = _noise(keys.texts, [response], math.nan), (*remarks, *notes, *left_out)
    return CompactionTest(file, table.columns["pressure"], response, noise, remarks)


def _keys(lines, stated):
    """The keys of a file's comment lines, and of those that sheet.toml states."""
    texts, problems = {key: ("sheet.toml", text) for key, text in stated.items()}, []
    unread = list[str]()
    for row, line in enumerate(lines, 1):
        # words, and a colon or an equals sign or at once a number
        match = re.match(
            r'[\s"]*#\s*([^\W\d][\w -]*?)\s*([:=]|(?=[-+.]?\d))\s*(.*?)["\s,;]*$', line
        )
        key, sign, value = match.groups() if match else ("", "", "")
        unit = re.sub(r"^[-+.,\deE]+|\s", "", value)
        is_quantity = value[:1] in "+-.0123456789" and {*unit.split("/")} <= model.ALL_UNITS
        if key in model.KEYS and (sign or is_quantity):
            if key in texts:
                problems.append(f"row {row}: the key {key} is repeated; expected once")
            texts.setdefault(key, (f"row {row}", value))
        elif sign and (is_quantity or difflib.get_close_matches(key, model.KEYS, 1, 0.75)):
            problems.append(str(unknown_key(key, model.KEYS, f"row {row}: the key {key}")))
        elif sign and key.isidentifier():
            unread.append(f"the line {key!r} is ignored")
    place, name = texts.pop("test", ("", ""))
    if name not in TESTS:
        where = 'in the file or in its table [tests."NAME"] of sheet.toml'
        no_test = f"no line `# test: ...` states the test; expected {', '.join(TESTS)}, {where}"
        unknown = unknown_key(name, TESTS, f"{place}: test {name!r}")
        _refuse([*problems, str(unknown) if name else no_test])
    test = TESTS[name]
    allowed = ("noise", *test.keys, *test.more)
    label = f"{{}}: the key {{}} of the test {name}"
    problems += [
        str(unknown_key(key, allowed, label.format(place, key)))
        for key, (place, _) in texts.items()
        if key not in allowed
    ]
    for key in (key for key in test.keys if key not in texts):
        example = f"`# {key}: {'free` or `held' if key == 'lateral' else '200 mm'}`"
        problems.append(f"the test {name} needs a line for {key}; expected {example}")
    place, lateral = texts.get("lateral", ("", "held"))
    if lateral not in ("held", "free"):
        problems.append(f"{place}: lateral is {lateral!r}; expected held or free")
    _refuse(problems)
    others = "noise", "lateral", "slack", "zero", "strain"
    lengths = {
        key: _quantity(key, texts[key], factors("length")) for key in texts if key not in others
    }
    for small, large, factor, least in (
        ("width", "height", 2, "a height of 2 widths or more"),
        ("fabric_length", "frame_length", 1, "a fabric up to as large as its frame"),
    ):
        if large in lengths and lengths[large] < factor * lengths[small]:
            sizes = f"{large} is {lengths[large]:g} mm and {small} {lengths[small]:g} mm"
            raise InputError(f"{sizes}; expected {least}")
    free, measured = None, test.measured
    if "lateral" in texts:  # of test uniaxial_a or uniaxial_b
        along = "ab".index(name[-1])
        free = along if lateral == "free" else None
        measured += (f"{'sigma' if free is None else 'eps'}_{'ba'[along]}",)
    return _Keys(name, free, measured, lengths, texts, unread)


def _quantity(key, stated, factors):
    """The number of a text with a unit, in that of the factors' first."""
    place, text = stated
    ((number, unit),) = re.findall(r"(?s)^([-+.,\deE]*)\s*(.*)", text.strip())
    value = number_of(number.replace(",", ".")) * factors.get(unit, math.nan)
    rule = {"zero": FINITE, "slack": FROM_ZERO}.get(key, POSITIVE)
    if not (math.isfinite(value) and rule.test(value)):
        allowed = f"{rule.allowed} with one of the units {', '.join(factors)}"
        raise InputError(f"{place}: {key} is {text!r}; expected {allowed}")
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
            f"{place}: noise is {text!r}; expected `2 % of maximum` or `2 % of value`, "
            "or a number with a unit if one column is measured"
        )
    return "absolute", _quantity("noise", texts["noise"], units(responses[0].column, thickness))


def _table(lines, keys, sheet):
    """The `Table` of a file's cells, and a sentence on each column that is not read."""
    test, named, csv = TESTS[keys.test], sheet.columns, sheet.csv

    def is_known(name):
        return name in named or model.column_of(name) in model.COLUMNS

    cells = table_of(lines, is_known, delimiter=csv.get("delimiter"))
    place, factors, header, unread = f"row {cells.top}", {}, dict[str, str](), list[str]()
    allowed = (*test.strains, *test.optional, *keys.measured, *test.image, *test.raw)
    counts = [cells.names[: i + 1].count(name) for i, name in enumerate(cells.names)]
    names = [f"{name} {n}" if name and n > 1 else name for name, n in zip(cells.names, counts)]
    stated, problems = {named[name] for name in names if name in named}, list[str]()
    for i, (name, unit) in enumerate(zip(names, cells.units)):
        meant = named.get(name, model.column_of(name))
        column, *other = re.findall(r"[^\s\[\]]+", meant) or [name]
        is_second = name not in named and (column in stated or counts[i] > 1)
        if column not in model.COLUMNS or is_second:
            unread += [name] if name else []
            continue
        unit, known = (other or [unit])[0], units(column, sheet.thickness)
        if column in header:
            once = (
                f'(a line `{name} = "{column}"` in [columns] of sheet.toml says which one counts)'
            )
            problems.append(f"{place}: the column {column} is repeated; expected once {once}")
        elif column not in allowed:
            label = f"{place}: column {column} of {keys.test}"
            problems.append(str(unknown_key(column, allowed, label)))
        elif unit in known:
            factors[i] = column, known[unit]
        elif unit:
            label = f"{place}: unit [{unit}] of column {column}"
            problems.append(str(unknown_key(unit, known, label)))
        else:
            example = f"{column} [{unit_inside(column)}], for example, or a row of units below"
            problems.append(f"{place}: the column {column} has no unit; expected {example}")
        header.setdefault(column, unit)
    _refuse([*problems, *(f"{place}: {words}" for words in _of_columns(keys, header, unread))])
    while cells.rows and not any(cells.cells[-1][i].strip() for i in factors):
        cells.rows.pop(), cells.cells.pop()  # of a longer test beside this one
    columns = values_of(cells, factors, csv.get("decimal"))
    sentences = [f"column {name!r} is ignored; see [columns] of sheet.toml" for name in unread]
    return Table(columns, header, cells.rows, cells.top), [*keys.unread, *sentences]


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
                known = ", ".join(model.COLUMNS)
                yield f"columns {wrong} are unknown; expected {known}, or {line}"
            break
    pairs = [(column, raw) for raw, (column, _) in test.raw.items() if column != "gamma"]
    pairs += [("gamma", "exx"), ("tau", "F_sh"), ("thickness", "fibre_volume_fraction")]
    for pair in pairs:
        if {*pair} <= {*header}:
            yield f"both columns {' and '.join(pair)} are given; expected one of them"
    measure = keys.texts.get("strain", ("", "not stated"))[1]
    if by_image and measure not in model.MEASURES:
        allowed = ", ".join(f"`# strain: {name}`" for name in model.MEASURES)
        yield f"the strain of exx is {measure}; expected {allowed}"
    for raw, (column, key) in test.raw.items():
        if raw in header and key not in keys.texts:
            allowed = f"a line `# {key}: 50 mm`, or the column {column}"
            yield f"the column {raw} needs the strip's {key}; expected {allowed}"
