"""Results of an explicit code, OpenRadioss, beside ours of the same problems: force, shear, places
of nodes. The files are described in studies/reference/openradioss/README.md."""

import math
from pathlib import Path

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

# stroke [mm] from which forces are compared: before, the explicit ones scatter, and inertia counts
FROM_STROKE = 30.0


def curve(file: Path) -> np.ndarray:
    """Displacement [mm] and reaction or force of the punch on the quarter [N] in OpenRadioss,
    (2, n)."""
    return np.loadtxt(file, delimiter=",", skiprows=1, usecols=(0, 1)).T


def formed_places(folder: Path, angle: int, flat: np.ndarray) -> np.ndarray:
    """Where OpenRadioss has the points `flat` (n, 2) of the flat ply after 60 mm, (n, 3) [mm]:
    linear between its nodes; angle of yarns a: 0 or 45 [deg]."""
    table = np.loadtxt(folder / f"double_dome_{angle}_nodes.csv", delimiter=",", skiprows=1)
    at, formed = table[:, :2], table[:, 2:]
    found = LinearNDInterpolator(at, formed)(flat)
    outside = np.isnan(found[:, 0])  # by rounding, on the edge
    found[outside] = NearestNDInterpolator(at, formed)(flat[outside])
    return found


def shear_angles(flat: np.ndarray, formed: np.ndarray, angle: float) -> np.ndarray:
    """Magnitude of the shear angle [deg] of triangles, (n,), with corners `flat` (n, 3, 2) and
    `formed` (n, 3, 3) [mm] and yarns at `angle` and `angle` + 90 [deg]."""
    edges, moved = flat[:, 1:] - flat[:, :1], formed[:, 1:] - formed[:, :1]
    a = math.radians(angle)
    yarns = np.array([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]])
    # a yarn as a sum of two edges, and the same sum of the formed edges
    parts = np.linalg.solve(np.swapaxes(edges, 1, 2), np.broadcast_to(yarns.T, (len(flat), 2, 2)))
    first, second = np.moveaxis(np.swapaxes(parts, 1, 2) @ moved, 1, 0)
    lengths = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    return np.degrees(np.abs(np.arcsin((first * second).sum(1) / lengths)))


def compare_formed(folder, angle, grid, rows):
    """How a formed ply and OpenRadioss' differ, with what is compared {name: number}; angle of
    yarns a: 0 or 45, grid: the last state, of linear triangles, rows: of its history."""
    flat = np.asarray(grid.points)[:, :2]
    mine = np.asarray(grid.points) + grid.point_data["u"]
    theirs = formed_places(folder, angle, flat)
    apart = np.linalg.norm(mine - theirs, axis=1)
    corners = grid.cells.reshape(grid.n_cells, -1)[:, 1:4]
    shear = [shear_angles(flat[corners], x[corners], angle) for x in (mine, theirs)]
    stroke, force = curve(folder / f"double_dome_{angle}_force.csv")
    mean = np.interp(stroke, [r["displacement_mm"] for r in rows], [r["reaction_N"] for r in rows])
    off = (mean - force)[stroke >= FROM_STROKE] / force.max()
    found = {"nodes_apart_rms_mm": float(np.sqrt(np.mean(apart**2)))}
    for whose, angles, of in (("", shear[0], mean), ("_openradioss", shear[1], force)):
        found[f"shear_angle_max{whose}_deg"] = float(angles.max())
        found[f"punch_force_50_mm{whose}_N"] = float(np.interp(50.0, stroke, of))
    return found | {"punch_force_apart_rms_relative": float(np.sqrt(np.mean(off**2)))}
