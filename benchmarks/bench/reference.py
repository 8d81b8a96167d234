"""Reference values with error bars for the strips: extrapolated, written and read."""

import csv
import json
import math
from typing import NamedTuple

import numpy as np

import fabric_fenicsx as ff

from .strips import GRID, LENGTH, STRIPS, WIDTH, field_distance

LOADS = [k / 20 for k in range(21)]
MIN_ORDER, MAX_ORDER = 0.5, 4.0  # of convergence that are plausible


class Estimate(NamedTuple):
    """A value, its error bar, and the order of convergence (None: the finest value is taken)."""

    value: float
    error: float
    order: float | None


def estimate(series, checks=()):
    """The `Estimate` from a series on meshes halved each time, the finest last.

    Extrapolated by Richardson with the order observed on the last three, if they are monotone and
    the order is plausible. The bar reaches to the finest value (else to the two before) and to
    all `checks`.
    """
    value, order, others = series[-1], None, series[-3:]
    if len(series) > 2 and series[-1] != series[-2]:
        ratio = (series[-2] - series[-3]) / (series[-1] - series[-2])
        if 2**MIN_ORDER <= ratio <= 2**MAX_ORDER:
            order, others = math.log2(ratio), series[-1:]
            value += (series[-1] - series[-2]) / (ratio - 1)
    return Estimate(value, max(abs(value - other) for other in (*others, *checks)), order)


def make_reference(folder, name, series, members, **facts):
    """Write NAME.json, NAME.csv and NAME_grid.csv of the strip `name` to `folder`, from its
    `members` {mesh: values, reactions at LOADS, camera's displacements and cost}, of which the
    `series` is extrapolated and others are checks. Quantities {name: value, error, order}."""
    strip, checks = STRIPS[name], [mesh for mesh in members if mesh not in series]
    finest = members[series[-1]]

    def estimated(part, key):
        of = {mesh: member[part][key] for mesh, member in members.items()}
        return estimate([of[mesh] for mesh in series], [of[mesh] for mesh in checks])

    def off(mesh):
        seen = (np.array(members[each]["seen"]) for each in (mesh, series[-1]))
        return field_distance(strip.angle, *seen)

    bars = np.max([off(mesh) for mesh in (*series[-2:-1], *checks)], axis=0).tolist()
    stroke = strip.strain * LENGTH
    scene = {"length_mm": LENGTH, "width_mm": WIDTH, "yarns_a_deg": strip.angle}
    quantities = {key: estimated("values", key)._asdict() for key in finest["values"]}
    kept = "dofs", "steps", "iterations", "wall_s", "values"
    whole = facts | {"scene": scene | {"stroke_mm": stroke}, "series": series, "checks": checks}
    whole |= {"quantities": quantities}
    whole["field_errors"] = dict(zip(("strain_l2", "shear_angle_rms_deg"), bars))
    whole["members"] = {mesh: {key: m[key] for key in kept} for mesh, m in members.items()}
    (folder / f"{name}.json").write_text(json.dumps(whole, indent=1, allow_nan=False) + "\n")
    table = np.concatenate([GRID, finest["seen"]], -1).reshape(-1, 4)
    header = {"header": "x_mm,y_mm,u_x_mm,u_y_mm", "comments": ""}
    np.savetxt(folder / f"{name}_grid.csv", table, "%.9g", ",", **header)
    with open(folder / f"{name}.csv", "w", newline="") as file:
        out = csv.writer(file)
        columns = [f"reaction_N of {mesh}" for mesh in members]
        out.writerow(["load", "displacement_mm", "reaction_N", "error_N", *columns])
        for k, load in enumerate(LOADS):
            row = [load * stroke, *estimated("reactions_N", k)[:2]]
            row += [member["reactions_N"][k] for member in members.values()]
            out.writerow([load, *(f"{v:.10g}" for v in row)])
    return quantities


def reference_grid(folder, name):
    """Displacements of the camera's points in the reference of the strip `name` [mm]."""
    table = np.loadtxt(folder / f"{name}_grid.csv", delimiter=",", skiprows=1)
    return table[:, 2:].reshape(GRID.shape)


def reference_curve(folder, name):
    """Load factors and reactions [N] of the reference of the strip `name`, (2, n)."""
    return np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1, usecols=(0, 2)).T


def read_references(folder, names, fabric, material):
    """The quantities {strip: {name: {value, error, order}}} of the references in `folder`.
    InputError for those of another fabric than `fabric`, which errors call `material`."""
    facts = {name: json.loads((folder / f"{name}.json").read_text()) for name in names}
    for name in names:
        if facts[name]["material"] != fabric.dumps():
            flaw = f"`material` {material} is not that of {name}.json in {folder}"
            raise ff.InputError(f"{flaw}; expected that of benchmarks/reference.py")
    return {name: facts[name]["quantities"] for name in names}
