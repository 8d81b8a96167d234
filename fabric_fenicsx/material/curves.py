"""Curves of material tests in CSV files, read and checked as a whole before anything is fitted.

A data set is a folder with one `sheet.toml` (the sheet) and one CSV file a test. A CSV file starts with comment lines
`# key: value` that state the test, then a header `name [unit]` for each column, then rows with a decimal point:

    # test: uniaxial_a
    # lateral: held
    # noise: 2 % of maximum
    eps_a [%], sigma_a [MPa]
    0.1, 1.36

| test | columns | further keys |
|---|---|---|
| uniaxial_a | eps_a; sigma_a; if held also sigma_b, if free eps_b | lateral: held (eps_b = 0) or free (sigma_b = 0) |
| uniaxial_b | the same with a and b exchanged | |
| biaxial | eps_a, eps_b; sigma_a and/or sigma_b | |
| compression_a | eps_a; sigma_a; optional gamma (sheared compression) | |
| compression_b | the same with a and b exchanged | |
| shear | gamma; tau or F_sh; optional eps_a, eps_b (pre-strain) | |
| picture_frame | gamma; F; optional eps_a, eps_b (pre-strain) | frame_length, fabric_length |
| bias_extension | gamma; F | height, width |

Every file may state `noise` (standard deviation): `2 % of maximum` (of each column's largest value), `5 % of value`, or an
absolute `0.2 MPa` if one column is measured. Stresses are nominal, conjugate to (eps_a, eps_b, gamma) per undeformed
volume: sigma_i = dW/d(eps_i), tau = dW/d(gamma). Yarns start at right angles.

Shear forces follow from the power that they do; t is the thickness, g the shear angle:

- frame of side L_f with fabric of side L: its diagonal 2 L_f cos(pi/4 - g/2) is pulled by F, so
  F L_f sin(pi/4 - g/2) = tau t L^2. With F_s = F / (2 cos(pi/4 - g/2)) and F_sh = F_s L_f / L^2 that is tau t = F_sh cos g.
- bias strip: F (H - W)/2 (cos g/2 - sin g/2) = t [tau(g) W (2H - 3W)/2 + tau(g/2) W^2/2], which is the formula of
  Cao et al. (2008) with the same tau t = F_sh cos g. F_sh / t is the part of the traction along the yarn (S_12), and only at
  small g also the stress conjugate to g.
"""

import csv
import difflib
import math
import re
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import tomli_w
from numpy.typing import ArrayLike

from ..errors import InputError
from .parameters import SHEAR, SHEET, UNITS, YARN, read_numbers, unknown_key

MIN_POINTS = 5
STRAINS = ("eps_a", "eps_b", "gamma")

_STRESS = {"MPa": 1.0, "kPa": 1e-3, "Pa": 1e-6, "GPa": 1e3, "N/mm2": 1.0}
_UNIT = {  # first unit of each: the one used inside
    "eps_a": {"-": 1.0, "%": 0.01}, "eps_b": {"-": 1.0, "%": 0.01}, "gamma": {"rad": 1.0, "deg": math.pi / 180},
    "sigma_a": _STRESS, "sigma_b": _STRESS, "tau": _STRESS,
    "F_sh": {"N/mm": 1.0, "N/m": 1e-3, "kN/m": 1.0}, "F": {"N": 1.0, "kN": 1e3},
}  # fmt: skip
_LENGTH = {"mm": 1.0, "cm": 10.0, "m": 1e3}
_RANGE = {"eps_a": 0.5, "eps_b": 0.5, "gamma": math.radians(85)}  # beyond it a wrong unit is the likely reason


class _Test(NamedTuple):
    strains: tuple[str, ...]  # columns that must be there
    optional: tuple[str, ...]  # strains that are 0 if their column is not there
    measured: tuple[str, ...]  # one of these at least
    keys: tuple[str, ...] = ()
    sign: int = 0  # of the first strain


