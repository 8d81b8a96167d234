"""The error of a run, estimated from the same run on a mesh twice as coarse.

On meshes with cells of size h and 2 h a number with an error of c h^p differs by c h^p (2^p - 1):
so the difference over 2^p - 1 is the error on the finer mesh (Richardson 1911). P. J. Roache
multiplies that by a factor of safety: 1.25 where the order p was observed, 3 where it is assumed
("Perspective: a method for uniform reporting of grid refinement studies", J. Fluids Eng. 116 (1994)
405-413).
"""

import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

from ..sheets.blank import Part
from . import measures
from .result import Result

SAFETY = 1.25  # of forces, energies, curves and means of fields
LOCAL_SAFETY = 3.0  # of all else, as a strain at a point: errors there change their sign
LOCAL_ORDER = 1.0
# names of forces, energies and stresses, which the whole sheet makes
FORCE = re.compile(r"_(N|Nmm|MPa|N_per_mm)$")
FIELDS = "log_eps_11", "log_eps_22", "shear_angle"
Row = dict[str, Any]


def factor(order: float, safety: float = SAFETY) -> float:
    """Factor from a difference to the coarser mesh to an error."""
    return safety / (2**order - 1)


def curve_errors(rows: Sequence[Row], coarse: Sequence[Row], by: float) -> np.ndarray:
    """Errors [N] of the curve at each of `rows`, its points joined by lines, (rows,): of the mesh,
    from the rows of the coarser one, times `by`, and of the lines between the points."""
    (load, force), (loads, forces) = (
        np.array([(row["load"], row["reaction_N"]) for row in each]).T for each in (rows, coarse)
    )
    mesh = by * np.abs(np.interp(loads, load, force) - forces)
    return np.interp(load, loads, mesh) + _off_lines(load, force)


def _off_lines(load, force):
    """Distance of a smooth curve through the points from the lines that join them, at most: h^2 / 8
    of its second derivative."""
    found = np.zeros(len(load))
    if len(load) < 3:
        return found
    step, slope = np.diff(load), np.diff(force) / np.diff(load)
    bent = np.abs(np.diff(slope)) / (step[1:] + step[:-1])  # half of the second derivative
    found[1:-1] = bent * np.maximum(step[1:], step[:-1]) ** 2 / 4
    found[[0, -1]] = found[[1, -2]]
    return found


def field_differences(result: Result, other: Result) -> dict[str, np.ndarray]:
    """Differences of the cell fields FIELDS of two runs on different meshes, at the owned cells of
    the first: the other's are interpolated between its cells' centres."""
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
        for name, column in zip(names, _interpolated(at[order], values[order], _centres(part)).T):
            found[name][part.cells] = np.abs(result.fields[name][part.cells] - column)
    return found


def _centres(part: Part) -> np.ndarray:
    """Undeformed centres of this rank's cells of a part, (cells, 2) [mm]."""
    return part.blank.midpoints()[:2, part.cells].T.round(9)


def _interpolated(at, values, places):
    if not len(places):
        return np.zeros((0, values.shape[1]))
    found = LinearNDInterpolator(at, values)(places)
    outside = np.isnan(found[:, 0])
    if outside.any():
        found[outside] = NearestNDInterpolator(at, values)(places[outside])
    return found


def estimate(
    result: Result, coarse: Result, order: float, names: Iterable[str]
) -> dict[str, float]:
    """Estimated absolute errors {quantity: error} of a run, from that on the coarser mesh.

    They are those of the reaction, strain energy, `names` of further quantities, the curve (at
    most) and the FIELDS (root mean square over the area). order: of forces and energies. The rows
    of the result get the curve's as `error_N`, its fields those of the FIELDS as `error_...`.
    """
    whole, local = factor(order), factor(LOCAL_ORDER, LOCAL_SAFETY)
    errors: dict[str, float] = {}
    for name in ("reaction_N", "strain_energy_Nmm", *names):
        mine, theirs = (run.number(name) for run in (result, coarse))
        if mine is not None and theirs is not None:
            errors[name] = (whole if FORCE.search(name) else local) * abs(mine - theirs)
    curve = curve_errors(result.rows, coarse.rows, whole)
    for row, error in zip(result.rows, curve):
        row["error_N"] = float(error)
    errors["curve_N"] = float(curve.max())
    comm, area = result.scene.comm, result.scene.blank.areas()
    for name, apart in field_differences(result, coarse).items():
        field = result.fields[f"error_{name}"] = factor(LOCAL_ORDER) * apart
        result.fields.units[f"error_{name}"] = result.fields.units.get(name, "-")
        mean = measures.mean(comm, np.nan_to_num(field) ** 2, area) or 0.0
        root = float(np.sqrt(mean))
        if name == "shear_angle":
            errors["shear_angle_rms_deg"] = float(np.degrees(root))
        else:
            errors[f"{name}_rms"] = root
    return errors
