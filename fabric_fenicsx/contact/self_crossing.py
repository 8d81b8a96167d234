"""Places where a sheet passes through itself or through another one."""

import numpy as np
from scipy.spatial import cKDTree

from ..core.formatting import coordinates
from ..sheet.blank import Blank, Part


def crossings(places: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Places (k, 3) where an edge of triangles (m, 3) of nodes at `places` (n, 3) passes through
    one of the others that it has no node in common with (Moeller and Trumbore, 1997)."""
    sides = triangles[:, [(0, 1), (1, 2), (2, 0)]].reshape(-1, 2)
    edges = np.unique(np.sort(sides, axis=1), axis=0)
    if not len(edges):
        return np.empty((0, 3))
    corners = places[triangles]
    centres, starts = corners.mean(1), places[edges[:, 0]]
    ways = places[edges[:, 1]] - starts
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max()
    radii = np.linalg.norm(ways, axis=1) / 2 + reach
    near = cKDTree(centres).query_ball_point(starts + ways / 2, radii)
    edge = np.repeat(np.arange(len(edges)), [len(found) for found in near])
    triangle = np.concatenate(near).astype(np.int64)
    apart = (edges[edge][:, :, None] != triangles[triangle][:, None]).all((1, 2))
    edge, triangle = edge[apart], triangle[apart]
    p, d = starts[edge], ways[edge]
    a, b, c = corners[triangle].swapaxes(0, 1)
    e, f = b - a, c - a
    across = np.cross(d, f)
    volume = _dot(e, across)
    # an edge and a triangle in a plane do not cross
    flat = 1e-6 * np.prod([np.linalg.norm(side, axis=1) for side in (d, e, f)], axis=0)
    at = np.flatnonzero(abs(volume) > flat)
    p, d, e, f, across, offset = (each[at] for each in (p, d, e, f, across, p - a))
    turned, scale = np.cross(offset, e), 1 / volume[at]
    u, v, t = scale * _dot(offset, across), scale * _dot(d, turned), scale * _dot(f, turned)
    through = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1)
    return (p + t[:, None] * d)[through]


def self_crossings(part: Part) -> np.ndarray:
    """Crossings of a sheet at its present displacement, its cells taken as flat triangles, on all
    ranks (k, 3) [mm]; none of a sheet in a plane."""
    blank, comm = part.blank, part.blank.mesh.comm
    if blank.mesh.geometry.dim < 3:
        return np.empty((0, 3))
    known = blank.triangles(part.cells).reshape(-1, 3).astype(np.int32)
    numbers = blank.V.dofmap.index_map.local_to_global(known.ravel())
    places = (blank.coordinates() + blank.nodal_displacement())[known.ravel()]
    gathered = comm.gather((numbers, places))
    if gathered is None:
        return comm.bcast(None)
    numbers, places = (np.concatenate(each) for each in zip(*gathered))
    _, first, node = np.unique(numbers, return_index=True, return_inverse=True)
    return comm.bcast(crossings(places[first], node.reshape(-1, 3)))


def crossing_warning(blank: Blank) -> str:
    """A warning if parts of a blank, as sheets of a stack, have passed through one another, which
    contact at points within cells lets corners do; otherwise ""."""
    parts = list(blank.parts.values())
    places = self_crossings(blank.whole)
    if not len(places) or len(parts) < 2 or any(len(self_crossings(part)) for part in parts):
        return ""
    return (
        f"{' and '.join(part.name for part in parts)} pass through one another at {len(places)} "
        f"places, as at {coordinates(places[0])} mm: contact acts at points within cells, so take "
        "smaller cells"
    )


def _dot(a, b):
    return (a * b).sum(1)
