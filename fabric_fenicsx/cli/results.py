"""`fabric export`, `pattern` and `view`: commands on the results of a forming run."""

import ctypes
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.files import check_new, ending, failure_reason, replace_file
from ..core.formatting import rounded
from ..core.rules import POSITIVE, unknown_key
from ..io.outlines import read_trim_line
from ..results import pattern, space, states, structural
from ..results.ply import planes_of
from .options import Parser, option_type

PLANE = '"z=5" (keep what is above), or "x,y,z,nx,ny,nz": a point [mm], a normal to the kept side'

FRAME = "final coordinates of this tool's file; `tool`: of the leading tool (default: press)"


def run(command: str, words: Sequence[str]) -> None:
    """Run a command with these words. Raises InputError, and OSError for files."""
    how = {"export": _export, "pattern": _pattern, "view": _view}[command]
    parser = Parser(prog=f"fabric {command}", description=how.__doc__)
    parser.option("folder", metavar="DIR", help="results of a run")
    parser.switch("--overwrite", "replace existing files")
    args = how(parser, words)
    if reason := failure_reason(Path(args.folder) / "summary.json"):
        print(f"warning: the run in {args.folder} did not end normally: {reason}", file=sys.stderr)


def _export(parser, words):
    """Formed plies with thickness and yarns, for a structural analysis."""
    kinds = ".vtu (VTK), .inp (Abaqus), .k or .key (LS-DYNA), .bdf or .nas (Nastran)"
    parser.option("file", metavar="FILE", help=f"file to write, with one of the extensions {kinds}")
    parser.switch("--modelled", "only the modelled part, e.g. a quarter (default: the whole part)")
    parser.option("--frame", metavar="TOOL", help=FRAME)
    args = parser.parse_args(words)
    check_new(Path(args.file), overwrite=args.overwrite)
    grids = states.read_grids(args.folder)
    frame = states.frame_of(args.folder, args.frame) if args.frame else None
    labels = states.set_labels(grids) if ending(args.file) == ".inp" else {}
    for name, ply in structural.export(grids, args.file, args.modelled, frame).items():
        own = f" (ELSET {labels[name]})" if labels else ""
        planes = {} if args.modelled else planes_of(grids[name])
        words = [f"{'xy'[axis]} = {place:g}" for axis, place in planes.items()]
        mirrored = f", mirrored in {' and '.join(words)}" if words else ""
        print(f"{args.file}: {name or 'ply'}{own}, {len(ply.cells)} cells{mirrored}")
    return args


def _view(parser, words):
    """Formed plies and tools in a window, or as a page for a browser."""
    page = "write a self-contained web page instead of a window (without a display: "
    parser.option("--html", metavar="FILE", help=f"{page}DIR/view.html)")
    field = "cell field to show (default: shear_angle)"
    parser.option("--field", metavar="NAME", help=field)
    args = parser.parse_args(words)
    states.states(args.folder)
    if args.html is None and _has_display():
        space.show(args.folder, args.field)
    else:
        file = Path(args.html or Path(args.folder) / "view.html")
        check_new(file, overwrite=args.overwrite)
        replace_file(file, space.page(args.folder, args.field))
        print(f"{file}: web page of the last state")
    return args


def _has_display():
    """True if an X server answers; without one VTK opens no window and says nothing."""
    with suppress(OSError):
        x11 = ctypes.CDLL("libX11.so.6")
        x11.XOpenDisplay.restype = ctypes.c_void_p
        return bool(x11.XOpenDisplay(None))
    return False


def _pattern(parser, words):
    """The flat pattern of a trimmed part, of the results of a forming run."""
    trim = parser.add_mutually_exclusive_group(required=True)
    line = "closed trim line on the formed ply: x, y and z in a .csv, or a .dxf; without z it is "
    trim.add_argument("--line", metavar="FILE", help=f"{line}projected along z; inner rings: holes")
    trim.add_argument("--plane", help=f"trim plane: {PLANE}")
    parser.option("--out", metavar="STEM", help="files without extension (default: DIR/pattern)")
    parser.option("--sheet", metavar="NAME", help="ply of a stack (default: all)")
    reach = "distance of the line from the ply (default: 2 thicknesses of all plies)"
    parser.option("--reach", type=option_type(POSITIVE), metavar="MM", help=reach)
    edge = "for a formed net blank: report how far its edge is from the line, write no files"
    parser.switch("--edge", edge)
    parser.option("--frame", metavar="TOOL", help=FRAME)
    # a plane may begin with a minus, which argparse takes for an option
    joined = "\n".join(words).replace("--plane\n", "--plane=")
    args = parser.parse_args(joined.split("\n") if words else [])
    if args.edge and args.plane:
        raise InputError("--edge is not allowed with --plane; use --line FILE")
    grids = states.read_grids(args.folder)
    if args.sheet is not None and args.sheet not in grids:
        raise unknown_key(args.sheet, filter(None, grids), f"--sheet {args.sheet}")
    trim, notes = (_plane(args.plane), []) if args.plane else read_trim_line(args.line)
    frame = states.frame_of(args.folder, args.frame) if args.frame else None
    where: Any = pattern.placed(trim, frame) if frame else trim
    trimmed = {name: grid for name, grid in grids.items() if args.sheet in (None, name)}
    if args.edge:
        for name, grid in trimmed.items():
            largest, mean = map(rounded, pattern.edge_distance(grid, where))
            of_ply = f"the edge of {f'ply {name}' if name else 'the ply'}"
            print(f"{of_ply} is up to {largest} mm from the trim line, {mean} mm on average")
        return args
    reach = args.reach or 2 * sum(map(_thickness, grids.values()))
    labels = states.set_labels(grids) if len(grids) > 1 else {}
    patterns = {}
    for name, grid in trimmed.items():
        try:
            patterns[name] = pattern.flat_pattern(grid, where, reach)
        except InputError as error:
            raise InputError(f"ply {name}: {error}" if name else str(error)) from None
    stem = args.out or Path(args.folder) / "pattern"
    stems = {n: f"{stem}_{labels[n]}" if labels else f"{stem}" for n in patterns}
    files = (Path(each + end) for each in stems.values() for end in (".dxf", ".csv", ".vtu"))
    check_new(*files, overwrite=args.overwrite)
    print("".join(f"{note}\n" for note in notes), end="")
    for name, flat in patterns.items():
        pattern.write_pattern(stems[name], flat, states.units(args.folder), name, frame)
        off = f", trim line up to {rounded(flat.off)} mm off the ply" if flat.off else ""
        sizes = f"area {rounded(flat.net.area, 6)} mm2, perimeter {rounded(flat.net.length, 6)} mm"
        formed = f"area of the formed part {rounded(flat.formed_area, 6)} mm2"
        print(f"{stems[name]}.dxf, .csv, .vtu: {sizes}, {formed}{off}")
    return args


def _plane(text):
    axis, _, place = text.replace(" ", "").partition("=")
    with suppress(ValueError):
        if axis in ("x", "y", "z"):
            normal = np.eye(3)["xyz".index(axis)]
            point = float(place) * normal
        else:
            point, normal = np.array(text.split(","), dtype=float).reshape(2, 3)
        if np.isfinite([*point, *normal]).all() and np.any(normal):
            return pattern.Plane(tuple(point), tuple(normal))
    raise InputError(f"--plane is {text}; expected {PLANE}")


def _thickness(grid):
    for name in ("thickness_under_pressure", "metal_thickness"):
        if name in grid.cell_data and np.isfinite(grid.cell_data[name]).any():
            return float(np.nanmax(grid.cell_data[name]))
    return 1.0
