"""Triangles of the double dome's surface, a quarter or all of it, finer on its roundings, for
ParaView and as a tool; or the dome as a solid in a STEP file.

python3 meshes/double_dome.py --depth 60 --saddle-depth 15 --size 10 --turn 10 --out double_dome.stl
python3 meshes/double_dome.py --depth 60 --saddle-depth 15 --out double_dome.step
"""

import argparse
import dataclasses
import math
import shutil
import tempfile
from pathlib import Path

import numpy as np

from fabric_fenicsx.meshes.gmsh_cells import meshed, own_model
from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.tools.double_dome import DoubleDome

SIZE, TURN = 10.0, 10.0  # of flat triangles' edges [mm], of the normal along an edge [deg]


def double_dome(
    dome: DoubleDome | None = None,
    length: float = 520.0,
    width: float = 320.0,
    size: float = SIZE,
    turn: float = TURN,
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
    _check(dome, length, width, size, turn)
    points, triangles = _quarter(dome, length / 2, width / 2, size, math.radians(turn))
    if not quarter:
        for axis in (0, 1):
            points, triangles = _mirrored(points, triangles, axis)
    return points, triangles


def _check(dome, length, width, size=SIZE, turn=TURN):
    given = {"length": length, "width": width, "size": size, "turn": turn}
    for name, value in given.items():
        high, allowed = (45, "below 45") if name == "turn" else (math.inf, "finite")
        if not 0 < value < high:
            raise InputError(f"{name} is {value}; allowed is above 0 and {allowed}")
    half_width = dome.dome_radius + dome.foot
    for name, least in (("length", dome.dome_distance + 2 * half_width), ("width", 2 * half_width)):
        if given[name] <= least:
            raise InputError(
                f"{name} is {given[name]:g}; allowed is above {least:g}, where the flange begins"
            )


def _quarter(dome, x, y, size, turn):
    """The quarter up to the corner (x, y), meshed in the developed plan, where no wall is seen
    edge-on."""
    import gmsh

    # The flange's outline, from the x axis over the corner to the y axis, moved outwards by what
    # the profile is longer.
    along, up = (np.linspace(0, end, max(2, math.ceil(end / size) + 1)) for end in (x, y))
    sides = [(x, each) for each in up] + [(each, y) for each in along[-2::-1]]
    outline = np.array(sides)
    outline = outline + (dome.developed[-1] - dome.foot) * dome.plan(*outline.T)[1].T

    rounding, wall, fillet, flange = dome.developed
    fine = ((rounding, wall, dome.top_radius * turn), (fillet, flange, dome.entry_radius * turn))

    def size_at(dim, tag, x, y, *z):
        s = float(dome.plan(np.array([x]), np.array([y]))[0][0])
        return min(size, *(least + 0.3 * max(start - s, s - end, 0) for start, end, least in fine))

    options = dict.fromkeys(("ExtendFromBoundary", "FromPoints", "FromCurvature"), 0.0)
    options = {f"MeshSize{name}": value for name, value in options.items()}
    with own_model(gmsh, Algorithm=6, **options):
        _lines_of_dome(gmsh.model.geo, dome, outline)
        gmsh.model.geo.synchronize()
        gmsh.model.mesh.setSizeCallback(size_at)
        places, triangles = meshed(gmsh)
    places = places[:, :2]
    places[abs(places) < 1e-9 * x] = 0
    used, triangles = np.unique(triangles, return_inverse=True)  # without centres of arcs
    return dome.lift(*places[used].T), triangles.reshape(-1, 3)


def _lines_of_dome(geo, dome, outline):
    """A quarter of the developed plan in gmsh: lines where the curvature jumps, so that no triangle
    lies across them, and their faces. The parts begin at lines beside the outline, arcs about the
    dome and, beyond a line across, about the centre of the waist."""
    centre, waist = np.array([dome.dome_distance / 2, 0.0]), dome.waist
    turn = -dome.plan(np.zeros(1), np.array([waist]))[2][0]
    middle = np.array([0.0, waist + 1 / turn]) if turn else None  # of the waist's arc
    across = np.array([0.0, 1.0]) if middle is None else middle - centre
    across /= np.linalg.norm(across)

    def point(place):
        return geo.addPoint(*place, 0)

    dome_at = point(centre)
    waist_at = None if middle is None else point(middle)
    start = end = point((0, 0))  # the last level's points on the axes
    joint, lines = None, []  # and its lines between them
    for s in dome.developed:
        radius = dome.dome_radius + s
        ends = centre + [radius, 0], centre + radius * across, (0.0, waist + s)
        a, j, b = map(point, ends)
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
    rim = [geo.addLine(p, q) for p, q in zip(places, places[1:])]
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
    points = np.vstack([points, points[off] * mirror])
    return points, np.vstack([triangles, image[triangles][:, ::-1]])


def write(path: Path | str, points: np.ndarray, cells: np.ndarray) -> None:
    """Write triangles (m, 3), or quadrilaterals (m, 4), over points (n, 3) [mm] to a file of any
    format that PyVista (VTP, STL, PLY) or meshio (MSH, VTU, INP, ...) writes.

    Raises InputError where it cannot be written.
    """
    import meshio
    import pyvista

    try:
        if str(path).lower().endswith((".vtp", ".stl", ".ply")):
            open(path, "wb").close()  # VTK only logs that it could not write
            pyvista.PolyData.from_regular_faces(points, cells).save(path)
        else:
            kind = {3: "triangle", 4: "quad"}[cells.shape[1]]
            meshio.write(path, meshio.Mesh(points, {kind: cells}))
    except (OSError, ValueError, SystemExit, meshio.ReadError, meshio.WriteError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{path} cannot be written ({reason}); allowed is a file like "
            "tool.stl, tool.vtp or tool.msh"
        ) from None


def write_step(
    path: Path | str,
    dome: DoubleDome | None = None,
    length: float = 520.0,
    width: float = 320.0,
    base: float = 20.0,
) -> None:
    """Write the dome on a plate `base` [mm] thick as a solid to a STEP file.

    Its faces are B-splines through the surface, one for each part of the profile along each arc of
    the outline, up to 1e-4 mm and 0.01 deg off it with the defaults' dimensions. dome, length,
    width: as for `double_dome`. Raises InputError where they do not fit or the file cannot be
    written.
    """
    import gmsh

    dome = dome or DoubleDome()
    _check(dome, length, width)
    with own_model(gmsh), tempfile.TemporaryDirectory() as folder:
        _solid(gmsh, dome, length, width, base)
        made = Path(folder) / "dome.step"  # gmsh knows the ending in small letters alone
        gmsh.write(str(made))
        try:
            shutil.copyfile(made, path)
        except OSError as error:
            raise InputError(
                f"{path} cannot be written ({error.strerror}); allowed is a file like tool.step"
            ) from None


def _solid(gmsh, dome, length, width, base):
    """Make the model of the dome on a plate, one solid."""
    occ = gmsh.model.occ
    parts = [_sides(dome, outline) for outline in _outline(dome)]
    occ.synchronize()
    inner, outer = (
        occ.addCurveLoop([_edge_at(dome, part[which], d) for part in parts])
        for which, d in zip((0, -1), dome.roundings)
    )
    plate = occ.addRectangle(-length / 2, -width / 2, 0, length, width)
    below = occ.extrude([(2, plate)], 0, 0, -base)
    occ.synchronize()
    rim = [tag for _, tag in gmsh.model.getBoundary([(2, plate)], oriented=False)]
    _top(dome, inner)
    occ.addPlaneSurface([occ.addCurveLoop(rim), outer])
    occ.remove([*(each for each in below if each[0] == 3), (2, plate)])
    occ.synchronize()
    faces = occ.healShapes([], 1e-3, False, False, False, True, False)  # sews them
    shell = occ.addSurfaceLoop([tag for dim, tag in faces if dim == 2], sewing=True)
    solid = occ.addVolume([shell])
    occ.synchronize()
    occ.remove([each for each in gmsh.model.getEntities() if each != (3, solid)])
    occ.synchronize()


def _outline(dome):
    """Places in mm along the outline (n,) and the outline there (2, n), for each of its four arcs,
    anticlockwise from that about (dome_distance / 2, 0)."""
    c, R, w = dome.dome_distance / 2, dome.dome_radius, dome.waist
    k = -dome.plan(np.zeros(1), np.array([w]))[2][0]
    end, joint = math.atan2(1 + k * w, -k * c), c / (1 + k * R)
    # what is not smooth in the saddle lies between its points
    n, m = (
        min(max(math.ceil(60 * each / dome.saddle_length), 21), 201)
        for each in (2 * R * end, 2 * joint)
    )
    a, x = np.linspace(-end, end, n), np.linspace(joint, -joint, m)
    around = R * a, np.array([c + R * np.cos(a), R * np.sin(a)])
    waist = -x, np.array([x, w + k * x * x / (1 + np.sqrt(1 - (k * x) ** 2))])
    return [around, waist, (around[0], -around[1]), (waist[0], -waist[1])]


def _sides(dome, outline, n=9):
    """Faces of rounding, wall and fillet along one arc of the outline."""
    u, place = outline
    normal, faces = dome.plan(*place)[1], []
    for ends in zip(dome.developed, dome.developed[1:]):
        v = np.linspace(*ends, n)
        x, y = place[:, :, None] + normal[:, :, None] * v
        points = dome.lift(x.ravel(), y.ravel()).reshape(len(u), n, 3)
        faces.append(_spline_face((u, v), points, (5, 5)))
    return faces


def _top(dome, loop):
    """The face within a loop of edges."""
    y = dome.dome_radius
    end = dome.dome_distance / 2 + y
    x = np.linspace(-end, end, 2 * math.ceil(min(200 * end / dome.saddle_length, 1000)) + 1)
    z = dome.depth * dome.height(x)[0]
    points = np.stack([np.column_stack([x, 0 * x + side, z]) for side in (-y, y)], 1)
    return _spline_face((x, np.array([-y, y])), points, (5, 1), loop)


def _spline_face(grid, points, degrees, loop=None):
    """A face through points (n, m, 3) at parameters `grid` ((n,), (m,)), within a loop of edges."""
    import gmsh
    from scipy.interpolate import make_interp_spline

    occ = gmsh.model.occ
    u = make_interp_spline(grid[0], points, degrees[0])
    v = make_interp_spline(grid[1], u.c.swapaxes(0, 1), degrees[1])
    control = [occ.addPoint(*place) for place in v.c.reshape(-1, 3)]
    (at_u, times_u), (at_v, times_v) = (np.unique(each.t, return_counts=True) for each in (u, v))
    loops = [] if loop is None else [loop]
    face = occ.addBSplineSurface(
        control, len(points), -1, *degrees, [], at_u, at_v, times_u, times_v, loops, True
    )
    occ.remove([(0, tag) for tag in control])
    return face


def _edge_at(dome, face, d):
    """That edge of a face whose middle is nearest to the distance d [mm] from the outline."""
    import gmsh

    def off(edge):
        low, high = gmsh.model.getParametrizationBounds(1, edge)
        x, y, _ = gmsh.model.getValue(1, edge, [(low[0] + high[0]) / 2])
        return abs(dome.plan(np.array([x]), np.array([y]))[0][0] - d)

    return min((tag for _, tag in gmsh.model.getBoundary([(2, face)], oriented=False)), key=off)


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
