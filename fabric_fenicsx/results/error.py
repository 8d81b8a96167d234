"""The error of a run, estimated by another run on a coarser mesh; see docs/errors.md.

On cells of another kind errors have other causes, so the difference of the two runs is about the
sum of both. On cells of the same kind, twice as large, the other run's error is 2^p times the run's
own, so their difference is at least that for p >= 1. Two numbers may agree by chance, forces and
energies along the whole second half of the load do not: of the same kind, they alone tell errors.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..scene import output
from ..scene.scene import Scene
from . import measures
from .quantities import crumples
from .result import Result
from .verdict import Numbers

OTHER_CELLS = 1.75  # times the difference to a run on cells of another kind
LARGER = {"reaction_N": 1.0, "strain_energy_Nmm": 1.5}  # of the same kind: p of 1 and 0.7
MIN_SHARE = 1e-3  # of a number: smaller errors two runs can't know, unless they agree to
OF_LAG = 2.0  # times the share by which contact lags: curves were off by 0.5 to 1.1 times as much
MIN_FORCE = 0.05  # of the largest: smaller forces, as of tools that go back, tell no share
MAX_SHARE = 0.5  # of a number: an error above that is not told
FIELDS = "log_eps_11", "log_eps_22", "shear_angle"
# compared with each other, as the first may agree by chance, and cells average it away
ANGLE, OF_MEANS = "shear_angle_99_percent_deg", "shear_angle_99_percent_of_means_deg"
Rows = Sequence[Numbers]


class Rule(NamedTuple):
    """Errors are `factor` times the difference of two runs and at least `share` of the number."""

    factor: float
    share: float

    def errors(self, values: ArrayLike, differences: ArrayLike) -> np.ndarray:
        """Errors of values that differ by `differences` from those of the other run."""
        return np.maximum(self.factor * np.abs(differences), self.share * np.abs(values))

    def error(self, value: float, difference: float = 0.0) -> float | None:
        """The error of a number, None if unknown."""
        error = float(self.errors(value, difference))
        return error if error <= MAX_SHARE * abs(value) else None


def rule(
    rows: Rows, others: Rows, *, of_other_kind: bool, lag: float = 0.0, column: str = "reaction_N"
) -> Rule:
    """The rule for a run with these `rows` and another one with `others`, on cells `of_other_kind`
    or on larger ones of the same, by a `column`; lag: share by which contact lags in both."""
    (load, force), (loads, forces) = _curve(rows, column), _curve(others, column)
    late = loads >= 0.5
    own = np.interp(loads[late], load, force)
    size = np.maximum(np.abs(own), max(MIN_FORCE * np.abs(force).max(), 1e-300))
    apart = np.abs(forces[late] - own) / size
    share = float(apart.max() if of_other_kind else LARGER[column] * np.sqrt(np.mean(apart**2)))
    if share > 1e-6:  # less is a homogeneous state
        share = max(share, MIN_SHARE, OF_LAG * lag)
    return Rule(OTHER_CELLS if of_other_kind else 1.0, share)


def _curve(rows, column="reaction_N"):
    return np.array([(row["load"], row[column]) for row in rows]).T


def curve_errors(rows: Rows, others: Rows, rule: Rule) -> np.ndarray:
    """Errors [N] of the curve of a run at each of its `rows`, (2, rows): of the mesh, by the rows
    of the other run, and of the lines that join its points: their distance from a smooth curve is
    at most h^2 / 8 of its second derivative."""
    (load, force), (loads, forces) = _curve(rows), _curve(others)
    apart = np.interp(loads, load, force) - forces
    of_mesh = rule.errors(force, np.interp(load, loads, np.abs(apart)))
    if len(load) < 3:
        return np.array([of_mesh, 0 * of_mesh])
    step, slope = np.diff(load), np.diff(force) / np.diff(load)
    bent = np.abs(np.diff(slope)) / (step[1:] + step[:-1])  # half of the second derivative
    of_lines = bent * np.maximum(step[1:], step[:-1]) ** 2 / 4
    return np.array([of_mesh, np.pad(of_lines, 1, mode="edge")])


def field_differences(result: Result, other: Result) -> dict[str, np.ndarray]:
    """Differences of the cell fields FIELDS of two runs on different meshes, at the owned cells of
    the first: the other's are interpolated between its cells' centres."""
    from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator  # take long to import

    blank, comm = result.scene.blank, result.scene.comm
    names = [name for name in FIELDS if name in result.fields and name in other.fields]
    found = {name: np.full(len(blank.areas()), np.nan) for name in names}
    for part in (blank.parts.values() or [blank.whole]) if names else ():
        theirs = other.scene.blank.part(part.name)
        at, places = (p.blank.midpoints()[:2, p.cells].T.round(9) for p in (theirs, part))
        fields = [other.fields[name][theirs.cells] for name in names]
        rows = np.concatenate(comm.allgather(np.column_stack([at, *fields])))
        rows = rows[np.lexsort(rows[:, :2].T)]  # the same on any number of ranks
        if len(places):
            columns = LinearNDInterpolator(rows[:, :2], rows[:, 2:])(places)
            nearest = NearestNDInterpolator(rows[:, :2], rows[:, 2:])(places)
            columns = np.where(np.isnan(columns), nearest, columns)
            for name, column in zip(names, columns.T):
                found[name][part.cells] = np.abs(result.fields[name][part.cells] - column)
    return found


def mesh_decides(result: Result) -> str:
    """Why strains and shapes depend on the mesh, however fine; "" if nothing is known to."""
    if crumples(result.summary["quantities"]):
        return "cells crumple"
    in_space = result.scene.blank.mesh.geometry.dim == 3
    return "the law allows bands" if in_space and output.has_bands(result.scene) else ""


def estimate(
    result: Result, other: Result, names: Iterable[str], *, of_other_kind: bool, forces_only: bool
) -> dict[str, float | None]:
    """Absolute errors {quantity: error, None if unknown} of a run, by another one on a
    coarser mesh, of cells `of_other_kind` or of the same: of the reaction, strain energy, `names`
    of quantities, the curve (at most) and the FIELDS (root mean square over the area). The result's
    rows get the curve's as `error_N`, its fields those of the FIELDS as `error_...`. forces_only:
    tell those of forces, energies and the angle of 99 % of the area alone."""
    options: Any = {"of_other_kind": of_other_kind, "lag": lag_of(result.scene)}
    by, errors = rule(result.rows, other.rows, **options), dict[str, float | None]()
    for name in (*LARGER, *names):
        own = result.number(name)
        others = result.number(OF_MEANS) if name == ANGLE else other.number(name)
        if own is not None and others is not None:
            errors[name] = by.error(own, own - others)
            if name in LARGER and not of_other_kind:
                errors[name] = rule(result.rows, other.rows, **options, column=name).error(own)
    curve = curve_errors(result.rows, other.rows, by)
    for row, each in zip(result.rows, curve.T.tolist()):
        row["error_N"], row["error_steps_N"] = sum(each), each[1]
    errors["curve_N"], errors["curve_steps_N"] = curve.sum(0).max(), curve[1].max()
    for name, differences in field_differences(result, other).items():
        size, apart = (_root(result, each) for each in (result.fields[name], differences))
        scale = by.errors(size, apart) / apart if apart else 0.0
        result.fields[f"error_{name}"] = differences * scale
        result.fields.units[f"error_{name}"] = result.fields.units.get(name, "-")
        is_angle = name == "shear_angle"
        quantity, unit = ("shear_angle_rms_deg", np.degrees) if is_angle else (f"{name}_rms", float)
        errors[quantity] = by.error(unit(size), unit(apart))
    if forces_only:
        errors |= {name: None for name in errors if not name.endswith(("_N", "_Nmm", ANGLE))}
    return errors


def lag_of(scene: Scene) -> float:
    """The largest share by which friction and pressed areas of a scene may lag; inf tells none."""
    of_terms = [(term, getattr(term, "coulomb", None)) for term in scene.terms]
    lags = [getattr(each, "lag", None) or 0.0 for pair in of_terms for each in pair]
    return max((each for each in lags if np.isfinite(each)), default=0.0)


def _root(result, values):
    squares, areas = np.nan_to_num(values) ** 2, result.scene.blank.areas()
    return float(np.sqrt(measures.mean(result.scene.comm, squares, areas) or 0.0))
