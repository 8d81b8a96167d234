"""`fabric`, or `python -m fabric_fenicsx`: runs studies, lists them, and says what is installed."""

import argparse
import ast
import re
import runpy
import sys
import textwrap
from pathlib import Path

from ..core.cache_folders import is_first
from ..core.errors import InputError
from ..core.processes import end_with_reader
from ..core.rules import unknown_key
from ..core.status import shown, task
from ..core.version import __version__
from . import info
from .options import STUDIES, Parser, asks_for_help, exit_status

COMMANDS = """\
run:
  STUDY    {}
  sweep    parameter study: runs of a press file with several values

results:
  view     formed plies and tools in a window or a web page
  export   formed plies, thickness and yarns, for VTK, Abaqus, LS-DYNA, Nastran
  pattern  the flat pattern of a trimmed part

set-up:
  info     versions, presets, and a check of the installation
  list     the studies, and the folder of their example data
  prepare  compile the forms of standard runs"""


def main(argv: list[str] | None = None) -> int:
    """Run the command in argv (default: the program's arguments); returns its exit status, 2 for
    bad arguments. A study leaves with its own."""
    argv = sys.argv[1:] if argv is None else argv
    command = argv[0] if argv else ""
    end_with_reader()
    scripts = {path.stem: path for path in sorted(STUDIES.glob("*.py"))}
    if command in scripts:
        sys.argv[:] = [str(scripts[command]), *map(_found, argv[1:])]
        with shown(first=is_first() and not asks_for_help(argv)), task(f"fabric {command}"):
            runpy.run_path(str(scripts[command]), run_name="__main__")
        return 0
    if command == "sweep":  # takes seconds to import, as what follows
        from . import sweep

        return sweep.main([*map(_found, argv[1:])])
    comm, status = info.world(), 0
    first = comm is None or comm.rank == 0
    if not first and asks_for_help(argv):
        return 0
    try:
        if command not in ("view", "export", "pattern"):
            command = _parsed(argv, scripts)
        if command == "info":
            return info.show(comm)
        if command == "prepare":
            from .prepare import prepare

            with shown(first=first):
                prepare()
        elif first and command == "list":
            print(_listed(scripts.values()))
        elif first:
            from . import results

            results.run(command, argv[1:])
    except (InputError, OSError) as error:
        status, text = exit_status(error)
        if first:
            print(f"fabric: {text}", file=sys.stderr, flush=True)
    if comm is not None:
        comm.Barrier()  # mpirun ends all ranks when the first leaves
    return status


def _parsed(argv, scripts):
    """The command of the words; InputError for others."""
    names = textwrap.fill(", ".join(scripts), 88, subsequent_indent=11 * " ")
    usage = "fabric STUDY|COMMAND [option ...]; --help lists the options of each"
    parser = Parser(prog="fabric", usage=usage, description=COMMANDS.format(names))
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("-v", "--version", action="version", version=__version__)
    parser.add_argument("command", help=argparse.SUPPRESS)
    args = parser.parse_args(argv or ["--help"])
    if args.command not in (known := re.findall("^  ([a-z]+) ", COMMANDS, re.MULTILINE)):
        raise unknown_key(args.command, [*known, *scripts], f"command {args.command}")
    return args.command


def _listed(scripts):
    """Each study with its description; then the example data."""
    lines = []
    for path in scripts:
        words = " ".join((ast.get_docstring(ast.parse(path.read_text())) or "").split())
        lines += textwrap.wrap(f"{path.stem:24}{words}", 100, subsequent_indent=24 * " ")
    lines.append(f"\nexample data: these names work in any folder; the files are in {STUDIES}")
    examples = [file.parent for file in STUDIES.glob("data/*/sheet.toml")]
    for path in sorted([*examples, *STUDIES.glob("presses/*.toml")]):
        lines.append(f"  studies/{path.relative_to(STUDIES)}")
    return "\n".join(lines)


def _found(word):
    """The path of example data, `studies/...`, where that is not in this folder."""
    path = STUDIES / word.removeprefix("studies/")
    example = word.startswith("studies/") and not Path(word).exists() and path.exists()
    return str(path) if example else word