TESTS = {
    "uniaxial_a": _Test(("eps_a",), (), ("sigma_a",), ("lateral",), 1),
    "uniaxial_b": _Test(("eps_b",), (), ("sigma_b",), ("lateral",), 1),
    "biaxial": _Test(("eps_a", "eps_b"), (), ("sigma_a", "sigma_b")),
    "compression_a": _Test(("eps_a",), ("gamma",), ("sigma_a",), sign=-1),
    "compression_b": _Test(("eps_b",), ("gamma",), ("sigma_b",), sign=-1),
    "shear": _Test(("gamma",), ("eps_a", "eps_b"), ("tau", "F_sh"), sign=1),
    "picture_frame": _Test(("gamma",), ("eps_a", "eps_b"), ("F",), ("frame_length", "fabric_length"), 1),
    "bias_extension": _Test(("gamma",), (), ("F",), ("height", "width"), 1),
}
_KEYS = ("test", "noise", *dict.fromkeys(key for test in TESTS.values() for key in test.keys))


@dataclass(frozen=True)
class Response:
    """A measured column: `values` (n,) in `unit`, and how the law predicts it: gain * s, plus half * tau(gamma/2) if
    `half` is given, with s the stress conjugate to eps_a, eps_b or gamma, or the lateral strain."""

    column: str
    unit: str
    values: np.ndarray
    gain: np.ndarray
    half: np.ndarray | None = None

    @property
    def component(self) -> int:
        """0: sigma_a, 1: sigma_b, 2: tau, 3: lateral strain."""
        return {"sigma_a": 0, "sigma_b": 1, "eps_a": 3, "eps_b": 3}.get(self.column, 2)

    @property
    def peak(self) -> float:
        """Largest magnitude, in `unit`."""
        return float(np.abs(self.values).max())


@dataclass(frozen=True)
class Curve:
    """One test. strains: (n, 3) eps_a, eps_b [-], gamma [rad] as prescribed; rows: (n,) line numbers in the file;
    free: 0 or 1 if the yarns across a tension along a or b are free of stress; noise: ("maximum" | "value" |
    "absolute", number) or None; abscissa: the column of `strains` that runs; keys: further keys of the file."""

    file: str
    test: str
    strains: np.ndarray
    responses: tuple[Response, ...]
    rows: np.ndarray
    abscissa: int
    free: int | None = None
    noise: tuple[str, float] | None = None
    keys: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Sheet:
    """What `sheet.toml` says: thickness [mm], density [g/cm3], whether warp and weft are tied (`balanced`), and values
    to assume for parameters that the data don't determine, as {"p_min": ..} or {"warp.p_min": ..}."""

    name: str
    thickness: float
    density: float
    balanced: bool
    assumed: dict[str, float] = field(default_factory=dict)


def read(folder: Path | str) -> tuple[Sheet, tuple[Curve, ...]]:
    """Sheet and curves of a data set; InputError by file, row and reason, also for two curves that contradict."""
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; allowed is one with a sheet.toml and a CSV file for each test")
    sheet = read_sheet(folder / "sheet.toml")
    paths = sorted(folder.glob("*.csv"))
    if not paths:
        raise InputError(f"{folder} has no *.csv; allowed is a folder with a CSV file for each test")
    curves = tuple(read_curve(path, sheet.thickness) for path in paths)
    check_contradictions(curves, sheet.balanced)
    return sheet, curves


