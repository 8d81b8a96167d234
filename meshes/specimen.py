"""Cells of a rectangular specimen, in any format that meshio writes:

python3 meshes/specimen.py specimen.msh --length 200 --width 50 --nx 100 --ny 25
"""

import argparse
import math

import meshio

from fabric_fenicsx.sheet.specimen import PATTERNS, specimen

parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
parser.add_argument("out", help="file to write")
for name, size in {"length": 200.0, "width": 50.0}.items():
    parser.add_argument(f"--{name}", type=float, default=size, help=f"[mm] ({size:g})")
parser.add_argument("--nx", type=int, default=100, help="rectangles along the length (100)")
parser.add_argument("--ny", type=int, default=25, help="rectangles across the width (25)")
parser.add_argument("--pattern", choices=PATTERNS, default="crossed")
parser.add_argument("--fibre-angle", type=float, default=0.0, help="of yarns a [deg] (0)")
parser.add_argument("--cell", choices=("triangle", "quadrilateral"), default="triangle")
args = parser.parse_args()
sizes = args.length, args.width, args.nx, args.ny
angle = math.radians(args.fibre_angle)
points, cells, kind = specimen(*sizes, args.pattern, args.cell, angle)
meshio.write_points_cells(args.out, points, [(kind, cells)])
