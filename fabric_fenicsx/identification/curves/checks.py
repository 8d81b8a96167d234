"""Values that a test curve cannot have, and curves that contradict each other."""

import math
from collections.abc import Sequence

import numpy as np

from ...readers.text_tables import Problems
from ...runtime.errors import InputError
from .model import STRAINS, TESTS, CompactionTest, Curve, Response, Sheet, Table, unit_inside, units

# beyond it a wrong unit is the likely reason
_RANGE = {"eps_a": 0.5, "eps_b": 0.5, "gamma": math.radians(85)}
_LONGEST = 0.2  # strain of a yarn in tension that fabrics hardly have
# what a test must reach: below it fractions were taken for percent, or radians for degrees
_LEAST = {"%": (5e-4, "-"), "deg": (math.radians(1.6), "rad")}
_OFFSET = 0.2  # largest share of the peak that may be measured in the undeformed state
_FALLEN = 0.5  # share of the peak below which tension falls where yarns break
_SLACK = 0.1  # of what a law without b would bear at a strain, below which a strip is slack
_SLACK_SHARE = 0.05  # of the largest strain, up to which slack is not worth a word
TRUSTED = 30.0  # deg, to which angles by the displacement of a bias test are measured ones
_PRESSED = 4  # points that tell compaction's three numbers
_RANGE_OF_PRESSURE = 5.0  # the last over the first, as thickness follows the logarithm


def _fail(row: int, text: str) -> InputError:
    return InputError(f"row {row}: {text}")


def _told(value: float, column: str) -> str:
    return f"{value:.4g} {unit_inside(column)}".removesuffix(" -")


def check_values(name: str, table: Table, runs: str, measured: Sequence[str]) -> None:
    """InputError by row for all values that the test `name` cannot have; runs: the strain that is
    raised; measured: what the law is fitted to."""
    problems = Problems()
    for column in STRAINS:
        with problems:
            _check_strain(name, table, column)
    with problems:
        _check_way(table, runs)
    strains = [table.columns[c] for c in STRAINS if c in table.columns and c not in measured]
    undeformed = np.flatnonzero(~np.any(strains, axis=0))
    for column in measured:
        with problems:
            _check_response(name, table, column, undeformed)
    problems.stop()
    if name.startswith("uniaxial") and f"sigma_{name[-1]}" in measured:
        _check_slack(table, runs, f"sigma_{name[-1]}")


def _check_strain(name, table, column):
    """A strain that is too large or of the wrong sign."""
    test = TESTS[name]
    if column not in table.columns:
        return
    values, most, unit = table.columns[column], _RANGE[column], unit_inside(column)
    if (far := np.flatnonzero(np.abs(values) > most)).size:
        value = f"{values[far[0]]:.4g} {unit}"
        allowed = f"within +-{most:.3g} (is the unit in the header right?)"
        raise _fail(table.rows[far[0]], f"{column} is {value}; allowed is {allowed}")
    if column != test.strains[0] or not test.sign:
        return
    if (wrong := np.flatnonzero(test.sign * values < 0)).size:
        allowed = f"{'at least' if test.sign > 0 else 'at most'} 0 in the test {name}"
        raise _fail(
            table.rows[wrong[0]], f"{column} is {values[wrong[0]]:.4g}; allowed is {allowed}"
        )


def _check_way(table, runs):
    """A strain that turns back, or hardly leaves 0."""
    x, unit = table.columns[runs], table.header[runs]
    if (fallen := np.flatnonzero(np.diff(x) * np.sign(x[-1] - x[0]) <= 0)).size:
        k = fallen[0] + 1
        allowed = "to rise or fall strictly (keep one loading branch)"
        raise _fail(
            table.rows[k], f"{runs} is {x[k]:.6g} after {x[k - 1]:.6g}; allowed is {allowed}"
        )
    least, other = _LEAST.get(unit, (0.0, ""))
    if (reached := np.abs(x).max()) < least:
        factor = units(runs)[unit]
        raise _fail(
            table.rows[int(np.abs(x).argmax())],
            f"{runs} reaches {reached / factor:.3g} {unit} only; allowed is {least / factor:.3g} "
            f"{unit} or more (is the unit {other} rather than {unit}?)",
        )


