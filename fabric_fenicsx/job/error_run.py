"""The run on a coarser mesh, from which a run's error is estimated."""

import time
from collections.abc import Callable, Sequence

from ..results import error
from ..results.history import History
from ..results.output import Output
from ..results.result import Result
from ..results.verdict import Numbers
from ..runtime.errors import InputError, SolverFailure


def estimated(
    result: Result,
    run_coarser: Callable[[], Result],
    output: Output,
    headlines: Sequence[str],
    of_other_kind: bool,
) -> Numbers:
    """Entries of the summary on the errors of `result`: `error` {quantity: absolute error}, and
    facts on the run on the coarser mesh, on cells `of_other_kind` or of the same. Empty, with a
    warning, if that run fails.

    The curve's errors are then in the rows of the result and in history.csv, those of the fields in
    its fields. Raises Interrupted.
    """
    began, folder = time.perf_counter(), result.folder
    try:
        other = run_coarser()
    except (InputError, SolverFailure) as failure:
        output.warn(f"no error is known, as the run on the coarser mesh failed: {failure}")
        return {}
    if reason := error.mesh_decides(result):
        output.warn(f"no errors but those of forces and energies can be told, as {reason}")
    how = {"of_other_kind": of_other_kind, "forces_only": bool(reason)}
    errors = error.estimate(result, other, headlines, **how)
    if folder:
        part = folder / "history.csv.part"
        History(part, result.scene.comm, result.rows).close()
        if result.scene.comm.rank == 0:
            part.replace(folder / "history.csv")
    facts = {"cells": other.summary["cells"], "steps": other.summary["steps_accepted"]}
    facts["wall_s"] = round(time.perf_counter() - began, 4)
    return {"error": errors, "error_run": facts}
