"""Cells that gmsh makes."""

from typing import Any

import numpy as np

KINDS = {3: 2, 4: 3}  # gmsh's number of cells, by their corners


def meshed(gmsh: Any, corners: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and cells (m, corners) of gmsh's current model, meshed in its sizes."""
    gmsh.model.mesh.generate(2)
    tags, x, _ = gmsh.model.mesh.getNodes()
    _, nodes = gmsh.model.mesh.getElementsByType(KINDS[corners])
    order = np.argsort(tags)
    cells = order[np.searchsorted(tags[order], nodes)]
    return x.reshape(-1, 3), cells.reshape(-1, corners)
