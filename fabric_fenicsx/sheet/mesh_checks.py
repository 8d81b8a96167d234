"""Checks of a mesh, without which its results mean nothing: of plain arrays, in NumPy and SciPy."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..core.errors import InputError
from ..core.graph import connected
from .cells import CELLS, at_place, bad_shape, one_sense


class MeshArrays(NamedTuple):
    """A mesh fit for use: points (n, 2 or 3) [mm], cells (m, k), their kind, and warnings."""

    points: np.ndarray
    cells: np.ndarray
    kind: str
    warnings: list[str]


def checked_mesh(
    points: np.ndarray, cells: np.ndarray, kind: str, source: str, spatial: bool = False
) -> MeshArrays:
    """The mesh with only the nodes that are in use, in R^2 if it is plane in z and not `spatial`.

    points (n, 2 or 3) [mm]; cells (m, k) of a kind of `CELLS`, in gmsh's order; source: what errors
    call the mesh. Cells of a plane mesh that are turned over are turned, and warned of, as are
    slits. Raises InputError, with number and place, for what no sheet has.
    """
    if flaw := _flaw(points, cells, kind):
        raise InputError(f"{source} {flaw}")
    how = CELLS[kind]
    used, numbers = np.unique(cells, return_inverse=True)
    points, cells = points[used], numbers.reshape(cells.shape)
    height, plane, warnings, x = 0.0, points.shape[1] == 2, list[str](), points
    # extent in z over the sheet's below which it is plane: files have singles
    if not plane and np.ptp(points[:, 2]) <= 1e-7 * np.ptp(points, axis=0).max():
        height, plane = np.median(points[:, 2]), True
    if plane:
        x = np.column_stack([points[:, :2], np.full(len(points), height)])
        cells, warnings = one_sense(x, cells, how, source)
    edges = _Edges(x, cells, how)
    flaw = bad_shape(x, cells, how, source) or _torn(x, edges, source)
    if flaw := flaw or _hanging(x, edges, used, how, source):
        raise InputError(flaw)
    warnings += _slits(x, edges, source)
    return MeshArrays(x[:, :2] if plane and not spatial else x, cells, kind, warnings)


def _flaw(points, cells, kind):
    """What makes arrays no mesh, and what is allowed; else ""."""
    if kind not in CELLS:
        return f"holds cells of kind {kind}; allowed are {sorted(CELLS)}"
    if len(cells) == 0:
        return "is empty: it holds 0 cells; allowed is 1 or more"
    if cells.shape[1:] != (nodes := len(CELLS[kind].nodes),):
        return f"has cells of {cells.shape[1:]} nodes; allowed are {nodes} for a {kind}"
    outside = np.flatnonzero((cells < 0).any(1) | (cells >= len(points)).any(1))
    if outside.size:
        cell, last = f"a cell, number {outside[0]},", len(points) - 1
        return f"has {cell} with nodes {cells[outside[0]].tolist()}; allowed are 0 to {last}"
    if (bad := cells[~np.isfinite(points[cells]).all(2)]).size:
        return f"has a coordinate that is not a number at node {bad.min()}; allowed are lengths"
    return ""


class _Edges:
    """Edges of a mesh: sides (m,) of its cells, those of one edge beside each other; their `ends`
    (m, 2) by nodes, cells (m,), and numbers `shared` (m,) of cells at their edges."""

    def __init__(self, x, cells, how):
        corners = cells[:, : how.corners]
        n, k = corners.shape
        ends = np.stack([corners, np.roll(corners, -1, 1)], -1).reshape(-1, 2)
        key = ends.min(1).astype(np.int64) * len(x) + ends.max(1)
        _, edge, count = np.unique(key, return_inverse=True, return_counts=True)
        sides = np.argsort(edge, kind="stable")
        self.ends, self.cells, self.shared = ends[sides], sides // k, count[edge[sides]]
        # middle nodes of quadratic cells' edges stand behind the corners, in the order of the edges
        self.middles = cells[:, k : 2 * k].ravel()[sides] if how.degree == 2 else None
        self.count, self.centres = n, x[corners].mean(1)

    def rim(self):
        """Straight edges (m, 2) by nodes on the sheet's rim, and their cells (m,)."""
        single = self.shared == 1
        ends, cells = self.ends[single], self.cells[single]
        if self.middles is None:
            return ends, cells
        halves = np.insert(ends, 1, self.middles[single], axis=1)
        return np.vstack([halves[:, :2], halves[:, 1:]]), np.tile(cells, 2)


def _torn(x, edges, source):
    """Why cells make no sheet, and what is allowed; else ""."""
    if (many := edges.shared > 2).any():
        first = many.argmax()
        cells = edges.cells[first : first + edges.shared[first]].tolist()
        return (
            f"{source} has an edge {at_place(x[edges.ends[first]].mean(0))} that {len(cells)} "
            f"cells share, numbers {str(cells)[1:-1]}; allowed are 2 cells or, at the rim, 1"
        )
    parts, part = connected(edges.count, edges.cells[edges.shared == 2].reshape(-1, 2).T)
    if parts > 1:
        one, other = (
            f"one with cell {k} {at_place(edges.centres[k])}"
            for k in (0, (part != part[0]).argmax())
        )
        return (
            f"{source} falls into {parts} parts that share no edge, {one}, {other}; allowed is one "
            "sheet, whose cells share nodes where they meet"
        )
    return ""


def _hanging(x, edges, numbers, how, source):
    """Why cells do not meet at whole edges, and what is allowed; else "". numbers: (n,) of points
    in the file."""
    ends, cells = edges.rim()
    # distance from an edge, over its length, of a node that lies on it; curved edges are cut
    nodes, near = np.unique(ends), {1: 1e-3, 2: 3e-2}[how.degree]
    if not len(nodes):  # a closed sheet
        return ""
    p, q = x[ends].swapaxes(0, 1)
    length = np.linalg.norm(q - p, axis=1)
    beside = cKDTree(x[nodes]).query_ball_point((p + q) / 2, (0.5 + near) * length)
    edge = np.repeat(np.arange(len(ends)), [len(each) for each in beside])
    node = nodes[np.concatenate([*beside, []]).astype(int)]
    # both over the edge's length; its own nodes are at 0 and 1
    arm = (x[node] - p[edge]) / length[edge, None]
    along = (q - p)[edge] / length[edge, None]
    at = (arm * along).sum(1)
    off = np.linalg.norm(arm - at[:, None] * along, axis=1)
    hits = np.flatnonzero((at > near) & (at < 1 - near) & (off < near))
    if not hits.size:
        return ""
    first = node[hits[0]]
    return (
        f"{source} has a hanging node, number {numbers[first]} {at_place(x[first])}: it lies on an "
        f"edge of cell {cells[edge[hits[0]]]}, which does not have it; allowed are cells that meet "
        "at whole edges"
    )


def _slits(x, edges, source):
    """A sentence if nodes of the rim lie where others do, in a list."""
    ends, _ = edges.rim()
    if not ends.size:
        return []
    # distance of nodes at one place, over the mean edge at the sheet's rim
    near = 1e-6 * np.linalg.norm(x[ends[:, 0]] - x[ends[:, 1]], axis=1).mean()
    x = x[np.unique(ends)]
    pairs = cKDTree(x).query_pairs(near, output_type="ndarray")
    return [
        f"{source} has {len(pairs)} nodes where another one lies, the first {at_place(x[first])}: "
        "the sheet is open there, a slit; merge these nodes if it should be whole"
        for first in np.unique(pairs)[:1]
    ]