def read_sheet(path: Path | str) -> Sheet:
    """Read `sheet.toml`: name, thickness_mm, density_g_per_cm3, balanced, and optional [assumed], [assumed.warp],
    [assumed.weft] with parameters as in a material file (d_MPa, p_min, ..). Raises InputError by file and key."""
    try:
        document = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is not valid TOML ({error})") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    try:
        name, balanced, assumed = document.pop("name", ""), document.pop("balanced", None), document.pop("assumed", {})
        units = document.pop("units", {})
        if not isinstance(name, str):
            raise InputError(f"name is {name!r}, but it must be a text")
        if not isinstance(balanced, bool):
            raise InputError(f"balanced is {balanced!r}; allowed is true (warp and weft are equal) or false")
        if not isinstance(assumed, dict) or not isinstance(units, dict):
            raise InputError("assumed and units must be tables")
        for kind, unit in units.items():
            if kind not in UNITS or unit not in UNITS[kind]:
                raise unknown_key(unit, [u for us in UNITS.values() for u in us], f"units.{kind} {unit!r}")
        numbers = read_numbers(document, SHEET, units, "", ("name", "balanced", "assumed", "units"))
        if missing := [key for key in SHEET if key not in numbers]:
            raise InputError(
                f"missing {', '.join(missing)}; allowed are thickness_mm and density_g_per_cm3, for example"
            )
        values: dict[str, float] = {}
        for yarn in ("warp", "weft"):
            table = assumed.pop(yarn, {})
            if balanced and table:
                raise InputError(
                    f"assumed.{yarn} is given for a balanced fabric; allowed is [assumed] for both directions"
                )
            values |= {f"{yarn}.{k}": v for k, v in read_numbers(table, YARN, units, f"assumed.{yarn}.").items()}
        values = read_numbers(assumed, (*YARN, *SHEAR), units, "assumed.", ("warp", "weft")) | values
        return Sheet(name, balanced=balanced, assumed=values, **numbers)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def read_curve(path: Path | str, thickness: float) -> Curve:
    """Read and check one CSV file; thickness [mm] of the sheet turns shear forces into stresses. InputError by file and
    row."""
    try:
        lines = Path(path).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as text ({getattr(error, 'strerror', None) or error})") from None
    try:
        return _parse(Path(path).name, lines, thickness)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _fail(row, text):
    return InputError(f"row {row}: {text}")


def _parse(file, lines, thickness):
    keys, table = _keys(lines)
    if "test" not in keys:
        raise InputError(f"no line `# test: ...` states the test; allowed are {', '.join(TESTS)}")
    row, name = keys.pop("test")
    if name not in TESTS:
        raise _fail(row, str(unknown_key(name, TESTS, f"test {name!r}")))
    test = TESTS[name]
    noise = keys.pop("noise", None)
    for key, (row, _) in keys.items():
        if key not in test.keys:
            allowed = ", ".join(("noise", *test.keys))
            raise _fail(row, f"the key {key} does not belong to the test {name}; allowed are {allowed}")
    if missing := [key for key in test.keys if key not in keys]:
        form = f"`# {missing[0]}: 200 mm`, for example"
        if missing[0] == "lateral":
            form = "`# lateral: held` (eps = 0 across) or `# lateral: free` (stress = 0 across)"
        raise InputError(f"the test {name} needs a line for {missing[0]}; allowed is {form}")
    free, needed, measured = None, test.strains, test.measured
    if "lateral" in keys:
        row, lateral = keys.pop("lateral")
        across = "b" if name[-1] == "a" else "a"
        if lateral not in ("held", "free"):
            raise _fail(row, f"lateral is {lateral!r}; allowed is held or free")
        if lateral == "held":
            measured = (*measured, f"sigma_{across}")
        else:
            free, needed = "ab".index(name[-1]), (*needed, f"eps_{across}")
    lengths = {key: _quantity(key, row, text, _LENGTH) for key, (row, text) in keys.items()}
    columns, rows = _columns(table, name, needed, test.optional, measured)
    found = [column for column in (*measured, *needed[len(test.strains) :]) if column in columns]
    if {"tau", "F_sh"} <= set(found):
        raise InputError("both columns tau and F_sh are given; allowed is one of them")
    if len(rows) < MIN_POINTS:
        last = rows[-1] if rows else table[0][0]
        raise _fail(last, f"the file ends after {len(rows)} points; at least {MIN_POINTS} are needed")
    runs = max(test.strains, key=lambda column: np.ptp(columns[column]))
    _check_values(name, columns, rows, runs, found)
    strains = np.zeros((len(rows), 3))
    for column in (*test.strains, *test.optional):
        if column in columns:
            strains[:, STRAINS.index(column)] = columns[column]
    responses = [_response(column, columns[column], strains[:, 2], name, lengths, thickness) for column in found]
    noise = _noise(noise, responses)
    return Curve(file, name, strains, tuple(responses), np.array(rows), STRAINS.index(runs), free, noise, lengths)


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
            if key in _KEYS:
                keys[key] = row, value
            elif near := difflib.get_close_matches(key, _KEYS, 1, 0.75):
                hint = f"(did you mean {near[0]}?); allowed are {', '.join(_KEYS)}"
                raise _fail(row, f"the key {key} is unknown {hint}")
    return keys, table


