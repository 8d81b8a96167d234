"""Reference values with error bars for the strips: solved, extrapolated, written and read."""

import csv
import json
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fabric_fenicsx.material.laws import Law
from fabric_fenicsx.runtime.errors import InputError, SolverFailure
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.settings import Settings
from fabric_fenicsx.solve.stepping import LoadStepping

from .camera import camera_displacements, camera_points, field_distance
from .extrapolation import Estimate, estimate
from .strips import (
    DEGREES,
    LENGTH,
    STRIPS,
    WIDTH,
    Discretisation,
    Strip,
    moving_grip,
    strip_scene,
    strip_values,
)

LOADS = np.arange(21) / 20


def solve_member(
    comm: MPI.Comm,
    fabric: Law,
    strip: Strip,
    how: Discretisation,
    tolerance: float,
    linear_solver: str,
) -> dict[str, Any]:
    """Values, reactions at LOADS [N], cost and the camera's displacements of one discretisation.

    Raises SolverFailure if it does not reach full load.
    """
    scene = strip_scene(comm, fabric, strip, how, DEGREES[how.element])
    measure, curve, began = moving_grip(strip.stroke), {}, time.perf_counter()

    def accept(accepted):
        curve[accepted.load] = measure(scene, accepted.load)[1]

    newton = Newton(scene, tolerance, linear_solver=linear_solver)
    settings = Settings(steps=len(LOADS) - 1, path_tolerance=None, milestones=tuple(LOADS[1:]))
    outcome = LoadStepping(newton, settings, on_accept=accept).run()
    wall = time.perf_counter() - began
    if outcome.reason:
        raise SolverFailure(f"{how}: {outcome.reason}")
    return {
        "dofs": 2 * scene.blank.V.dofmap.index_map.size_global,
        "steps": outcome.accepted,
        "iterations": outcome.iterations,
        "wall_s": round(wall, 2),
        "values": strip_values(scene),
        "reactions_N": [curve[load] for load in LOADS],
        "seen": camera_displacements(scene).tolist(),
    }


@dataclass(frozen=True)
class Reference:
    """The strip `name` solved in all discretisations: `members` {discretisation: as `solve_member`}
    of the `series` and of the `checks`; quantities {name: {value, error, order}}; the `curve`, an
    `Estimate` at each of LOADS; and the error bars of the fields."""

    name: str
    series: tuple[Discretisation, ...]
    checks: tuple[Discretisation, ...]
    members: Mapping[str, dict[str, Any]]
    quantities: dict[str, dict[str, float | None]]
    curve: list[Estimate]
    field_errors: dict[str, float]

    def write(self, folder: Path, command: str, fabric: Law) -> None:
        """Write NAME.json, NAME.csv and NAME_grid.csv to `folder`; `command` made them."""
        strip, members = STRIPS[self.name], self.members
        unread = "reactions_N", "seen"  # of the JSON; they are in the tables
        facts = {
            "command": command,
            "scene": {
                "length_mm": LENGTH,
                "width_mm": WIDTH,
                "yarns_a_deg": strip.angle,
                "stroke_mm": strip.stroke,
            },
            "material": fabric.dumps(),
            "series": [str(how) for how in self.series],
            "checks": [str(how) for how in self.checks],
            "quantities": self.quantities,
            "field_errors": self.field_errors,
            "members": {
                how: {k: v for k, v in member.items() if k not in unread}
                for how, member in members.items()
            },
        }
        text = json.dumps(facts, indent=1, allow_nan=False)
        (folder / f"{self.name}.json").write_text(text + "\n")
        finest = np.array(members[str(self.series[-1])]["seen"])
        table = np.concatenate([camera_points(), finest], -1).reshape(-1, 4)
        header = "x_mm,y_mm,u_x_mm,u_y_mm"
        path = folder / f"{self.name}_grid.csv"
        np.savetxt(path, table, "%.9g", ",", header=header, comments="")
        with open(folder / f"{self.name}.csv", "w", newline="") as file:
            out = csv.writer(file)
            columns = [f"reaction_N of {how}" for how in members]
            out.writerow(["load", "displacement_mm", "reaction_N", "error_N", *columns])
            for k, load in enumerate(LOADS):
                row = *self.curve[k][:2], *(m["reactions_N"][k] for m in members.values())
                numbers = (f"{v:.10g}" for v in row)
                out.writerow([load, f"{load * strip.stroke:g}", *numbers])


