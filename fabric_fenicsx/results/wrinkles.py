"""Wrinkles of a formed ply: waves, as opposed to shape, which bends one way."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import lazy_loader
import numpy as np
from scipy import ndimage
from scipy.linalg import toeplitz

from .ply import Grid, grid_of, mark_planes, plan_area, ply_of, whole
from .shape import outline

pyvista = lazy_loader.load("pyvista")
# of heights as a grid: fields of nodes, and the shortest and the longest wave, field data [mm]
HEIGHT, LENGTH, RIPPLE, SEEN = "wrinkle_height", "wavelength", "ripple_height", "seen_wavelengths"
MIN_HEIGHT = 0.1  # mm, the height from which on waves are reported
MIN_RIDGE = 0.3  # mm by which a ridge of the rim stands out
MIN_CELLS_SEEN = 4.0  # cells of the shortest wave that a mesh can make
# Of bands of wavelengths: ratio of one to the next, places sampled of each, and directions
RATIO, PLACES, WAYS = 1.44, 8, 6
# Standard deviations over the wavelength of a band: what smooths noise, shape, across, normals
FINE, COARSE, ACROSS, NORMAL = 0.1, 0.68, 0.2, 0.3
REACH = 0.75  # of a wavelength, in which a wave turns to both sides
CUT = 3.5  # standard deviations beyond which places have no weight
Heights = Callable[[np.ndarray], np.ndarray]


def height_map(grid: Grid, over_tools: Heights, shortest: float = 0.0) -> Grid:
    """The ply in a grid with the height of its wrinkles at the nodes, `HEIGHT` [mm], with a sign,
    their wavelengths on the flat ply, `LENGTH` [mm], and the heights of waves that are shorter than
    `shortest` [mm], or than cells can make, `RIPPLE` [mm]. Heights count as far as the ply is off
    tools. over_tools: function of formed places (n, 3) [mm] to the distance (n,) [mm] of the ply's
    faces from the nearest tool."""
    ply = ply_of(grid)
    free = np.clip(np.nan_to_num(over_tools(ply.formed), nan=np.inf), 0.0, None)
    shortest = max(shortest, MIN_CELLS_SEEN * _edge(ply))
    longest = np.ptp(whole(ply).x, axis=0).max() / 3  # longer ones are not told from shape
    heights = grid_of(ply.x, ply.cells, ply.u)
    w, lengths = _waves(ply, _edge(ply), longest)
    for name, low, high in ((RIPPLE, 0.0, min(shortest, longest)), (HEIGHT, shortest, longest)):
        of_kind = w * ((lengths >= low) & (lengths < high))
        best = abs(of_kind).argmax(0), np.arange(len(ply.x))
        heights.point_data[name] = np.clip(of_kind[best], -free, free)
    heights.point_data[LENGTH] = lengths[best]
    heights.field_data[SEEN] = [shortest, longest]
    mark_planes(heights, ply.planes)
    return heights


def wrinkles(heights: Grid) -> dict[str, Any]:
    """Numbers of the wrinkles of a ply by its `height_map`. The wavelength is a mean with the
    squares of heights as weights; ripples_mm: largest height of waves that are none; rim_mm: height
    of the outer free edge, whose ridges that stand out by `MIN_RIDGE` are `folds`."""
    ply, w = ply_of(heights), heights.point_data[HEIGHT]
    thirds = np.repeat(plan_area(ply.x, ply.cells) / 3, 3)
    of_nodes = np.bincount(ply.cells.ravel(), thirds, len(w))
    largest, length = float(abs(w).max()), None
    if largest >= MIN_HEIGHT:
        length = float(np.average(heights.point_data[LENGTH], weights=of_nodes * w**2))
    rim = max((line.formed[:, 2] for line in outline(heights)), key=len)
    return {
        "height_mm": largest,
        "height_rms_mm": float(np.sqrt(np.average(w**2, weights=of_nodes))),
        "wavelength_mm": length,
        "cells_a_wave": None if length is None else float(length / _edge(ply)),
        "ripples_mm": float(abs(heights.point_data[RIPPLE]).max()),
        "seen_mm": [float(length) for length in heights.field_data[SEEN]],
        "rim_mm": float(np.ptp(rim)),
        "folds": _ridges(rim, len(ply.planes)),
    }


def _edge(ply):
    corners = ply.x[ply.cells]
    return float(np.linalg.norm(corners - np.roll(corners, 1, 1), axis=2).mean())


def _waves(ply, edge, longest):
    """Heights, 0 where there is none, and lengths (k, n) [mm] of waves at the nodes, from two edges
    of cells on, in k combinations of direction and band."""
    full = whole(ply)
    flat = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: full.cells}, full.x * [1, 1, 0])
    flat.point_data["formed"] = full.formed
    count = np.ceil(np.log(max(longest / edge / 2, 1)) / np.log(RATIO))
    bands = 2 * edge * RATIO ** np.arange(count + 2)  # the last for waves that are too long
    steps = np.clip(bands / PLACES, edge / 2, 0.9 * edge)  # coarser ones mistake ripples for waves
    at, spacing = ply.x[:, :2], np.sqrt(flat.area / flat.n_points)
    waves = []
    for angle in np.arange(WAYS) * np.pi / WAYS:
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s], [s, c]])  # of flat places, to along and across the direction
        sampled = _sampled(flat, at @ turn, turn, bands, steps)
        waves.append([_along(at @ turn, spacing, *band) for band in zip(bands, steps, *sampled)])
    w, energy, length = np.array(waves).transpose(2, 0, 1, 3)
    beside = np.pad(energy, ((0, 0), (1, 1), (0, 0)))
    others = np.roll(energy, 1, 0), np.roll(energy, -1, 0), beside[:, :-2], beside[:, 2:]
    strongest = (energy > 0) & (energy >= np.max(others, axis=0))  # not seen from aside, or in part
    return (w * strongest).reshape(-1, len(ply.x)), length.reshape(-1, len(ply.x))


def _along(nodes, spacing, band, step, low, on, x):
    """Height, energy and length (3, n) at flat `nodes` (n, 2), turned, of waves about `band` long
    [mm], from places as of `_sampled`; spacing: of the ply's nodes [mm]."""
    wave = band / step  # places a wave
    fine, coarse, quarter = FINE * wave, COARSE * wave, wave / 4
    inside, between = ndimage.minimum_filter(on, 3), ndimage.minimum_filter1d(on, 3, 0)
    along, across = (np.gradient(x, step, axis=axis) for axis in (0, 1))
    normal = _mean(np.cross(along, across), inside, NORMAL * wave, NORMAL * wave)
    normal /= np.maximum(np.linalg.norm(normal, axis=2), 1e-300)[..., None]
    bend = _mean((_turn(x) * normal).sum(2), between, fine, 0) * on
    even = _fitted(x.swapaxes(0, 1), on.T, ACROSS * wave).swapaxes(0, 1)
    z = ((_fitted(even, on, fine) - _fitted(even, on, coarse)) * normal).sum(2)
    z -= _fitted(z[..., None], on, coarse)[..., 0]  # what is left of the shape
    climb = np.gradient(z, step, axis=0)  # slope of the wave, which may lengthen it
    stretches = (along**2).sum(2) - climb**2 - (across**2).sum(2)
    longer = _mean(stretches, inside, quarter, quarter)
    squares = _mean(np.dstack([_turn(z), z]) ** 2, between, quarter, quarter)
    turned = np.sqrt(np.divide(*np.maximum(np.moveaxis(squares, 2, 0), 1e-30)))
    phase = np.arccos(np.clip(1 - turned / 2, -1, 0.99))  # from place to place
    shape = _passed(phase, coarse)
    apart = spacing / step  # places from node to node, between straight
    alternates = np.where(z > 0, _alternates(bend, wave), _alternates(-bend, wave)) * (z * bend < 0)
    # that much of both sides must be on the ply
    around = 2 * round(REACH * wave) + 1
    alternates *= ndimage.uniform_filter1d(on, around, 0, mode="constant") > 0.7
    energy = _mean((z * alternates) ** 2, on, quarter, quarter)
    left_over = (_passed(phase, fine) - shape) * (1 - shape)
    left_over *= np.sinc(apart * phase / 2 / np.pi) ** 2
    z *= alternates / np.maximum(left_over, 0.8)
    longer = ndimage.maximum_filter1d(longer, around, 0)  # or where it turns back
    nearest = ndimage.distance_transform_edt(on == 0, return_distances=False, return_indices=True)
    at = ((nodes - low) / step).T
    # waves along stretches, squared, that are so much longer than across, are shape
    values = z * (longer < 0.05), energy, 2 * np.pi * step / phase
    return [ndimage.map_coordinates(each[tuple(nearest)], at, order=1) for each in values]


