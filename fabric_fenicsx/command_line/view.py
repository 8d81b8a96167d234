"""Formed plies and tools of results, in a window or as a page for a browser."""

import os
from pathlib import Path

from ..runtime.errors import InputError
from ..runtime.files import replace_file, unwritable
from .options import Parser


def run(words: list[str]) -> None:
    """Show the results that the command line `words` name. Raises InputError for what is not
    allowed."""
    parser = Parser(prog="fabric view", description=__doc__)
    parser.add_argument("folder", metavar="DIR", help="results of a run")
    parser.add_argument(
        "--html",
        metavar="FILE",
        help="write a page that needs no network, in place of a window (without a display: "
        "DIR/view.html)",
    )
    parser.add_argument(
        "--field", metavar="NAME", help="field of the cells to show (default: shear_angle)"
    )
    args = parser.parse_args(words)
    from ..plot import view
    from ..postprocess.states import states

    states(args.folder)
    if args.html is None and os.environ.get("DISPLAY"):
        view.show(args.folder, args.field)
        return
    file = Path(args.html or Path(args.folder) / "view.html")
    if not file.parent.is_dir():
        raise InputError(
            f"--html is {file}, but {file.parent} is no folder; allowed is a file in one"
        )
    text = view.page(args.folder, args.field)
    try:
        replace_file(file, text)
    except OSError as error:
        raise unwritable(error) from None
    print(f"{file}: the last state, for a browser")
