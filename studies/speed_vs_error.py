"""What accuracy costs: wall time, iterations and memory against the error to studies/reference, over elements, meshes, load steps, tolerances, linear solvers and ranks, one factor at a time from a baseline. Of the options that all studies share, those of the material and the output count."""

import argparse
import csv
import json
import math
import os
import re
import shlex
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import ufl
from mpi4py import MPI
from petsc4py import PETSc
from reference import SCENES, Discretisation, measured, scene_of
from tqdm import tqdm

from fabric_fenicsx import timing
from fabric_fenicsx.cli import POSITIVE
from fabric_fenicsx.errors import InputError, SolverFailure
from fabric_fenicsx.scene import Scene
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.stepping import march
from fabric_fenicsx.study import parser, run

HERE = Path(__file__).resolve().parent
REPEATS = 5  # of what is timed alone; the fastest counts
SHORT = 2.0  # seconds below which a march is timed three times
GOALS = 0.1, 0.01, 0.001
MPIRUN = "mpirun.openmpi --map-by :OVERSUBSCRIBE --bind-to none -n"
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_mpi_yield_when_idle": "1",  # the study may not be alone
}
# column of the printed table -> its format
PRINTED = {
    "scene": "s", "sweep": "s", "element": "s", "pattern": "s", "nx": "d", "steps": "d", "tolerance": ".0e", "path_tolerance": ".0e",
    "linear_solver": "s", "ranks": "d", "dofs": "d", "iterations": "d", "wall_s": ".3g", "own_solves": ".3g", "cost": ".3g",
    "tangent_ratio": ".2f", "memory_mib": ".0f", "error_reaction": ".2%", "error_energy": ".2%", "error_centre_shear_deg": ".3f",
    "error_centre_eps_b": ".2%", "on_front": "d", "reason": "s",
}  # fmt: skip


@dataclass(frozen=True)
class Configuration:
    """One run; `sweep` says which factor it varies."""

    scene: str
    sweep: str = "baseline"
    element: str = "P1"
    pattern: str = "crossed"
    nx: int = 96
    steps: int = 20
    tolerance: float = 1e-8
    path_tolerance: float | None = None
    linear_solver: str = "mumps-cholesky"
    ranks: int = 1

    def __str__(self):
        return " ".join(str(v) for k, v in asdict(self).items() if v is not None and k != "sweep")


QUICK = [
    {"sweep": "mesh", "nx": 48}, {"sweep": "pattern", "nx": 48, "pattern": "unstructured"},
    {"sweep": "pattern", "element": "P2", "pattern": "unstructured"},
    {"sweep": "solver", "linear_solver": "cg-gamg"}, {"sweep": "ranks", "ranks": 2},
]  # fmt: skip
FULL = [
    *({"sweep": "mesh", "nx": nx} for nx in (24, 48, 192)),
    *({"sweep": "mesh", "element": "P2", "nx": nx} for nx in (12, 24, 48, 96)),
    *({"sweep": "mesh", "element": "Q1", "nx": nx} for nx in (24, 48, 96)),
    *({"sweep": "mesh", "element": "Q2", "nx": nx} for nx in (12, 24, 48)),
    *({"sweep": "pattern", "pattern": p, "nx": nx} for p, nx in (("left", 96), ("unstructured", 48), ("unstructured", 96))),
    *({"sweep": "pattern", "element": "P2", "pattern": p, "nx": nx} for p, nx in (("left", 48), ("unstructured", 24), ("unstructured", 48))),
    *({"sweep": "steps", "steps": n} for n in (1, 2, 5, 10, 40)),
    *({"sweep": "tolerance", "tolerance": t} for t in (1e-2, 1e-4, 1e-11)),
    *({"sweep": "path", "path_tolerance": t} for t in (1e-2, 1e-5)),
    *({"sweep": "solver", "linear_solver": s} for s in ("mumps-lu", "cg-gamg", "cg-hypre")),
    *({"sweep": "ranks", "ranks": 2, "nx": nx} for nx in (96, 192)),
    *({"sweep": "lean", "steps": 5, "path_tolerance": 1e-2, "element": e, "nx": nx} for e, nx in (("P1", 24), ("P1", 192), ("P2", 12), ("P2", 24), ("P2", 48), ("P2", 96))),
]  # fmt: skip


