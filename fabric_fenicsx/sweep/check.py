"""Whether press files with changes can be read, asked in a process of its own: reading one needs
DOLFINx and starts MPI, which a process that starts others should not.

As a program it takes on standard input a dict in JSON with `press`, `law_file` and `changes`, a
list for each run; it prints, behind `MARK`, the first sentence of bad input and ends with status 2.
"""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from ..runtime.errors import InputError
from ..runtime.ranks import RANKS_ENVIRONMENT
from .varied import Values, changes, label

MARK = "refused: run "


def check(press: Path, values: Sequence[Values], law_file: str | None = None) -> None:
    """Raise InputError, with its sentence, for the first of the runs' values that the press file
    cannot have. What can be told only by its run is left to that."""
    asked = {"press": str(press), "law_file": law_file, "changes": [changes(v) for v in values]}
    done = subprocess.run(
        [sys.executable, "-m", __name__],
        input=json.dumps(asked),
        capture_output=True,
        text=True,
        env=os.environ | RANKS_ENVIRONMENT,
    )
    # libraries of MPI may print before and after
    told = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    if done.returncode == 2 and told:
        number, words = told[0].removeprefix(MARK).split(" ", 1)
        raise InputError(f"run {label(values[int(number)])}: {words}")


def _main():
    from ..forming.press_file import read_press
    from ..material.presets import read_laws

    asked = json.load(sys.stdin)
    if asked["law_file"]:
        read_laws(asked["law_file"])
    for number, each in enumerate(asked["changes"]):
        try:
            read_press(asked["press"], each)
        except InputError as error:
            print(f"\n{MARK}{number} {error}", flush=True)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(_main())
