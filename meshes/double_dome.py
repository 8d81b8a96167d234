"""Triangles of the double dome's surface, a quarter or all of it, finer on its roundings, for
ParaView and as a tool; or the dome as a solid in a STEP file.

python3 meshes/double_dome.py --depth 60 --saddle-depth 15 --size 10 --turn 10 --out double_dome.stl
python3 meshes/double_dome.py --depth 60 --saddle-depth 15 --out double_dome.step
"""

import argparse
import dataclasses

from fabric_fenicsx.meshes.double_dome import double_dome, write, write_step
from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.tools.double_dome import DoubleDome


def main() -> None:
    """Write what the command line asks for; exit status 2 for options that do not fit."""
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").partition("\n")[0],
        argument_default=argparse.SUPPRESS,  # of options of triangles: `double_dome` has their own
    )
    dimensions = dataclasses.fields(DoubleDome)
    for each in dimensions:
        parser.add_argument(
            f"--{each.name.replace('_', '-')}",
            type=float,
            default=each.default,
            help=each.metadata["help"],
        )
    parser.add_argument("--length", type=float, default=520.0, help="of the flange along x [mm]")
    parser.add_argument("--width", type=float, default=320.0, help="of the flange along y [mm]")
    parser.add_argument(
        "--size", type=float, help="of the edges where it is flat [mm], 10 by default"
    )
    parser.add_argument(
        "--turn", type=float, help="of the normal along an edge on roundings [deg], 10 by default"
    )
    parser.add_argument("--quarter", action="store_true", help="only x >= 0, y >= 0")
    parser.add_argument(
        "--out",
        default="double_dome.stl",
        help="file to write, of any format that PyVista or meshio writes; or .step: a solid, whole "
        "and without triangles",
    )
    args = parser.parse_args()
    of_triangles = {
        name: value for name, value in vars(args).items() if name in ("size", "turn", "quarter")
    }
    try:
        dome = DoubleDome(**{each.name: getattr(args, each.name) for each in dimensions})
        if args.out.lower().endswith((".step", ".stp")):
            if of_triangles:
                options = ", ".join(f"--{name}" for name in of_triangles)
                raise InputError(
                    f"{options} cannot be used for {args.out}, a solid without triangles; allowed "
                    "is a file like tool.stl"
                )
            write_step(args.out, dome, args.length, args.width)
            print(f"{args.out}: a solid")
            return
        points, triangles = double_dome(dome, args.length, args.width, **of_triangles)
        write(args.out, points, triangles)
    except InputError as error:
        parser.error(str(error))
    print(f"{args.out}: {len(points)} nodes, {len(triangles)} triangles")


if __name__ == "__main__":
    main()