def options():
    p = parser("speed_vs_error", __doc__)
    test = p.add_argument_group("test")
    test.add_argument(
        "--scenes", nargs="+", choices=tuple(SCENES), help="of studies/reference.py (all, with --quick the first two)"
    )
    test.add_argument("--reference", metavar="DIR", type=Path, default=HERE / "reference", help="what errors are to")
    test.add_argument("--limit", type=POSITIVE, default=60.0, help="of one configuration, starting included [s]")
    p.add_argument("--configuration", help=argparse.SUPPRESS)  # one run, in a process of its own
    return p


class LinearElasticity:
    """Isotropic plane stress on the membrane's mesh, space and points: its solve is the unit of cost."""

    name, energy_kind = "linear elasticity", "strain"

    def __init__(self, membrane):
        self._u = membrane.blank.u
        self._dx = ufl.Measure("dx", membrane.blank.mesh, metadata={"quadrature_degree": membrane.degree})
        self.energy = 0.5 * self._work(self._u, self._u)

    def _work(self, u, v, E=1000.0, nu=0.3):
        strains = [ufl.sym(ufl.grad(x)) for x in (u, v)]
        shear, volume = ufl.inner(*strains), ufl.tr(strains[0]) * ufl.tr(strains[1])
        return (E / (1 + nu) * shear + E * nu / (1 - nu**2) * volume) * self._dx

    def variations(self, v, w):
        return self._work(self._u, v), self._work(w, v)


def timed(comm, action, repeats=REPEATS):
    """Seconds of the fastest of `repeats` runs of `action`, of the slowest rank."""
    times = []
    for _ in range(repeats):
        comm.Barrier()
        began = time.perf_counter()
        action()
        comm.Barrier()
        times.append(time.perf_counter() - began)
    return comm.allreduce(min(times), MPI.MAX)


def resident_mib(comm, key):
    """Resident memory of all ranks, now (VmRSS) or at most so far (VmHWM; getrusage's may be the parent's)."""
    status = Path("/proc/self/status").read_text()
    return comm.allreduce(int(re.search(rf"{key}:\s+(\d+)", status).group(1)) / 1024)


def one(study, c):
    """Run the `Configuration` c in this process; returns its row of the table without errors."""
    comm, case = study.comm, SCENES[c.scene]
    scene = scene_of(comm, study.fabric, case, Discretisation(c.element, c.nx, c.pattern))
    before = resident_mib(comm, "VmRSS")
    compiled, best, total = timing.seconds["compile"], None, 0.0
    while best is None or (total < SHORT and best["repeats"] < 3):
        u = scene.u.duplicate()
        scene.set(u)
        timing.seconds.clear()
        newton, outcome = None, None

        def solve():
            nonlocal newton, outcome
            newton = Newton(scene, c.tolerance, linear_solver=c.linear_solver)
            outcome = march(newton, c.steps, path_tolerance=c.path_tolerance)

        wall = timed(comm, solve, 1)
        total += wall
        parts = {f"{name}_s": timing.seconds[name] for name in ("assemble", "linear_solve")}
        if best is None:
            peak = resident_mib(comm, "VmHWM")
            best = {"wall_s": wall, "repeats": 0} | parts
        best |= {"repeats": best["repeats"] + 1} | ({"wall_s": wall} | parts if wall < best["wall_s"] else {})
    row = best | {
        "compile_s": compiled,
        "dofs": 2 * scene.blank.V.dofmap.index_map.size_global,
        "cells": scene.blank.mesh.topology.index_map(2).size_global,
        "iterations": outcome.iterations,
        "accepted": outcome.accepted,
        "rejected": outcome.rejected,
        "reason": outcome.reason,
        "peak_mib": peak,
        "memory_mib": peak - before,
    }
    assembly = timed(comm, lambda: scene.tangent(newton.A))
    values = measured(study, scene)
    row["elastic_assembly_s"], row["elastic_solve_s"] = elastic(scene)
    row["tangent_ratio"] = assembly / row["elastic_assembly_s"]
    return row | {name: values[name] for name in ("reaction_N", "energy_Nmm", "centre_shear_deg", "centre_eps_b")}


def elastic(scene):
    """Seconds of the assembly, and of assembly, analysis, factorisation and solution by MUMPS, of linear elasticity."""
    comm, twin = scene.comm, Scene(scene.blank, [LinearElasticity(scene.terms[0])], scene.supports)
    A, b = twin.create_matrix(), twin.u.duplicate()
    b.set(1.0)

    def solve():
        twin.tangent(A)
        ksp = PETSc.KSP().create(comm)
        ksp.setType("preonly")
        ksp.pc.setType("cholesky")
        ksp.pc.setFactorSolverType("mumps")
        ksp.setOperators(A)
        ksp.solve(b, b.duplicate())
        ksp.destroy()

    return timed(comm, lambda: twin.tangent(A)), timed(comm, solve)