def _check_response(name, table, column, undeformed):
    """A measured column that is 0, of the wrong sign, not 0 in the rows without strain, or that
    falls."""
    test, values, rows = TESTS[name], table.columns[column], table.rows
    peak = int(np.abs(values).argmax())
    if not values[peak]:
        raise _fail(rows[0], f"{column} is 0 in every row, so there is nothing to fit")
    narrows = column.startswith("eps")
    sign = -1 if narrows else test.sign
    if not narrows and test.sign < 0 and "gamma" in table.columns:
        sign = 0  # compressed and sheared, k_SC can make it a pull
    if values[peak] * sign < 0:
        why = "free sides narrow" if narrows else f"of the test {name}"
        allowed = f"at {'least' if sign > 0 else 'most'} 0, {why} (is its sign turned?)"
        raise _fail(rows[peak], f"{column} is {_told(values[peak], column)}; allowed is {allowed}")
    if (off := undeformed[np.abs(values[undeformed]) > _OFFSET * abs(values[peak])]).size:
        value = _told(values[off[0]], column)
        allowed = f"up to {100 * _OFFSET:g} % of its peak there (take the offset off)"
        raise _fail(
            rows[off[0]], f"{column} is {value} before anything is strained; allowed is {allowed}"
        )
    if name.startswith("uniaxial") and abs(values[-1]) < _FALLEN * abs(values[peak]):
        value = f"{100 * values[-1] / values[peak]:.0f} % of its value in row {rows[peak]}"
        allowed = f"{100 * _FALLEN:g} % or more (keep the rows before yarns break)"
        raise _fail(rows[-1], f"{column} has fallen to {value}; allowed is {allowed}")


def _check_slack(table, runs, column):
    """A strip that is pulled and hardly bears anything at first.

    Of the law's curves over strain the one without b rises latest, with the square; slack is far
    below.
    """
    x, y = (table.columns[c] / np.abs(table.columns[c]).max() for c in (runs, column))
    low = int(np.argmin(np.append(y < _SLACK * x**2, False)))
    if low < 2 or x[low - 1] < _SLACK_SHARE:
        return
    raw = "displacement" if "displacement" in table.columns else runs
    unit = table.header[raw]
    end = f"{table.columns[raw][low - 1] / units(raw)[unit]:.4g} {unit}"
    rows, most = f"rows {table.rows[0]} to {table.rows[low - 1]}", 100 * y[:low].max()
    raise InputError(
        f"{rows}: {column} is up to {most:.2g} % of its peak, while {raw} reaches {end}: the strip "
        f"is slack; allowed is a line `# slack: {end}`, from which the strain then counts"
    )


def doubted_angles(test: str, table: Table) -> list[str]:
    """A sentence if shear angles of a bias test are from its displacement and beyond `TRUSTED`."""
    if test != "bias_extension" or "displacement" not in table.columns:
        return []
    beyond = np.flatnonzero(np.abs(table.columns["gamma"]) > math.radians(TRUSTED))
    if not beyond.size:
        return []
    return [
        f"from row {table.rows[beyond[0]]} on shear angles are above {TRUSTED:g} deg by the "
        "displacement, where those of a real strip are less: measure them, or leave these rows out"
    ]


def check_compaction(table: Table) -> None:
    """InputError by row for what a test of compaction cannot have."""
    columns, rows = table.columns, table.rows
    if len(columns) > 2:
        raise _fail(
            table.top, "both columns thickness and fibre_volume_fraction; allowed is one of them"
        )
    if len(rows) < _PRESSED:
        raise _fail(
            rows[-1] if rows else table.top,
            f"the file ends after {len(rows)} points; allowed is {_PRESSED} or more",
        )
    (column,) = (name for name in columns if name != "pressure")
    is_share = column == "fibre_volume_fraction"
    for name, most in (("pressure", math.inf), (column, 1.0 if is_share else math.inf)):
        if (wrong := np.flatnonzero((columns[name] <= 0) | (columns[name] >= most))).size:
            value = _told(columns[name][wrong[0]], name)
            below = " and below 1" if most == 1 else ""
            raise _fail(rows[wrong[0]], f"{name} is {value}; allowed is above 0{below}")
    p, v = columns["pressure"], columns[column]
    if (fallen := np.flatnonzero(np.diff(p) <= 0)).size:
        k = fallen[0] + 1
        raise _fail(
            rows[k],
            f"pressure is {p[k]:.6g} MPa after {p[k - 1]:.6g} MPa; allowed is to rise strictly "
            "(keep one loading branch)",
        )
    if p[-1] < _RANGE_OF_PRESSURE * p[0]:
        raise _fail(
            rows[-1],
            f"pressure ends at {p[-1] / p[0]:.2g} times the first; allowed is "
            f"{_RANGE_OF_PRESSURE:g} times or more",
        )
    if (v[-1] <= v[0]) if is_share else (v[-1] >= v[0]):
        raise _fail(
            rows[-1],
            f"{column} is {_told(v[-1], column)} under the highest pressure and "
            f"{_told(v[0], column)} under the lowest; allowed is {'more' if is_share else 'less'} "
            "under the highest",
        )


