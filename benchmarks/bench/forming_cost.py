"""What forming over the double dome costs, measured in this process, and what errors are made
of."""

import dataclasses
import time
from typing import Any

from mpi4py import MPI

from fabric_fenicsx.forming.press import Press
from fabric_fenicsx.material.laws import Law
from fabric_fenicsx.runtime.errors import SolverFailure

from .cost import resident_mib
from .cost_plan import Configuration

COMPARED = {  # column of the table -> number of the run
    "punch_force_N": "punch_force_N",
    "shear_max_deg": "shear_angle_max_deg",
    "shear_99_percent_deg": "shear_angle_99_percent_deg",
    "draw_in_mm": "draw_in.largest_mm",
}


def dome(fabric: Law, **mesh: Any) -> Press:
    """The press of the double dome with this fabric and fields of the sheet."""
    press = Press.read("double_dome")
    return press.replace(sheets=dataclasses.replace(press.sheets[0], fabric=fabric, **mesh))


def forming_cost(comm: MPI.Comm, fabric: Law, c: Configuration) -> dict[str, Any]:
    """Row of the table of forming of the `Configuration` c. cpu_s is of the whole process, its
    start included; `doubt` is why a result at full load is not to be believed; `curve` is the punch
    force [N] over the load."""
    asked: Any = {k: getattr(c, k) for k in ("element", "pattern", "nx", "fibre_angle")}
    forming = dome(fabric, **asked).build(comm)
    job = forming.job(
        steps=c.steps,
        tolerance=c.tolerance,
        path_tolerance=c.path_tolerance,
        linear_solver=c.linear_solver,
    )
    try:
        result, said = job.run(), ""
    except SolverFailure as failure:
        result, said = failure.result, str(failure)
    cpu, summary = time.process_time(), result.summary
    whole = summary["stroke_reached"] == 1
    return {
        "cpu_s": comm.allreduce(cpu),
        "wall_s": summary["wall_s"]["total"],
        "peak_mib": resident_mib(comm, "VmHWM"),
        "dofs": summary["dofs"],
        "cells": summary["cells"],
        "iterations": summary["newton_iterations"],
        "accepted": summary["steps_accepted"],
        "rejected": summary["steps_rejected"],
        "reason": "" if whole else said,
        "doubt": said if whole else "",
        "warnings": "; ".join(summary["warnings"]),
        "curve": [(row["load"], row["reaction_N"]) for row in result.rows],
    } | {column: result.number(name) for column, name in COMPARED.items()}