def apart(study, c):
    """The row of `Configuration` c from a process, or ranks, of its own; with a reason if it did not end well."""
    args = study.args
    command = [sys.executable, __file__, "--configuration", json.dumps(asdict(c))]
    command += ["--material", args.material, "--model", args.model]
    command += [word for coupling in args.without for word in ("--without", coupling)]
    if c.ranks > 1:
        command = [*MPIRUN.split(), str(c.ranks), *command]
    # timeout also ends what mpirun started
    done = subprocess.run(
        ["timeout", "-k", "5", f"{args.limit:g}", *command],
        capture_output=True,
        text=True,
        env=os.environ | ENVIRONMENT,
        stdin=subprocess.DEVNULL,
    )
    row = asdict(c)
    if done.returncode == 0:
        return row | json.loads(done.stdout.splitlines()[-1])
    said = [line for line in done.stderr.splitlines() if line.strip()] or [f"ended with status {done.returncode}"]
    return row | {"reason": f"not done within {args.limit:g} s" if done.returncode == 124 else said[-1].strip()}


def references(study, names):
    """The reference quantities of the scenes `names`."""
    found = {}
    for name in names:
        path = study.args.reference / f"{name}.json"
        try:
            text = path.read_text()
            found[name] = json.loads(text)["quantities"]
            material = json.loads(text)["material"]
        except (OSError, ValueError, KeyError, TypeError):
            raise InputError(
                f"--reference {study.args.reference} holds no readable {name}.json; allowed is a folder that studies/reference.py wrote"
            ) from None
        if material != study.fabric.dumps():
            raise InputError(
                f"--material {study.args.material} is not that of {path}; allowed is the one that studies/reference.py was run with"
            )
    return found


def judge(rows, reference):
    """Add to the rows of one scene their errors, their cost in elastic solves (their own mesh's, the baseline's) and
    whether they are on the front of those for which none is both cheaper and more accurate."""
    base = rows[0]
    unit = min(
        r["elastic_solve_s"] for r in rows
        if "elastic_solve_s" in r and all(r[k] == base[k] for k in ("element", "pattern", "nx", "ranks"))
    )  # fmt: skip
    bars = {name: quantity["error"] / abs(quantity["value"]) for name, quantity in reference.items()}
    for r in rows:
        r |= {"own_solves": None, "cost": None, "error_bar": bars["reaction_N"], "on_front": False}
        if r["reason"]:
            continue
        r["own_solves"], r["cost"] = r["wall_s"] / r["elastic_solve_s"], r["wall_s"] / unit

        def error(name, r=r):
            return r[name] / reference[name]["value"] - 1

        r["error_reaction"], r["error_energy"] = error("reaction_N"), error("energy_Nmm")
        if SCENES[r["scene"]].angle:
            r["error_centre_shear_deg"] = r["centre_shear_deg"] - reference["centre_shear_deg"]["value"]
        else:
            r["error_centre_eps_b"] = error("centre_eps_b")
    least = math.inf
    for r in sorted((r for r in rows if not r["reason"]), key=lambda r: (r["cost"], seen(r))):
        r["on_front"], least = seen(r) < least, min(least, seen(r))


def seen(r):
    """Error of the reaction, as far as the reference resolves it."""
    return max(abs(r["error_reaction"]), r["error_bar"])


def recommended(rows):
    """{goal: cheapest row whose reaction is within it, None if there is none, or a word if the reference is not}."""
    found = {}
    for goal in GOALS:
        good = [r for r in rows if not r["reason"] and abs(r["error_reaction"]) + r["error_bar"] <= goal]
        found[goal] = min(good, key=lambda r: r["cost"], default=None)
        if rows[0]["error_bar"] >= goal:
            found[goal] = f"not resolved by the reference, known to {rows[0]['error_bar']:.2g} of it"
    return found


