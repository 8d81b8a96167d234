"""What a run costs: seconds, memory, and the unit of a linear-elastic solve, measured in this
process or, by `apart`, in one of its own."""

import dataclasses
import json
import os
import re
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

import fabric_fenicsx as ff
from fabric_fenicsx.mechanics.shell.membrane import default_degree
from fabric_fenicsx.runtime.ranks import RANKS_ENVIRONMENT, on_ranks
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.settings import Settings

from . import strips
from .cost_plan import Configuration
from .reference import reference_curve, reference_grid

SHORT = 2.0  # seconds below which a run is timed three times
FORMED = {  # column of the table -> number of the run
    "punch_force_N": "punch_force_N",
    "shear_max_deg": "shear_angle_max_deg",
    "shear_99_percent_deg": "shear_angle_99_percent_deg",
    "draw_in_mm": "draw_in.largest_mm",
}


class LinearElasticity(ff.Term):
    """Isotropic plane stress on a membrane's mesh, space and points: its solve is the unit of
    cost."""

    name, energy_kind = "linear elasticity", "strain"

    def set_up(self, scene: Any) -> None:
        """As in `Term`."""
        degree = {"quadrature_degree": default_degree(self.part)}
        self._dx = ufl.Measure("dx", scene.blank.mesh, metadata=degree)
        self.energy = 0.5 * self._work(scene.blank.u, scene.blank.u)

    def _work(self, u, v, E=1000.0, nu=0.3):
        strains = [ufl.sym(ufl.grad(x)) for x in (u, v)]
        shear, volume = ufl.inner(*strains), ufl.tr(strains[0]) * ufl.tr(strains[1])
        return (E / (1 + nu) * shear + E * nu / (1 - nu**2) * volume) * self._dx

    def variations(self, v: Any, w: Any) -> tuple[Any, Any]:
        """First and second variation of the energy, for the test and trial functions v and w."""
        return self._work(self.blank.u, v), self._work(w, v)


def timed(comm: MPI.Comm, action: Callable[[], Any], repeats: int = 5) -> float:
    """Seconds of the fastest of `repeats` runs of `action`, of the slowest rank."""
    times = []
    for _ in range(repeats):
        comm.Barrier()
        began = time.perf_counter()
        action()
        comm.Barrier()
        times.append(time.perf_counter() - began)
    return comm.allreduce(min(times), MPI.MAX)


def resident_mib(comm: MPI.Comm, key: str) -> float:
    """Resident memory of all ranks [MiB], now (key VmRSS) or at most so far (VmHWM)."""
    status = Path("/proc/self/status").read_text()
    return comm.allreduce(int(re.findall(rf"{key}:\s+(\d+)", status)[0]) / 1024)


def elastic_seconds(scene: ff.Scene) -> tuple[float, float]:
    """Seconds of the assembly, and of assembly, analysis, factorisation and solution by MUMPS, of
    linear elasticity on the scene's mesh."""
    twin = ff.Scene(scene.blank, [LinearElasticity()], scene.supports)
    A, b = twin.create_matrix(), twin.u.duplicate()
    b.set(1.0)

    def solve():
        twin.tangent(A)
        ksp = PETSc.KSP().create(scene.comm)
        ksp.setType("preonly")
        ksp.pc.setType("cholesky")
        ksp.pc.setFactorSolverType("mumps")
        ksp.setOperators(A)
        ksp.solve(b, b.duplicate())
        ksp.destroy()

    return timed(scene.comm, lambda: twin.tangent(A)), timed(scene.comm, solve)


def cost(comm: MPI.Comm, fabric: ff.Law, c: Configuration, reference: Path) -> dict[str, Any]:
    """Row of the table of the `Configuration` c, run in this process: costs and what errors are
    made of; reference: folder of the references. Without steps it is of one tangent and its
    solution, with a fibre angle of forming."""
    if c.fibre_angle is not None:
        return forming_cost(comm, fabric, c)
    scene = strips.strip_scene(comm, fabric, c.scene, c.mesh, None, c.integration)
    before, mesh = resident_mib(comm, "VmRSS"), scene.blank.mesh
    row = run_cost(scene, c, reference) if c.steps else solution_cost(scene, c)
    row |= {"cells": mesh.topology.index_map(2).size_global, "dofs": scene.u.size}
    return row | {"memory_mib": row.pop("peak_mib") - before}


