"""The run on a mesh twice as coarse, from which a run's error is estimated."""

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

FOLDER = "coarse"  # in the run's own


def coarsened(job: Job, made: Any) -> Any:
    """The job `made` on a mesh twice as coarse, with the settings of `job` that go with it."""
    settings = job.coarser_settings()
    given = {each.name: getattr(settings, each.name) for each in dataclasses.fields(settings)}
    changes = given | {"every": 10**9, "error": False, "tables": None, "pictures": None}
    return dataclasses.replace(made, **changes, name=f"{job.name}, twice as coarse")


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

    assert job.coarser and result.folder
    folder, comm, began = result.folder / FOLDER, job.scene.comm, time.perf_counter()
    known = output.resume and comm.bcast((folder / "checkpoint.npz").exists())
    try:
        made = coarsened(job, job.coarser())
        cells = made.scene.blank.mesh.topology.index_map(2).size_global
        output.say(
            f"the error: the same run on {cells} cells instead of {result.summary['cells']}, "
            f"in {made.steps:g} steps"
        )
        apart = Output(made.name, folder, comm, resume=known, overwrite=not known)
        apart.is_quiet = True
        try:
            known_by = dict(problem) | {"mesh": "twice as coarse"}
            coarse = made.run(apart, problem=known_by, pictures=False)
            errors = error.estimate(result, coarse, job.order, job.headlines)
        finally:
            apart.close()
    except (InputError, SolverFailure) as failure:
        output.warn(f"no error is known, as the run on the coarser mesh failed: {failure}")
        return {}
    write_history(result, comm)
    steps = coarse.summary["steps_accepted"]
    seconds = round(time.perf_counter() - began, 4)
    return {"error": errors, "error_run": {"cells": cells, "steps": steps, "wall_s": seconds}}


def write_history(result: Result, comm: Any) -> None:
    """Write history.csv anew, with the curve's errors."""
    assert result.folder
    path = result.folder / "history.csv"
    part = Path(f"{path}.part")
    History(part, comm, result.rows).close()
    if comm.rank == 0:
        part.replace(path)
