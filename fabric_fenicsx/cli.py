"""Options, and how a program ends: what scripts share that need no DOLFINx."""

import argparse
import math
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from .errors import InputError, Interrupted


def exit_status(error: Exception) -> tuple[int, str]:
    """Status and words with which a program leaves for an InputError (2), SolverFailure or Interrupted (3)."""
    if isinstance(error, InputError):
        return 2, f"error: {error}"
    return 3, str(error) if isinstance(error, Interrupted) else f"stopped: {error}"


def command(ranks: int = 1) -> str:
    """What starts this program anew, as it was started but for --resume and --overwrite."""
    here, python = Path.cwd(), Path(sys.executable)
    words = [str(python.relative_to(here) if python.is_relative_to(here) else python)]
    words += [word for word in sys.argv if word not in ("--resume", "--overwrite")]
    return (f"mpirun -n {ranks} " if ranks > 1 else "") + shlex.join(words)


def number(allowed: str, test: Callable[[Any], bool], kind: type = float) -> Callable[[str], Any]:
    """An argparse type: a finite `kind` that passes `test`, otherwise a message that says what is `allowed`."""

    def convert(text):
        try:
            value = kind(text)
            good = math.isfinite(value) and test(value)
        except ValueError:
            good = False
        if not good:
            raise argparse.ArgumentTypeError(f"is {text}; allowed is {allowed}")
        return value

    return convert


FRACTION = number("a fraction above 0 and up to 1, where 0.1 is 10 %", lambda v: 0 < v <= 1)
COUNT = number("a whole number of 1 or more", lambda v: v >= 1, int)
POSITIVE = number("a number above 0", lambda v: v > 0)
FROM_ZERO = number("a number from 0", lambda v: v >= 0)
BETWEEN_YARNS = number("an angle above 0 and below 180 deg", lambda v: 0 < v < 180)
ANY = number("a finite number", lambda v: True)


class Parser(argparse.ArgumentParser):
    """An argument parser that raises InputError, where argparse would print its usage and leave."""

    def error(self, message: str) -> NoReturn:
        """Raise InputError with argparse's message."""
        raise InputError(message.removeprefix("argument ").replace(": is ", " is ", 1))


class Help(argparse.ArgumentDefaultsHelpFormatter):
    """Tells defaults, where there is one to tell."""

    def _get_help_string(self, action):
        return action.help if action.default in (None, False, []) else super()._get_help_string(action)
