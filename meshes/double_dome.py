"""Triangles of the double dome's surface, a quarter or all of it, finer on its roundings, for
ParaView and as a tool.

python3 meshes/double_dome.py --depth 60 --saddle-depth 15 --size 10 --turn 10 --out double_dome.stl
"""

import argparse
import dataclasses
import math
from pathlib import Path

import numpy as np

from fabric_fenicsx.errors import InputError
from fabric_fenicsx.tools import DoubleDome


def double_dome(
    dome: DoubleDome | None = None,
    length: float = 520.0,
    width: float = 320.0,
    size: float = 10.0,
    turn: float = 10.0,
    quarter: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) [mm] on the surface and triangles (m, 3), seen from above anticlockwise.

    dome: a `DoubleDome`, by default that of its defaults. length, width: of the flange's outline,
    along x and y [mm].
    size: of the edges where the surface is flat [mm]; turn: of the normal along an edge on
    roundings and fillets [deg].
    quarter: only x >= 0, y >= 0, with nodes on both planes of symmetry. Raises InputError where
    they do not fit.
    """
    dome = dome or DoubleDome()
    for name, value, high in (
        ("length", length, math.inf),
        ("width", width, math.inf),
        ("size", size, math.inf),
        ("turn", turn, 45),
    ):
        if not 0 < value < high:
            raise InputError(
                f"{name} is {value}; allowed is above 0 and "
                f"{'finite' if high == math.inf else f'below {high}'}"
            )
    foot = dome.foot
    for name, value, half in (
        ("length", length, dome.dome_distance / 2 + dome.dome_radius),
        ("width", width, dome.dome_radius),
    ):
        if value <= 2 * (half + foot):
            raise InputError(
                f"{name} is {value:g}; allowed is above {2 * (half + foot):g}, "
                "where the flange begins"
            )
    points, triangles = _quarter(dome, length / 2, width / 2, size, math.radians(turn))
    if not quarter:
        for axis in (0, 1):
            points, triangles = _mirrored(points, triangles, axis)
    return points, triangles


def _quarter(dome, x, y, size, turn):
    """The quarter up to the corner (x, y), meshed in the developed plan, where no wall is seen
    edge-on."""
    import gmsh

    # The flange's outline, from the x axis over the corner to the y axis, moved outwards by what
    # the profile is longer.
    along, up = (np.linspace(0, end, max(2, math.ceil(end / size) + 1)) for end in (x, y))
    outline = np.vstack(
        [
            np.column_stack([np.full(len(up), x), up]),
            np.column_stack([along, np.full(len(along), y)])[-2::-1],
        ]
    )
    outline = outline + (dome.developed[-1] - dome.foot) * dome.plan(*outline.T)[1].T

    rounding, wall, fillet, flange = dome.developed
    fine = ((rounding, wall, dome.top_radius * turn), (fillet, flange, dome.entry_radius * turn))

    def size_at(dim, tag, x, y, *z):
        s = float(dome.plan(np.array([x]), np.array([y]))[0][0])
        return min(size, *(least + 0.3 * max(start - s, s - end, 0) for start, end, least in fine))

    gmsh.initialize(readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("double dome")
        geo = gmsh.model.geo
        _lines_of_dome(geo, dome, outline)
        geo.synchronize()
        for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
            gmsh.option.setNumber(f"Mesh.{option}", 0)
        gmsh.option.setNumber("Mesh.Algorithm", 6)
        gmsh.model.mesh.setSizeCallback(size_at)
        gmsh.model.mesh.generate(2)
        tags, places, _ = gmsh.model.mesh.getNodes()
        _, triangles = gmsh.model.mesh.getElementsByType(2)
    finally:
        gmsh.finalize()
    number = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    number[tags.astype(np.int64)] = np.arange(len(tags))
    places = places.reshape(-1, 3)[:, :2]
    places[abs(places) < 1e-9 * x] = 0
    used, triangles = np.unique(
        number[triangles.astype(np.int64)], return_inverse=True
    )  # without centres of arcs
    return dome.lift(*places[used].T), triangles.reshape(-1, 3)


def _lines_of_dome(geo, dome, outline):
    """A quarter of the developed plan in gmsh: lines where the curvature jumps, so that no triangle
    lies across them, and their faces. The parts begin at lines beside the outline, arcs about the
    dome and, beyond a line across, about the centre of the waist."""
    centre, waist = np.array([dome.dome_distance / 2, 0.0]), dome.waist
    turn = -dome.plan(np.zeros(1), np.array([waist]))[2][0]
    middle = np.array([0.0, waist + 1 / turn]) if turn else None  # of the waist's arc
    across = (
        np.array([0.0, 1.0])
        if middle is None
        else (middle - centre) / np.linalg.norm(middle - centre)
    )

    def point(place):
        return geo.addPoint(*place, 0)

    dome_at = point(centre)
    waist_at = None if middle is None else point(middle)
    corner = point((0, 0))
    start, end, lines = (
        corner,
        corner,
        [],
    )  # the last level's points on the axes, and its lines between them
    joint = None
    for s in dome.developed:
        radius = dome.dome_radius + s
        a, j, b = (
            point(centre + [radius, 0]),
            point(centre + radius * across),
            point((0.0, waist + s)),
        )
        curve = geo.addCircleArc(a, dome_at, j)
        rest = geo.addLine(j, b) if waist_at is None else geo.addCircleArc(j, waist_at, b)
        x, y = geo.addLine(start, a), geo.addLine(b, end)
        if joint is None:
            loops = [[x, curve, rest, y]]
        else:
            step = geo.addLine(joint, j)
            loops = [[x, curve, -step, -lines[0]], [step, rest, y, -lines[1]]]
        for loop in loops:
            geo.addPlaneSurface([geo.addCurveLoop(loop)])
        start, joint, end, lines = a, j, b, [curve, rest]
    places = [point(place) for place in outline]
    rim = [geo.addLine(*ends) for ends in zip(places, places[1:])]
    for line in rim:
        geo.mesh.setTransfiniteCurve(line, 2)
    loop = [geo.addLine(start, places[0]), *rim, geo.addLine(places[-1], end), -lines[1], -lines[0]]
    geo.addPlaneSurface([geo.addCurveLoop(loop)])


def _mirrored(points, triangles, axis):
    """With their image in the plane through 0 across `axis`, whose nodes the two share."""
    off = points[:, axis] != 0
    image = np.arange(len(points))
    image[off] = len(points) + np.arange(off.sum())
    mirror = np.ones(3)
    mirror[axis] = -1
    return np.vstack([points, points[off] * mirror]), np.vstack(
        [triangles, image[triangles][:, ::-1]]
    )


def write(path: Path | str, points: np.ndarray, triangles: np.ndarray) -> None:
    """Write triangles (m, 3) over points (n, 3) [mm] to a file of any format that PyVista (VTP,
    STL, PLY) or meshio (MSH, VTU, INP, ...) writes.

    Raises InputError where it cannot be written.
    """
    import meshio
    import pyvista

    try:
        if str(path).lower().endswith((".vtp", ".stl", ".ply")):
            open(path, "wb").close()  # VTK only logs that it could not write
            pyvista.PolyData(
                points, np.column_stack([np.full(len(triangles), 3), triangles]).ravel()
            ).save(path)
        else:
            meshio.write(path, meshio.Mesh(points, {"triangle": triangles}))
    except (OSError, ValueError, SystemExit, meshio.ReadError, meshio.WriteError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{path} cannot be written ({reason}); allowed is a file like "
            "tool.stl, tool.vtp or tool.msh"
        ) from None


def main() -> None:
    """What `python3 meshes/double_dome.py` does; exit status 2 for options that do not fit."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
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
        "--size", type=float, default=10.0, help="of the edges where it is flat [mm]"
    )
    parser.add_argument(
        "--turn", type=float, default=10.0, help="of the normal along an edge on roundings [deg]"
    )
    parser.add_argument("--quarter", action="store_true", help="only x >= 0, y >= 0")
    parser.add_argument(
        "--out",
        default="double_dome.stl",
        help="file to write, of any format that PyVista or meshio writes",
    )
    args = parser.parse_args()
    try:
        dome = DoubleDome(**{each.name: getattr(args, each.name) for each in dimensions})
        points, triangles = double_dome(
            dome, args.length, args.width, args.size, args.turn, args.quarter
        )
        write(args.out, points, triangles)
    except InputError as error:
        parser.error(str(error))
    print(f"{args.out}: {len(points)} nodes, {len(triangles)} triangles")


if __name__ == "__main__":
    main()
