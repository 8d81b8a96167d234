"""What a run costs in seconds, and how far it is from the references."""

import dataclasses
import time

import numpy as np

import fabric_fenicsx as ff
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.settings import Settings

from . import strips
from .reference import reference_curve, reference_grid

FORMED = {  # column of the table -> number of the run
    "punch_force_N": "reaction_N",
    "shear_max_deg": "shear_angle_max_deg",
    "shear_99_percent_deg": "shear_angle_99_percent_deg",
    "draw_in_mm": "draw_in.largest_mm",
}


def cost(comm, fabric, c, reference):
    """Row of the table of the `Configuration` c: what it is, its cost [s] and what errors are made
    of; reference: folder of the references. With a fibre angle it is of forming. A `reason` says
    why it did not end well."""
    of = strip_cost if c.fibre_angle is None else forming_cost
    try:
        row = of(comm, fabric, c, reference)
    except ff.SolverFailure as failure:
        row = {"reason": str(failure)}
    return {"run": str(c)} | dataclasses.asdict(c) | row


def strip_cost(comm, fabric, c, reference):
    """Wall time (the least of up to three within 2 s) and errors of a whole run of a strip."""
    scene = strips.strip_scene(comm, fabric, c.scene, c.mesh, None, c.integration)
    settings, walls = Settings(steps=c.steps, path_tolerance=c.path_tolerance), list[float]()
    while not walls or (sum(walls) < 2.0 and len(walls) < 3):
        scene.set(scene.u.duplicate())
        began = time.perf_counter()
        newton = Newton(scene, c.tolerance, linear_solver=c.linear_solver)
        outcome, curve = strips.pull(newton, settings)
        walls.append(time.perf_counter() - began)
    fields = strips.camera_displacements(scene), reference_grid(reference, c.scene)
    strain, angle = strips.field_distance(strips.STRIPS[c.scene].angle, *fields)
    row: dict = {"reason": outcome.reason, "cost": min(walls), "dofs": scene.u.size}
    row |= {"iterations": outcome.iterations, "energy_Nmm": scene.energies()["strain"]}
    row |= {"reaction_N": curve[1, -1], "error_strain": strain, "error_shear_deg": angle}
    reference = reference_curve(reference, c.scene)
    return row | {"error_curve": strips.curve_distance(curve, reference)}


def dome(fabric, **mesh):
    """The press of the double dome with this fabric and fields of the sheet."""
    press = ff.Press.read("double_dome")
    return press.replace(sheets=[dataclasses.replace(press.sheets[0], fabric=fabric, **mesh)])


def forming_cost(comm, fabric, c, _):
    """CPU time and numbers of forming; `doubt` is why a result at full load is not valid, `curve`
    the punch force [N] over the load."""
    element, pattern, nx = c.mesh.split()
    cells = {"element": element, "pattern": pattern, "nx": int(nx), "fibre_angle": c.fibre_angle}
    names = "steps", "tolerance", "path_tolerance", "linear_solver"
    began = time.process_time()
    job = dome(fabric, **cells).build(comm).job(**{name: getattr(c, name) for name in names})
    try:
        result, said = job.run(), ""
    except ff.SolverFailure as failure:
        result, said = failure.result, str(failure)
    whole = result.number("stroke_reached") == 1
    row: dict = {"reason": "" if whole else said, "doubt": said if whole else ""}
    row |= {"cost": comm.allreduce(time.process_time() - began)}
    row |= {name: result.summary[name] for name in ("dofs", "cells", "newton_iterations")}
    row["curve"] = np.transpose([(at["load"], at["reaction_N"]) for at in result.rows])
    return row | {column: result.number(name) for column, name in FORMED.items()}
