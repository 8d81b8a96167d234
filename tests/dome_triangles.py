"""Triangles of the double dome, finer on its roundings, as a program of CAD exports them."""

import math

import numpy as np

from fabric_fenicsx.surfaces.double_dome import DoubleDome


def double_dome(dome=None, size=10.0, turn=10.0):
    """Points (n, 3) [mm] on the surface and triangles (m, 3), seen from above anticlockwise, with a
    flange of 520 x 320 mm.

    size: of the edges where the surface is flat [mm]; turn: of the normal across roundings and
    fillets [deg].
    """
    dome = dome or DoubleDome()
    curves, turn = _curves(dome, size), math.radians(turn)
    steps = size, dome.top_radius * turn, size, dome.entry_radius * turn, size
    rows = [curves[:1]]
    for a, b, step in zip(curves, curves[1:], steps):
        count = math.ceil(np.linalg.norm(b - a, axis=1).max() / step)
        rows.append(a + np.linspace(0, 1, count + 1)[1:, None, None] * (b - a))
    p = np.vstack(rows)
    low, high, right, far = p[:-1, :-1], p[:-1, 1:], p[1:, :-1], p[1:, 1:]
    cells = np.array([[low, right, far], [low, far, high]])  # (2, 3, rows, columns, 2)
    cells = np.moveaxis(cells, 1, 3).reshape(-1, 3, 2)
    cells = cells[abs(np.cross(cells[:, 1] - cells[:, 0], cells[:, 2] - cells[:, 0])) > 1e-6]
    for mirror in ([-1, 1], [1, -1]):
        cells = np.vstack([cells, cells[:, ::-1] * mirror])
    _, first, triangles = np.unique(
        cells.reshape(-1, 2).round(6), axis=0, return_index=True, return_inverse=True
    )
    return dome.lift(*cells.reshape(-1, 2)[first].T), triangles.reshape(-1, 3)


def _curves(dome, size):
    """Lines of a quarter of the developed plan from the x to the y axis (6, n, 2): its axis, lines
    where the curvature jumps, so that no triangle lies across them, and the flange's rim. They are
    arcs about the dome and, beyond a line across, about the centre of the waist."""
    centre = np.array([dome.dome_distance / 2, 0.0])
    reach = -1 / dome.plan(np.zeros(1), np.array([dome.waist]))[2][0]
    middle = np.array([0.0, dome.waist + reach])  # of the waist's arc
    x, y = middle - centre
    end, begin = math.atan2(y, x), math.atan2(-y, -x)
    n, m = (math.ceil(a / size) for a in (end * dome.dome_radius, (begin + np.pi / 2) * reach))
    arcs = [np.linspace(0, end, n + 1), np.linspace(begin, -np.pi / 2, m + 1)[1:]]
    around, below = (np.column_stack([np.cos(a), np.sin(a)]) for a in arcs)
    along, up = np.linspace(1, 0, m + 1)[1:, None], np.linspace(0, 1, n + 1)[:, None]
    curves = [np.vstack([centre + 0 * around, centre * along])]
    for s in dome.developed:
        radius = dome.dome_radius + s
        curves.append(np.vstack([centre + radius * around, middle + (reach - s) * below]))
    # moved outwards by what the profile is longer
    rim = np.vstack([[260, 0] + [0, 160] * up, [0, 160] + [260, 0] * along])
    longer = dome.developed[-1] - dome.roundings[1]
    curves.append(rim + longer * dome.plan(*rim.T)[1].T)
    curves = np.array(curves)
    curves[:, 0, 1] = curves[:, -1, 0] = 0.0  # on the axes
    return curves
