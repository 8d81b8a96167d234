"""Options and exit status, shared by scripts that need no DOLFINx."""

import argparse
import os
import re
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from ..core.errors import NOT_VALID, InputError, Interrupted
from ..core.files import unwritable
from ..core.processes import on_ranks
from ..core.rules import Rule
from ..io.field import OfPlace

STUDIES = Path(__file__).parents[1] / "studies"  # a link in the repository, a copy where installed


def asks_for_help(words: Sequence[str]) -> bool:
    """Whether the words of a command line ask for help, so that nothing else is to be printed."""
    return not {"-h", "--help"}.isdisjoint(words)


def exit_status(error: Exception) -> tuple[int, str]:
    """Status and words to leave with for an InputError or OSError (2), SolverFailure or Interrupted
    (3)."""
    error = unwritable(error) if isinstance(error, OSError) else error
    if isinstance(error, InputError):
        return 2, f"error: {error}"
    ended = isinstance(error, Interrupted) or str(error).startswith(NOT_VALID)
    return 3, str(error) if ended else f"stopped: {error}"


def program(name: str) -> str:
    """First words of the command that started study `name`: `fabric` or a script."""
    script = Path(sys.argv[0])
    return f"fabric {name}" if script.parent == STUDIES else "/".join(script.parts[-2:])


def restart_command(ranks: int = 1) -> str:
    """Command that restarts this program, without --resume and --overwrite."""
    options = [word for word in sys.argv[1:] if word not in ("--resume", "--overwrite")]
    script, here = Path(sys.argv[0]), f"{Path.cwd()}/"
    start = ["-m", "fabric_fenicsx", script.stem] if script.parent == STUDIES else [str(script)]
    mpirun = on_ranks(ranks)[0].removeprefix(here).removesuffix(".openmpi")
    words = [mpirun, "-n", str(ranks)] if ranks > 1 else []
    return shlex.join([*words, sys.executable.removeprefix(here), *start, *options])


def spelled(name: str) -> str:
    """The option of a parameter of this name."""
    return "--" + name.replace("_", "-")


def option_type(rule: Rule) -> Callable[[str], object]:
    """An argparse type of the numbers that `rule` allows, or of files of points where it does."""

    def convert(text: str) -> object:
        if isinstance(rule, OfPlace) and os.path.isfile(text):
            return os.path.abspath(text)
        try:
            return rule.check("", float(text))
        except (ValueError, InputError):
            flaw = f"{text} is not allowed; expected {rule.allowed}"
            raise argparse.ArgumentTypeError(flaw) from None

    return convert


class Parser(argparse.ArgumentParser):
    """An argument parser that raises InputError, where argparse would print its usage and leave.
    `free`: names of the options that a resumed run may change; all others define the problem."""

    # what most runs are told, first in the help of a study
    USUAL = (
        "--material --length --width --strain --nx --steps --quick --out --overwrite --resume"
    ).split()

    def __init__(self, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, formatter_class=HelpFormatter, **settings)
        self.free: set[str] = set()
        self._groups: dict[str, argparse._ArgumentGroup] = {}
        self._group: argparse._ActionsContainer = self

    def group(self, title: str) -> None:
        """Add the options that follow to the group of this title."""
        self._group = self._groups.get(title) or self.add_argument_group(title)
        self._groups[title] = self._group

    def option(self, *names: str, free: bool = False, **settings: Any) -> None:
        """Add an option, as argparse's add_argument; free: a resumed run may change it."""
        group = self._groups.get("usual") if names[0] in self.USUAL else None
        action = (group or self._group).add_argument(*names, **settings)
        self.free |= {action.dest} if free else set()

    def switch(self, name: str, words: str) -> None:
        """Add an option without a value, which a resumed run may change."""
        self.option(name, action="store_true", help=words, free=True)

    def format_help(self) -> str:
        return self.translated(super().format_help())

    def translated(self, text: str) -> str:
        """A message with its parameters as options: `resume=True` as --resume, `steps=3` as
        --steps 3 and `Limits.strain` as --max-strain; other words stay."""

        def option(match: re.Match[str]) -> str:
            name = spelled(("max_" if match[1] else "") + match[2])
            if name not in self._option_string_actions:
                return match[0]
            return name if match[3] in (None, "True") else f"{name} {match[3]}".replace('"', "")

        return re.sub(r'`(Limits\.)?(\w+)(?:=(\w+|"[^"`]*"))?`', option, text)

    def error(self, message: str) -> NoReturn:
        """Raise InputError with what argparse says."""
        raise InputError(f"{message}; see --help")


class HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Tells defaults, where there is one to tell."""

    def _get_help_string(self, action):
        has_default = action.default not in (None, False, [])
        return super()._get_help_string(action) if has_default else action.help
