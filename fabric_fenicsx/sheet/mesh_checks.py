"""Kinds of cells, and checks of a mesh, without which its results mean nothing, of plain arrays."""

from collections.abc import Sequence
from typing import NamedTuple

import basix
import numpy as np
import shapely
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from .. import dolfinx_compat as compat
from ..core.errors import InputError
from ..core.formatting import rounded
from ..core.graph import connected


class MeshArrays(NamedTuple):
    """A mesh fit for use: points (n, 2 or 3) [mm], cells (m, k), their kind, and warnings."""

    points: np.ndarray
    cells: np.ndarray
    kind: str
    warnings: list[str]


class CellKind(NamedTuple):
    """A kind of cell: what DOLFINx calls it, numbers of its corners, its geometric degree, and
    places (k, 2) of its nodes in the reference cell, in gmsh's order with the corners first."""

    cell: str
    corners: int
    degree: int
    nodes: np.ndarray


_TRIANGLE = np.array([(0, 0), (2, 0), (0, 2), (1, 0), (1, 1), (0, 1)]) / 2
_QUAD = np.array([(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)]) / 2
CELLS = {
    "triangle": CellKind("triangle", 3, 1, _TRIANGLE[:3]),
    "triangle6": CellKind("triangle", 3, 2, _TRIANGLE),
    "quad": CellKind("quadrilateral", 4, 1, _QUAD[:4]),
    "quad9": CellKind("quadrilateral", 4, 2, _QUAD),
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
    how, warnings = CELLS[kind], list[str]()
    used, numbers = np.unique(cells, return_inverse=True)
    x, cells = points[used], numbers.reshape(cells.shape)
    # extent in z over the sheet's below which it is plane: files have singles
    plane = x.shape[1] == 2 or np.ptp(x[:, 2]) <= 1e-7 * np.ptp(x, axis=0).max()
    if plane:
        height = np.full(len(x), np.median(x[:, 2:]) if x.shape[1] > 2 else 0.0)
        x = np.column_stack([x[:, :2], height])
        cells, warnings = _one_sense(x, cells, how)
    flaw = _bad_shape(x, cells, how)
    if not flaw:
        flaw, rim, of = _torn(x, cells, how)
    if not flaw and len(rim):  # no closed sheet
        flaw, slits = _hanging(x, rim, of, {1: 1e-3, 2: 3e-2}[how.degree], used)
        warnings += slits
    if flaw:
        raise InputError(f"{source} {flaw}")
    warnings = [f"{source} {words}" for words in warnings]
    return MeshArrays(x[:, :2] if plane and not spatial else x, cells, kind, warnings)


# Flaws are a verb with its object and what is allowed, "" if there is none; x: points (n, 3) [mm].


def _flaw(points, cells, kind):
    """What makes arrays no mesh."""
    if kind not in CELLS:
        return f"holds cells of kind {kind}; expected {sorted(CELLS)}"
    if len(cells) == 0:
        return "is empty: it holds 0 cells; expected 1 or more"
    if cells.shape[1:] != (nodes := len(CELLS[kind].nodes),):
        return f"has cells of {cells.shape[1:]} nodes; expected {nodes} for a {kind}"
    last = len(points) - 1
    for k in np.flatnonzero((cells < 0).any(1) | (cells > last).any(1))[:1]:
        return f"has a cell, number {k}, with nodes {cells[k].tolist()}; expected 0 to {last}"
    if (bad := cells[~np.isfinite(points[cells]).all(2)]).size:
        return f"has a coordinate that is not a number at node {bad.min()}; expected lengths"
    return ""


def _torn(x, cells, how):
    """The flaw of cells that make no one sheet; and straight edges (m, 2) on its rim, by nodes, and
    their cells (m,)."""
    k, corners = how.corners, cells[:, : how.corners]
    ends = np.stack([corners, np.roll(corners, -1, 1)], -1).reshape(-1, 2)
    key = ends.min(1).astype(np.int64) * len(x) + ends.max(1)
    _, edge, count = np.unique(key, return_inverse=True, return_counts=True)
    sides = np.argsort(edge, kind="stable")  # those of one edge beside each other
    ends, of, shared = ends[sides], sides // k, count[edge[sides]]
    if (many := shared > 2).any():
        first = many.argmax()
        numbers = of[first : first + shared[first]].tolist()
        place = at_place(x[ends[first]].mean(0))
        flaw = f"has an edge {place} that {len(numbers)} cells share, numbers {str(numbers)[1:-1]}"
        return f"{flaw}; expected 2 cells or, at the rim, 1", None, None
    parts, part = connected(len(cells), of[shared == 2].reshape(-1, 2).T)
    if parts > 1:
        one, other = (
            f"one with cell {cell} {at_place(x[corners[cell]].mean(0))}"
            for cell in (0, (part != part[0]).argmax())
        )
        flaw = f"consists of {parts} parts that share no edge, {one}, {other}; expected one sheet,"
        return f"{flaw} whose neighbouring cells share nodes", None, None
    single = shared == 1
    rim, of = ends[single], of[single]
    if how.degree == 2:  # middle nodes of edges stand behind the corners, in the same order
        halves = np.insert(rim, 1, cells[:, k : 2 * k].ravel()[sides][single], axis=1)
        rim, of = np.vstack([halves[:, :2], halves[:, 1:]]), np.tile(of, 2)
    return "", rim, of


def _hanging(x, ends, cells, near, numbers):
    """The flaw of cells that do not meet at whole edges, by a node of the rim on an edge of it, up
    to `near` of its length off; and words on nodes of the rim that lie where others do, in a list.
    numbers: (n,) of points in the file."""
    nodes, (p, q) = np.unique(ends), x[ends].swapaxes(0, 1)
    length = np.linalg.norm(q - p, axis=1)
    tree = cKDTree(x[nodes])
    beside = tree.query_ball_point((p + q) / 2, (0.5 + near) * length)
    edge = np.repeat(np.arange(len(ends)), [len(each) for each in beside])
    node = nodes[np.concatenate([*beside, []]).astype(int)]
    # both over the edge's length; its own nodes are at 0 and 1
    arm = (x[node] - p[edge]) / length[edge, None]
    along = (q - p)[edge] / length[edge, None]
    at = (arm * along).sum(1)
    off = np.linalg.norm(arm - at[:, None] * along, axis=1)
    for hit in np.flatnonzero((at > near) & (at < 1 - near) & (off < near))[:1]:
        where = f"number {numbers[node[hit]]} {at_place(x[node[hit]])}"
        flaw = f"has a hanging node, {where}: it lies on an edge of cell {cells[edge[hit]]}, which"
        return f"{flaw} does not contain it; expected cells that share whole edges", []
    pairs = tree.query_pairs(1e-6 * length.mean(), output_type="ndarray")
    return "", [
        f"has {len(pairs)} nodes where another one lies, the first {at_place(x[nodes[first]])}: "
        "the sheet has a slit there; merge these nodes if it should not"
        for first in np.unique(pairs)[:1]
    ]


def _one_sense(x, cells, how):
    """Cells (m, k) of a plane mesh that all turn the same way round about z, as most of them do,
    and words if some had to be turned over, in a list."""
    corners = x[cells[:, : how.corners]]
    arms = corners[:, 1:] - corners[:, :1]
    sense = np.sign(np.cross(arms[:, :-1], arms[:, 1:])[..., 2].sum(1))
    turn = np.flatnonzero(sense == (-1 if sense.sum() >= 0 else 1))
    if not turn.size:
        return cells, []
    cells = cells.copy()
    cells[turn] = turned_over(cells[turn], how)
    return cells, [
        f"has {turn.size} of {len(cells)} cells with reversed orientation, the first number "
        f"{turn[0]} {at_place(corners[turn[0]].mean(0))}; they were reoriented"
    ]


def _bad_shape(x, cells, how):
    """The flaw of a cell that is flat, not convex or turned over somewhere."""
    corners = x[cells[:, : how.corners]]
    edges = np.roll(corners, -1, 1) - corners
    # twice the area of the triangle at each corner
    normals = np.cross(edges, -np.roll(edges, 1, 1))
    mean, size = normals.mean(1), (edges**2).sum(2).max(1)
    flat = np.flatnonzero((normals * mean[:, None]).sum(2).min(1) <= AREA_TOLERANCE * size**2)
    if flat.size:
        where = f"number {flat[0]} {at_place(corners[flat[0]].mean(0))}"
        return f"has a degenerate or non-convex cell, {where}; expected cells with area"
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
                f"has a cell, number {block[k]}, that its curved edges invert, "
                f"{place}; expected a positive area everywhere"
            )
    return ""