def make_reference(
    name: str, solve: Callable[[Strip, Discretisation], dict[str, Any]], quick: bool = False
) -> Reference:
    """The `Reference` of the strip `name`; solve: as `solve_member`, of a strip and how; quick: the
    two coarsest meshes alone."""
    strip = STRIPS[name]
    series, checks = (strip.series[:2], ()) if quick else (strip.series, strip.checks)
    members = {str(how): solve(strip, how) for how in (*series, *checks)}

    def estimated(pick):
        values = [pick(member) for member in members.values()]
        return estimate(values[: len(series)], values[len(series) :])

    quantities: dict[str, dict[str, float | None]] = {
        quantity: estimated(lambda member, name=quantity: member["values"][name])._asdict()
        for quantity in next(iter(members.values()))["values"]
    }
    reactions = range(len(LOADS))
    curve = [estimated(lambda member, k=k: member["reactions_N"][k]) for k in reactions]
    finest = str(series[-1])
    fields = [
        field_distance(strip.angle, np.array(member["seen"]), np.array(members[finest]["seen"]))
        for how, member in members.items()
        if how != finest
    ]
    # how far the mesh before the finest and the checks are from the finest bounds its error
    worst = np.max(fields[len(series) - 2 :], axis=0).tolist()
    errors = dict(zip(("strain_l2", "shear_angle_rms_deg"), worst))
    return Reference(name, series, checks, members, quantities, curve, errors)


def convergence(references: Iterable[Reference]) -> dict[str, tuple[list, list, str]]:
    """Errors of the reaction of all discretisations over their unknowns, and the reference's own,
    {label: (unknowns, errors, matplotlib format)}."""
    series: dict[str, tuple[list, list, str]] = {}
    for k, found in enumerate(references):
        members, reaction = found.members, found.quantities["reaction_N"]
        value, bar = reaction["value"], reaction["error"]
        assert value is not None and bar is not None
        error = {h: abs(m["values"]["reaction_N"] / value - 1) for h, m in members.items()}
        of_series = [str(how) for how in found.series]
        for label, hows, style in (
            (found.name, of_series, f"C{k}o-"),
            (f"{found.name}, checks", [h for h in members if h not in of_series], f"C{k}x"),
        ):
            if hows:
                dofs = [members[h]["dofs"] for h in hows]
                series[label] = dofs, [error[h] for h in hows], style
        dofs = [m["dofs"] for m in members.values()]
        bars = [bar / abs(value)] * 2
        series[f"{found.name}, error bar"] = [min(dofs), max(dofs)], bars, f"C{k}:"
    return series


def reference_grid(folder: Path, name: str) -> np.ndarray:
    """Displacements of the camera's points in the reference of the strip `name`, (n, m, 2) [mm]."""
    table = np.loadtxt(folder / f"{name}_grid.csv", delimiter=",", skiprows=1)
    return table[:, 2:].reshape(camera_points().shape)


def reference_curve(folder: Path, name: str) -> np.ndarray:
    """Load factors and reactions [N] of the reference of the strip `name`, (2, n)."""
    return np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1, usecols=(0, 2)).T


def curve_distance(curve: np.ndarray, reference: np.ndarray) -> float:
    """Largest distance of the polygon through the points of `curve` from those of `reference`, both
    (2, n), over the last of the latter: what is read off a plotted curve is off by that."""
    off = np.abs(np.interp(reference[0], *curve) - reference[1])
    return float(off.max() / abs(reference[1, -1]))


def read_references(
    folder: Path, names: Iterable[str], fabric: Law, material: str
) -> dict[str, dict[str, dict[str, float]]]:
    """The quantities {strip: {name: {value, error, order}}} of the references in `folder`.

    Raises InputError where a file is missing or not readable, or was made with another fabric than
    `fabric`, which errors call `material`.
    """
    found = {}
    for name in names:
        file = f"{name}.json"
        try:
            facts = json.loads((folder / file).read_text())
            found[name], own = facts["quantities"], facts["material"]
            file = f"{name}.csv"
            reference_curve(folder, name)
            file = f"{name}_grid.csv"
            reference_grid(folder, name)
        except (OSError, ValueError, LookupError, TypeError):
            raise InputError(
                f"`reference` {folder} holds no readable {file}; allowed is a folder that "
                "benchmarks/reference.py wrote"
            ) from None
        if own != fabric.dumps():
            raise InputError(
                f"`material` {material} is not that of {name}.json in {folder}; "
                "allowed is the one that benchmarks/reference.py was run with"
            )
    return found
