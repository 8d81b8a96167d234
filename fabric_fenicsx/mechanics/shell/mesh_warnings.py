"""What speaks against a result though nothing failed: the sheet's size, bands, cells that lock."""

import math
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from ... import dolfinx_compat as compat
from ...material import kernel
from ...material.laws import Law
from ...runtime.errors import InputError
from ...runtime.formatting import coordinates, of_sheet, percent, rounded
from ...sheets.blank import Blank
from ...sheets.part import OFF, Part

FEW = 8  # cells, below which a mesh is no strip
SLENDER = 100.0  # longest side over height of a cell, above which it is a sliver
SMALL, LARGE = 20.0, 10_000.0  # mm: a few yarns, more than looms weave
BANDS = 1e-2  # share of the area in which bands are not worth a word
# share of the strain energy in stretches that neighbouring cells undo, from which cells are
# doubted: linear ones, these where edges follow the yarns, quadratic ones, and these with inner
# points
LOCKED, ALIGNED, COARSE, INNER_COARSE = 2.5e-3, 0.02, 0.01, 0.03
# by how much a strip's force is too high, over that share: medians of strips at 10 to 45 deg, of
# which four in five lie between half and twice that
LINEAR_EXCESS, QUADRATIC_EXCESS, INNER_EXCESS = 12.0, 6.0, 4.0
SPATIAL = "yarn strains of single cells mean little, and forces may be some per cent too high"
LITTLE = 0.25  # share of the energy from which a force says nothing
# strain of yarns all over a sheet, with less energy than which it is not doubted: pressed flat, it
# has no other strains than those of cells
NOISE = 1e-4


class StrainedSheet(Protocol):
    """What warnings ask of a `Membrane`."""

    blank: Blank
    part: Part
    fabric: Law
    integration: str

    @property
    def weights(self) -> np.ndarray:
        """Weights of a cell's quadrature points (points,)."""

    def state(self) -> tuple[kernel.State, Any, Any, Any]:
        """The kernel's answer at the quadrature points, and more."""

    def at_points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F, b0 and stress there."""

    def least_ellipticity(self) -> np.ndarray:
        """The least ellipticity indicator of each cell."""


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


def band_warning(membrane: StrainedSheet) -> str:
    """A sentence if the law allows bands in more than `BANDS` of the sheet's area in the present
    state, else "".

    The law has no length, so a band is as wide as a row of cells, and which of two rows becomes one
    is open: with yarns at +-45 deg the double dome's corner has neighbouring equilibria, whose
    largest shear angles are 52.1 and 54.5 deg.
    """
    part, comm = membrane.part, membrane.blank.mesh.comm
    areas = membrane.blank.areas()[part.cells]
    least = membrane.least_ellipticity()
    lost, whole = comm.allreduce(np.array([areas[least < 0].sum(), areas.sum()]))
    if lost <= BANDS * whole:
        return ""
    # to few digits, so that of cells that mirror each other the same is named on any ranks
    centres = membrane.blank.places()[part.cells].round(6)
    order = np.lexsort((*centres.T[::-1], [float(f"{v:.4g}") for v in least]))[:1]
    found = [(float(f"{least[i]:.4g}"), *centres[i]) for i in order]
    _, *centre = min(each for rank in comm.allgather(found) for each in rank)
    name = part.name or membrane.blank.name
    return (
        f"in {percent(lost / whole)} of {name}, as at {of_sheet(centre)}, "
        "the law allows bands: strains gather in rows of cells, and which rows depends on mesh and "
        "steps; so do the largest strains and shear angles, unless bending within the sheet "
        "(`in_plane_bending`) gives bands a width"
    )


def locking_warning(membrane: StrainedSheet) -> str:
    """A sentence if cells lock, or are too coarse, in the present state, else "".

    Yarns hardly stretch. Cells without edges along both yarns can still only shear if they stretch
    yarns, and neighbours do so in opposite directions. The energy of this is the measure of
    locking: the strain energy less that of strains which are smoothed over neighbouring cells, at
    the same shear angles. Quadratic cells that yarns cross at a small angle take some of it, too.
    A sheet whose whole energy is that of yarns strained by `NOISE` is not doubted.
    """
    blank = membrane.blank
    taken = alternating_energy(membrane)
    if taken <= min(LOCKED, COARSE) or _is_at_rest(membrane):
        return ""
    stretched = (
        f"{percent(taken)} of the strain energy stretches yarns in one cell and compresses them in "
        "the next"
    )
    if blank.degree > 1:
        inner, plane = membrane.integration == "inner", blank.mesh.geometry.dim == 2
        if taken <= (INNER_COARSE if inner else COARSE):
            return ""
        can_be_inner = plane and not inner and blank.degree == 2 and blank.triangulated
        cure = 'finer cells or `integration="inner"`' if can_be_inner else "finer cells"
        effect = _excess(taken, INNER_EXCESS if inner else QUADRATIC_EXCESS) if plane else SPATIAL
        return f"{stretched}, as cells are coarse for yarns at these angles: {effect}; take {cure}"
    off = membrane.part.share_off_the_yarns()
    # in space strains vary from cell to cell as the tools' curvature does
    aligned = ALIGNED if off and blank.mesh.geometry.dim == 2 else math.inf
    if taken <= (LOCKED if off > OFF else aligned):
        return ""
    effect, cure = _of_linear_cells(membrane, taken)
    return (
        f"{percent(off)} of the linear cells have no edges along both yarns at their corners, and "
        f"cells lock: {stretched}; {effect}; take {cure}"
    )


def _of_linear_cells(membrane, taken):
    """What locking does to a result, and what to take instead, in words."""
    blank = membrane.blank
    if blank.mesh.geometry.dim == 2:
        cure = 'P2 with `integration="inner"`, P3 or `pattern="yarns"`'
        cure = 'P2 with `integration="inner"` or P3' if blank.from_file else cure
        return _excess(taken, LINEAR_EXCESS), cure
    return SPATIAL, "P2, as by default, or finer cells"


def _excess(taken, ratio):
    """How much too high a strip's force is, in words."""
    if taken > LITTLE:
        return "forces say nothing"
    return (
        f"a strip's force is then about {percent(ratio * taken)} too high, mostly between half and "
        "twice that"
    )


