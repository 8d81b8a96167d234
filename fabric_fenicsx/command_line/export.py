"""`fabric export`: formed plies with thickness and yarn directions, for a structural analysis."""

import sys
from pathlib import Path

from ..runtime.files import unwritable
from .options import Parser


def run(words: list[str]) -> None:
    """Write the file that the command line `words` name, of the last state of results. Raises
    InputError for what is not allowed."""
    parser = Parser(prog="fabric export", description=__doc__)
    parser.add_argument("folder", metavar="DIR", help="results of a run")
    kinds = ".vtu (VTK), .inp (Abaqus), .k or .key (LS-DYNA), .bdf or .nas (Nastran)"
    parser.add_argument("file", metavar="FILE", help=f"to write, as its ending says: {kinds}")
    parser.add_argument(
        "--modelled",
        action="store_true",
        help="what was modelled, as a quarter (default: the whole part)",
    )
    args = parser.parse_args(words)
    from ..postprocess import states, structural
    from ..postprocess.ply import planes_of
    from ..results.output import failure_reason

    structural.checked(args.file)
    grids = states.read_grids(args.folder)
    try:
        plies = structural.export(grids, args.file, args.modelled)
    except OSError as error:
        raise unwritable(error) from None
    labels = states.set_labels(grids) if Path(args.file).suffix == ".inp" else {}
    for name, found in plies.items():
        own = f" (ELSET {labels[name]})" if labels else ""
        mirrored = " and ".join("xy"[axis] for axis in planes_of(grids[name]))
        mirrored = f", mirrored in {mirrored} = 0" if mirrored and not args.modelled else ""
        print(f"{args.file}: {name or 'ply'}{own}, {len(found.cells)} cells{mirrored}")
    if reason := failure_reason(Path(args.folder) / "summary.json"):
        print(f"warning: the run in {args.folder} did not end well: {reason}", file=sys.stderr)
