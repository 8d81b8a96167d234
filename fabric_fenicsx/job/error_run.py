"""The runs on coarser meshes, from which a run's error is estimated."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..results.history import History
from ..results.output import Output
from ..results.result import Result
from ..runtime.errors import InputError, SolverFailure

if TYPE_CHECKING:
    from .job import Job

FOLDERS = "coarse", "coarser"  # in the run's own
MIN_CELLS = 8  # cells of a mesh that may tell an order


def coarsened(job: Job, made: Any) -> Any:
    """The job `made` on a mesh twice as coarse, with the settings of `job` that go with it."""
    settings = job.coarser_settings()
    given = {each.name: getattr(settings, each.name) for each in dataclasses.fields(settings)}
    return dataclasses.replace(made, **given | {"every": 10**9, "error": False})


def estimated(
    job: Job, result: Result, output: Output, problem: Mapping[str, Any]
) -> dict[str, Any]:
    """Entries of the summary on the errors of `result`, which `job` gave: `error` {quantity:
    absolute error}, and facts on the run on the mesh twice as coarse. Empty, with a warning, if
    that run fails; a third mesh, which tells the order, may.

    The curve's errors are then in the rows of the result and in history.csv, those of the fields in
    its fields. Raises Interrupted.
    """
    from ..results import error

    assert result.folder
    made, runs, began = job, list[Result](), time.perf_counter()
    for name in FOLDERS:
        try:
            if not (coarse := made.on_coarser_mesh()):
                break
            made = coarsened(job, coarse)
            if runs and _cells(made) < MIN_CELLS:
                break
            runs.append(_run(made, output, result, name, problem))
        except (InputError, SolverFailure) as failure:
            if not runs:
                output.warn(f"no error is known, as the run on the coarser mesh failed: {failure}")
                return {}
    errors = error.estimate(result, runs, job.setup.headlines())
    write_history(result, job.scene.comm)
    facts = {"cells": _cells(runs[0]), "steps": runs[0].summary["steps_accepted"]}
    facts["wall_s"] = round(time.perf_counter() - began, 4)
    return {"error": errors, "error_run": facts}


def _run(made, output, result, name, problem):
    """The `Result` of the job `made`, in this folder of the run's own."""
    folder, comm = result.folder / name, made.scene.comm
    output.say(
        f"the error: the same run on {_cells(made)} cells instead of {result.summary['cells']}, "
        f"in {made.steps:g} steps"
    )
    is_begun = output.resume and comm.bcast((folder / "checkpoint.npz").exists())
    apart = Output(
        f"{made.name}, twice as coarse", folder, comm, resume=is_begun, overwrite=not is_begun
    )
    apart.is_quiet = True
    try:
        return made.run(apart, problem=dict(problem) | {"mesh": name}, pictures=False)
    finally:
        apart.close()


def _cells(of):
    """Cells of a job or result."""
    return of.scene.blank.mesh.topology.index_map(2).size_global


def write_history(result: Result, comm: Any) -> None:
    """Write history.csv anew, with the curve's errors."""
    assert result.folder
    path = result.folder / "history.csv"
    part = Path(f"{path}.part")
    History(part, comm, result.rows).close()
    if comm.rank == 0:
        part.replace(path)
