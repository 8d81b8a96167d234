"""Kinds of cells, and checks of a mesh, without which its results mean nothing, of plain arrays."""

from typing import NamedTuple

import basix
import numpy as np
from scipy.spatial import cKDTree

from .. import dolfinx_compat as compat
from ..core.errors import InputError
from ..core.graph import connected


class MeshArrays(NamedTuple):
    """A mesh fit for use: points (n, 2 or 3) [mm], cells (m, k), their kind, and warnings."""

    points: np.ndarray
    cells: np.ndarray
    kind: str
    warnings: list[str]


class CellKind(NamedTuple):
    """A kind of cell: what DOLFINx calls it, its geometric degree, and places (k, 2) of its nodes
    in the reference cell, in gmsh's order with the corners first."""

    cell: str
    degree: int
    nodes: np.ndarray

    @property
    def corners(self) -> int:
        """Number of its corners."""
        return 3 if self.cell == "triangle" else 4


_TRIANGLE = np.array([(0, 0), (2, 0), (0, 2), (1, 0), (1, 1), (0, 1)]) / 2
_QUAD = np.array([(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)]) / 2
CELLS = {
    "triangle": CellKind("triangle", 1, _TRIANGLE[:3]),
    "triangle6": CellKind("triangle", 2, _TRIANGLE),
    "quad": CellKind("quadrilateral", 1, _QUAD[:4]),
    "quad9": CellKind("quadrilateral", 2, _QUAD),
}
AREA_TOLERANCE = 1e-16  # squared area over the longest edge's fourth power: no area below it


def at_place(place: np.ndarray) -> str:
    """Text of a place (2 or 3,) [mm]."""
    return f"at {np.round(place, 6).tolist()} mm"


def turned_over(cells: np.ndarray, how: CellKind) -> np.ndarray:
    """The same cells (m, k) with their nodes the other way round."""
    k = how.corners
    corners, edges = np.r_[0, k - 1 : 0 : -1], np.arange(2 * k - 1, k - 1, -1)
    order = np.concatenate([corners, edges, np.arange(2 * k, len(how.nodes))])
    return cells[:, order[: len(how.nodes)] if how.degree > 1 else corners]


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
        cells, warnings = _one_sense(x, cells, how, source)
    edges = _Edges(x, cells, how)
    flaw = _bad_shape(x, cells, how, source) or _torn(x, edges, source)
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


def _one_sense(
    x: np.ndarray, cells: np.ndarray, how: CellKind, source: str
) -> tuple[np.ndarray, list[str]]:
    """Cells (m, k) of a plane mesh that all turn the same way round about z, as most of them do,
    and a sentence if some had to be turned over. x: points (n, 3) [mm]."""
    corners = x[cells[:, : how.corners]]
    arms = corners[:, 1:] - corners[:, :1]
    sense = np.sign(np.cross(arms[:, :-1], arms[:, 1:])[..., 2].sum(1))
    turn = np.flatnonzero(sense == (-1 if sense.sum() >= 0 else 1))
    if not turn.size:
        return cells, []
    cells = cells.copy()
    cells[turn] = turned_over(cells[turn], how)
    return cells, [
        f"{source} has {turn.size} of {len(cells)} cells turned over, the first number {turn[0]} "
        f"{at_place(corners[turn[0]].mean(0))}; they were turned to agree with the others"
    ]


def _bad_shape(x: np.ndarray, cells: np.ndarray, how: CellKind, source: str) -> str:
    """What is wrong with a cell that is flat, not convex or turned over somewhere, and what is
    allowed; else "". x: points (n, 3) [mm]; cells: (m, k), of kind `how`; source: of the mesh."""
    corners = x[cells[:, : how.corners]]
    edges = np.roll(corners, -1, 1) - corners
    # twice the area of the triangle at each corner
    normals = np.cross(edges, -np.roll(edges, 1, 1))
    mean, size = normals.mean(1), (edges**2).sum(2).max(1)
    flat = np.flatnonzero((normals * mean[:, None]).sum(2).min(1) <= AREA_TOLERANCE * size**2)
    if flat.size:
        where = f"number {flat[0]} {at_place(corners[flat[0]].mean(0))}"
        return f"{source} has a degenerate or non-convex cell, {where}; allowed are cells with area"
    if how.degree == 1:
        return ""
    kind, variant = getattr(basix.CellType, how.cell), basix.LagrangeVariant.equispaced
    fine = basix.create_lattice(kind, 20, basix.LatticeType.equispaced, True)
    lagrange = basix.create_element(basix.ElementFamily.P, kind, 2, variant)
    order = np.argsort(compat.to_dolfinx_order(how.cell, len(how.nodes)))
    values, ds, dt = lagrange.tabulate(1, fine)[..., order, 0]
    for block in np.array_split(np.arange(len(cells)), 1 + len(cells) // 2000):
        nodes = x[cells[block]]
        # products of the cells' normals, as long as dA over that of the reference cell, with `mean`
        areas = (np.cross(ds @ nodes, dt @ nodes) * mean[block, None]).sum(2)
        for k in np.flatnonzero(areas.min(1) <= AREA_TOLERANCE * size[block] ** 2)[:1]:
            place = at_place(values[areas[k].argmin()] @ nodes[k])
            return (
                f"{source} has a cell, number {block[k]}, that its curved edges turn over inside, "
                f"{place}; allowed is area everywhere"
            )
    return ""
