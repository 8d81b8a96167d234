"""Data sets from files: `sheet.toml` and a CSV file a test."""

import dataclasses
import tomllib
from pathlib import Path

from ...material.files import FIBRES, read_numbers, read_sheet_numbers, take_table
from ...material.laws.coupled import SHEAR, YARN
from ...readers.text_tables import Problems
from ...readers.units import UNITS
from ...runtime.errors import InputError
from ...runtime.rules import unknown_key
from . import checks
from .csv_files import read_test
from .model import COLUMNS, COMPACTION, KEYS, CompactionTest, Curve, Sheet, Stated

FILES = ".csv", ".tsv"


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
    named = sheet.stated.keys
    paths = [p for p in folder.iterdir() if p.suffix.lower() in FILES or p.name in named]
    paths.sort()
    if not paths:
        raise InputError(
            f"{folder} has no *.csv; allowed is a folder with a CSV file for each test, or files "
            'of other names with a table [tests."NAME"] each in sheet.toml'
        )
    tests, problems = [], Problems()
    for path in paths:
        with problems:
            tests.append(read_test(path, sheet.thickness, sheet.stated))
    if lost := sorted({*sheet.stated.keys} - {path.name for path in paths}):
        told = ", ".join(path.name for path in paths)
        problems.append(
            f"{folder / 'sheet.toml'}: tests.{lost[0]!r} is no file; allowed are {told}"
        )
    problems.stop()
    curves = tuple(test for test in tests if isinstance(test, Curve))
    checks.check_contradictions(curves, sheet.balanced)
    compaction = tuple(test for test in tests if isinstance(test, CompactionTest))
    checks.check_fibres(compaction, sheet)
    return dataclasses.replace(sheet, compaction=compaction), curves


def read_sheet(path: Path | str) -> Sheet:
    """Read `sheet.toml`: name, thickness_mm, density_g_per_cm3 or areal_weight_g_per_m2, balanced,
    and optional fibre_density_g_per_cm3, [assumed], [assumed.warp], [assumed.weft] with parameters
    as in a material file (d_MPa, p_min, ..), and [columns] and [tests."FILE"], see `Stated`. Raises
    InputError by file and key."""
    try:
        document = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is not valid TOML ({error})") from None
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})"
        ) from None
    try:
        return _sheet(document)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _sheet(document):
    """The sheet of a document; InputError by key."""
    name, balanced, assumed = (
        document.pop("name", ""),
        document.pop("balanced", None),
        document.pop("assumed", {}),
    )
    stated = _stated(document)
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
        raise InputError("missing density; allowed is density_g_per_cm3 or areal_weight_g_per_m2")
    values = _assumed(assumed, balanced, given)
    known = numbers["thickness"], numbers["density"], balanced, values, weight
    return Sheet(name, *known, numbers.get("fibre_density"), stated=stated)


def _assumed(assumed, balanced, given):
    """The values of [assumed] as {"p_min": ..} or {"warp.p_min": ..}."""
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
    return read_numbers(assumed, {**YARN, **SHEAR}, given, "assumed.", ("warp", "weft")) | values


def _stated(document):
    """What a document says of CSV files, taken out of it."""
    columns, tests = take_table(document, "columns"), take_table(document, "tests")
    for table, where in ((columns, "columns"), *((tests[f], f"tests.{f!r}") for f in tests)):
        if not isinstance(table, dict):
            raise InputError(f'{where} is {table!r}; allowed is a table, [tests."bias.csv"]')
        for key, text in table.items():
            if not isinstance(text, str):
                raise InputError(f'{where}.{key} is {text!r}; allowed is a text, as "200 mm"')
            if where != "columns" and key not in KEYS:
                raise unknown_key(key, KEYS, f"{where}.{key}")
            if where == "columns" and text.split(" ")[0] not in COLUMNS:
                raise unknown_key(text, COLUMNS, f"columns.{key} {text!r}")
    return Stated(tests, columns)


def read_curve(path: Path | str, thickness: float, stated: Stated | None = None) -> Curve:
    """Read and check one CSV file of a test in the sheet's plane; thickness [mm] of the sheet turns
    shear forces into stresses; stated: what `sheet.toml` says of the file. InputError by file and
    row."""
    found = read_test(path, thickness, stated or Stated())
    if isinstance(found, CompactionTest):
        raise InputError(
            f"{path}: the test is {COMPACTION}, across the sheet; allowed is one in its plane"
        )
    return found
