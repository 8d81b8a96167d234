"""Checks of a mesh, without which its results mean nothing: of plain arrays, in NumPy and SciPy."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..runtime.errors import InputError
from ..runtime.graph import connected
from .cells import CELLS, at_place, check_shapes, one_sense


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
    height, plane = 0.0, points.shape[1] == 2
    # extent in z over the sheet's below which it is plane: files have singles
    if not plane and np.ptp(points[:, 2]) <= 1e-7 * np.ptp(points, axis=0).max():
        height, plane = np.median(points[:, 2]), True
    warnings: list[str] = []
    x = np.column_stack([points[:, :2], np.full(len(points), height)]) if plane else points
    if plane:
        cells, warnings = one_sense(x, cells, how, source)
    check_shapes(x, cells, how, source)
    warnings += _Neighbours(x, cells, used, how, source).check()
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
        return (
            f"has a cell, number {outside[0]}, with nodes {cells[outside[0]].tolist()}; allowed "
            f"are numbers from 0 to {len(points) - 1}"
        )
    if (bad := cells[~np.isfinite(points[cells]).all(2)]).size:
        flaw = f"has a coordinate that is not a number at node {bad.min()}"
        return f"{flaw}; allowed are finite lengths in mm"
    return ""


class _Neighbours:
    """Cells of a mesh beside each other. x: points (n, 3) [mm]; numbers: (n,) of these in the
    file."""

    def __init__(self, x, cells, numbers, how, source):
        self.x, self.cells, self.numbers = x, cells, numbers
        self.how, self.source = how, source
        corners = cells[:, : how.corners]
        n, k = corners.shape
        ends = np.stack([corners, np.roll(corners, -1, 1)], -1).reshape(-1, 2)
        key = ends.min(1).astype(np.int64) * len(x) + ends.max(1)
        order = np.argsort(key, kind="stable")
        start = np.flatnonzero(np.diff(key[order], prepend=-1))
        count = np.diff(start, append=len(key))
        self.ends, self.order, self.start, self.count = ends, order, start, count
        inner = start[count == 2]
        # the two entries of `ends` (m, 2) of each edge between two cells
        self.pairs = np.column_stack([order[inner], order[inner + 1]])
        self.of_cell = np.repeat(np.arange(n), k)
        # middle nodes of quadratic cells' edges stand behind the corners, in the order of the edges
        self.middles = cells[:, k : 2 * k].ravel() if how.degree == 2 else None
        self.centres = x[corners].mean(1)

    def check(self):
        """Warnings, a sentence each; raises InputError for what no sheet has."""
        self._crowded()
        self._sheets()
        rim = self._rim()
        if not len(rim[0]):  # a closed sheet
            return []
        self._hanging(*rim)
        return self._slits(rim[0])

    def _cell(self, number):
        return f"cell {number} {at_place(self.centres[number])}"

    def _node(self, number):
        return f"{self.numbers[number]} {at_place(self.x[number])}"

    def _wrong(self, flaw, allowed):
        return InputError(f"{self.source} {flaw}; allowed {allowed}")

    def _crowded(self):
        many = np.flatnonzero(self.count > 2)
        if many.size:
            first = self.order[self.start[many[0]] :][: self.count[many[0]]]
            place = at_place(self.x[self.ends[first[0]]].mean(0))
            names = ", ".join(map(str, self.of_cell[first]))
            flaw = f"has an edge {place} that {len(first)} cells share, numbers {names}"
            raise self._wrong(flaw, "are 2 cells or, at the rim, 1")

    def _sheets(self):
        parts, part = connected(len(self.cells), self.of_cell[self.pairs].T)
        if parts > 1:
            one, other = self._cell(0), self._cell((part != part[0]).argmax())
            flaw = f"falls into {parts} parts that share no edge, one with {one}, one with {other}"
            raise self._wrong(flaw, "is one sheet, whose cells share nodes where they meet")

    def _rim(self):
        """Straight edges (m, 2) by nodes on the sheet's rim, and their cells (m,)."""
        single = self.order[self.start[self.count == 1]]
        ends, cells = self.ends[single], self.of_cell[single]
        if self.middles is not None:
            middle = self.middles[single]
            halves = np.stack([ends[:, 0], middle, middle, ends[:, 1]], 1)
            ends, cells = np.vstack([halves[:, :2], halves[:, 2:]]), np.tile(cells, 2)
        return ends, cells

    def _hanging(self, ends, cells):
        # distance from an edge, over its length, of a node that lies on it; curved edges are cut
        nodes, near = np.unique(ends), {1: 1e-3, 2: 3e-2}[self.how.degree]
        p, q = self.x[ends].swapaxes(0, 1)
        length = np.linalg.norm(q - p, axis=1)
        beside = cKDTree(self.x[nodes]).query_ball_point((p + q) / 2, (0.5 + near) * length)
        edge = np.repeat(np.arange(len(ends)), [len(each) for each in beside])
        node = nodes[np.concatenate([*beside, []]).astype(int)]
        other = (node != ends[edge, 0]) & (node != ends[edge, 1])
        edge, node = edge[other], node[other]
        # both over the edge's length
        arm = (self.x[node] - p[edge]) / length[edge, None]
        along = (q - p)[edge] / length[edge, None]
        at = (arm * along).sum(1)
        off = np.linalg.norm(arm - at[:, None] * along, axis=1)
        hits = np.flatnonzero((at > near) & (at < 1 - near) & (off < near))
        if hits.size:
            hanging, cell = self._node(node[hits[0]]), cells[edge[hits[0]]]
            flaw = f"has a hanging node, number {hanging}: it lies on an edge of cell {cell}"
            allowed = "are cells that meet at whole edges"
            raise self._wrong(f"{flaw}, which does not have it", allowed)

    def _slits(self, ends):
        nodes = np.unique(ends)
        if not nodes.size:
            return []
        # distance of nodes at one place, over the mean edge at the sheet's rim
        near = 1e-6 * np.linalg.norm(self.x[ends[:, 0]] - self.x[ends[:, 1]], axis=1).mean()
        pairs = cKDTree(self.x[nodes]).query_pairs(near, output_type="ndarray")
        if not len(pairs):
            return []
        return [
            f"{self.source} has {len(pairs)} nodes where another one lies, the first "
            f"{at_place(self.x[nodes[pairs.min()]])}: the sheet is open there, a slit; merge these "
            "nodes if it should be whole"
        ]
