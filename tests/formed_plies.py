"""Grids of plies that are formed in closed form."""

import numpy as np
import pyvista

from fabric_fenicsx.results.ply import SYMMETRIC
from fabric_fenicsx.sheet.specimen import specimen


def formed(
    place, nx=47, ny=27, length=235.0, width=135.0, *, full=False, angle=0.0, ranks=1, **pattern
):
    """Grid of a ply whose points x, y (n,) are formed to place(x, y) (n, 3), yarns a at `angle`
    [rad]; full: centred, not a quarter; written by `ranks`, which share no nodes."""
    x, cells, _ = specimen(length, width, nx, ny, **pattern)
    if full:
        x = x - [length / 2, width / 2, 0]
    u = place(x[:, 0], x[:, 1]) - x
    edges, moved = (np.moveaxis(p[cells[:, 1:]] - p[cells[:, :1]], 1, 2) for p in (x, x + u))
    F = moved @ np.linalg.inv(edges[:, :2])
    c, s = np.cos(angle), np.sin(angle)
    a, b = F @ [c, s], F @ [-s, c]
    la, lb = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
    values = {"log_eps_11": np.log(la), "log_eps_22": np.log(lb), "a": a, "b": b}
    values["shear_angle"] = np.arcsin((a * b).sum(1) / la / lb)
    values["strain_state"] = (1 + (lb <= 1) + 2 * (la <= 1)).astype(np.int32)
    part = np.arange(len(cells)) * ranks // len(cells)
    number = np.arange(len(x)) + part[:, None, None] * len(x)
    number = number[np.arange(len(cells))[:, None], 0, cells]
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: number}, np.tile(x, (ranks, 1)))
    if ranks > 1:  # as places computed by each
        grid.points += 1e-12 * np.random.default_rng(1).uniform(-1, 1, grid.points.shape)
    grid.point_data["u"] = np.tile(u, (ranks, 1))
    for name, across in zip("ab", ([-s, c], [c, s])):
        grid.point_data[f"yarn_coordinate_{name}"] = grid.points[:, :2] @ across
    grid.cell_data.update(values)
    grid.field_data[SYMMETRIC] = [] if full else [0, 1]
    return grid


def plane(*rows):
    """place(x, y) of a homogeneous deformation in the plane, with gradient `rows`."""
    return lambda x, y: np.column_stack([np.column_stack([x, y]) @ np.array(rows).T, 0 * x])


SHEARED = plane((1.02, 0.3), (0, 0.9))

HALVES = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 1, 0.0]])  # of 6 and 2 mm2


def halves(u=0.0, **fields):
    """Two triangles along the diagonal of four corners."""
    triangles = {pyvista.CellType.TRIANGLE: np.array([[0, 1, 2], [0, 2, 3]])}
    grid = pyvista.UnstructuredGrid(triangles, HALVES)
    grid.point_data["u"] = u + 0 * HALVES
    grid.cell_data.update(fields)
    return grid
