"""What accuracy costs: wall time, iterations and memory against the error to studies/reference, over elements, meshes, load steps, tolerances, linear solvers and ranks, one factor at a time from a baseline. Of the options that all studies share, those of the material and the output count."""

import argparse
import json
import math
import os
import re
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc
from reference import SCENES, Discretisation, field_distance, grid, measured, scene_of, seen
from tqdm import tqdm

from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx import timing
from fabric_fenicsx.cli import POSITIVE
from fabric_fenicsx.errors import InputError, SolverFailure
from fabric_fenicsx.mechanics.membrane import QUADRATURE_DEGREE
from fabric_fenicsx.scene import Scene, pulled
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
    "scene": "s", "sweep": "s", "element": "s", "pattern": "s", "integration": "s", "nx": "d", "steps": "d", "tolerance": ".0e", "path_tolerance": ".0e",
    "linear_solver": "s", "ranks": "d", "dofs": "d", "iterations": "d", "wall_s": ".3g", "own_solves": ".3g", "cost": ".3g",
    "tangent_ratio": ".2f", "memory_mib": ".0f", "error_curve": ".2%", "error_reaction": ".2%", "error_energy": ".2%", "error_strain": ".2%",
    "error_shear_deg": ".3f", "error_centre_shear_deg": ".3f", "error_centre_eps_b": ".2%", "yarn_strain_max": ".1e", "on_front": "d", "reason": "s",
}  # fmt: skip


@dataclass(frozen=True)
class Configuration:
    """One run; `sweep` says which factor it varies."""

    scene: str
    sweep: str = "baseline"
    element: str = "P1"
    pattern: str = "crossed"
    nx: int = 96
    integration: str = "full"
    steps: int = 20
    tolerance: float = 1e-8
    path_tolerance: float = 1e-5
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
    *({"sweep": "mesh", "nx": nx} for nx in (24, 48, 120, 192)),
    *({"sweep": "mesh", "element": "P2", "nx": nx} for nx in (12, 24, 48, 96)),
    *({"sweep": "mesh", "element": "P3", "nx": nx} for nx in (12, 16, 24, 32)),
    *({"sweep": "mesh", "element": e, "nx": nx} for e, nx in (("Q1", 48), ("Q1", 96), ("Q2", 24), ("Q2", 48))),
    *({"sweep": "pattern", "element": e, "pattern": p, "nx": nx} for p, sizes in (("left", (150, 76, 50)), ("unstructured", (133, 66, 42)), ("yarns", (133, 66, 42)))
      for e, nx in zip(("P1", "P2", "P3"), sizes)),
    *({"sweep": "pattern", "element": e, "pattern": p, "nx": nx} for p in ("unstructured", "yarns") for e, nx in (("P1", 66), ("P2", 33), ("P3", 21))),
    *({"sweep": "graded", "pattern": "graded", "element": e, "nx": nx, "steps": n, "path_tolerance": t} for n, t, kinds in (
        (20, 1e-3, (("P1", 24), ("P1", 48), ("P1", 96), ("P2", 24), ("P2", 48))), (15, 1e-2, (("P1", 48), ("P2", 24))),
        (20, 1e-4, (("P2", 24), ("P2", 32), ("P2", 48))),
    ) for e, nx in kinds),
    *({"sweep": "integration", "element": "P2", "integration": "reduced", "pattern": p, "nx": nx}
      for p, nx in (("left", 76), ("unstructured", 33), ("unstructured", 66), ("crossed", 48), ("graded", 32))),
    *({"sweep": "integration", "element": "P2", "integration": "reduced", "pattern": "unstructured", "nx": nx, "steps": n, "path_tolerance": t}
      for nx, n, t in ((33, 15, 1e-2), (50, 15, 1e-2), (50, 20, 1e-3))),
    *({"sweep": "steps", "steps": n} for n in (1, 5, 10, 40)),
    *({"sweep": "tolerance", "tolerance": t} for t in (1e-2, 1e-11)),
    *({"sweep": "path", "path_tolerance": t} for t in (1e-2, 1e-3)),
    *({"sweep": "solver", "linear_solver": s} for s in ("mumps-lu", "cg-gamg", "cg-hypre")),
    {"sweep": "ranks", "ranks": 2},
    *({"sweep": "lean", "path_tolerance": t, "steps": n, "element": e, "nx": nx} for t, n, kinds in (
        (1e-2, 5, (("P1", 24), ("P2", 12))), (1e-3, 5, (("P1", 24), ("P2", 12), ("P2", 24))),
        (1e-3, 10, (("P1", 24), ("P2", 12), ("P2", 48), ("P3", 16))), (1e-2, 20, (("P1", 120), ("P2", 48))),
        (1e-3, 20, (("P1", 24), ("P1", 120), ("P2", 12), ("P2", 24), ("P2", 48), ("P3", 16), ("P3", 32))), (1e-4, 20, (("P2", 12), ("P2", 24), ("P2", 32))),
    ) for e, nx in kinds),
]  # fmt: skip


