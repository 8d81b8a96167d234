"""Rectangular specimen: structured (crossed, left, right), unstructured or with edges along yarns,
of triangles or quadrilaterals.

python3 meshes/specimen.py --length 200 --width 50 --nx 100 --ny 25 --pattern crossed --out
specimen.msh
"""

import argparse
import math

from double_dome import write

from fabric_fenicsx.meshes.specimen import PATTERNS, specimen
from fabric_fenicsx.runtime.errors import InputError


def main() -> None:
    """Write what the command line asks for; exit status 2 for options that are not allowed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--length", type=float, default=200.0, help="along x [mm]")
    parser.add_argument("--width", type=float, default=50.0, help="along y [mm]")
    parser.add_argument("--nx", type=int, default=100, help="rectangles along the length")
    parser.add_argument("--ny", type=int, default=25, help="rectangles across the width")
    parser.add_argument("--pattern", choices=PATTERNS, default="crossed")
    parser.add_argument(
        "--fibre-angle",
        type=float,
        default=0.0,
        help="of the yarns [deg], for patterns `along` and `yarns`",
    )
    parser.add_argument("--cell", choices=("triangle", "quadrilateral"), default="triangle")
    parser.add_argument(
        "--out", default="specimen.msh", help="file to write, as .msh, .vtu or .stl"
    )
    args = parser.parse_args()
    if not math.isfinite(args.fibre_angle):
        parser.error(f"--fibre-angle is {args.fibre_angle}; allowed is a finite angle in deg")
    for name in ("length", "width", "nx", "ny"):
        if not 0 < getattr(args, name) < float("inf"):
            parser.error(f"--{name} is {getattr(args, name)}; allowed is a finite value above 0")
    sizes = args.length, args.width, args.nx, args.ny
    try:
        yarns = math.radians(args.fibre_angle)
        points, cells, _ = specimen(*sizes, args.pattern, args.cell, yarns)
        write(args.out, points, cells)
    except InputError as error:
        parser.error(str(error))
    print(f"{args.out}: {len(points)} nodes, {len(cells)} {args.cell}s")


if __name__ == "__main__":
    main()