def _check_values(name, columns, rows, runs, measured):
    """Range and sign of the strains, a strict rise or fall of the column `runs`, something in what was measured."""
    for column in set(STRAINS) & set(columns):
        most, unit = _RANGE[column], next(iter(_UNIT[column]))
        if (far := np.flatnonzero(np.abs(columns[column]) > most)).size:
            value = f"{columns[column][far[0]]:.4g} {unit}"
            allowed = f"it must be within +-{most:.3g} (is the unit in the header right?)"
            raise _fail(rows[far[0]], f"{column} is {value}, but {allowed}")
    test = TESTS[name]
    first = columns[test.strains[0]]
    if test.sign and (wrong := np.flatnonzero(test.sign * first < 0)).size:
        allowed = f"in the test {name} it must be {'at least' if test.sign > 0 else 'at most'} 0"
        raise _fail(rows[wrong[0]], f"{test.strains[0]} is {first[wrong[0]]:.4g}, but {allowed}")
    x = columns[runs]
    if (back := np.flatnonzero(np.diff(x) * np.sign(x[-1] - x[0]) <= 0)).size:
        k = back[0] + 1
        allowed = "it must rise or fall strictly (keep one loading branch)"
        raise _fail(rows[k], f"{runs} is {x[k]:.6g} after {x[k - 1]:.6g}, but {allowed}")
    for column in measured:
        if not np.any(columns[column]):
            raise _fail(rows[0], f"{column} is 0 in every row, so there is nothing to fit")


def _columns(table, name, needed, optional, measured):
    """Columns {name: (n,)} in inner units, and their line numbers."""
    if not table:
        raise InputError("there is no header; allowed is a line such as eps_a [%], sigma_a [MPa]")
    line, text = table[0]
    delimiter = ";" if ";" in text else ","
    allowed = (*needed, *optional, *measured)
    header: list[tuple[str, float]] = []
    for cell in next(csv.reader([text], delimiter=delimiter)):
        match = re.fullmatch(r"\s*(\w+)\s*(?:\[\s*(.+?)\s*\])?\s*", cell)
        column, unit = match.groups() if match else (cell.strip(), None)
        if column not in _UNIT:
            raise _fail(line, str(unknown_key(column, allowed, f"column {column!r}")))
        if column not in allowed:
            raise _fail(
                line, f"the column {column} does not belong to the test {name}; allowed are {', '.join(allowed)}"
            )
        if column in (h[0] for h in header):
            raise _fail(line, f"the column {column} is repeated; allowed is once")
        if unit is None:
            raise _fail(
                line, f"the column {column} has no unit; write {column} [{next(iter(_UNIT[column]))}], for example"
            )
        if unit not in _UNIT[column]:
            raise _fail(line, str(unknown_key(unit, _UNIT[column], f"unit [{unit}] of column {column}")))
        header.append((column, _UNIT[column][unit]))
    names = [h[0] for h in header]
    missing = [column for column in needed if column not in names]
    if not set(TESTS[name].measured) & set(names):
        missing.append(" or ".join(TESTS[name].measured))
    if missing:
        raise _fail(line, f"the column {missing[0]} is missing, which the test {name} needs")
    rows, values = [], []
    for number, text in table[1:]:
        cells = next(csv.reader([text], delimiter=delimiter))
        if len(cells) != len(header):
            raise _fail(
                number,
                f"there are {len(cells)} cells under {len(header)} columns; "
                "allowed is one number a column, with a decimal point",
            )
        found = []
        for cell, (column, factor) in zip(cells, header):
            try:
                value = float(cell)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                raise _fail(
                    number, f"{column} is {cell.strip()!r}, but it must be a finite number with a decimal point"
                )
            found.append(value * factor)
        rows.append(number)
        values.append(found)
    return dict(zip(names, np.array(values).reshape(-1, len(names)).T)), rows


