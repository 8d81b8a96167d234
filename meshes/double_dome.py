"""Triangles of the double dome, for ParaView or as a tool, as .stl, .vtp or .ply:

python3 meshes/double_dome.py dome.stl --size 6
"""

import argparse

import pyvista

from fabric_fenicsx.sheet.specimen import specimen
from fabric_fenicsx.surfaces.double_dome import DoubleDome

parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
parser.add_argument("out", help="file to write")
parser.add_argument("--size", type=float, default=6.0, help="of the squares cut in four [mm] (6)")
args = parser.parse_args()
counts = (round(each / args.size) for each in (600, 400))
flat, cells, _ = specimen(600, 400, *counts)
points = DoubleDome().lift(flat[:, 0] - 300, flat[:, 1] - 200)
pyvista.PolyData.from_regular_faces(points, cells).save(args.out)