def _sampled(flat, nodes, turn, bands, steps):
    """The ply at places around `nodes` that are turned, for each of `bands` and `steps` [mm]: the
    first along and across, whether the ply is there, 1 or 0 (p, q), and where it is formed to
    (p, q, 3). Places of all bands are found at once, as VTK sorts the cells each time."""
    lows, counts, places = [], [], []
    for band, step in zip(bands, steps):
        ends = [(flat.points[:, :2] @ turn, 1.382 * step), (nodes, CUT * COARSE * band)]
        # no row on a straight edge
        low = np.max([x.min(0) - beyond for x, beyond in ends], axis=0)
        high = np.min([x.max(0) + beyond for x, beyond in ends], axis=0)
        lows.append(low)
        counts.append(((high - low) / step).astype(int) + 2)
        places.append((low + step * np.indices(counts[-1]).reshape(2, -1).T) @ turn.T)
    sampled = pyvista.PolyData(np.pad(np.vstack(places), ((0, 0), (0, 1)))).sample(flat)
    starts = np.cumsum([len(at) for at in places])[:-1]
    on, x = (
        [part.reshape(*n, *part.shape[1:]) for part, n in zip(np.split(field, starts), counts)]
        for field in (np.asarray(sampled[k], float) for k in ("vtkValidPointMask", "formed"))
    )
    return lows, on, x


