"""Triangles in an outline with holes, in any format that meshio writes:

python3 meshes/outline.py blank.dxf blank.msh --size 8
"""

import argparse
import math

import meshio

from fabric_fenicsx.io.outlines import read_outline
from fabric_fenicsx.sheet.sources import PATTERNS, outline_mesh

parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
parser.add_argument("outline", help="DXF, CSV of x and y [mm], or a mesh")
parser.add_argument("out", help="file to write")
parser.add_argument("--size", type=float, required=True, help="of the cells' edges [mm]")
parser.add_argument("--pattern", choices=PATTERNS, default="along")
parser.add_argument("--fibre-angle", type=float, default=0.0, help="from x to yarns a [deg] (0)")
parser.add_argument("--yarn-angle", type=float, default=90.0, help="from a to b [deg] (90)")
parser.add_argument("--layer", help="of a DXF, or several with commas between them (all)")
args = parser.parse_args()
sheet, doubts = read_outline(args.outline, args.layer)
yarns = math.radians(args.fibre_angle), math.radians(args.fibre_angle + args.yarn_angle)
points, cells, kind, more = outline_mesh(sheet, args.size, args.pattern, yarns)
meshio.write_points_cells(args.out, points, [(kind, cells)])
print(*(f"warning: {doubt}" for doubt in (*doubts, *more)), sep="\n", end="")
