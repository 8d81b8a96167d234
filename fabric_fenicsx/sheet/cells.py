"""Kinds of cells, and checks of their shape: area everywhere."""

from typing import NamedTuple

import basix
import numpy as np

from .. import dolfinx_compat as compat
from ..core.errors import InputError


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
# corners and degree of cells of which DOLFINx would have more than the checks can judge
HIGHER = {f"triangle{(p + 1) * (p + 2) // 2}": (3, p) for p in range(3, 11)} | {
    f"quad{(p + 1) ** 2}": (4, p) for p in range(3, 11)
}
STRAIGHT_TOLERANCE = 1e-6  # distance of nodes from an edge or a plane, over the edge's length
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


def with_centres(points: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and cells (m, 9) of the same shape as quadrilaterals (m, 8) without a node inside."""
    x = points[cells]
    centres = x[:, 4:].sum(1) / 2 - x[:, :4].sum(1) / 4
    numbers = len(points) + np.arange(len(cells))
    return np.vstack([points, centres]), np.column_stack([cells, numbers])


def straight_cells(
    points: np.ndarray, cells: np.ndarray, kind: str, source: str
) -> tuple[np.ndarray, str]:
    """The corners (m, 3 or 4) of plane cells (m, k) of a higher degree with straight edges, and
    their kind; `kind` is one of `HIGHER`. Raises InputError for cells of another shape."""
    k, degree = HIGHER[kind]
    x = points[cells]
    edges = np.roll(x[:, :k], -1, 1) - x[:, :k]
    length = np.linalg.norm(edges, axis=2)
    near = STRAIGHT_TOLERANCE * length.max(1)
    arms = x[:, k : k * degree].reshape(-1, k, degree - 1, 3) - x[:, :k, None]
    beside = np.linalg.norm(np.cross(arms, edges[:, :, None]), axis=3).max(2)
    normal = np.cross(edges[:, 0], edges[:, 1])
    above = abs(((x - x[:, :1]) * normal[:, None]).sum(2)).max(1)
    curved = (beside > near[:, None] * length).any(1)
    curved |= above > near * np.linalg.norm(normal, axis=1)
    if curved.any():
        first = int(curved.argmax())
        raise InputError(
            f"{source} has curved cells of order {degree}, the first number {first} "
            f"{at_place(x[first, :k].mean(0))}; allowed curved cells of order 2 (in gmsh "
            "Mesh.ElementOrder = 2) and straight ones"
        )
    return cells[:, :k], {3: "triangle", 4: "quad"}[k]


def one_sense(
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


def bad_shape(x: np.ndarray, cells: np.ndarray, how: CellKind, source: str) -> str:
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
