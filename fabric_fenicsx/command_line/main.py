"""`python -m fabric_fenicsx info`: what is installed and whether it works; studies are the scripts
in studies/."""

import argparse
import sys

from ..errors import InputError
from . import info
from .options import Parser, exit_status


def main(argv: list[str] | None = None) -> int:
    """Run the command in argv (default: the program's arguments); returns its exit status, 2 for
    bad arguments."""
    comm = info.world()
    speaks = comm is None or comm.rank == 0
    argv = sys.argv[1:] if argv is None else argv
    if not speaks and {"-h", "--help"} & set(argv):
        return 0
    parser = Parser(
        prog="python -m fabric_fenicsx", description="What is installed, and whether it works."
    )
    parser.add_argument(
        "command",
        type=_command,
        metavar="command",
        help="info: versions, presets, and whether all works",
    )
    try:
        parser.parse_args(argv)
    except InputError as error:
        status, text = exit_status(error)
        if speaks:
            print(f"python -m fabric_fenicsx: {text}", file=sys.stderr, flush=True)
        if comm is not None:
            comm.Barrier()  # mpirun ends all ranks when the first leaves
        return status
    return info.show(comm)


def _command(text: str) -> str:
    if text != "info":
        raise argparse.ArgumentTypeError(f"is {text}; allowed is info")
    return text
