"""Models of gmsh, and the cells that it makes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import ModuleType

import numpy as np


@contextmanager
def own_model(gmsh: ModuleType, **options: float) -> Iterator[None]:
    """A new current model of gmsh with these options; a user's session stays as it was."""
    running = getattr(gmsh, "isInitialized", lambda: False)()
    if not running:
        gmsh.initialize(readConfigFiles=False)
    before = gmsh.model.getCurrent()
    numbers = {"General.Terminal": 0.0} | {f"Mesh.{name}": v for name, v in options.items()}
    usual = {name: gmsh.option.getNumber(name) for name in numbers}
    for name, value in numbers.items():
        gmsh.option.setNumber(name, value)
    gmsh.model.add("fabric_fenicsx")
    try:
        yield
    finally:
        if running:
            gmsh.model.remove()
            gmsh.model.setCurrent(before)
            for name, value in usual.items():
                gmsh.option.setNumber(name, value)
        else:
            gmsh.finalize()


def meshed(
    gmsh: ModuleType, corners: int = 3, size_at: Callable[[float, float], float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and cells (m, corners) of gmsh's current model, of its sizes or size_at(x, y)
    [mm]."""
    if size_at:
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, *_: size_at(x, y))
    try:
        gmsh.model.mesh.generate(2)
    finally:
        if size_at:
            gmsh.model.mesh.removeSizeCallback()
    tags, x, _ = gmsh.model.mesh.getNodes()
    _, nodes = gmsh.model.mesh.getElementsByType({3: 2, 4: 3}[corners])
    order = np.argsort(tags)
    cells = order[np.searchsorted(tags[order], nodes)]
    return x.reshape(-1, 3), cells.reshape(-1, corners)
