"""Reference values with error bars for three strips, extrapolated over finer and finer meshes; what other runs are measured by. Mesh, element and steps are the scenes' own."""

import csv
import json
import math
import shlex
import sys
import time
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.blank import Blank
from fabric_fenicsx.errors import SolverFailure
from fabric_fenicsx.mechanics.membrane import Membrane
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.scene import Scene, grips, pulled
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.stepping import march
from fabric_fenicsx.study import parser, run

LENGTH, WIDTH = 200.0, 50.0
LOADS = np.arange(21) / 20
SPACING = 2.5  # [mm] of the points whose displacements tell the fields, as a camera's
ORDERS = 0.5, 4.0  # of convergence that are believed


@dataclass(frozen=True)
class Discretisation:
    """Element, number of rectangles along the length, pattern as of `specimen`, degree of quadrature (None: the
    membrane's own) and its integration."""

    element: str
    nx: int
    pattern: str = "crossed"
    quadrature: int | None = None
    integration: str = "full"

    def __str__(self):
        words = [self.element, self.pattern, str(self.nx)]
        return " ".join(words + ([f"degree {self.quadrature}"] if self.quadrature else []))


@dataclass(frozen=True)
class Case:
    """A strip with yarns a at `angle` [deg] to its length, clamped and pulled by `strain` of it; a `series` of
    discretisations, each halving the cells of the one before, and others that `checks` it."""

    angle: float
    strain: float
    series: tuple
    checks: tuple

    @property
    def stroke(self):
        return self.strain * LENGTH


# Shear jumps across yarns from the corners, over some tenths of a millimetre: meshes for it are graded towards them.
SCENES = {
    "tensile": Case(
        0.0,
        0.03,
        tuple(Discretisation("P2", nx) for nx in (24, 48, 96, 192)),
        (Discretisation("P1", 192), Discretisation("P2", 96, "unstructured")),
    ),
    "bias10": Case(
        45.0,
        0.1,
        tuple(Discretisation("P1", nx, "graded") for nx in (24, 48, 96, 192, 384)),
        (Discretisation("P2", 96, "graded"), Discretisation("P2", 96, "graded", 4)),
    ),
    "bias30": Case(
        45.0,
        0.3,
        tuple(Discretisation("P1", nx, "graded") for nx in (24, 48, 96, 192)),
        (Discretisation("P2", 96), Discretisation("P2", 96, quadrature=4)),
    ),
}


def options():
    p = parser("reference", __doc__)
    p.add_argument_group("test").add_argument("--scenes", nargs="+", choices=tuple(SCENES), default=list(SCENES))
    return p


def scene_of(comm, fabric, case, how):
    """Scene of `case` in the `Discretisation` `how`."""
    arrays = (None, None, None)
    if comm.rank == 0:
        cell = "triangle" if how.element[0] == "P" else "quadrilateral"
        ny = max(1, round(how.nx * WIDTH / LENGTH))
        arrays = specimen(LENGTH, WIDTH, how.nx, ny, how.pattern, cell, math.radians(case.angle))
    blank = Blank.from_arrays(comm, *arrays, a=math.radians(case.angle), degree=int(how.element[1]))
    return Scene(blank, [Membrane(blank, fabric, how.quadrature, how.integration)], grips(blank, case.stroke))


def measured(study, scene):
    """What is compared of a solved scene. Means at the centre, by area, are of cells with midpoints within an eighth of
    the width of it (or the nearest)."""
    from fabric_fenicsx.results.fields import cell_fields  # imports pyvista

    (membrane,), blank = scene.terms, scene.blank
    fields = cell_fields(membrane)[0]
    shear = np.degrees(np.abs(fields["shear_angle"]))
    distance = np.linalg.norm(blank.midpoints() - [[LENGTH / 2], [WIDTH / 2]], axis=0)
    centre = distance <= max(WIDTH / 8, study.extremes(distance)[0])
    x = blank.mesh.geometry.x[compat.geometry_dofmap(blank.mesh)[: len(distance)]]
    area = np.linalg.norm(np.cross(x[:, -1] - x[:, 0], x[:, 1] - x[:, 2 if x.shape[1] == 4 else 0]), axis=1)
    names = {"eps_a": fields["eps_a"], "eps_b": fields["eps_b"], "shear_deg": shear}
    values = {"reaction_N": float(scene.reaction("moving grip")[0]), "energy_Nmm": scene.energies()["strain"]}
    values |= {
        f"centre_{name}": study.mean(field * area, centre) / study.mean(area, centre) for name, field in names.items()
    }
    for name, field in names.items():
        values[f"{name}_min"], values[f"{name}_max"] = study.extremes(field)
    del values["shear_deg_min"]
    return values


