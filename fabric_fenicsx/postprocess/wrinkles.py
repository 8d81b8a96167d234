"""Wrinkles of a formed ply: how far it is off the smooth surface through it, where no tool is."""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import sparse
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from .ply import SYMMETRIC, Grid, areas, grid_of, plan_area, ply_of, whole
from .shape import outline

HEIGHT = "wrinkle_height"
# of Gaussian weights [mm]: waves up to about three times as long are seen nearly in full
SIGMA = 20.0
STEP = 5.0  # mm between places that it is fitted to
CUT = 3.5  # of these, beyond which places have no weight
MIN_HEIGHT = 0.1  # mm, the height from which on waves are told of
MIN_RIDGE = 0.3  # mm by which a ridge of the rim stands out
Heights = Callable[[np.ndarray], np.ndarray]


def height_map(grid: Grid, over_tools: Heights) -> Grid:
    """The ply in a grid with the height of its wrinkles at the nodes, `HEIGHT` [mm]: the distance,
    with a sign, from the parabola that fits the ply around a node best, with Gaussian weights
    (`SIGMA`), less its mean along the way on which that is shortened most, which is shape. It
    counts as far as the ply is off tools. over_tools: function of formed places (n, 3) [mm] to the
    distance (n,) [mm] of the ply's faces from the nearest tool."""
    ply = ply_of(grid)
    w = _waves(ply)
    free = np.clip(np.nan_to_num(over_tools(ply.formed), nan=np.inf), 0.0, None)
    heights = grid_of(ply.x, ply.triangles, ply.u)
    heights.point_data[HEIGHT] = np.sign(w) * np.minimum(abs(w), free)
    if ply.planes:
        heights.field_data[SYMMETRIC] = ply.planes
    return heights


def wrinkles(heights: Grid) -> dict[str, Any]:
    """Numbers of the wrinkles of a ply by its `height_map`. Its wavelength is 2 pi times the r.m.s.
    height over that of its slope; rim_mm: height of the outer free edge, whose ridges that stand
    out by `MIN_RIDGE` are `folds`."""
    ply, w = ply_of(heights), heights.point_data[HEIGHT]
    area = plan_area(ply.x, ply.triangles)
    of_nodes = np.bincount(ply.triangles.ravel(), np.repeat(area / 3, 3), len(w))
    rms = float(np.sqrt(np.average(w**2, weights=of_nodes)))
    slope = float(np.sqrt(np.average((_slopes(ply, w) ** 2).sum(1), weights=area)))
    largest = float(abs(w).max())
    length = 2 * np.pi * rms / slope if largest >= MIN_HEIGHT else None
    corners = ply.x[ply.triangles]
    edge = np.linalg.norm(corners - np.roll(corners, 1, 1), axis=2).mean()
    rim = max((each.formed[:, 2] for each in outline(heights)), key=len)
    return {
        "height_mm": largest,
        "height_rms_mm": rms,
        "wavelength_mm": length,
        "cells_a_wave": None if length is None else float(length / edge),
        "rim_mm": float(np.ptp(rim)),
        "folds": _ridges(rim, len(ply.planes)),
    }


def _waves(ply):
    """Heights (n,) of the nodes, but for tools [mm]."""
    w, tangents = _off_smooth(ply)
    metric = tangents @ tangents.swapaxes(1, 2)
    # twice the angle of the way; 1 where it is clear, 0 where all ways are shortened alike
    double = np.stack([metric[:, 1, 1] - metric[:, 0, 0], -2 * metric[:, 0, 1]])
    apart = np.hypot(*double)
    # difference of squared stretches, from which on one way is shortened most
    double *= apart / (apart**2 + 0.005**2)
    sampled = _raster(ply, np.stack([*double, w]))
    start, sums, weights = np.hypot(*double), sampled(ply.x[:, :2])[2], np.ones(len(w))
    way = np.arctan2(double[1], double[0]) / 2
    for sign in (1.0, -1.0):
        at, ahead = ply.x[:, :2].copy(), sign * np.stack([np.cos(way), np.sin(way)], axis=1)
        weight = start.copy()
        for k in range(1, round(CUT * SIGMA / STEP) + 1):
            at += STEP * ahead
            for axis in ply.planes:  # the image's way is the way's image
                beyond = at[:, axis] < 0
                at[beyond, axis] *= -1
                ahead[beyond, axis] *= -1
            one, other, height, covered = sampled(at)
            angle = np.arctan2(other, one) / 2
            turned = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            along = (turned * ahead).sum(1)
            ahead = np.where(along < 0, -1.0, 1.0)[:, None] * turned
            weight *= np.hypot(one, other) * covered * along**2  # no jump where ways cross
            share = weight * np.exp(-((k * STEP / SIGMA) ** 2) / 2)
            sums += share * height
            weights += share
    return w - start * sums / weights


