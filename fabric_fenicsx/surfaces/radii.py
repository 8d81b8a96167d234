"""Least radii of a surface of triangles."""

import math

import numpy as np
from scipy.spatial import cKDTree

from .curved_triangles import CurvedTriangles
from .projection import curvatures


def least_radii(surface: CurvedTriangles, length: float = 0.0) -> tuple[float, float]:
    """Least radius of curvature [mm] as seen from inside the body and from outside; infinite where
    nothing bends to that side. Where patches turn to and fro within a `length` [mm], or two edges,
    as on slivers of scans, it is that of the facets' mean turning over it."""
    larger, smaller = curvatures(surface.patches)
    bent, area = np.maximum([larger, -smaller], 0.0), surface.areas
    inside, outside = (_least_radius(each, area, 0.99) for each in bent)
    arms = surface.corners - np.roll(surface.corners, 1, 1)
    edge = float(np.median(np.linalg.norm(arms, axis=2)))
    if min(inside, outside) < max(length, edge):
        # median edges, the least length over which turning has a mean
        mean = _mean_turning(surface, max(length, 2.0 * edge))
        share = np.full(mean.shape[1], area.sum() / mean.shape[1])
        # times as much as over a length, from which turning is to and fro
        if (bent @ area).sum() > 1.3 * (mean @ share).sum():
            inside, outside = (_least_radius(each, share, 0.95) for each in mean)
    return inside, outside


def _least_radius(curvature, area, bent):
    """The radius than which a share `bent` of the turning has a larger one."""
    weight = area * curvature**2
    turns = curvature * np.sqrt(area) > 1e-4  # less is rounding
    if not turns.any():
        return math.inf
    curvature, weight = curvature[turns], weight[turns]
    order = np.argsort(curvature)
    share = np.cumsum(weight[order])
    return 1 / float(curvature[order[np.searchsorted(share, bent * share[-1])]])


def _mean_turning(surface, length):
    """Curvature (2, n) [1/mm], as seen from inside and from outside, at places spread over the
    surface: the turn at the edges within a `length`, over the area there (D. Cohen-Steiner, J.-M.
    Morvan, Restricted Delaunay triangulations and normal cycle, SoCG 2003)."""
    whole, random = surface.areas.sum(), np.random.default_rng(0)
    count, within = 2000, 25  # places that are asked for, and points in a circle of that length
    n = int(np.clip(within * whole / (math.pi * length**2), count, 60_000))
    length = max(length, math.sqrt(within * whole / (math.pi * n)))
    ends = np.cumsum(surface.areas)
    t = np.searchsorted(ends, (np.arange(n) + 0.5) / n * ends[-1])
    on = np.einsum("nc,nci->ni", random.dirichlet((1, 1, 1), n), surface.corners[t])
    normal = surface.facets[t]
    one, other, (foot, head) = surface.smooth_edges()
    step, facets = surface.points[head] - surface.points[foot], surface.facets
    size, turn = np.linalg.norm(step, axis=1), surface.turns()[1]
    rises = ((surface.middles[other] - surface.middles[one]) * facets[one]).sum(1) > 0
    weight = np.where(rises, -turn, turn) / size  # of the square of a piece along the edge
    pieces = np.ceil(2 * size / length).astype(int)
    of = np.repeat(np.arange(len(size)), pieces)
    along = (np.arange(len(of)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 0.5) / pieces[of]
    at = surface.points[foot][of] + along[:, None] * step[of]
    tensor = np.einsum("n,ni,nj->nij", weight / pieces, step, step)[of].reshape(-1, 9)
    seeds = np.linspace(0, n - 1, count).astype(int)

    def summed(places, normals, values):
        """Values (k, m) at places about the seeds, of facets that look to the same side."""
        neighbours = cKDTree(places).query_ball_point(on[seeds], length)
        row = np.repeat(np.arange(count), [len(each) for each in neighbours])
        near = np.concatenate(neighbours).astype(int)
        away = ((places[near] - on[seeds][row]) ** 2).sum(1) / length**2
        share = (1 - away) ** 2 * ((normals[near] * normal[seeds][row]).sum(1) > 0)
        return np.stack([np.bincount(row, share * v[near], count) for v in values.T], 1)

    area = summed(on, normal, np.full((n, 1), whole / n))
    bend = np.linalg.eigvalsh((summed(at, facets[one][of], tensor) / area).reshape(-1, 3, 3))
    return np.maximum([bend[:, 2], -bend[:, 0]], 0.0)
