"""Triangles in an outline with holes, from a drawing (DXF), a table of points (CSV) or the boundary
of a mesh.

python3 meshes/outline.py blank.dxf --size 8 --out blank.msh
"""

import argparse
import math
from pathlib import Path

from double_dome import write

from fabric_fenicsx.meshes.outline import PATTERNS, outline_mesh
from fabric_fenicsx.meshes.outline_files import read_outline
from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.runtime.rules import BELOW_180, FINITE


def main() -> None:
    """Write what the command line asks for; exit status 2 for what is not allowed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("outline", type=Path, help="DXF, CSV of x and y [mm], or a mesh")
    parser.add_argument("--size", type=float, required=True, help="of the cells' edges [mm]")
    parser.add_argument("--pattern", choices=PATTERNS, default="along")
    parser.add_argument(
        "--fibre-angle", type=float, default=0.0, help="from x to yarns a [deg], for `along`"
    )
    parser.add_argument(
        "--yarn-angle", type=float, default=90.0, help="from yarns a to b [deg], for `along`"
    )
    parser.add_argument("--layer", help="of a DXF, or several with commas between them (all)")
    parser.add_argument("--out", default="blank.msh", help="file to write, as .msh, .vtu or .stl")
    args = parser.parse_args()
    try:
        a = math.radians(FINITE.check("--fibre-angle", args.fibre_angle))
        b = a + math.radians(BELOW_180.check("--yarn-angle", args.yarn_angle))
        sheet, told = read_outline(args.outline, args.layer)
        points, cells, _, others = outline_mesh(sheet, args.size, args.pattern, (a, b))
        write(args.out, points, cells)
    except InputError as error:
        parser.error(str(error))
    for words in (*told, *others):
        print(f"warning: {words}")
    print(f"{args.out}: {len(points)} nodes, {len(cells)} triangles")


if __name__ == "__main__":
    main()