def _turn(x):
    turn = np.zeros_like(x)
    turn[1:-1] = x[2:] - 2 * x[1:-1] + x[:-2]
    return turn


def _mean(values, weights, *sigma):
    """Gaussian means with `weights` (p, q); sigma: along and across [places]."""
    n, m = weights.shape
    along, across = _gaussian(n, sigma[0]), _gaussian(m, sigma[1])
    parts = np.dstack([values * weights.reshape(n, m, *[1] * (values.ndim - 2)), weights])
    sums = across @ (along @ parts.reshape(n, -1)).reshape(n, m, -1)
    return (sums[..., :-1] / np.maximum(sums[..., -1:], 1e-9)).reshape(values.shape)


def _fitted(values, weights, sigma):
    """Parabolas along the first axis that fit the values (p, q, k) around each place best, with
    Gaussian weights of `sigma` [places] and `weights` (p, q): their values there."""
    moments = _moments(len(weights), sigma)
    a, b, c, d, e = moments @ weights
    c_, e = c + 1e-6 * a, e + 1e-6 * a  # of few places
    share = np.array([c_ * e - d * d, c * d - b * e, b * d - c * c_])
    share /= np.maximum(a * share[0] + b * share[1] + c * share[2], 1e-30)
    sums = moments[:3] @ (values * weights[..., None]).reshape(len(weights), -1)
    return (share[..., None] * sums.reshape(3, *values.shape)).sum(0)


@lru_cache(8)
def _gaussian(n, sigma):
    return ndimage.gaussian_filter1d(np.eye(n), sigma, 0) if sigma else np.eye(n)


@lru_cache(8)
def _moments(n, sigma):
    """Matrices (5, n, n) of sums over n places, times powers of the way to each, over `sigma`."""
    s = np.arange(n) / sigma
    near = np.exp(-s * s / 2) * (s * sigma <= np.ceil(CUT * sigma))
    return np.array(
        [toeplitz((-1) ** power * near * s**power, near * s**power) for power in range(5)]
    )


def _passed(phase, sigma):
    """Share of a wave of `phase` [rad] a place that `_fitted` with `sigma` lets pass."""
    q = (phase * sigma) ** 2 / 2
    return np.exp(-q) * (1 + q)


def _alternates(bend, wave):
    """Share with which a crest counts: 0 where `bend` on one of its sides has less than a tenth of
    the crest's the other way, 1 from a fifth on."""
    half, highest = round(REACH * wave / 2), ndimage.maximum_filter1d
    sides = [highest(bend, 2 * half + 1, 0, mode="constant", origin=o) for o in (half, -half)]
    three = np.stack([*sides, highest(-bend, 2 * round(wave / 4) + 1, 0)])
    share = three.min(0) / np.maximum(three.max(0), 1e-12)
    return np.clip((share - 0.1) / 0.1, 0, 1)


def _ridges(z, planes):
    """Number of ridges of a rim's profile z (n,), mirrored in planes of symmetry."""
    for _ in range(planes):
        z = np.concatenate([z, z[::-1]])
    low = high = z.min()
    ridges, rises = 0, False
    for height in np.roll(z, -z.argmin()).tolist() + [low]:
        low, high = min(low, height), max(high, height)
        if rises and high - height >= MIN_RIDGE:
            ridges, rises, low = ridges + 1, False, height
        elif not rises and height - low >= MIN_RIDGE:
            rises, high = True, height
    return ridges