def run_cost(scene: ff.Scene, c: Configuration, reference: Path) -> dict[str, Any]:
    """Costs and errors of a whole run of a strip."""
    comm, walls = scene.comm, list[float]()
    settings = Settings(steps=c.steps, path_tolerance=c.path_tolerance)
    ran: Any = None

    def solve():
        nonlocal ran
        newton = Newton(scene, c.tolerance, linear_solver=c.linear_solver)
        ran = newton, *strips.pull(newton, settings)

    while not walls or (sum(walls) < SHORT and len(walls) < 3):
        scene.set(scene.u.duplicate())
        walls.append(timed(comm, solve, 1))
    newton, outcome, curve = ran
    row = {"iterations": outcome.iterations, "reason": outcome.reason, "wall_s": min(walls)}
    row["peak_mib"] = resident_mib(comm, "VmHWM")
    assembly = timed(comm, lambda: scene.tangent(newton.tangent.A))
    elastic, row["elastic_solve_s"] = elastic_seconds(scene)
    row["tangent_ratio"], values = assembly / elastic, strips.strip_values(scene)
    row |= {"reaction_N": values["reaction_N"], "energy_Nmm": values["energy_Nmm"]}
    row["error_curve"] = strips.curve_distance(curve, reference_curve(reference, c.scene))
    fields = strips.camera_displacements(scene), reference_grid(reference, c.scene)
    apart = strips.field_distance(strips.STRIPS[c.scene].angle, *fields)
    return row | dict(zip(("error_strain", "error_shear_deg"), apart))


def solution_cost(scene: ff.Scene, c: Configuration) -> dict[str, Any]:
    """Costs of assembly and one solution with the tangent of the strip uniformly stretched by 1 %
    (its width -6.66 %). The error is that of a known solution, in the tangent's energy norm."""
    comm, newton = scene.comm, Newton(scene, linear_solver=c.linear_solver)
    x, A, ksp = newton.x, newton.tangent.A, newton.tangent.ksp
    stretched = scene.blank.coordinates()[:, :2] * [0.01, -0.0666]
    x.array[:] = stretched.ravel()[: x.local_size]
    scene.set(x)
    residual, known, d = x.duplicate(), x.copy(), x.duplicate()
    row: dict[str, Any] = {
        "tangent_s": timed(comm, lambda: scene.tangent(A)),
        "residual_s": timed(comm, lambda: scene.residual(residual)),
    }
    known.array[scene.fixed_dofs] = 0
    rhs = A * known

    def solve():
        ksp.setOperators(A)
        ksp.solve(rhs, d)

    row["solve_s"] = timed(comm, solve, 1)  # analysis and set-up included
    row["reason"] = "" if ksp.getConvergedReason() > 0 else "the linear solver failed"
    d.axpy(-1.0, known)
    row["linear_error"] = float(np.sqrt(abs(d.dot(A * d)) / known.dot(rhs)))
    return row | {"peak_mib": resident_mib(comm, "VmHWM")}


def dome(fabric: ff.Law, **mesh: Any) -> ff.Press:
    """The press of the double dome with this fabric and fields of the sheet."""
    press = ff.Press.read("double_dome")
    return press.replace(sheets=[dataclasses.replace(press.sheets[0], fabric=fabric, **mesh)])


def forming_cost(comm: MPI.Comm, fabric: ff.Law, c: Configuration) -> dict[str, Any]:
    """Row of the table of forming. cpu_s is of the whole process, its start included; `doubt` is
    why a result at full load is not to be believed; `curve` is the punch force [N] over the
    load."""
    element, pattern, nx = c.mesh.split()
    cells = {"element": element, "pattern": pattern, "nx": int(nx), "fibre_angle": c.fibre_angle}
    names = "steps", "tolerance", "path_tolerance", "linear_solver"
    job = dome(fabric, **cells).build(comm).job(**{name: getattr(c, name) for name in names})
    try:
        result, said = job.run(), ""
    except ff.SolverFailure as failure:
        result, said = failure.result, str(failure)
    cpu, whole = time.process_time(), result.number("stroke_reached") == 1
    row = {"cpu_s": comm.allreduce(cpu), "peak_mib": resident_mib(comm, "VmHWM")}
    row |= {"reason": "" if whole else said, "doubt": said if whole else ""}
    row |= {name: result.summary[name] for name in ("dofs", "cells", "newton_iterations")}
    row["curve"] = [(at["load"], at["reaction_N"]) for at in result.rows]
    return row | {column: result.number(name) for column, name in FORMED.items()}


def apart(c: Configuration, command: Sequence[str], limit: float) -> dict[str, Any]:
    """Row of the `Configuration` c, which `command` prints as JSON in its last line, run in a
    process, or ranks, of its own within `limit` [s]; with a `reason` if it did not end well."""
    words = [*command, "--configuration", json.dumps(asdict(c))]
    # timeout also ends what mpirun started, and itself where it must kill
    done = subprocess.run(
        ["timeout", "-k", "5", f"{limit:g}", *(on_ranks(c.ranks) if c.ranks > 1 else ()), *words],
        capture_output=True,
        text=True,
        env=os.environ | RANKS_ENVIRONMENT,
        stdin=subprocess.DEVNULL,
    )
    if done.returncode == 0:
        return asdict(c) | json.loads(done.stdout.splitlines()[-1])
    said = [f"ended with status {done.returncode}", *filter(str.strip, done.stderr.splitlines())]
    late = done.returncode in (124, -9)
    return asdict(c) | {"reason": f"not done within {limit:g} s" if late else said[-1]}
