"""The run on a coarser mesh, from which a run's error is estimated."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..results.history import History
from ..results.output import Output
from ..results.result import Result
from ..runtime.errors import InputError, SolverFailure

if TYPE_CHECKING:
    from .job import Job

FOLDER = "coarse"  # in the run's own


def coarsened(job: Job, made: Any) -> Any:
    """The job `made` on a coarser mesh, with the settings of `job` that go with it."""
    settings = job.coarser_settings(job.setup.FEWER_STEPS)
    given = {each.name: getattr(settings, each.name) for each in dataclasses.fields(settings)}
    return dataclasses.replace(made, **given | {"every": 10**9, "error": False})


def estimated(
    job: Job, result: Result, output: Output, problem: Mapping[str, Any]
) -> dict[str, Any]:
    """Entries of the summary on the errors of `result`, which `job` gave: `error` {quantity:
    absolute error}, and facts on the run on the coarser mesh. Empty, with a warning, if that run
    fails.

    The curve's errors are then in the rows of the result and in history.csv, those of the fields in
    its fields. Raises Interrupted.
    """
    from ..results import error

    assert result.folder
    began = time.perf_counter()
    try:
        made = coarsened(job, job.on_coarser_mesh())
        other = _run(made, output, result, problem)
    except (InputError, SolverFailure) as failure:
        output.warn(f"no error is known, as the run on the coarser mesh failed: {failure}")
        return {}
    of_other_kind = not job.coarser and job.setup.coarser_is_other_kind()
    how = {"of_other_kind": of_other_kind, "forces_only": False}
    if reason := error.mesh_decides(result):
        how["forces_only"] = True
        output.warn(f"no errors but those of forces and energies can be told, as {reason}")
    errors = error.estimate(result, other, job.setup.headlines(), **how)
    part = result.folder / "history.csv.part"
    History(part, job.scene.comm, result.rows).close()
    if job.scene.comm.rank == 0:
        part.replace(result.folder / "history.csv")
    facts = {"cells": _cells(made), "steps": other.summary["steps_accepted"]}
    facts["wall_s"] = round(time.perf_counter() - began, 4)
    return {"error": errors, "error_run": facts}


def _run(made, output, result, problem):
    """The `Result` of the job `made`, in a folder of the run's own."""
    folder, comm = result.folder / FOLDER, made.scene.comm
    output.say(
        f"the error: the same run on {_cells(made)} cells instead of {result.summary['cells']}, "
        f"in {made.steps:g} steps"
    )
    known = output.resume and comm.bcast((folder / "checkpoint.npz").exists())
    apart = Output(f"{made.name}, coarser", folder, comm, resume=known, overwrite=not known)
    apart.is_quiet = True
    try:
        return made.run(apart, problem=dict(problem) | {"mesh": FOLDER}, pictures=False)
    finally:
        apart.close()


def _cells(of):
    """Cells of a job or result."""
    return of.scene.blank.mesh.topology.index_map(2).size_global
