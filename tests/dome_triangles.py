"""Triangles of the double dome, finer on its roundings, as a program of CAD exports them."""

import math

import numpy as np

from fabric_fenicsx.meshes.gmsh_cells import meshed, own_model
from fabric_fenicsx.tools.double_dome import DoubleDome


def double_dome(dome=None, size=10.0, turn=10.0):
    """Points (n, 3) [mm] on the surface and triangles (m, 3), seen from above anticlockwise, with a
    flange of 520 x 320 mm.

    size: of the edges where the surface is flat [mm]; turn: of the normal along an edge on
    roundings and fillets [deg].
    """
    points, triangles = _quarter(dome or DoubleDome(), 260.0, 160.0, size, math.radians(turn))
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
    sides = [(x, each) for each in up] + [(each, y) for each in along[-2::-1]]
    outline = np.array(sides)
    outline = outline + (dome.developed[-1] - dome.roundings[1]) * dome.plan(*outline.T)[1].T

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
