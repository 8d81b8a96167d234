"""Data sets from files: `sheet.toml` and a CSV file a test."""

import dataclasses
from pathlib import Path

from ...core.files import ending
from ...core.rules import check_complete, unknown_key
from ...io.text_tables import Problems
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
from .csv_files import read_test
from .model import COLUMNS, KEYS, CompactionTest, Curve, Sheet


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
            tests.append(read_test(each, sheet))
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
