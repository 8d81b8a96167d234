"""Fingerprint of a scene: a run is only resumed from a checkpoint that agrees in it."""

from typing import Any

import numpy as np
from mpi4py import MPI

from ..mechanics.fingerprint import entries, plain
from .scene import Scene


def of_scene(scene: Scene) -> dict[str, Any]:
    """Parameters of the terms, largest displacement of the supports and directions of the yarns,
    the same on any number of ranks."""
    found: dict[str, Any] = {"terms": ", ".join(term.name for term in scene.terms)}
    for i, term in enumerate(scene.terms, 1):
        given = {
            k: v for name, each in term.fingerprint.items() for k, v in entries(each, name).items()
        }
        found |= {f"{name} of term {i}, {term.name}": v for name, v in given.items()}
    found["supports"] = ", ".join(support.name for support in scene.supports)
    farthest = scene.comm.allreduce(abs(scene.supports.values(1.0)).max(initial=0.0), MPI.MAX)
    found["largest displacement of supports [mm]"] = plain(float(farthest))
    if straight := scene.blank.whole.straight:
        found["directions of the yarns"] = np.round(straight, 9).tolist()
    return found
