"""A surface mesh as any reader finds it in a file."""

from collections.abc import Iterable
from typing import NamedTuple, Self

import numpy as np


def surface_kind(corners: int, nodes: int) -> str:
    """meshio's name of a surface cell with so many corners and nodes."""
    name = {3: "triangle", 4: "quad"}.get(corners, f"polygon{corners}")
    return name if nodes == corners else f"{name}{nodes}"


class SurfaceMesh(NamedTuple):
    """A mesh in a file: points (n, 3) [mm]; surface cells (m, k) by meshio's name of their kind, as
    triangle, quad9 or polygon5, in gmsh's order of nodes; other kinds with their dimension."""

    points: np.ndarray
    cells: dict[str, np.ndarray]
    others: dict[str, int]

    @classmethod
    def collected(
        cls, points: np.ndarray, blocks: Iterable[tuple[str, np.ndarray]], others: dict[str, int]
    ) -> Self:
        """The mesh of points (n, 2 or 3) and blocks (kind, (m, k)), with each cell once."""
        x = np.asarray(points, float)
        parts: dict[str, list[np.ndarray]] = {}
        for kind, nodes in blocks:
            parts.setdefault(kind, []).append(nodes)
        cells = {kind: np.concatenate(each).astype(np.int64) for kind, each in parts.items()}
        for kind, nodes in cells.items():
            cells[kind] = nodes[np.sort(np.unique(nodes, axis=0, return_index=True)[1])]
        return cls(np.pad(x, ((0, 0), (0, 3 - x.shape[1]))), cells, others)