def _raster(ply, values):
    """Function of flat places (m, 2) to values (k, n) of the nodes there, joined smoothly, and the
    share of what is around that the ply covers, (k + 1, m)."""
    area = np.bincount(
        ply.triangles.ravel(), np.repeat(plan_area(ply.x, ply.triangles) / 3, 3), len(ply.x)
    )
    cell = max(STEP / 2, 0.7 * np.sqrt(area.mean()))
    low = np.where(np.isin([0, 1], ply.planes), 0.0, ply.x[:, :2].min(0) - 3 * cell)
    at = (ply.x[:, :2] - low) / cell
    shape = np.ceil(at.max(0)).astype(int) + 4
    corner, part = np.floor(at).astype(int), at % 1
    sums = np.zeros((len(values) + 1, *shape))
    for i in (0, 1):
        for j in (0, 1):
            share = area * abs(1 - i - part[:, 0]) * abs(1 - j - part[:, 1])
            for total, each in zip(sums, [*values, np.ones(len(at))]):
                np.add.at(total, (corner[:, 0] + i, corner[:, 1] + j), share * each)
    *smooth, covered = (gaussian_filter(each, 1.0, mode="mirror") for each in sums)
    fields = [each / np.maximum(covered, 1e-12) for each in smooth]
    fields.append(np.minimum(covered / cell**2, 1.0))

    def sampled(x):
        return [map_coordinates(each, ((x - low) / cell).T, order=1) for each in fields]

    return sampled


def _off_smooth(ply):
    """Distances (n,) of the nodes from their smooth surface, and tangents of that along both axes
    of the flat ply (n, 2, 3) [mm]."""
    at, means, count = ply.x[:, :2] / SIGMA, _means(whole(ply)), len(ply.x)
    X, x, weight = means[:, :2] / SIGMA, means[:, 2:5], means[:, 5]
    near = cKDTree(at).sparse_distance_matrix(cKDTree(X), CUT, output_type="coo_matrix")
    # 0 at the cut, or rounding decides what counts
    weights = np.exp(-(near.data**2) / 2) * (1 - (near.data / CUT) ** 2) * weight[near.col]
    W = sparse.csr_matrix((weights, (near.row, near.col)), shape=near.shape)
    basis = _quadratic(X)
    A = (W @ (basis[:, :, None] * basis[:, None]).reshape(-1, 36)).reshape(count, 6, 6)
    b = (W @ (basis[:, :, None] * x[:, None]).reshape(-1, 18)).reshape(count, 6, 3)
    # of coordinates from each node on, in which few places beside it leave some terms free
    shift = _shifted(-at)
    A = shift @ A @ shift.swapaxes(1, 2)
    fitted = np.linalg.pinv(A, rcond=1e-6, hermitian=True) @ (shift @ b)
    normal = np.cross(fitted[:, 1], fitted[:, 2])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    return ((ply.formed - fitted[:, 0]) * normal).sum(1), fitted[:, 1:3]


def _shifted(d):
    """Matrices (n, 6, 6) from `_quadratic` of places to that of places + d (n, 2)."""
    matrix = np.zeros((len(d), 6, 6))
    s, t = d.T
    matrix[:, range(6), range(6)] = 1.0
    matrix[:, 1, 0], matrix[:, 2, 0] = s, t
    matrix[:, 3, 0], matrix[:, 3, 1] = s * s, 2 * s
    matrix[:, 4, 0], matrix[:, 4, 1], matrix[:, 4, 2] = s * t, t, s
    matrix[:, 5, 0], matrix[:, 5, 2] = t * t, 2 * t
    return matrix


def _quadratic(X):
    """1, s, t, s^2, s t, t^2 of places X (n, 2), (n, 6)."""
    s, t = X.T
    return np.stack([np.ones_like(s), s, t, s * s, s * t, t * t], axis=1)


def _means(ply):
    """Mean flat place, formed place and area of squares of `STEP`, (k, 6): finer nodes cost much
    and tell nothing of a smooth surface."""
    n = len(ply.x)
    corners = areas(ply.x[ply.triangles])
    area = np.bincount(ply.triangles.ravel(), np.repeat(corners / 3, 3), n)
    middle = (ply.x[:, :2].min(0) + ply.x[:, :2].max(0)) / 2
    # of a square, so that nodes of even meshes do not lie on its sides
    square = np.floor((ply.x[:, :2] - middle) / STEP + 0.3819)
    squares = np.unique(square, axis=0, return_inverse=True)[1].ravel()
    values = np.column_stack([ply.x[:, :2], ply.formed, np.ones(n)]) * area[:, None]
    sums = np.stack([np.bincount(squares, each) for each in values.T], axis=1)
    return np.column_stack([sums[:, :5] / sums[:, 5:], sums[:, 5]])


def _slopes(ply, w):
    """Gradients (m, 2) of values w (n,) at the nodes over the flat triangles."""
    p, q, r = ply.x[ply.triangles, :2].swapaxes(0, 1)
    values = w[ply.triangles]
    sides = np.stack([q - p, r - p], 1)
    return np.linalg.solve(sides, (values[:, 1:] - values[:, :1])[..., None])[..., 0]


def _ridges(z, planes):
    """Number of ridges of a rim's profile z (n,), mirrored in planes of symmetry."""
    for _ in range(planes):
        z = np.concatenate([z, z[::-1]])
    if np.ptp(z) < MIN_RIDGE:
        return 0
    from scipy.signal import find_peaks  # takes long to import

    peaks, _ = find_peaks(np.tile(z, 3), prominence=MIN_RIDGE, plateau_size=1)
    return int(((peaks >= len(z)) & (peaks < 2 * len(z))).sum())