def _quantity(key, row, text, units):
    match = re.fullmatch(r"\s*([-+.\deE]+)\s*(\S+)\s*", text)
    try:
        value = float(match[1]) * units[match[2]] if match else math.nan
    except (KeyError, ValueError):
        value = math.nan
    if not 0 < value < math.inf:
        raise _fail(row, f"{key} is {text!r}, but it must be a number above 0 with one of the units {', '.join(units)}")
    return value


def _noise(given, responses):
    if given is None:
        return None
    row, text = given
    if match := re.fullmatch(r"([.\deE+-]+)\s*%\s*of\s*(maximum|value)", text):
        return match[2], _quantity("noise", row, f"{match[1]} %", {"%": 0.01})
    if len(responses) > 1 or "%" in text:
        raise _fail(
            row,
            f"noise is {text!r}; allowed is `2 % of maximum` or `2 % of value`, "
            "or a number with a unit if one column is measured",
        )
    return "absolute", _quantity("noise", row, text, _UNIT[responses[0].column])


def _response(column, values, gamma, test, lengths, t):
    """How the law predicts this column; see the power balances at the top."""
    gain, half = np.ones_like(values), None
    if column == "F_sh":
        gain = t / np.cos(gamma)
    elif test == "picture_frame":
        gain = t * lengths["fabric_length"] ** 2 / (lengths["frame_length"] * np.sin(math.pi / 4 - gamma / 2))
    elif test == "bias_extension":
        H, W = lengths["height"], lengths["width"]
        if H < 2 * W:
            raise InputError(
                f"height is {H:g} mm and width {W:g} mm; allowed is a height of 2 widths or more, for a zone of full shear"
            )
        lever = (H / W - 1) * (np.cos(gamma / 2) - np.sin(gamma / 2))
        gain, half = t * (2 * H - 3 * W) / lever, t * W / lever
    return Response(column, next(iter(_UNIT[column])), values, gain, half)


def bias_normalised(gamma: ArrayLike, force: ArrayLike, height: float, width: float) -> np.ndarray:
    """Normalised shear force F_sh (n,) [N/mm] of a bias test, by the formula of Cao et al. (2008).

    gamma: (n,) [rad], rising from above 0; force: (n,) [N]; height, width [mm] of the strip. F_sh(gamma/2) is interpolated
    linearly, from 0 at 0, so the formula is one linear system.
    """
    g, H, W = np.asarray(gamma, float), height, width
    at_half = np.array([np.interp(g / 2, np.r_[0, g], np.r_[0, hat]) for hat in np.eye(len(g))]).T
    A = np.diag((2 * H - 3 * W) * np.cos(g)) + (W * np.cos(g / 2))[:, None] * at_half
    return np.linalg.solve(A, (H / W - 1) * np.asarray(force) * (np.cos(g / 2) - np.sin(g / 2)))