def table(rows):
    """The columns PRINTED of rows as text."""

    def text(value, form):
        return "-" if value is None or value == "" else format(value, form)

    names = {name: name.replace("error_", "e_").replace("tolerance", "tol").replace("centre_", "") for name in PRINTED}
    lines = [list(names.values()), *([text(r.get(k), form) for k, form in PRINTED.items()] for r in rows)]
    widths = [max(map(len, column)) for column in zip(*lines)]
    return "\n".join("  ".join(word.rjust(w) for word, w in zip(line, widths)).rstrip() for line in lines)


def picture(path, scenes):
    """Error over cost of the scenes {name: rows}, with their fronts."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(scenes), figsize=(5.2 * len(scenes), 4.6), squeeze=False, layout="constrained")
    for ax, (name, rows) in zip(axes[0], scenes.items()):
        good = [r for r in rows if not r["reason"]]
        for k, kind in enumerate(dict.fromkeys((r["element"], r["pattern"]) for r in good)):
            mine = [r for r in good if (r["element"], r["pattern"]) == kind]
            marker = {"P1": "^", "P2": "v", "Q1": "s", "Q2": "D"}[kind[0]]
            ax.plot([r["cost"] for r in mine], [abs(r["error_reaction"]) for r in mine], marker, color=f"C{k}", ms=5, label=" ".join(kind))  # fmt: skip
        front = sorted((r["cost"], seen(r)) for r in good if r["on_front"])
        ax.step(*zip(*front), where="post", color="k", lw=1, label="front")
        ax.axhspan(0, rows[0]["error_bar"], color="0.9", label="not resolved")
        ax.set(xscale="log", yscale="log", xlabel="wall time / linear-elastic solves of the baseline mesh", title=name)
        ax.set_ylabel("relative error of the reaction")
        ax.grid(alpha=0.3)
        ax.legend(fontsize="x-small")
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main(study):
    args = study.args
    if args.configuration:
        row = one(study, Configuration(**json.loads(args.configuration)))
        study.say(json.dumps(row))
        return
    if study.comm.size > 1:
        raise InputError(f"the study was started on {study.comm.size} ranks; allowed is 1, it starts its runs itself")
    names = args.scenes or list(SCENES)[: 2 if args.quick else None]
    reference, folder, scenes = references(study, names), study.folder(), {}
    changes, scale = (QUICK, {"nx": 24, "steps": 5}) if args.quick else (FULL, {})
    plan = []
    for name in names:
        base = Configuration(name, **scale)
        plan += [base, *(replace(base, **change) for change in changes)]
    for c in tqdm(plan, disable=None, leave=False):
        row = apart(study, c)
        scenes.setdefault(c.scene, []).append(row)
        if row["reason"]:
            tqdm.write(f"{c}: {row['reason']}", file=sys.stderr)
    for name, rows in scenes.items():
        if rows[0]["reason"]:
            raise SolverFailure(f"the baseline of {name} failed: {rows[0]['reason']}")
        judge(rows, reference[name])
    advice = {name: recommended(rows) for name, rows in scenes.items()}
    rows = [r for rows in scenes.values() for r in rows]
    with open(folder / "table.csv", "w", newline="") as file:
        out = csv.DictWriter(file, list(dict.fromkeys(k for r in rows for k in r)))
        out.writeheader()
        out.writerows(rows)
    if not args.no_pictures:
        picture(folder / "front.png", scenes)
    study.summarise(
        folder, converged=True, stroke_reached=1.0, material=study.fabric.name, command=shlex.join(sys.argv),
        quantities={
            name: {
                "runs": len(found), "failed": sum(bool(r["reason"]) for r in found), "reference_error_bar": found[0]["error_bar"],
                "baseline_elastic_solve_s": found[0]["wall_s"] / found[0]["cost"], "front": [str(Configuration(**{k: r[k] for k in Configuration.__dataclass_fields__})) for r in found if r["on_front"]],
                "recommended": {f"{goal:g}": choice for goal, choice in advice[name].items()},
            }
            for name, found in scenes.items()
        },
    )  # fmt: skip
    study.say(table(rows))
    for name, choices in advice.items():
        for goal, r in choices.items():
            if isinstance(r, dict):
                c = Configuration(**{k: r[k] for k in Configuration.__dataclass_fields__})
                words = f"{c}: {r['wall_s']:.3g} s, {r['cost']:.3g} baseline solves, errors of reaction {r['error_reaction']:.2%} and energy {r['error_energy']:.2%}"
            else:
                words = r or "none of these"
            study.say(f"{name}, reaction within {goal:.1%}: {words}")


if __name__ == "__main__":
    run("speed_vs_error", options(), main)
