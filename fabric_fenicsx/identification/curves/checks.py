"""Values that a test curve cannot have, and doubts about those that it has."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ...core.errors import InputError
from ...core.formatting import rounded
from ...io.units import REACH
from .model import STRAINS, TESTS, Curve, Table, bias_angle, unit_inside, units


def check_length(table: Table, least: int) -> None:
    """InputError for a table of fewer rows than `least`."""
    if len(table.rows) < least:
        text = f"{len(table.rows)} points remain to be fitted; expected {least} or more"
        raise InputError(f"row {[table.top, *table.rows][-1]}: {text}")


def check_values(name: str, table: Table, runs: str, measured: Sequence[str]) -> None:
    """InputError by row for a value that the test `name` cannot have; runs: the column that is
    raised; measured: what the law is fitted to."""
    of_test = _compaction_faults if name == "compaction" else _faults
    for column, flags, words, allowed in of_test(name, table, runs, measured):
        for k in np.flatnonzero(flags)[:1]:
            text = f"{column} is {_value(table.columns[column][k], column)}{words}"
            raise InputError(f"row {table.rows[k]}: {text}; expected {allowed}")


def _value(value, column):
    return f"{value:.4g} {unit_inside(column)}".removesuffix(" -")


def _faults(name, table, runs, measured):
    """(column, flags of the rows (n,), what follows the value, what is allowed) of each rule."""
    sign, row, columns = TESTS[name].sign, np.arange(len(table.rows)), table.columns
    strains, first = [column for column in STRAINS if column in columns], TESTS[name].strains[0]
    for column in strains:
        _, most = REACH[column.split("_")[0]]
        allowed = f"within +-{most:.3g} (is the unit in the header right?)"
        yield column, np.abs(columns[column]) > most, "", allowed
    allowed = f"at {'least' if sign > 0 else 'most'} 0 in the test {name}"
    yield first, sign * columns[first] < 0, "", allowed
    x, unit = columns[runs], table.header[runs]
    other = {"%": "-", "deg": "rad"}.get(unit, "")
    bound = REACH[runs.split("_")[0]][0] if other else 0.0
    least = f"{bound / units(runs)[unit]:.3g} {unit}"
    allowed = f"{least} or more (is the unit {other} rather than {unit}?)"
    yield runs, (row == np.abs(x).argmax()) & (np.abs(x) < bound), " at most", allowed
    undeformed = ~np.any([columns[c] for c in strains if c not in measured], axis=0)
    for column in measured:
        values, narrows = columns[column], column.startswith("eps")
        if "F" in columns and not narrows:  # of a load cell that may not read 0
            values = values - values[0]
        peak = int(np.abs(values).argmax())
        largest = values[peak]
        allowed = "within +-1e9 (is it a mark of overload?)"
        yield column, np.abs(columns[column]) > 1e9, "", allowed
        yield column, values * 0 == largest, " in every row", "the range of the law"
        side, why = (-1, "free sides narrow") if narrows else (sign, f"of the test {name}")
        if not narrows and sign < 0 and "gamma" in columns:
            side = 0  # compressed and sheared, k_SC can make it a pull
        allowed = f"at {'least' if side > 0 else 'most'} 0, {why} (is its sign wrong?)"
        wrong = min(largest * side, columns[column][peak] * side) < 0
        yield column, (row == peak) & wrong, "", allowed
        flags, allowed = np.abs(values) > 0.2 * abs(largest), "up to 20 % of its peak there"
        words = " at the start"
        yield column, undeformed & flags, words, f"{allowed} (subtract the offset)"
        share = f"{100 * values[-1] / largest:.0f} % of its value in row {table.rows[peak]}"
        flags = (row == row[-1]) & (np.abs(values) < 0.5 * abs(largest))
        allowed = "50 % or more (keep only rows before yarns break)"
        yield column, flags & name.startswith("uniaxial"), f" and has fallen to {share}", allowed


def _compaction_faults(_, table, runs, measured):
    """As `_faults`, of a test of compaction."""
    p, (column,) = table.columns[runs], measured
    values, is_share = table.columns[column], column == "fibre_volume_fraction"
    last = np.arange(len(p)) == len(p) - 1
    yield runs, p <= 0, "", "above 0"
    allowed = "above 0 and below 1" if is_share else "above 0"
    yield column, (values <= 0) | (is_share & (values >= 1)), "", allowed
    yield runs, last & (p[-1] <= p[0]), " at last", "to rise"
    words = f" under the highest pressure and {_value(values[0], column)} under the lowest"
    grows = values[-1] <= values[0] if is_share else values[-1] >= values[0]
    yield column, last & grows, words, "more" if is_share else "less"


def origin_remarks(name: str, table: Table, moved: str, stated: Mapping) -> Iterator[str]:
    """Sentences on a force that is not 0 at first, or that hardly rises at first, where no `zero`
    or `slack` is `stated`; moved: the column that runs."""
    if "F" not in table.columns or TESTS[name].sign <= 0:
        return
    x, zero = np.abs(table.columns[moved]), table.columns["F"][0]
    force = np.abs(table.columns["F"] - zero)
    if "zero" not in stated and x[0] <= 0.01 * x[-1] and abs(zero) > 0.02 * force.max():
        reading = f"F is {rounded(zero)} N at the start"
        yield f"{reading}; if this is an offset, state `# zero: {rounded(zero)} N`"
    early = (force > 0.05 * force.max()) & (force < 0.15 * force.max()) & (x < x[-1])
    if "slack" in stated or early.sum() < 3 or not np.ptp(x[early]):
        return
    slope, offset = np.polyfit(x[early], force[early], 1)
    toe = -offset / slope if slope > 0 else 0.0
    # a straight or parabolic curve has more force there
    if toe > 0.03 * x[-1] and np.interp(toe, x, force) < 0.2 * slope * toe:
        unit = {"displacement": "mm", "gamma": "deg"}.get(moved, "%")
        most = f"{rounded(toe / units(moved)[unit], 2)} {unit}"  # of a curve that bends upwards
        tangent = f"the tangent at 10 % of the peak meets zero force at {most}"
        yield f"{tangent}; if this is slack, state it as `# slack: {most}` or less"


def angle_remarks(table: Table, lengths: Mapping[str, float]) -> Iterator[str]:
    """A sentence on measured shear angles that are not those of the displacement up to 30 deg."""
    by_clamp = bias_angle(table.columns["displacement"], lengths["height"], lengths["width"])
    for k in np.flatnonzero((by_clamp > math.radians(5)) & (by_clamp < math.radians(30)))[-1:]:
        angle, other = math.degrees(table.columns["gamma"][k]), math.degrees(by_clamp[k])
        if abs(angle / other - 1) > 0.3:
            yield (
                f"gamma is {angle:.3g} deg in row {table.rows[k]}, and {other:.3g} deg by the "
                "displacement; it must be the change of the angle between the yarns, not half of "
                "it as the shear strain of a tensor"
            )


def curve_warnings(curves: Sequence[Curve]) -> Iterator[str]:
    """Sentences on bias tests with shear angles from the displacement, and beyond 30 deg, where the
    specimen is not simulated."""
    for curve in (c for c in curves if c.is_raw and c.responses[0].linear is None):
        for k in np.flatnonzero(np.abs(curve.strains[:, 2]) > math.radians(30))[:1]:
            yield (
                f"{curve.file}: from row {curve.rows[k]} on shear angles are above 30 deg by "
                "the displacement, more than a real strip's: simulate or measure them"
            )


def copies(curves: Sequence[Curve]) -> Iterator[str]:
    """Sentences on copies of one file, which would count twice."""
    first: dict[bytes, str] = {}
    for curve in curves:
        values = np.column_stack([curve.strains, *(each.values for each in curve.responses)])
        if (other := first.setdefault(values.tobytes(), curve.file)) != curve.file:
            flaw = f"{curve.file} has the values of {other}, row by row"
            yield f"{flaw}; list each test once, and as one kind of test"
