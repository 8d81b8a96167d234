"""A configuration run in a process, or ranks, of its own."""

import json
import os
import subprocess
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from .cost_plan import Configuration

MPIRUN = "mpirun.openmpi --map-by :OVERSUBSCRIBE --bind-to none -n"
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_mpi_yield_when_idle": "1",  # other runs may share the cores
}


def run_apart(c: Configuration, command: Sequence[str], limit: float) -> dict[str, Any]:
    """Row of the `Configuration` c, which `command` prints as JSON in its last line, within `limit`
    [s]; with a `reason` if it did not end well."""
    words = [*command, "--configuration", json.dumps(asdict(c))]
    if c.ranks > 1:
        words = [*MPIRUN.split(), str(c.ranks), *words]
    # timeout also ends what mpirun started, and itself where it must kill
    done = subprocess.run(
        ["timeout", "-k", "5", f"{limit:g}", *words],
        capture_output=True,
        text=True,
        env=os.environ | ENVIRONMENT,
        stdin=subprocess.DEVNULL,
    )
    row = asdict(c)
    if done.returncode == 0:
        return row | json.loads(done.stdout.splitlines()[-1])
    if done.returncode in (124, -9):
        return row | {"reason": f"not done within {limit:g} s"}
    said = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return row | {"reason": said[-1] if said else f"ended with status {done.returncode}"}
