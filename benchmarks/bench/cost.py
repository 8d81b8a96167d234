"""What a run costs, measured in this process: seconds, memory, and the unit of a linear-elastic
solve."""

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc
from ufl.core.expr import Expr

from fabric_fenicsx.material.laws import Law
from fabric_fenicsx.mechanics.shell.membrane import default_degree
from fabric_fenicsx.mechanics.term import SceneFacts, Term
from fabric_fenicsx.runtime import timing
from fabric_fenicsx.scene.scene import Scene
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.settings import Settings
from fabric_fenicsx.solve.stepping import LoadStepping

from .camera import camera_displacements, field_distance
from .cost_plan import Configuration
from .reference import curve_distance, reference_curve, reference_grid
from .strips import STRIPS, Discretisation, moving_grip, strip_scene, strip_values

REPEATS = 5  # of what is timed alone; the fastest counts
SHORT = 2.0  # seconds below which a run is timed three times


class LinearElasticity(Term):
    """Isotropic plane stress on a membrane's mesh, space and points: its solve is the unit of
    cost."""

    name, energy_kind = "linear elasticity", "strain"

    def set_up(self, scene: SceneFacts) -> None:
        """As in `Term`."""
        mesh, u = scene.blank.mesh, scene.blank.u
        degree = default_degree(self.part)
        self._dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": degree})
        self.energy = 0.5 * self._work(u, u)

    def _work(self, u, v, E=1000.0, nu=0.3):
        strains = [ufl.sym(ufl.grad(x)) for x in (u, v)]
        shear, volume = ufl.inner(*strains), ufl.tr(strains[0]) * ufl.tr(strains[1])
        return (E / (1 + nu) * shear + E * nu / (1 - nu**2) * volume) * self._dx

    def variations(self, v: Expr, w: Expr) -> tuple[Expr, Expr]:
        """First and second variation of the energy, for the test and trial functions v and w."""
        return self._work(self.blank.u, v), self._work(w, v)


def timed(comm: MPI.Comm, action: Callable[[], Any], repeats: int = REPEATS) -> float:
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
    """Resident memory of all ranks [MiB], now (key VmRSS) or at most so far (VmHWM; getrusage's may
    be the parent's)."""
    found = re.search(rf"{key}:\s+(\d+)", Path("/proc/self/status").read_text())
    assert found  # Linux has both
    return comm.allreduce(int(found.group(1)) / 1024)


def elastic_seconds(scene: Scene) -> tuple[float, float]:
    """Seconds of the assembly, and of assembly, analysis, factorisation and solution by MUMPS, of
    linear elasticity on the scene's mesh."""
    comm, twin = scene.comm, Scene(scene.blank, [LinearElasticity()], scene.supports)
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


def scene_of(comm: MPI.Comm, fabric: Law, c: Configuration) -> Scene:
    """The strip of the `Configuration` c, discretised as that says."""
    how = Discretisation(c.element, c.nx, c.pattern, integration=c.integration)
    return strip_scene(comm, fabric, STRIPS[c.scene], how)


def cost(comm: MPI.Comm, fabric: Law, c: Configuration, reference: Path) -> dict[str, Any]:
    """As `run_cost`, of a `Configuration` without steps as `solution_cost`, of one with a fibre
    angle as `forming_cost`."""
    if c.fibre_angle is not None:
        from .forming_cost import forming_cost

        return forming_cost(comm, fabric, c)
    if c.steps:
        return run_cost(comm, fabric, c, reference)
    return solution_cost(comm, fabric, c)