SIZES = [
    *({"nx": nx, "linear_solver": solver} for nx in (96, 208, 448, 1000) for solver in ("mumps-cholesky", "cg-gamg", "cg-hypre")),
    *({"nx": nx, "ranks": 2} for nx in (96, 448)),
]  # fmt: skip
QUICK_SIZES = [*({"nx": nx} for nx in (24, 48)), {"nx": 48, "ranks": 2}]
PRINTED_SIZES = {
    "nx": "d", "linear_solver": "s", "ranks": "d", "dofs": "d", "cells": "d", "tangent_s": ".3g", "residual_s": ".3g", "elastic_assembly_s": ".3g",
    "tangent_ratio": ".2f", "solve_s": ".3g", "linear_iterations": "d", "linear_error": ".1e", "memory_mib": ".0f", "reason": "s",
}  # fmt: skip


def options():
    p = parser("speed_vs_error", __doc__)
    test = p.add_argument_group("test")
    test.add_argument(
        "--scenes", nargs="+", choices=tuple(SCENES), help="of studies/reference.py (all, with --quick the first two)"
    )
    test.add_argument("--reference", metavar="DIR", type=Path, default=HERE / "reference", help="what errors are to")
    test.add_argument("--limit", type=POSITIVE, default=60.0, help="of one configuration, starting included [s]")
    test.add_argument("--sizes", action="store_true", help="instead: one tangent and its solution, over mesh sizes")
    p.add_argument("--configuration", help=argparse.SUPPRESS)  # one run, in a process of its own
    return p


class LinearElasticity:
    """Isotropic plane stress on the membrane's mesh, space and points: its solve is the unit of cost."""

    name, energy_kind = "linear elasticity", "strain"

    def __init__(self, membrane):
        self._u = membrane.blank.u
        mesh = membrane.blank.mesh
        degree = QUADRATURE_DEGREE[compat.cell_name(mesh), membrane.blank.degree]
        self._dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": degree})
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
    scene = scene_of(comm, study.fabric, case, Discretisation(c.element, c.nx, c.pattern, integration=c.integration))
    before = resident_mib(comm, "VmRSS")
    compiled, best, total = timing.seconds["compile"], None, 0.0
    while best is None or (total < SHORT and best["repeats"] < 3):
        u = scene.u.duplicate()
        scene.set(u)
        timing.seconds.clear()
        newton, outcome, measure, curve = None, None, pulled(case.stroke), []

        def solve():
            nonlocal newton, outcome
            newton = Newton(scene, c.tolerance, linear_solver=c.linear_solver)
            outcome = march(
                newton,
                c.steps,
                on_accept=lambda at: curve.append((at.load, measure(scene, at.load)[1])),
                path_tolerance=c.path_tolerance,
            )

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
    row |= {name: values[name] for name in ("reaction_N", "energy_Nmm", "centre_shear_deg", "centre_eps_b")}
    row["yarn_strain_max"] = max(abs(values[f"eps_{yarn}_{end}"]) for yarn in "ab" for end in ("min", "max"))
    row["error_curve"] = curve_distance(np.transpose(curve), reference_curve(study, c.scene))
    row["error_strain"], row["error_shear_deg"] = field_distance(case, seen(scene), reference_grid(study, c.scene))
    return row