def grid():
    """Undeformed positions of the camera's points, (n, m, 2) [mm]."""
    axes = (np.linspace(0, size, round(size / SPACING) + 1) for size in (LENGTH, WIDTH))
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1)


def seen(scene):
    """Displacements of the camera's points, (n, m, 2) [mm]."""
    x = grid()
    edge = 1e-9 * LENGTH  # points on the edge may be found outside, by rounding
    points = np.clip(x.reshape(-1, 2), edge, [LENGTH - edge, WIDTH - edge])
    values = compat.values_at(scene.blank.u, np.column_stack([points, np.zeros(len(points))]))
    values = np.where(np.isnan(values), -np.inf, values)
    scene.comm.Allreduce(MPI.IN_PLACE, values, MPI.MAX)
    return values.reshape(x.shape)


def field_distance(case, u, other):
    """Distances of two displacements of the camera's points: of their Green-Lagrange strains, relative in L2, and of
    their shear angles, root mean square [deg]."""
    strains, angles = [], []
    cosine, sine = math.cos(math.radians(case.angle)), math.sin(math.radians(case.angle))
    for v in (u, other):
        x = grid() + v
        along, across = np.diff(x, axis=0), np.diff(x, axis=1)
        F = np.stack([along[:, 1:] + along[:, :-1], across[1:] + across[:-1]], -1) / (2 * SPACING)
        C = np.swapaxes(F, -1, -2) @ F
        strains.append((C - np.eye(2)) / 2)
        a, b = F @ [cosine, sine], F @ [-sine, cosine]
        angles.append(np.degrees(np.arctan2((a * b).sum(-1), np.linalg.det(F))))
    strain = np.linalg.norm(strains[0] - strains[1]) / np.linalg.norm(strains[1])
    return float(strain), float(np.sqrt(np.mean((angles[0] - angles[1]) ** 2)))


def member(study, case, how):
    """Values, reactions at LOADS and cost of one discretisation."""
    scene = scene_of(study.comm, study.fabric, case, how)
    measure, curve, began = pulled(case.stroke), {}, time.perf_counter()

    def accept(accepted):
        curve[accepted.load] = measure(scene, accepted.load)[1]

    newton = Newton(scene, study.args.tolerance, linear_solver=study.args.linear_solver)
    outcome = march(newton, len(LOADS) - 1, on_accept=accept, milestones=LOADS)
    wall = time.perf_counter() - began
    if outcome.reason:
        raise SolverFailure(f"{how}: {outcome.reason}")
    return {
        "dofs": 2 * scene.blank.V.dofmap.index_map.size_global,
        "steps": outcome.accepted,
        "iterations": outcome.iterations,
        "wall_s": round(wall, 2),
        "values": measured(study, scene),
        "reactions_N": [curve[load] for load in LOADS],
        "seen": seen(scene).tolist(),
    }


def estimate(series, checks):
    """Value, error bar and order (None: the finest value is taken) from a series on meshes halved each time.

    Extrapolated by Richardson with the order observed on the last three, if they are monotone and the order is one of
    ORDERS. The bar reaches to the finest value (else to the two before) and to all `checks`.
    """
    value, order, others = series[-1], None, series[-3:]
    if len(series) > 2 and series[-1] != series[-2]:
        ratio = (series[-2] - series[-3]) / (series[-1] - series[-2])
        if 2 ** ORDERS[0] <= ratio <= 2 ** ORDERS[1]:
            order, others = math.log2(ratio), series[-1:]
            value += (series[-1] - series[-2]) / (ratio - 1)
    return value, max(abs(value - other) for other in (*others, *checks)), order