def run_cost(comm: MPI.Comm, fabric: Law, c: Configuration, reference: Path) -> dict[str, Any]:
    """Row of the table of the `Configuration` c, run in this process: costs and what errors are
    made of; reference: folder of the references."""
    strip = STRIPS[c.scene]
    scene = scene_of(comm, fabric, c)
    before = resident_mib(comm, "VmRSS")
    compiled, total = timing.seconds["compile"], 0.0
    row: dict[str, Any] = {}
    while not row or (total < SHORT and row["repeats"] < 3):
        scene.set(scene.u.duplicate())
        timing.seconds.clear()
        measure = moving_grip(strip.stroke)
        curve: list[tuple[float, float]] = []
        made: dict[str, Any] = {}

        def solve():
            newton = made["newton"] = Newton(scene, c.tolerance, linear_solver=c.linear_solver)
            made["outcome"] = LoadStepping(
                newton,
                Settings(steps=c.steps, path_tolerance=c.path_tolerance),
                on_accept=lambda at: curve.append((at.load, measure(scene, at.load)[1])),
            ).run()

        wall = timed(comm, solve, 1)
        total += wall
        parts = {f"{name}_s": timing.seconds[name] for name in ("assemble", "linear_solve")}
        if not row:
            peak = resident_mib(comm, "VmHWM")
            row = {"wall_s": wall, "repeats": 0} | parts
        row["repeats"] += 1
        if wall < row["wall_s"]:
            row |= {"wall_s": wall} | parts
    outcome, tangent = made["outcome"], made["newton"].tangent.A
    row |= {
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
    assembly = timed(comm, lambda: scene.tangent(tangent))
    values = strip_values(scene)
    row["elastic_assembly_s"], row["elastic_solve_s"] = elastic_seconds(scene)
    row["tangent_ratio"] = assembly / row["elastic_assembly_s"]
    compared = "reaction_N", "energy_Nmm", "centre_shear_deg", "centre_eps_b"
    row |= {name: values[name] for name in compared}
    ends = [values[f"eps_{yarn}_{end}"] for yarn in "ab" for end in ("min", "max")]
    row["yarn_strain_max"] = max(map(abs, ends))
    known = reference_curve(reference, c.scene)
    row["error_curve"] = curve_distance(np.transpose(curve), known)
    seen, kept = camera_displacements(scene), reference_grid(reference, c.scene)
    row["error_strain"], row["error_shear_deg"] = field_distance(strip.angle, seen, kept)
    return row


def solution_cost(comm: MPI.Comm, fabric: Law, c: Configuration) -> dict[str, Any]:
    """Row of the table of sizes of the `Configuration` c: assembly and one solution with the
    tangent of the strip uniformly stretched by 1 % (its width -6.66 %). The error is that of a
    known solution, in the tangent's energy norm."""
    scene = scene_of(comm, fabric, c)
    before = resident_mib(comm, "VmRSS")
    newton = Newton(scene, linear_solver=c.linear_solver)
    x, A, ksp = newton.x, newton.tangent.A, newton.tangent.ksp
    gradient = np.diag([0.01, -0.0666])
    x.array[:] = (scene.blank.coordinates()[:, :2] @ gradient).ravel()[: x.local_size]
    scene.set(x)
    r = x.duplicate()
    row: dict[str, Any] = {
        "tangent_s": timed(comm, lambda: scene.tangent(A)),
        "residual_s": timed(comm, lambda: scene.residual(r)),
    }
    known, d = x.copy(), x.duplicate()
    known.array[scene.fixed_dofs] = 0
    rhs = A * known

    def solve():
        ksp.setOperators(A)
        ksp.solve(rhs, d)

    row["solve_s"] = timed(comm, solve, 1)  # analysis and set-up included
    row["reason"] = "" if ksp.getConvergedReason() > 0 else "the linear solver failed"
    d.axpy(-1.0, known)
    row["linear_error"] = float(np.sqrt(abs(d.dot(A * d)) / known.dot(rhs)))
    row["linear_iterations"] = ksp.getIterationNumber()
    row["memory_mib"] = resident_mib(comm, "VmHWM") - before
    row["elastic_assembly_s"] = None
    if c.linear_solver == "mumps-cholesky":
        row["elastic_assembly_s"] = elastic_seconds(scene)[0]
        row["tangent_ratio"] = row["tangent_s"] / row["elastic_assembly_s"]
    mesh = scene.blank.mesh
    return row | {"dofs": x.size, "cells": mesh.topology.index_map(2).size_global}
