"""Options and exit status, shared by scripts that need no DOLFINx."""

import argparse
import os
import re
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from ..readers.field import OfPlace
from ..runtime.errors import NOT_BELIEVED, InputError, Interrupted
from ..runtime.ranks import on_ranks
from ..runtime.rules import Rule, did_you_mean

STUDIES = Path(__file__).parents[1] / "studies"  # a link in the repository, a copy where installed


# what most runs are told, first in the help of a study
USUAL = (
    *("--material", "--length", "--width", "--strain", "--nx", "--steps", "--quick"),
    *("--out", "--overwrite", "--resume"),
)


def asks_for_help(words: Sequence[str]) -> bool:
    """Whether the words of a command line ask for help, so that nothing else is to be printed."""
    return not {"-h", "--help"}.isdisjoint(words)


def exit_status(error: Exception) -> tuple[int, str]:
    """Status and words to leave with for an InputError (2), SolverFailure or Interrupted (3)."""
    if isinstance(error, InputError):
        return 2, f"error: {error}"
    words = str(error)
    ended = isinstance(error, Interrupted) or words.startswith(NOT_BELIEVED)
    return 3, words if ended else f"stopped: {words}"


def program(name: str) -> str:
    """First words of the command that started study `name`: `fabric` or a script."""
    script = Path(sys.argv[0])
    return f"fabric {name}" if _by_fabric() else f"{script.parent.name}/{script.name}"


def restart_command(ranks: int = 1) -> str:
    """Command that starts this program anew, without --resume and --overwrite."""
    options = [word for word in sys.argv[1:] if word not in ("--resume", "--overwrite")]
    script = Path(sys.argv[0])
    start = ["-m", "fabric_fenicsx", script.stem] if _by_fabric() else [str(script)]
    words = [_from_here(sys.executable), *start, *options]
    mpirun = _from_here(on_ranks(ranks)[0]).removesuffix(".openmpi")
    return (f"{mpirun} -n {ranks} " if ranks > 1 else "") + shlex.join(words)


def _by_fabric():
    return Path(sys.argv[0]).parent == STUDIES


def _from_here(file):
    here, path = Path.cwd(), Path(file)
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def spelled(name: str) -> str:
    """The option of a parameter of this name."""
    return "--" + name.replace("_", "-")


def option_type(rule: Rule) -> Callable[[str], Any]:
    """An argparse type of the numbers that `rule` allows, or of files of points where it does."""

    def convert(text: str) -> Any:
        if isinstance(rule, OfPlace) and os.path.isfile(text):
            return os.path.abspath(text)
        try:
            return rule.check("", float(text))
        except (ValueError, InputError):
            raise argparse.ArgumentTypeError(f"is {text}; allowed is {rule.allowed}") from None

    return convert


class Parser(argparse.ArgumentParser):
    """An argument parser that raises InputError, where argparse would print its usage and leave.
    `free`: names of the options that a resumed run may change; all others define the problem."""

    # what messages say of a parameter: `name`, `name=value` or, of what is believed, `Limits.name`
    PARAMETER = re.compile(r'`(Limits\.)?(\w+)(?:=(\w+|"[^"`]*"))?`')

    def __init__(self, **settings: Any) -> None:
        usual: dict[str, Any] = {"allow_abbrev": False, "formatter_class": HelpFormatter}
        super().__init__(**usual | settings)
        self.free: set[str] = set()
        self._names: set[str] = set()
        self._groups: dict[str, Any] = {}
        self._group: Any = self

    def group(self, title: str) -> None:
        """Add the options that follow to the group of this title."""
        if title not in self._groups:
            self._groups[title] = self.add_argument_group(title)
        self._group = self._groups[title]

    def format_help(self) -> str:
        """Argparse's help, with parameters as options; a group `usual` is in the order of USUAL."""
        if "usual" in self._groups:
            usual = self._groups["usual"]._group_actions
            usual.sort(key=lambda action: USUAL.index(action.option_strings[0]))
        return self.translated(super().format_help())

    def option(self, *names: str, free: bool = False, **settings: Any) -> None:
        """Add an option, as argparse's add_argument; free: a resumed run may change it."""
        group = self._groups.get("usual") if names[0] in USUAL else None
        action = (group or self._group).add_argument(*names, **settings)
        self._names.add(action.dest)
        if free:
            self.free.add(action.dest)

    def switch(self, name: str, words: str) -> None:
        """Add an option without a value, which a resumed run may change."""
        self.option(name, action="store_true", help=words, free=True)

    def change(self, name: str, **settings: Any) -> None:
        """Give an option that is there other settings, as its help."""
        vars(self._option_string_actions[name]).update(settings)

    def translated(self, text: str) -> str:
        """A message with its parameters, `resume=True`, as options, --resume; other words stay."""

        def option(match: re.Match[str]) -> str:
            name = ("max_" if match[1] else "") + match[2]
            if name not in self._names:
                return match[0]
            value = (match[3] or "True").strip('"')
            return spelled(name) if value == "True" else f"{spelled(name)} {value}"

        return self.PARAMETER.sub(option, text)

    def error(self, message: str) -> NoReturn:
        """Raise InputError with what argparse says, in the form of all messages."""
        allowed = "allowed are those that --help tells"
        if match := re.fullmatch(r"unrecognized arguments: (.*)", message):
            word = match[1].split()[0].split("=")[0]
            if not word.startswith("-"):
                raise InputError(f"word {word} belongs to no option; {allowed}")
            near = did_you_mean(word.replace("_", "-"), self._option_string_actions)
            raise InputError(f"option {word} is unknown{near}; {allowed}")
        if match := re.fullmatch(r"the following arguments are required: (.*)", message):
            raise InputError(f"{match[1]} is missing; see --help")
        if match := re.match(r"argument (\S+): ignored explicit argument", message):
            raise InputError(f"{match[1]} is given a value; allowed is {match[1]} alone")
        wrong = re.match(r"argument (\S+): (invalid (.*?)(?: value)?: |expected)(\S*)", message)
        if not wrong:
            raise InputError(message.removeprefix("argument ").replace(": is ", " is ", 1))
        option, kind, value = wrong[1], wrong[3], wrong[4].strip("'\"")
        if not kind:
            raise InputError(f"{option} has no value; allowed is one after it")
        if kind != "choice":
            words = {"int": "a whole number", "float": "a number"}.get(kind, f"a {kind}")
            raise InputError(f"{option} is {value}; allowed is {words}")
        choices = list(map(str, self._option_string_actions[option.split("/")[0]].choices or ()))
        flaw = f"{option} is {value}{did_you_mean(value, choices)}"
        raise InputError(f"{flaw}; allowed is one of {', '.join(choices)}")


class HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Tells defaults, where there is one to tell."""

    def _get_help_string(self, action):
        has_default = action.default not in (None, False, [])
        return super()._get_help_string(action) if has_default else action.help