def write(folder: Path | str, sheet: Sheet, curves: Iterable[Curve], remarks: Iterable[str] = ()) -> None:
    """Write a data set that `read` reads back to 12 digits; remarks: comment lines for each CSV. Raises InputError."""
    folder = Path(folder)
    shown = {"eps_a": "%", "eps_b": "%", "gamma": "deg"}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        numbers = {"thickness_mm": sheet.thickness, "density_g_per_cm3": sheet.density}
        text = tomli_w.dumps({"name": sheet.name, **numbers, "balanced": sheet.balanced})
        (folder / "sheet.toml").write_text(text, encoding="utf-8")
        for curve in curves:
            test = TESTS[curve.test]
            strains = [
                c
                for c in (*test.strains, *test.optional)
                if c in test.strains or np.any(curve.strains[:, STRAINS.index(c)])
            ]
            columns = {c: curve.strains[:, STRAINS.index(c)] for c in strains} | {
                r.column: r.values for r in curve.responses
            }
            units = {c: shown.get(c, next(iter(_UNIT[c]))) for c in columns}
            head = [*remarks, f"test: {curve.test}", *(f"{k}: {v:g} mm" for k, v in curve.keys.items())]
            if "lateral" in test.keys:
                head.append(f"lateral: {'held' if curve.free is None else 'free'}")
            if curve.noise:
                kind, size = curve.noise
                head.append(
                    f"noise: {size:g} {curve.responses[0].unit}"
                    if kind == "absolute"
                    else f"noise: {100 * size:g} % of {kind}"
                )
            with open(folder / curve.file, "w", newline="", encoding="utf-8") as stream:
                stream.writelines(f"# {line}\n" for line in head)
                writer = csv.writer(stream, lineterminator="\n")
                writer.writerow(f"{c} [{unit}]" for c, unit in units.items())
                writer.writerows(
                    [f"{v / _UNIT[c][units[c]]:.12g}" for c, v in zip(columns, row)] for row in zip(*columns.values())
                )
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None


def check_contradictions(curves: Sequence[Curve], balanced: bool) -> None:
    """InputError if two curves of the same states differ, as r.m.s. over their common range, by more than a quarter of
    the larger peak and 4 standard deviations of their stated noise. If `balanced`, warp is also compared with weft."""
    for i, one in enumerate(curves):
        for two in curves[i + 1 :]:
            _contradict(one, two, "")
            if balanced:
                _contradict(one, _exchanged(two), "; if warp and weft differ, say balanced = false")


def _exchanged(curve):
    """The curve with the names a and b exchanged."""
    swap = str.maketrans("ab", "ba")
    responses = [
        Response(
            r.column[:-1] + r.column[-1].translate(swap) if r.column[:3] in ("sig", "eps") else r.column,
            r.unit,
            r.values,
            r.gain,
            r.half,
        )
        for r in curve.responses
    ]
    return Curve(curve.file, curve.test, curve.strains[:, [1, 0, 2]], tuple(responses), curve.rows,
                 (1, 0, 2)[curve.abscissa], None if curve.free is None else 1 - curve.free, curve.noise, curve.keys)  # fmt: skip


def _contradict(one, two, hint):
    if one.free != two.free or one.abscissa != two.abscissa:
        return
    x, order = one.strains[:, one.abscissa], np.argsort(two.strains[:, two.abscissa])
    there = two.strains[order, two.abscissa]
    common = np.flatnonzero((x >= there[0]) & (x <= there[-1]))
    if common.size < 3:
        return
    for k in range(3):
        other = np.interp(x[common], there, two.strains[order, k])
        size = max(np.abs(one.strains[:, k]).max(), np.abs(two.strains[:, k]).max())
        if np.any(np.abs(one.strains[common, k] - other) > 0.05 * size):
            return
    for r in one.responses:
        for q in two.responses:
            if r.component != q.component or (r.half is not None or q.half is not None) and one.keys != two.keys:
                continue
            scale = (r.gain, q.gain) if r.half is None and q.half is None else (1.0, 1.0)
            mine, theirs = r.values / scale[0], (q.values / scale[1])[order]
            gap = np.abs(mine[common] - np.interp(x[common], there, theirs))
            peak = max(np.abs(mine[common]).max(), np.abs(theirs).max())
            stated = [c.noise[1] / (peak if c.noise[0] == "absolute" else 1) for c in (one, two) if c.noise]
            if (found := np.sqrt(np.mean(gap**2)) / peak) > max(0.25, 4 * math.hypot(*stated)):
                worst = common[np.argmax(gap)]
                raise InputError(
                    f"{one.file}, row {one.rows[worst]}: {r.column} contradicts {q.column} of {two.file}, as they differ by "
                    f"{100 * found:.0f} % of their peak (r.m.s.) in the same states; allowed is 25 % or 4 standard deviations{hint}"
                )
