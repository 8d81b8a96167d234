"""Data sets from files: `sheet.toml` and a CSV file a test."""

import dataclasses
import re
from pathlib import Path

from ...material.files import (
    FIBRES,
    read_numbers,
    read_sheet_numbers,
    read_toml,
    take_table,
    take_units,
)
from ...material.laws.coupled import SHEAR, YARN
from ...readers.text_tables import Problems
from ...runtime.errors import InputError
from ...runtime.files import ending
from ...runtime.rules import unknown_key
from . import checks
from .csv_files import read_test
from .model import COLUMNS, KEYS, CompactionTest, Curve, Sheet

SPELLING = {"delimiter": "[;,\t ]", "decimal": "[.,]", "encoding": ".+"}  # of [csv]


def read(path: Path | str) -> tuple[Sheet, tuple[Curve, ...]]:
    """Sheet, which has the tests of compaction, and curves of a data set: of a folder, or of one of
    its CSV files. InputError by file, row and reason, also for two curves that contradict."""
    path = Path(path)
    if not path.exists():
        raise InputError(
            f"{path} does not exist; allowed is a folder with a sheet.toml and a CSV file a test, "
            "or one of these files"
        )
    folder = path if path.is_dir() else path.parent
    sheet = read_sheet(folder / "sheet.toml")
    named = sheet.keys
    paths = sorted(p for p in folder.iterdir() if ending(p) in (".csv", ".tsv") or p.name in named)
    if not paths:
        raise InputError(
            f"{folder} has no *.csv; allowed is a CSV file a test, or files of other names with a "
            'table [tests."NAME"] each in sheet.toml'
        )
    tests, problems = [], Problems()
    for each in paths if path in (folder, folder / "sheet.toml") else [path]:
        with problems:
            tests.append(read_test(each, sheet))
    files = [each.name for each in paths]
    if lost := sorted({*named} - {*files}):
        allowed = f"allowed are {', '.join(files)}"
        problems.append(f"{folder / 'sheet.toml'}: tests.{lost[0]!r} is no file; {allowed}")
    problems.stop()
    curves = tuple(test for test in tests if isinstance(test, Curve))
    checks.check_copies(curves)
    compaction = tuple(test for test in tests if isinstance(test, CompactionTest))
    for test in compaction:
        if test.response.column == "fibre_volume_fraction" and sheet.fibre_density is None:
            raise InputError(
                f"{test.file}: the column fibre_volume_fraction needs the fibres' density; allowed "
                "is a line fibre_density_g_per_cm3 = 2.54 in sheet.toml, for example"
            )
    return dataclasses.replace(sheet, compaction=compaction), curves


def read_sheet(path: Path | str) -> Sheet:
    """Read `sheet.toml`: name, thickness_mm, density_g_per_cm3 or areal_weight_g_per_m2, balanced,
    and optional fibre_density_g_per_cm3, fibre_share, [assumed], [assumed.warp], [assumed.weft]
    with parameters as in a material file (d_MPa, p_min, ..), and [csv], [columns] and
    [tests."FILE"]. Raises InputError by file and key."""
    return read_toml(path, _sheet)


def _sheet(document):
    """The sheet of a document; InputError by key."""
    name, balanced = document.pop("name", ""), document.pop("balanced", None)
    assumed, units = take_table(document, "assumed"), take_units(document)
    stated = _stated(document)
    if not isinstance(name, str):
        raise InputError(f"name is {name!r}; allowed is a text")
    if not isinstance(balanced, bool):
        raise InputError(
            f"balanced is {balanced!r}; allowed is true (warp and weft are equal) or false"
        )
    also = "name", "balanced", "assumed", "units"
    numbers, weight = read_sheet_numbers(document, units, also, FIBRES)
    if "thickness" not in numbers:
        raise InputError(
            "missing thickness; allowed is thickness_mm = 1.2, for example: "
            "by it a force per width (N/mm) becomes a stress and an areal weight a density"
        )
    if "density" not in numbers:
        raise InputError("missing density; allowed is density_g_per_cm3 or areal_weight_g_per_m2")
    values = _assumed(assumed, balanced, units)
    more = {"balanced": balanced, "assumed": values, "areal_weight": weight}
    return Sheet(name, **more, **stated, **numbers)


def _assumed(assumed, balanced, units):
    """The values of [assumed] as {"p_min": ..} or {"warp.p_min": ..}."""
    values: dict[str, float] = {}
    for yarn in ("warp", "weft"):
        table = assumed.pop(yarn, {})
        if balanced and table:
            raise InputError(
                f"assumed.{yarn} is given for a balanced fabric; allowed is [assumed] alone"
            )
        own = read_numbers(table, YARN, units, f"assumed.{yarn}.")
        values |= {f"{yarn}.{name}": value for name, value in own.items()}
    return read_numbers(assumed, {**YARN, **SHEAR}, units, "assumed.", ("warp", "weft")) | values


def _stated(document):
    """The statements of a document on CSV files, taken out of it."""
    columns, tests = take_table(document, "columns"), take_table(document, "tests")
    spelled = take_table(document, "csv")
    tables = [(columns, "columns"), (spelled, "csv")]
    for table, where in (*tables, *((tests[f], f"tests.{f!r}") for f in tests)):
        if not isinstance(table, dict):
            raise InputError(f'{where} is {table!r}; allowed is a table, [tests."bias.csv"]')
        for key, text in table.items():
            if not isinstance(text, str):
                raise InputError(f'{where}.{key} is {text!r}; allowed is a text, as "200 mm"')
            rules = SPELLING if where == "csv" else KEYS
            if where != "columns" and key not in rules:
                raise unknown_key(key, rules, f"{where}.{key}")
            if where == "csv" and not re.fullmatch(rules[key], text):
                allowed = '";", "\\t" or ","' if key == "delimiter" else '"." or ","'
                raise InputError(f"csv.{key} is {text!r}; allowed is {allowed}")
            if where == "columns" and text.split(" ")[0] not in COLUMNS:
                raise unknown_key(text, COLUMNS, f"columns.{key} {text!r}")
    return {"keys": tests, "columns": columns, "csv": spelled}