def one_solution(study, c):
    """Assembly and one solution with the tangent of the strip uniformly stretched by 1 % (its width -6.66 %): the row
    of `Configuration` c. The error is that of a known solution, in the tangent's energy norm."""
    comm = study.comm
    scene = scene_of(
        comm, study.fabric, SCENES[c.scene], Discretisation(c.element, c.nx, c.pattern, integration=c.integration)
    )
    before = resident_mib(comm, "VmRSS")
    newton = Newton(scene, linear_solver=c.linear_solver)
    x = newton.x
    gradient = np.diag([0.01, -0.0666])
    x.array[:] = (scene.blank.coordinates()[:, :2] @ gradient).ravel()[: x.local_size]
    scene.set(x)
    r = x.duplicate()
    row = {
        "tangent_s": timed(comm, lambda: scene.tangent(newton.A)),
        "residual_s": timed(comm, lambda: scene.residual(r)),
    }
    known, d, ksp = x.copy(), x.duplicate(), newton.snes.ksp
    known.array[scene.held] = 0
    rhs = newton.A * known

    def solve():
        ksp.setOperators(newton.A)
        ksp.solve(rhs, d)

    row["solve_s"] = timed(comm, solve, 1)  # analysis and set-up included
    row["reason"] = "" if ksp.getConvergedReason() > 0 else "the linear solver failed"
    d.axpy(-1.0, known)
    row["linear_error"] = float(np.sqrt(abs(d.dot(newton.A * d)) / known.dot(rhs)))
    row |= {"linear_iterations": ksp.getIterationNumber(), "memory_mib": resident_mib(comm, "VmHWM") - before}
    row["elastic_assembly_s"] = elastic(scene)[0] if c.linear_solver == "mumps-cholesky" else None
    if row["elastic_assembly_s"]:
        row["tangent_ratio"] = row["tangent_s"] / row["elastic_assembly_s"]
    mesh = scene.blank.mesh
    return row | {"dofs": x.size, "cells": mesh.topology.index_map(2).size_global}


def sizes(study):
    """Cost of assembly and solution over mesh size; table, exponents and the gain by ranks."""
    args, folder = study.args, study.folder()
    base = Configuration("tensile", "size", steps=0)
    plan = [replace(base, **change) for change in (QUICK_SIZES if args.quick else SIZES)]
    rows = [study.once(str(asdict(c)), lambda c=c: apart(study, c)) for c in tqdm(plan, disable=None, leave=False)]
    study.write_table(folder / "table.csv", rows)
    good, found = [r for r in rows if not r["reason"]], {}
    for solver in dict.fromkeys(r["linear_solver"] for r in good):
        mine = [r for r in good if r["linear_solver"] == solver and r["ranks"] == 1]
        if len(mine) > 1:
            dofs = np.log([r["dofs"] for r in mine])
            found[solver] = {f"exponent_of_{k}": float(np.polyfit(dofs, np.log([r[k] for r in mine]), 1)[0]) for k in ("tangent_s", "solve_s", "memory_mib")}  # fmt: skip
            found[solver] |= {
                f"{k}_per_dof": mine[-1][k] / mine[-1]["dofs"] for k in ("tangent_s", "solve_s", "memory_mib")
            }
    for two in (r for r in good if r["ranks"] > 1):
        alone = next(r for r in good if r["ranks"] == 1 and all(r[k] == two[k] for k in ("nx", "linear_solver")))
        found[f"{two['ranks']} ranks, {two['cells']} cells"] = {f"gain_of_{k}": alone[k] / two[k] for k in ("tangent_s", "residual_s", "solve_s")}  # fmt: skip
    study.summarise(folder, converged=True, stroke_reached=1.0, quantities=found)
    study.say(table(rows, PRINTED_SIZES))
    for name, values in found.items():
        study.say(f"{name}: " + ", ".join(f"{k} {v:.3g}" for k, v in values.items()))


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
    command += ["--reference", str(args.reference), "--material", args.material, "--model", args.model]
    command += [word for coupling in args.without for word in ("--without", coupling)]
    if c.ranks > 1:
        command = [*MPIRUN.split(), str(c.ranks), *command]
    # timeout also ends what mpirun started, and itself where it must kill
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
    return row | {"reason": f"not done within {args.limit:g} s" if done.returncode in (124, -9) else said[-1].strip()}


def reference_grid(study, name):
    """Displacements of the camera's points in the reference of scene `name`."""
    return np.loadtxt(study.args.reference / f"{name}_grid.csv", delimiter=",", skiprows=1)[:, 2:].reshape(grid().shape)


def reference_curve(study, name):
    """Load factors and reactions [N] of the reference of scene `name`, (2, n)."""
    return np.loadtxt(study.args.reference / f"{name}.csv", delimiter=",", skiprows=1, usecols=(0, 2)).T


