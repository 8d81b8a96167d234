"""Values that a test curve cannot have."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from ...readers.text_tables import Problems
from ...runtime.errors import InputError
from ...runtime.formatting import rounded
from .branch import NOISE
from .forces import bias_angle
from .model import STRAINS, TESTS, Curve, Table, unit_inside, units

# beyond it a wrong unit is the likely reason
MAX_STRAINS = {"eps_a": 0.5, "eps_b": 0.5, "gamma": math.radians(85)}
# what a test must reach: below it fractions were taken for percent, or radians for degrees
LEAST_STRAINS = {"%": (5e-4, "-"), "deg": (math.radians(1.6), "rad")}


def _refused(row: int, text: str, allowed: str) -> InputError:
    return InputError(f"row {row}: {text}; allowed is {allowed}")


def _first(flags: np.ndarray) -> np.ndarray:
    """The number of the first true flag, if there is one."""
    return np.flatnonzero(flags)[:1]


def _value(value: float, column: str) -> str:
    return f"{value:.4g} {unit_inside(column)}".removesuffix(" -")


def check_length(table: Table, least: int) -> None:
    """InputError for a table of fewer rows than `least`."""
    if len(table.rows) < least:
        text = f"the file ends after {len(table.rows)} points"
        raise _refused([table.top, *table.rows][-1], text, f"{least} or more")


def check_values(name: str, table: Table, runs: str, measured: Sequence[str]) -> None:
    """InputError by row for all values that the test `name` cannot have; runs: the strain that is
    raised; measured: what the law is fitted to."""
    problems = Problems()
    strains = [column for column in STRAINS if column in table.columns]
    for column in strains:
        with problems:
            _check_strain(name, table, column)
    with problems:
        x = table.columns[runs]
        _check_monotone(table, runs, np.sign(x[-1] - x[0]), "rise or fall")
        _check_reach(table, runs)
    undeformed = ~np.any([table.columns[c] for c in strains if c not in measured], axis=0)
    for column in measured:
        with problems:
            _check_response(name, table, column, undeformed)
    problems.stop()


def _check_strain(name, table, column):
    """A strain that is too large or of the wrong sign."""
    test, rows, values, most = TESTS[name], table.rows, table.columns[column], MAX_STRAINS[column]
    for k in _first(np.abs(values) > most):
        text = f"{column} is {values[k]:.4g} {unit_inside(column)}"
        raise _refused(rows[k], text, f"within +-{most:.3g} (is the unit in the header right?)")
    for k in _first((column == test.strains[0]) & (test.sign * values < 0)):
        allowed = f"{'at least' if test.sign > 0 else 'at most'} 0 in the test {name}"
        raise _refused(rows[k], f"{column} is {values[k]:.4g}", allowed)


def _check_monotone(table, runs, sign, way, unit=""):
    """A column that turns back by more than noise."""
    x, onward = table.columns[runs], sign * table.columns[runs]
    for far in _first(np.maximum.accumulate(onward) - onward > NOISE * np.ptp(x)):
        k = int(onward[:far].argmax()) + 1
        text = f"{runs} is {x[k]:.6g}{unit} after {x[k - 1]:.6g}{unit}"
        raise _refused(table.rows[k], text, f"to {way} (keep one loading branch)")


def _check_reach(table, runs):
    """A strain that hardly leaves 0."""
    x, unit = np.abs(table.columns[runs]), table.header[runs]
    least, other = LEAST_STRAINS.get(unit, (0.0, ""))
    if x.max() < least:
        factor = units(runs)[unit]
        text = f"{runs} reaches {x.max() / factor:.3g} {unit} only"
        allowed = f"{least / factor:.3g} {unit} or more (is the unit {other} rather than {unit}?)"
        raise _refused(table.rows[int(x.argmax())], text, allowed)


def _check_response(name, table, column, undeformed):
    """A measured column that is 0, of the wrong sign, not 0 without strain, or that falls."""
    test, values, rows = TESTS[name], table.columns[column], table.rows
    if "F" in table.columns and not column.startswith("eps"):  # of a load cell that may not read 0
        values = values - values[0]
    peak = int(np.abs(values).argmax())
    largest = values[peak]
    if not largest:
        same = f"{column} is {table.columns[column][0]:g} in every row"
        raise InputError(f"row {rows[0]}: {same}, so there is nothing to fit")
    narrows = column.startswith("eps")
    sign = -1 if narrows else test.sign
    if not narrows and sign < 0 and "gamma" in table.columns:
        sign = 0  # compressed and sheared, k_SC can make it a pull
    if largest * sign < 0:
        why = "free sides narrow" if narrows else f"of the test {name}"
        allowed = f"at {'least' if sign > 0 else 'most'} 0, {why} (is its sign turned?)"
        raise _refused(rows[peak], f"{column} is {_value(largest, column)}", allowed)
    for k in _first(undeformed & (np.abs(values) > 0.2 * abs(largest))):
        text = f"{column} is {_value(values[k], column)} before anything is strained"
        allowed = "up to 20 % of its peak there (take the offset off)"
        raise _refused(rows[k], text, allowed)
    if name.startswith("uniaxial") and abs(values[-1]) < 0.5 * abs(largest):
        share = f"{100 * values[-1] / largest:.0f} % of its value in row {rows[peak]}"
        allowed = "50 % or more (keep the rows before yarns break)"
        raise _refused(rows[-1], f"{column} has fallen to {share}", allowed)


def check_compaction(table: Table, column: str) -> None:
    """InputError by row for values that a test of compaction, measured by `column`, cannot have."""
    columns, rows = table.columns, table.rows
    if len(columns) > 2:
        text = "both columns thickness and fibre_volume_fraction"
        raise _refused(table.top, text, "one of them")
    check_length(table, 4)  # to tell three numbers
    is_share = column == "fibre_volume_fraction"
    for name, values in columns.items():
        below = name == "fibre_volume_fraction"
        for k in _first((values <= 0) | (below & (values >= 1))):
            allowed = "above 0 and below 1" if below else "above 0"
            raise _refused(rows[k], f"{name} is {_value(values[k], name)}", allowed)
    _check_monotone(table, "pressure", 1, "rise", " MPa")
    p, v = columns["pressure"], columns[column]
    if p[-1] < 5.0 * p[0]:  # thickness follows the logarithm
        text = f"pressure ends at {p[-1] / p[0]:.2g} times the first"
        raise _refused(rows[-1], text, "5 times or more")
    if (v[-1] <= v[0]) if is_share else (v[-1] >= v[0]):
        low, high = (_value(each, column) for each in v[[0, -1]])
        text = f"{column} is {high} under the highest pressure and {low} under the lowest"
        raise _refused(rows[-1], text, "more" if is_share else "less")


def origin_remarks(name: str, table: Table, moved: str, stated: Mapping) -> list[str]:
    """Sentences on a force that is not 0 at first, or that hardly rises at first, where no `zero`
    or `slack` is `stated`; moved: the column that runs."""
    if "F" not in table.columns or TESTS[name].sign <= 0:
        return []
    x, remarks = np.abs(table.columns[moved]), []
    zero, force = table.columns["F"][0], np.abs(table.columns["F"] - table.columns["F"][0])
    if "zero" not in stated and x[0] <= 0.01 * x[-1] and abs(zero) > 0.02 * force.max():
        text = f"F is {rounded(zero)} N before anything is strained; if the load cell reads that"
        remarks.append(f"{text} without load, state `# zero: {rounded(zero)} N`")
    early = (force > 0.05 * force.max()) & (force < 0.15 * force.max()) & (x < x[-1])
    if "slack" in stated or early.sum() < 3 or not np.ptp(x[early]):
        return remarks
    slope, offset = np.polyfit(x[early], force[early], 1)
    toe = -offset / slope if slope > 0 else 0.0
    # a straight or parabolic curve has more force there
    if toe > 0.03 * x[-1] and np.interp(toe, x, force) < 0.2 * slope * toe:
        unit = {"displacement": "mm", "gamma": "deg"}.get(moved, "%")
        most = f"{rounded(toe / units(moved)[unit], 2)} {unit}"  # of a curve that bends upwards
        text = f"the tangent at 10 % of the peak meets zero force at {most}: slack up to that is"
        remarks.append(f"{text} possible; if you know it, state it as `# slack: {most}` or less")
    return remarks


def angle_remarks(table: Table, lengths: Mapping[str, float]) -> list[str]:
    """A sentence on measured shear angles that are not those of the displacement up to 30 deg."""
    by_clamp = bias_angle(table.columns["displacement"], lengths["height"], lengths["width"])
    for k in np.flatnonzero((by_clamp > math.radians(5)) & (by_clamp < math.radians(30)))[-1:]:
        gamma = table.columns["gamma"][k]
        if abs(gamma / by_clamp[k] - 1) > 0.3:
            angle, other = (rounded(math.degrees(each), 3) for each in (gamma, by_clamp[k]))
            return [
                f"gamma is {angle} deg in row {table.rows[k]}, and {other} deg by the "
                "displacement; gamma is the change of the angle between the yarns, not half of it "
                "as the shear strain of a tensor"
            ]
    return []


def curve_warnings(curves: Sequence[Curve]) -> Iterator[str]:
    """Sentences on bias tests with shear angles from the displacement, and beyond 30 deg, where the
    specimen is not simulated."""
    for curve in curves:
        if curve.is_raw and curve.responses[0].linear is None:
            for k in _first(np.abs(curve.strains[:, 2]) > math.radians(30)):
                yield (
                    f"{curve.file}: from row {curve.rows[k]} on shear angles are above 30 deg by "
                    "the displacement, where those of a real strip are less: simulate the "
                    "specimen, which needs DOLFINx, measure them, or leave these rows out"
                )


def check_copies(curves: Sequence[Curve]) -> None:
    """InputError for two copies of one file, which would count twice."""
    for one, two in combinations(curves, 2):
        mine, theirs = ([c.strains, *(r.values for r in c.responses)] for c in (one, two))
        if len(mine) == len(theirs) and all(map(np.array_equal, mine, theirs)):
            raise InputError(
                f"{two.file} has the values of {one.file}, row by row; allowed is each test once, "
                "and as one kind of test"
            )
