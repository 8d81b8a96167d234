"""A surface mesh as any reader finds it in a file."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple, Self

import numpy as np


class OtherFormat(Exception):
    """A file whose content is of another format than its ending says; the message is the reason."""


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
        cls, points: np.ndarray, blocks: Iterable[tuple[str, np.ndarray]], others: Mapping[str, int]
    ) -> Self:
        """The mesh of points (n, 2 or 3) and blocks (kind, (m, k)), with each cell once."""
        x = np.asarray(points, dtype=float).reshape(len(points), -1 if len(points) else 3)
        parts: dict[str, list[np.ndarray]] = {}
        for kind, cells in blocks:
            if len(cells):
                parts.setdefault(kind, []).append(np.asarray(cells, dtype=np.int64))
        surface = {kind: np.concatenate(each) for kind, each in parts.items()}
        for kind, cells in surface.items():
            surface[kind] = cells[np.sort(np.unique(cells, axis=0, return_index=True)[1])]
        return cls(np.pad(x, ((0, 0), (0, max(0, 3 - x.shape[1])))), surface, dict(others))

    @property
    def sound(self) -> bool:
        """True if there are surface cells, and all their nodes."""
        last = len(self.points) - 1
        return bool(self.cells) and all(
            0 <= cells.min() and cells.max() <= last for cells in self.cells.values()
        )