def curve_distance(curve, reference):
    """Largest distance of the polygon through the points of `curve` from those of `reference`, both (2, n), over the
    last of the latter: what is read off a plotted curve is off by that."""
    return float(np.abs(np.interp(reference[0], *curve) - reference[1]).max() / abs(reference[1, -1]))


def references(study, names):
    """The reference quantities of the scenes `names`, whose files are all there."""
    found = {}
    for name in names:
        file = f"{name}.json"
        try:
            facts = json.loads((study.args.reference / file).read_text())
            found[name], material = facts["quantities"], facts["material"]
            file = f"{name}.csv"
            reference_curve(study, name)
            file = f"{name}_grid.csv"
            reference_grid(study, name)
        except (OSError, ValueError, LookupError, TypeError):
            raise InputError(
                f"--reference {study.args.reference} holds no readable {file}; allowed is a folder that studies/reference.py wrote"
            ) from None
        if material != study.fabric.dumps():
            raise InputError(
                f"--material {study.args.material} is not that of {name}.json in {study.args.reference}; allowed is the one that studies/reference.py was run with"
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
    for r in sorted((r for r in rows if not r["reason"]), key=lambda r: (r["cost"], resolved(r))):
        r["on_front"], least = resolved(r) < least, min(least, resolved(r))


def resolved(r):
    """Error of the curve, as far as the reference resolves it."""
    return max(r["error_curve"], r["error_bar"])


def within(r, goal):
    return not r["reason"] and r["error_curve"] + r["error_bar"] <= goal


def configuration(r):
    return Configuration(**{k: r[k] for k in Configuration.__dataclass_fields__})


def recommended(rows):
    """{goal: cheapest row whose curve is within it, None if there is none, or a word if the reference is not}."""
    found = {}
    for goal in GOALS:
        good = [r for r in rows if within(r, goal)]
        found[goal] = min(good, key=lambda r: r["cost"], default=None)
        if rows[0]["error_bar"] >= goal:
            found[goal] = f"not resolved by the reference, known to {rows[0]['error_bar']:.2g} of it"
    return found


def recommended_for_all(scenes):
    """{goal: of the configurations whose curves are within it in all scenes {name: rows}, the cheapest's rows}."""
    found = {}
    for goal in GOALS:
        good = {}
        for r in (r for rows in scenes.values() for r in rows if within(r, goal)):
            good.setdefault(replace(configuration(r), scene="", sweep=""), {})[r["scene"]] = r
        good = [list(mine.values()) for mine in good.values() if len(mine) == len(scenes)]
        found[goal] = min(good, key=lambda mine: sum(r["cost"] for r in mine), default=None)
    return found


def table(rows, printed=PRINTED):
    """The columns `printed` of rows as text."""

    def text(value, form):
        return "-" if value is None or value == "" else format(value, form)

    names = {name: name.replace("error_", "e_").replace("tolerance", "tol").replace("centre_", "") for name in printed}
    lines = [list(names.values()), *([text(r.get(k), form) for k, form in printed.items()] for r in rows)]
    widths = [max(map(len, column)) for column in zip(*lines)]
    return "\n".join("  ".join(word.rjust(w) for word, w in zip(line, widths)).rstrip() for line in lines)


def picture(path, scenes):
    """Error over cost of the scenes {name: rows}, with their fronts."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(scenes), figsize=(5.2 * len(scenes), 5.4), squeeze=False, layout="constrained")
    markers, patterns = {"P1": "^", "P2": "v", "P3": "<", "Q1": "s", "Q2": "D"}, {}
    for ax, (name, rows) in zip(axes[0], scenes.items()):
        good = [r for r in rows if not r["reason"]]
        kinds = [(r["element"], r["pattern"], r["integration"]) for r in good]
        for element, pattern, integration in dict.fromkeys(kinds):
            mine = [r for r, kind in zip(good, kinds) if kind == (element, pattern, integration)]
            shape = "rectangles" if element[0] == "Q" and pattern == "crossed" else pattern
            colour = patterns.setdefault(shape, f"C{len(patterns)}")
            fill = {"mfc": "none"} if integration == "reduced" else {}
            ax.plot([r["cost"] for r in mine], [r["error_curve"] for r in mine], markers[element], color=colour, ms=5, **fill)  # fmt: skip
        front = sorted((r["cost"], resolved(r)) for r in good if r["on_front"])
        ax.step(*zip(*front), where="post", color="k", lw=1)
        ax.axhspan(0, rows[0]["error_bar"], color="0.9")
        ax.set(xscale="log", yscale="log", xlabel="wall time / linear-elastic solves of the baseline mesh", title=name)
        ax.set_ylabel("largest error of the curve / final reaction")
        ax.grid(alpha=0.3)
    used = dict.fromkeys(r["element"] for rows in scenes.values() for r in rows if not r["reason"])
    keys = [plt.Line2D([], [], color="k", lw=1, label="front"), plt.Rectangle((0, 0), 1, 1, color="0.9", label="not resolved")]  # fmt: skip
    keys += [plt.Line2D([], [], ls="", marker=markers[e], color="0.4", label=e) for e in sorted(used)]
    if any(r["integration"] == "reduced" for rows in scenes.values() for r in rows):
        keys.append(plt.Line2D([], [], ls="", marker="v", color="0.4", mfc="none", label="reduced"))
    keys += [plt.Line2D([], [], ls="", marker="o", color=colour, label=shape) for shape, colour in patterns.items()]
    figure.get_layout_engine().set(rect=(0, 0.13, 1, 0.87))
    figure.legend(handles=keys, loc="lower center", ncols=6, fontsize="small")
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main(study):
    args = study.args
    if args.configuration:
        c = Configuration(**json.loads(args.configuration))
        study.say(json.dumps(one(study, c) if c.steps else one_solution(study, c)))
        return
    if study.comm.size > 1:
        raise InputError(f"the study was started on {study.comm.size} ranks; allowed is 1, it starts its runs itself")
    if args.sizes:
        sizes(study)
        return
    names = args.scenes or list(SCENES)[: 2 if args.quick else None]
    reference, folder, scenes = references(study, names), study.folder(), {}
    changes, scale = (QUICK, {"nx": 24, "steps": 5}) if args.quick else (FULL, {})
    plan = []
    for name in names:
        base = Configuration(name, **scale)
        plan += [base, *(replace(base, **change) for change in changes)]
    for c in tqdm(plan, disable=None, leave=False):
        row = study.once(str(asdict(c)), lambda c=c: apart(study, c))
        scenes.setdefault(c.scene, []).append(row)
        if row["reason"]:
            tqdm.write(f"{c}: {row['reason']}", file=sys.stderr)
    for name, rows in scenes.items():
        if rows[0]["reason"]:
            raise SolverFailure(f"the baseline of {name} failed: {rows[0]['reason']}")
        judge(rows, reference[name])
    advice = {name: recommended(rows) for name, rows in scenes.items()}
    common = recommended_for_all(scenes)
    rows = [r for rows in scenes.values() for r in rows]
    study.write_table(folder / "table.csv", rows)
    if not args.no_pictures:
        picture(folder / "front.png", scenes)
    study.summarise(
        folder, converged=True, stroke_reached=1.0, material=study.fabric.name,
        quantities={
            name: {
                "runs": len(found), "failed": sum(bool(r["reason"]) for r in found), "reference_error_bar": found[0]["error_bar"],
                "baseline_elastic_solve_s": found[0]["wall_s"] / found[0]["cost"], "front": [str(configuration(r)) for r in found if r["on_front"]],
                "recommended": {f"{goal:g}": choice for goal, choice in advice[name].items()},
            }
            for name, found in scenes.items()
        },
        recommended={f"{goal:g}": choice for goal, choice in common.items()},
    )  # fmt: skip
    study.say(table(rows))
    for name, choices in advice.items():
        for goal, r in choices.items():
            if isinstance(r, dict):
                words = f"{configuration(r)}: {r['wall_s']:.3g} s, {r['cost']:.3g} baseline solves, errors of the curve {r['error_curve']:.2%}, the reaction {r['error_reaction']:.2%} and strain {r['error_strain']:.2%}"
            else:
                words = r or "none of these"
            study.say(f"{name}, curve within {goal:.1%}: {words}")
    for goal, choice in common.items():
        words = "; ".join(f"{configuration(r)}: {r['cost']:.3g}" for r in choice or ()) or "none of these"
        study.say(f"all scenes, curve within {goal:.1%}, cost in baseline solves: {words}")


if __name__ == "__main__":
    run("speed_vs_error", options(), main)
