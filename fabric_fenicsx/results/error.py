"""The error of a run, estimated from the same run on two meshes, each twice as coarse.

On meshes with cells of size h and 2 h a number with an error of c h^p differs by c h^p (2^p - 1):
so the difference over 2^p - 1 is the error on the finer mesh (Richardson 1911). A third mesh
measures the order p, as differences between meshes grow by 2^p. P. J. Roache multiplies by a factor
of safety where p was measured, and takes three times the difference where it was not ("Perspective:
a method for uniform reporting of grid refinement studies", J. Fluids Eng. 116 (1994) 405-413).
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..sheets.blank import Part
from . import measures
from .result import Result

SAFETY = 2.0  # see docs/errors.md
UNMEASURED = 3.0  # times the difference without a third mesh
ORDERS = 0.5, 3.0  # least and greatest order that is believed
FIELDS = "log_eps_11", "log_eps_22", "shear_angle"
Row = dict[str, Any]


def bound(first: ArrayLike, second: ArrayLike | None = None) -> np.ndarray:
    """Errors of numbers by their `first` differences, to the next coarser mesh, and the `second`
    ones, between that mesh and one more, if there is one; as many as the first. Of several numbers
    the largest differences tell the order of all."""
    first = np.asarray(first, float)
    if second is None:
        return UNMEASURED * abs(first)
    a, b = (float(np.ravel(each)[np.abs(each).argmax()]) for each in (first, second))
    if not a:
        return SAFETY * np.full_like(first, abs(b))
    if a * b <= 0:  # the error changes its sign, so only its size is known
        return SAFETY * max(1.0, abs(b / a)) * abs(first)
    return SAFETY / (2 ** np.clip(np.log2(b / a), *ORDERS) - 1) * abs(first)


def curve_errors(curves: Sequence[Sequence[Row]]) -> np.ndarray:
    """Errors [N] of the curve at each row of the first of `curves`, its points joined by lines,
    (rows,): of the mesh, from the rows on coarser meshes, and of the lines: their distance from a
    smooth curve is at most h^2 / 8 of its second derivative."""
    points = [np.array([(row["load"], row["reaction_N"]) for row in rows]).T for rows in curves]
    apart = [np.interp(to[0], *of) - to[1] for of, to in zip(points, points[1:])]
    (load, force), (loads, _), *_ = points
    of_mesh = np.interp(load, loads, bound(*apart))
    if len(load) < 3:
        return of_mesh
    step, slope = np.diff(load), np.diff(force) / np.diff(load)
    bent = np.abs(np.diff(slope)) / (step[1:] + step[:-1])  # half of the second derivative
    return of_mesh + np.pad(bent * np.maximum(step[1:], step[:-1]) ** 2 / 4, 1, mode="edge")


def field_differences(result: Result, other: Result) -> dict[str, np.ndarray]:
    """Differences of the cell fields FIELDS of two runs on different meshes, at the owned cells of
    the first: the other's are interpolated between its cells' centres."""
    from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator  # take long to import

    blank, comm = result.scene.blank, result.scene.comm
    known = other.scene.blank
    names = [name for name in FIELDS if name in result.fields and name in other.fields]
    found = {name: np.full(len(blank.areas()), np.nan) for name in names}
    if not names:
        return found
    for part in blank.parts.values() or [blank.whole]:
        theirs = known.part(part.name)
        at = np.concatenate(comm.allgather(_centres(theirs)))
        order = np.lexsort(at.T)  # the same on any number of ranks
        fields = np.column_stack([other.fields[name][theirs.cells] for name in names])
        values = np.concatenate(comm.allgather(fields))
        known_at, places = (at[order], values[order]), _centres(part)
        if not len(places):
            continue
        columns = LinearNDInterpolator(*known_at)(places)
        columns = np.where(np.isnan(columns), NearestNDInterpolator(*known_at)(places), columns)
        for name, column in zip(names, columns.T):
            found[name][part.cells] = np.abs(result.fields[name][part.cells] - column)
    return found


def _centres(part: Part) -> np.ndarray:
    """Undeformed centres of this rank's cells of a part, (cells, 2) [mm]."""
    return part.blank.midpoints()[:2, part.cells].T.round(9)


def estimate(result: Result, coarser: Sequence[Result], names: Iterable[str]) -> dict[str, float]:
    """Estimated absolute errors {quantity: error} of a run, from one or two on meshes that are each
    twice as coarse as the one before: of the reaction, strain energy, `names` of quantities, the
    curve (at most) and the FIELDS (root mean square over the area). The result's rows get the
    curve's as `error_N`, its fields those of the FIELDS as `error_...`."""
    runs, errors = [result, *coarser], dict[str, float]()
    for name in ("reaction_N", "strain_energy_Nmm", *names):
        values = [value for run in runs if (value := run.number(name)) is not None]
        if len(values) == len(runs):
            errors[name] = float(bound(*np.diff(values)))
    curve = curve_errors([run.rows for run in runs])
    for row, error in zip(result.rows, curve):
        row["error_N"] = float(error)
    errors["curve_N"] = float(curve.max())
    apart = [field_differences(fine, coarse) for fine, coarse in zip(runs, runs[1:])]
    for name, differences in apart[0].items():
        sizes = []
        for run, each in zip(runs, apart):
            squares, areas = np.nan_to_num(each[name]) ** 2, run.scene.blank.areas()
            sizes.append(float(np.sqrt(measures.mean(run.scene.comm, squares, areas) or 0.0)))
        root = float(bound(*sizes))
        result.fields[f"error_{name}"] = differences * (root / sizes[0] if sizes[0] else 0.0)
        result.fields.units[f"error_{name}"] = result.fields.units.get(name, "-")
        if name == "shear_angle":
            errors["shear_angle_rms_deg"] = float(np.degrees(root))
        else:
            errors[f"{name}_rms"] = root
    return errors
