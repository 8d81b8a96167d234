"""A configuration run in a process, or ranks, of its own."""

import json
import os
import subprocess
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from fabric_fenicsx.runtime.ranks import RANKS_ENVIRONMENT, on_ranks

from .cost_plan import Configuration


def run_apart(c: Configuration, command: Sequence[str], limit: float) -> dict[str, Any]:
    """Row of the `Configuration` c, which `command` prints as JSON in its last line, within `limit`
    [s]; with a `reason` if it did not end well."""
    words = [*command, "--configuration", json.dumps(asdict(c))]
    if c.ranks > 1:
        words = [*on_ranks(c.ranks), *words]
    # timeout also ends what mpirun started, and itself where it must kill
    done = subprocess.run(
        ["timeout", "-k", "5", f"{limit:g}", *words],
        capture_output=True,
        text=True,
        env=os.environ | RANKS_ENVIRONMENT,
        stdin=subprocess.DEVNULL,
    )
    row = asdict(c)
    if done.returncode == 0:
        return row | json.loads(done.stdout.splitlines()[-1])
    if done.returncode in (124, -9):
        return row | {"reason": f"not done within {limit:g} s"}
    said = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return row | {"reason": said[-1] if said else f"ended with status {done.returncode}"}