def _is_at_rest(membrane):
    """Whether the sheet has no more strain energy than yarns strained by `NOISE` all over it."""
    energy, areas = membrane.state()[0].energy, membrane.blank.areas()[membrane.part.cells]
    strains = NOISE * np.eye(3)[:, :2]
    most = membrane.fabric.derivatives(*strains, second=False).parts.max()
    found = np.array([areas @ (energy @ membrane.weights), areas.sum()])
    whole, area = membrane.blank.mesh.comm.allreduce(found)
    return bool(whole <= most * area)


def alternating_energy(membrane: StrainedSheet) -> float:
    """Share of the strain energy that goes when yarn strains are smoothed over neighbouring cells;
    0 at rest."""
    blank = membrane.blank
    state, _, _, _ = membrane.state()
    _, b, _ = membrane.at_points()
    stretches, gamma = np.sqrt(state.invariants[..., [0, 2]]), state.invariants[..., 3]
    cells = membrane.part.cells
    corners, nodes = blank.corners()[cells], _nodes(blank)[cells]
    ends = (
        ((1, 0), (2, 0)) if corners.shape[1] == 3 else ((2, 0), (3, 1))
    )  # two sides, or both diagonals
    spans = [corners[:, i] - corners[:, j] for i, j in ends]
    squares = [[(p * q).sum(1) for q in spans] for p in spans]
    areas = np.sqrt(np.maximum(squares[0][0] * squares[1][1] - squares[0][1] ** 2, 0)) / 2
    means = np.einsum("q,cqk->ck", membrane.weights, stretches) * areas[:, None]

    def at_nodes(values):
        return blank.summed(np.repeat(values[:, None], nodes.shape[1], 1), cells)[nodes]

    smooth = (at_nodes(means) / at_nodes(areas[:, None])).mean(1)[:, None]
    before = np.arctan2(b[..., 1], b[..., 0])  # angle from yarns a to b

    def energy(stretches):
        turned = before - gamma
        fa = np.stack([stretches[..., 0], 0 * gamma], -1)
        fb = stretches[..., 1:] * np.stack([np.cos(turned), np.sin(turned)], -1)
        frame = np.stack([np.broadcast_to([1.0, 0.0], b.shape), b], -1)
        F = np.stack([fa, fb], -1) @ np.linalg.inv(frame)
        fibres = [1.0, 0.0], b.reshape(-1, 2)
        found = kernel.evaluate(membrane.fabric, gradient=F.reshape(-1, 2, 2), fibres=fibres).energy
        return float(areas @ (found.reshape(gamma.shape) @ membrane.weights))

    parts = np.array([energy(stretches), energy(np.broadcast_to(smooth, stretches.shape))])
    whole, smoothed = blank.mesh.comm.allreduce(parts, MPI.SUM)
    return float((whole - smoothed) / whole) if whole > 0 else 0.0


def _nodes(blank):
    """Nodes of `u` of each owned cell, (cells, k), the corners first."""
    return compat.dofmap(blank.V)[: blank.mesh.topology.index_map(2).size_local]
