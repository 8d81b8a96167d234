"""Warnings of a mesh: the size of the sheet, few cells, slivers."""

import numpy as np

from ...runtime.errors import InputError
from ...runtime.formatting import coordinates, rounded
from ...sheets.blank import Blank

FEW = 8  # cells, below which a mesh is no strip
SLENDER = 100.0  # longest side over height of a cell, above which it is a sliver
SMALL, LARGE = 20.0, 10_000.0  # mm: a few yarns, more than looms weave


def size_warning(blank: Blank, thickness: float, source: str) -> str:
    """A sentence if the sheet's size may be in another unit than mm, else ""; thickness: of the
    fabric [mm].

    Raises InputError for a sheet smaller than its thickness, which must be in metres.
    """
    low, high = blank.extent()
    sides = " x ".join(rounded(side, 4) for side in high - low)
    if (high - low).max() < thickness:
        raise InputError(
            f"{source} is {sides} mm, less than the fabric is thick ({thickness:g} mm); allowed "
            "is a sheet in mm, so one in metres times 1000"
        )
    if (high - low).max() < SMALL:
        return (
            f"{source} is {sides} mm, which is some yarns only; lengths are in mm (metres "
            "times 1000, inches times 25.4)"
        )
    if (high - low).max() > LARGE:
        return (
            f"{source} is {sides} mm, which is more than looms weave; lengths are in "
            "mm (micrometres over 1000)"
        )
    return ""


def cell_warnings(blank: Blank, source: str) -> list[str]:
    """Sentences on a mesh of few cells, and on the one whose longest side is largest over its
    height, if that is more than `SLENDER`; source: what they call the mesh."""
    comm, found = blank.mesh.comm, []
    corners, areas = blank.corners(), blank.areas()
    cells = comm.allreduce(len(areas))
    if cells < FEW:
        found.append(
            f"{source} has {cells} cells in all, which tell no distribution of strains; take 10 or "
            "more along each side"
        )
    sides = np.linalg.norm(np.roll(corners, -1, 1) - corners, axis=2).max(1, initial=0.0)
    share = 2.0 if corners.shape[1] == 3 else 1.0
    slender = sides**2 / (share * np.maximum(areas, 1e-300))
    # to few digits, so that of cells that mirror each other the same is named on any ranks
    rows = zip(-slender, *blank.midpoints()[:2].round(6))
    mine = min([[float(f"{value:.4g}") for value in row] for row in rows], default=[np.inf])
    least, *place = min(comm.allgather(mine))
    if -least > SLENDER:
        found.append(
            f"{source} has slivers: a cell at {coordinates(place)} mm is {rounded(-least)} times "
            "as long as high; strains there say little, and the run may take many iterations"
        )
    return found