def check_fibres(tests: Sequence[CompactionTest], sheet: Sheet) -> None:
    """InputError for fibre volume fractions of a sheet without a fibre density."""
    for test in tests:
        if test.response.column == "fibre_volume_fraction" and sheet.fibre_density is None:
            raise InputError(
                f"{test.file}: the column fibre_volume_fraction needs the density of the fibres; "
                "allowed is a line fibre_density_g_per_cm3 = 2.54 in sheet.toml, for example, or "
                "the column thickness"
            )


def unit_warnings(curves: Sequence[Curve]) -> list[str]:
    """Sentences on curves that may be in a wrong unit."""
    found = []
    for curve in curves:
        longest = curve.strains[:, :2].max(initial=0)
        if longest > _LONGEST:
            found.append(
                f"{curve.file}: a yarn is stretched by {100 * longest:.3g} %, where fabrics have "
                f"up to {100 * _LONGEST:g} %; look at the unit"
            )
    return found


def check_contradictions(curves: Sequence[Curve], balanced: bool) -> None:
    """InputError if two curves of the same states contradict each other.

    They do if their difference, as r.m.s. over the common range, is more than a quarter of the
    larger peak and more than 4 standard deviations of their stated noise. If `balanced`, warp is
    also compared with weft. Also an error are two copies of one file, which would count twice, and
    a strip that is stiffer with free sides than with held ones: k_TC <= 1 where the yarns across
    contract (eq. 17).
    """
    for i, one in enumerate(curves):
        for two in curves[i + 1 :]:
            _copied(one, two)
            _contradict(one, two, "")
            if balanced:
                _contradict(one, _exchanged(two), "; if warp and weft differ, say balanced = false")


def _exchanged(curve):
    """The curve with the names a and b exchanged."""
    swap = str.maketrans("ab", "ba")
    responses = [
        Response(
            r.column[:-1] + r.column[-1].translate(swap)
            if r.column[:3] in ("sig", "eps")
            else r.column,
            r.unit,
            r.values,
            r.gain,
            r.half,
        )
        for r in curve.responses
    ]
    return Curve(
        curve.file,
        curve.test,
        curve.strains[:, [1, 0, 2]],
        tuple(responses),
        curve.rows,
        (1, 0, 2)[curve.abscissa],
        None if curve.free is None else 1 - curve.free,
        curve.noise,
        curve.keys,
    )


def _copied(one, two):
    if len(one.strains) != len(two.strains) or not np.array_equal(one.strains, two.strains):
        return
    mine, theirs = ([r.values for r in curve.responses] for curve in (one, two))
    if len(mine) == len(theirs) and all(np.array_equal(r, q) for r, q in zip(mine, theirs)):
        raise InputError(
            f"{two.file} has the values of {one.file}, row by row; allowed is each test once, "
            "and as one kind of test"
        )


def _contradict(one, two, hint):
    if (
        one.test == two.test
        and one.test.startswith("uniaxial")
        and (one.free is None) != (two.free is None)
    ):
        held, loose = (one, two) if one.free is None else (two, one)
        _compare(held, loose, hint, softer=True)
    elif one.free == two.free:
        _compare(one, two, hint)


def _compare(one, two, hint, softer=False):
    """InputError if responses differ in the same states; softer: if those of `two` are above those
    of `one`."""
    if one.abscissa != two.abscissa:
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
            if (
                r.component != q.component
                or (r.half is not None or q.half is not None)
                and one.keys != two.keys
            ):
                continue
            scale = (r.gain, q.gain) if r.half is None and q.half is None else (1.0, 1.0)
            mine, theirs = r.values / scale[0], (q.values / scale[1])[order]
            gap = np.interp(x[common], there, theirs) - mine[common]
            gap = np.maximum(gap, 0) if softer else np.abs(gap)
            peak = max(np.abs(mine[common]).max(), np.abs(theirs).max())
            stated = [
                c.noise[1] / (peak if c.noise[0] == "absolute" else 1)
                for c in (one, two)
                if c.noise
            ]
            if (found := np.sqrt(np.mean(gap**2)) / peak) > max(0.25, 4 * math.hypot(*stated)):
                worst = common[np.argmax(gap)]
                if softer:
                    raise InputError(
                        f"{one.file}, row {one.rows[worst]}: with lateral: held {r.column} is "
                        f"{100 * found:.0f} % of the peak (r.m.s.) below that of {two.file} with "
                        "lateral: free; allowed is above it, as free sides make a fabric softer "
                        "(are the two exchanged?)"
                    )
                raise InputError(
                    f"{one.file}, row {one.rows[worst]}: {r.column} contradicts {q.column} of "
                    f"{two.file}, as they differ by {100 * found:.0f} % of their peak (r.m.s.) in "
                    f"the same states; allowed is 25 % or 4 standard deviations{hint}"
                )
