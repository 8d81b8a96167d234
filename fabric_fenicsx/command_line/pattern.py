"""`fabric pattern`: the flat pattern of a trimmed part from the results of a forming run."""

import sys
from pathlib import Path

import numpy as np

from ..runtime.errors import InputError
from ..runtime.files import unwritable
from ..runtime.formatting import rounded
from ..runtime.rules import POSITIVE, unknown_key
from .options import Parser, option_type

LAYERS = 2.0  # thicknesses of all plies, by which a trim line may be off the formed ply
PLANE = '"z=5" (what is above it), or "x,y,z,nx,ny,nz": a point [mm] and the normal to what is kept'


def run(words: list[str]) -> None:
    """Write the patterns that the command line `words` ask for, and print their sizes. Raises
    InputError for what is not allowed."""
    parser = Parser(prog="fabric pattern", description=__doc__)
    parser.add_argument("folder", metavar="DIR", help="results of a forming run")
    trim = parser.add_mutually_exclusive_group()
    trim.add_argument(
        "--line",
        metavar="FILE",
        help="closed trim line on the formed ply: x, y and z in a .csv, or a .dxf; without z it is "
        "projected along z; inner rings are holes",
    )
    trim.add_argument("--plane", help=f"plane that trims: {PLANE}")
    parser.add_argument("--out", metavar="STEM", help="of the files (default: DIR/pattern)")
    parser.add_argument("--sheet", metavar="NAME", help="ply of a stack (default: all)")
    parser.add_argument(
        "--reach",
        type=option_type(POSITIVE),
        metavar="MM",
        help=f"distance of the line from the ply that is allowed (default: {LAYERS:g} times the "
        "thickness of all plies)",
    )
    # a plane may begin with a minus, which argparse takes for an option
    joined = "\n".join(words).replace("--plane\n", "--plane=")
    args = parser.parse_args(joined.split("\n") if words else [])
    if not (args.line or args.plane):
        raise InputError("nothing says where to trim; allowed is --line FILE or --plane PLANE")
    _write(args)


def _write(args):
    from ..meshes.outline_files import read_trim_line
    from ..postprocess import pattern, states
    from ..results.output import failure_reason

    grids = states.read_grids(args.folder)
    if args.sheet is not None and args.sheet not in grids:
        raise unknown_key(args.sheet, filter(None, grids), f"--sheet {args.sheet}")
    trim, notes = (_plane(args.plane), []) if args.plane else read_trim_line(args.line)
    reach = args.reach or LAYERS * sum(map(_thickness, grids.values()))
    labels = states.set_labels(grids) if len(grids) > 1 else dict.fromkeys(grids, "")
    found, wrong = {}, []
    for name, grid in grids.items():
        if args.sheet in (None, name):
            try:
                found[name] = pattern.flat_pattern(grid, trim, reach)
            except InputError as error:
                wrong.append(f"ply {name}: {error}" if name else str(error))
    if wrong:
        raise InputError("\n".join(wrong))
    stem, units = Path(args.out or Path(args.folder) / "pattern"), states.units(args.folder)
    if not stem.parent.is_dir():
        raise InputError(
            f"--out is {stem}, but {stem.parent} is no folder; allowed is a file's name in one"
        )
    for note in notes:
        print(note)
    for name, flat in found.items():
        own = stem.with_name("_".join(filter(None, [stem.name, labels[name]])))
        try:
            pattern.write_pattern(own, flat, units)
        except OSError as error:
            raise unwritable(error) from None
        off = f", trim line up to {rounded(flat.off)} mm off the ply" if flat.off else ""
        print(
            f"{own}.dxf, .csv, .vtu: area {rounded(flat.net.area, 6)} mm2, perimeter "
            f"{rounded(flat.net.length, 6)} mm, area of the formed part "
            f"{rounded(flat.formed_area, 6)} mm2{off}"
        )
    if reason := failure_reason(Path(args.folder) / "summary.json"):
        print(f"warning: the run in {args.folder} did not end well: {reason}", file=sys.stderr)


def _plane(text):
    """The plane of an option's text."""
    from ..postprocess.pattern import Plane

    try:
        axis, _, place = text.replace(" ", "").partition("=")
        if place:
            normal = np.eye(3)["xyz".index(axis)] if len(axis) == 1 else np.zeros(3)
            point = float(place) * normal
        else:
            point, normal = np.array(text.split(","), dtype=float).reshape(2, 3)
    except ValueError:
        point = normal = np.zeros(3)
    if not (np.isfinite([*point, *normal]).all() and np.any(normal)):
        raise InputError(f"--plane is {text}; allowed is {PLANE}")
    return Plane(tuple(point), tuple(normal))


def _thickness(grid):
    """The largest thickness of a ply [mm]."""
    for name in ("thickness_under_pressure", "metal_thickness"):
        if name in grid.cell_data and np.isfinite(grid.cell_data[name]).any():
            return float(np.nanmax(grid.cell_data[name]))
    return 1.0