def cut_open(
    points: np.ndarray, cells: np.ndarray, kind: str, slits: Sequence[ArrayLike], source: str
) -> tuple[np.ndarray, np.ndarray]:
    """Points and cells of a mesh with other nodes on both sides of lines (n, 2) [mm], but at their
    ends inside. Raises InputError for lines that do not run along edges of its cells."""
    if not len(slits):
        return points, cells
    lines, sides = shapely.MultiLineString(list(slits)), np.arange(cells.size).reshape(cells.shape)
    nodes, after = cells.ravel(), np.roll(sides, -1, 1).ravel()
    ends = np.stack([nodes, nodes[after]], 1)
    x = points[ends, :2]
    length = np.linalg.norm(x[:, 1] - x[:, 0], axis=1)
    places = shapely.points(np.stack([*x.swapaxes(0, 1), x.mean(1)]))
    is_cut = shapely.distance(lines, places).max(0) < 0.1 * length  # edges that lie on slits
    _, edge, count = np.unique(np.sort(ends, 1), axis=0, return_inverse=True, return_counts=True)
    edge = edge.ravel()
    follows = length[is_cut & (count[edge] == 2)].sum() / 2
    if CELLS[kind].degree > 1 or abs(follows - lines.length) > 0.01 * lines.length:
        raise InputError(
            f"{source} has edges of straight cells along {rounded(follows)} of the "
            f"{rounded(lines.length)} mm of `slits`; expected lines within the sheet along "
            "edges, or an `outline`, whose cells follow them"
        )
    # corners of cells at one node are one as far as they meet in edges that are not cut
    corners, whole = np.append(sides, after), np.tile(~is_cut, 2)
    meets = np.stack([np.tile(edge, 2), nodes[corners]], 1)
    meets = cells.size + np.unique(meets, axis=0, return_inverse=True)[1].ravel()
    _, fan = connected(3 * cells.size, [corners[whole], meets[whole]])
    named = np.stack([nodes, fan[: cells.size] * np.isin(nodes, ends[is_cut])], 1)
    _, first, number = np.unique(named, axis=0, return_index=True, return_inverse=True)
    return points[nodes[first]], number.reshape(cells.shape)
