"""Output of a scene's present state, the same on all ranks."""

from collections.abc import Collection

import numpy as np
from mpi4py import MPI

from .. import dolfinx_compat as compat
from ..energy.membrane import Membrane
from ..energy.membrane_warnings import band_warning, locking_warning, membrane_warnings
from ..energy.output import Content, Fields, merged
from ..energy.term import overrides
from ..surfaces.tool import Tool
from .scene import Scene

# names in every sheet, without terms
OF_A_SHEET = "u", "yarn_coordinate_a", "yarn_coordinate_b", "rank", "part"


def history(scene: Scene, taken: Collection[str] = ()) -> dict[str, Content]:
    """Entries of the terms in a row of history.csv, beside the columns `taken`."""
    columns = merged(scene.terms, "history", taken).items()
    return {name: column.value for name, column in columns}


def summary(scene: Scene) -> dict[str, Content]:
    """Entries of the terms in summary.json."""
    of_runs = (
        "study ranks converged stroke_reached reason element dofs cells terms steps_accepted "
        "steps_rejected newton_iterations energy reaction_N reaction_is energy_imbalance "
        "energy_imbalance_largest branches quantities error verdict reasons warnings wall_s "
        "peak_memory_mib versions"
    ).split()
    entries = merged(scene.terms, "summary", of_runs).items()
    names = [term.name for term in scene.terms]
    return {"terms": names} | {name: entry.value for name, entry in entries}


def sizes(scene: Scene) -> dict[str, Content]:
    """Entries of the mesh in summary.json: element, dofs and cells."""
    blank = scene.blank
    kind = "P" if compat.cell_name(blank.mesh) == "triangle" else "Q"
    return {
        "element": f"{kind}{blank.degree}",
        "dofs": blank.V.dofmap.index_map.size_global * blank.mesh.geometry.dim,
        "cells": blank.mesh.topology.index_map(2).size_global,
    }


def cell_fields(scene: Scene) -> Fields:
    """Fields on this rank's owned cells, (cells, ...)."""
    return Fields(merged(scene.terms, "cell_fields", OF_A_SHEET))


def nodal_fields(scene: Scene, taken: Collection[str] = ()) -> Fields:
    """Fields at this rank's nodes, ghosts too, (nodes, ...), beside those `taken` by cells."""
    fields = Fields(merged(scene.terms, "nodal_fields", (*OF_A_SHEET, *taken)))
    fields.update({name: scene.blank.with_ghosts(values) for name, values in fields.items()})
    return fields


def tools(scene: Scene) -> list[Tool]:
    """Tools whose surface the sheet may touch."""
    touching = [term.tool for term in scene.terms if overrides(term, "may_press") and term.tool]
    return list(dict.fromkeys(touching))


def tool_force(scene: Scene, tool: Tool) -> np.ndarray:
    """Force of `tool` on the sheet in the last accepted state, (3,) [N]."""
    return sum((term.tool_force() for term in scene.terms if term.tool is tool), np.zeros(3))


def deepest(scene: Scene) -> tuple[float, str]:
    """Deepest penetration of a sheet by a tool or another sheet in any accepted state, over the
    sheet's thickness; and which one it was, and where, as a text."""
    depths = [(term.penetration_of_thickness(), term) for term in scene.terms]
    deepest, term = max(depths, key=lambda pair: pair[0])
    return deepest, term.where_deepest() if deepest else ""


def overstretched(scene: Scene, strain: float) -> float:
    """Largest share of a sheet's area in which yarns are stretched by more than `strain`."""
    return max((term.overstretched(strain) for term in _membranes(scene)), default=0.0)


def locking(scene: Scene) -> list[str]:
    """Warnings of cells that lock, one for each sheet at most."""
    return [text for term in _membranes(scene) if (text := locking_warning(term))]


def has_bands(scene: Scene) -> bool:
    """True if the law allows bands in a sheet."""
    return any([band_warning(term) for term in _membranes(scene)])


def _membranes(scene):
    return [term for term in scene.terms if isinstance(term, Membrane)]


def virial(scene: Scene) -> np.ndarray:
    """Virial of the nodal forces after `Scene.residual`: sum of force times undeformed position,
    (gdim, gdim) [N mm]: in equilibrium the volume integral of the first Piola-Kirchhoff stress."""
    forces = scene.forces.array.reshape(-1, scene.blank.mesh.geometry.dim)
    places = scene.blank.along(scene.blank.coordinates()[: len(forces)].T)
    return scene.comm.allreduce(forces.T @ places.T, MPI.SUM)


def outer_forces(scene: Scene) -> dict[str, float]:
    """Sums of sizes of nodal forces after `Scene.residual` [N], by support, "" of all else. What
    two supports hold counts for the first, or for the one that does not only locate."""
    sizes, left = {}, abs(scene.forces.array)
    for support in sorted(scene.supports, key=lambda support: support.locates):
        dofs = scene.supports.dofs_of[support.name][:, list(support.components)]
        sizes[support.name] = left[dofs].sum()
        left[dofs] = 0.0
    sizes[""] = sum(abs(given).sum() for given in scene.applied_forces())
    return {name: scene.comm.allreduce(float(size)) for name, size in sizes.items()}


def warnings(scene: Scene) -> list[str]:
    """Doubts about the state though nothing failed, as sentences."""
    texts = [text for term in _membranes(scene) for text in membrane_warnings(term)]
    for sentences in (term.warnings() for term in scene.terms):
        texts += [sentences] if isinstance(sentences, str) else sentences
    return [*texts, *filter(None, [scene.supports.locating_warning(outer_forces(scene))])]
