"""Check of values before any run starts."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from ..runtime.errors import InputError
from ..runtime.ranks import RANKS_ENVIRONMENT

MARK = "refused: "  # before the child's answer, as libraries of MPI print, too


def check(press: Path, runs: Sequence[Sequence[str]], law_file: str = "") -> tuple[int, str] | None:
    """Number and sentence of the first run whose changes of the press file are not allowed.

    A child process reads the file, as that starts MPI today.
    """
    program = f"from {__name__} import _answer; _answer()"
    done = subprocess.run(
        [sys.executable, "-c", program],
        input=json.dumps([str(press), list(map(list, runs)), law_file]),
        capture_output=True,
        text=True,
        env=os.environ | RANKS_ENVIRONMENT,
    )
    found = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    return tuple(json.loads(found[0].removeprefix(MARK))) if found else None


def refused(
    press: Path | str, runs: Sequence[Sequence[str]], law_file: str = ""
) -> tuple[int, str] | None:
    """As `check`, in this process."""
    from ..forming.press_file import read_press
    from ..material.presets import read_laws

    if law_file:
        read_laws(law_file)
    for number, changes in enumerate(runs):
        try:
            read_press(press, changes)
        except InputError as error:
            return number, str(error)
    return None


def _answer():
    if found := refused(*json.load(sys.stdin)):
        print(f"\n{MARK}{json.dumps(found)}", flush=True)