def reference(study, name, folder):
    """Run the members of scene `name` and write `name`.json and `name`.csv; returns its quantities."""
    case = SCENES[name]
    series, checks = (case.series[:2], ()) if study.args.quick else (case.series, case.checks)
    members = {}
    for how in (*series, *checks):
        found = members[str(how)] = study.once(f"{name} {how}", lambda how=how: member(study, case, how))
        study.say(
            f"{name}  {how!s:28s} {found['dofs']:7d} dofs {found['iterations']:4d} iterations {found['wall_s']:7.1f} s  reaction {found['values']['reaction_N']:.8g} N"
        )

    def estimated(pick):
        values = [pick(found) for found in members.values()]
        return estimate(values[: len(series)], values[len(series) :])

    quantities = {}
    for quantity in next(iter(members.values()))["values"]:
        value, error, order = estimated(lambda found, quantity=quantity: found["values"][quantity])
        quantities[quantity] = {"value": value, "error": error, "order": order}
    curve = [estimated(lambda found, k=k: found["reactions_N"][k]) for k in range(len(LOADS))]
    finest = np.array(members[str(series[-1])]["seen"])
    fields = [
        field_distance(case, np.array(found["seen"]), finest)
        for how, found in members.items()
        if how != str(series[-1])
    ]
    # the finest of the series is the reference; how far the one before and the checks are from it bounds its error
    bars = dict(zip(("strain_l2", "shear_angle_rms_deg"), np.max(fields[len(series) - 2 :], axis=0).tolist()))
    if study.comm.rank == 0:
        facts = {
            "command": shlex.join([".venv/bin/python", "studies/reference.py", *sys.argv[1:]]),
            "scene": {"length_mm": LENGTH, "width_mm": WIDTH, "yarns_a_deg": case.angle, "stroke_mm": case.stroke},
            "material": study.fabric.dumps(),
            "series": [str(how) for how in series],
            "checks": [str(how) for how in checks],
            "quantities": quantities,
            "field_errors": bars,
            "members": {
                how: {k: v for k, v in m.items() if k not in ("reactions_N", "seen")} for how, m in members.items()
            },
        }
        (folder / f"{name}.json").write_text(json.dumps(facts, indent=1, allow_nan=False) + "\n")
        table = np.concatenate([grid(), finest], -1).reshape(-1, 4)
        np.savetxt(folder / f"{name}_grid.csv", table, "%.9g", ",", header="x_mm,y_mm,u_x_mm,u_y_mm", comments="")
        with open(folder / f"{name}.csv", "w", newline="") as file:
            out = csv.writer(file)
            out.writerow(
                ["load", "displacement_mm", "reaction_N", "error_N", *(f"reaction_N of {how}" for how in members)]
            )
            for k, load in enumerate(LOADS):
                row = *curve[k][:2], *(found["reactions_N"][k] for found in members.values())
                out.writerow([load, f"{load * case.stroke:g}", *(f"{v:.10g}" for v in row)])
    return quantities


def convergence(path, folder, found):
    """Errors of the reaction of all discretisations over their unknowns, and the reference's own, for each scene of `found`."""
    from fabric_fenicsx.results import pictures

    series = {}
    for k, (name, quantities) in enumerate(found.items()):
        members, r = json.loads((folder / f"{name}.json").read_text())["members"], quantities["reaction_N"]
        error = {how: abs(m["values"]["reaction_N"] / r["value"] - 1) for how, m in members.items()}
        of_series = [how for how in map(str, SCENES[name].series) if how in members]
        for label, hows, style in (
            (name, of_series, f"C{k}o-"),
            (f"{name}, checks", [h for h in members if h not in of_series], f"C{k}x"),
        ):
            if hows:
                series[label] = [members[h]["dofs"] for h in hows], [error[h] for h in hows], style
        ends = [min(m["dofs"] for m in members.values()), max(m["dofs"] for m in members.values())]
        series[f"{name}, error bar"] = ends, [r["error"] / abs(r["value"])] * 2, f"C{k}:"
    pictures.curves(path, series, "unknowns", "error of the reaction, relative", "log")


def main(study):
    folder, found = study.folder(), {}
    for name in study.args.scenes:
        found[name] = reference(study, name, folder)
        r = found[name]["reaction_N"]
        study.say(
            f"{folder}/{name}.json: reaction {r['value']:.6g} +- {r['error']:.2g} N, {'finest mesh' if r['order'] is None else 'order {:.2g}'.format(r['order'])}"
        )
    study.summarise(folder, converged=True, stroke_reached=1.0, quantities=found)
    if study.comm.rank == 0 and not study.args.no_pictures:
        convergence(folder / "convergence.png", folder, found)


if __name__ == "__main__":
    run("reference", options(), main)
