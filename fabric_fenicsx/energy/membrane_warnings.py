"""Warnings of a membrane's state though nothing failed: cells that lock, bands, strains beyond
the law's ranges."""

import math
from functools import partial

import numpy as np
from mpi4py import MPI

from ..core.formatting import of_sheet, percent, rounded
from ..material import stability
from ..material.strains import CRUMPLED
from ..sheet.part import MAX_OFF_YARNS
from .bending import Bending
from .membrane import Membrane


def membrane_warnings(membrane: Membrane) -> list[str]:
    """A sentence each on cells that lock, on bands, and on strains beyond the law's ranges."""
    texts = locking_warning(membrane), band_warning(membrane), *range_warnings(membrane)
    return [text for text in texts if text]


def band_warning(membrane: Membrane) -> str:
    """A sentence if the law allows bands in more than 1 % of the sheet's area in the present
    state, else "".

    The law has no length, so a band is as wide as a row of cells, and which of two rows becomes one
    is open. Bending within the sheet, of stiffness B, makes it about sqrt(B / Gt) wide; a layer of
    shear is right to 3 % in cells of half of that.
    """
    part, blank, comm = membrane.part, membrane.blank, membrane.blank.mesh.comm
    state = stability.evaluate(membrane.law_of_points, membrane.invariants_at_points())
    least = state.ellipticity.min(1)
    share = membrane.share_of(least < 0)
    if share <= 0.01:
        return ""
    shear = np.take_along_axis(state.shear, state.ellipticity.argmin(1)[:, None], 1)[:, 0]
    corners = blank.corners()[part.cells]
    edges = np.linalg.norm(np.roll(corners, 1, 1) - corners, axis=2).max(1)
    # to few digits, so that of cells that mirror each other the same is named on any ranks
    centres = blank.places()[part.cells].round(6)
    cells = zip((float(f"{v:.4g}") for v in least), *centres.T, shear, edges)
    worst = comm.allgather(min(cells, default=None))
    _, *centre, shear, edge = min(each for each in worst if each)
    scene = membrane.bound_to and membrane.bound_to()
    terms = [term for term in scene.terms if isinstance(term, Bending)] if scene else []
    B = max((term.within for term in terms if term.part_name in ("", part.name)), default=0.0)
    Gt = shear * membrane.fabric.thickness
    rim = (least < 0) & blank.at_rim()[part.cells]
    short = -membrane.strains_at_points()[:2, rim].min(initial=1.0)
    short, apart = comm.allreduce(short, MPI.MAX), ""
    if short > CRUMPLED:
        apart = f". The row of cells at its edge, where yarns are shortened by {percent(short)}, "
        apart += "is not a band"
    width = ""
    if Gt > 0:
        width = f" of about sqrt(B / ({rounded(Gt)} N/mm)) there, and cells have half of it"
        size = math.sqrt(B / Gt)
        width += f": {rounded(size / 2)} mm instead of {rounded(edge)}" if B else ""
    return (
        f"in {percent(share)} of {part.name or blank.name}, e.g. at {of_sheet(centre)}, "
        "the law allows bands: strains concentrate in rows of cells that depend on mesh and steps, "
        "and so do the largest strains and shear angles, unless in-plane bending "
        f"(`in_plane_stiffness`, B) gives bands a width{width}{apart}; use neither "
        "of these values, or check them with another `nx`"
    )


def locking_warning(membrane: Membrane) -> str:
    """A sentence if cells lock, or are too coarse, in the present state, else "".

    Yarns hardly stretch. Cells without edges along both yarns can still only shear if they stretch
    yarns, and neighbours do so in opposite directions. The energy of this is the measure of
    locking: the strain energy less that of strains which are smoothed over neighbouring cells, at
    the same shear angles. Quadratic cells that yarns cross at a small angle take some of it, too. A
    sheet whose whole energy is that of yarns strained by 1e-4 is not doubted: pressed flat, it has
    no other strains than those of cells.
    """
    blank, inner = membrane.blank, membrane.integration == "inner"
    share, measured = alternating_energy(membrane), _is_strip(membrane)
    # limits of the share, and by how much a strip's force is too high, over it: medians of strips
    # at 10 to 45 deg, of which four in five lie between half and twice that
    if blank.degree > 1:
        limit, excess, cure = (0.03, 4.0, "finer cells") if inner else (0.01, 6.0, "finer cells")
        if measured and not inner and blank.degree == 2 and blank.triangulated:
            cure = 'finer cells or `integration="inner"`'
    else:
        off, plane = membrane.part.share_off_the_yarns(), blank.mesh.geometry.dim == 2
        # in space strains vary from cell to cell as the tools' curvature does
        aligned = 0.02 if off and plane else math.inf
        limit, excess = (2.5e-3 if off > MAX_OFF_YARNS else aligned), 12.0
        cure = "P2 (the default) or finer cells"
        if measured:
            cure = 'P2 with `integration="inner"`, P3 or cells along yarns (`pattern="yarns"`)'
    if share <= limit or _is_at_rest(membrane):
        return ""
    effect = "yarn strains of single cells are not reliable, and the force error is unknown"
    if measured:
        off_by = f"force is about {percent(excess * share)} too high, to within a factor of two"
        effect = "forces are not reliable" if share > 0.25 else f"a strip's {off_by}"
    reason = "cells are coarse for yarns at these angles"
    if blank.degree == 1:
        reason = f"cells lock, of which {percent(off)} have no edges along both yarns"
    return (
        f"{percent(share)} of the strain energy stretches yarns in one cell and compresses them in "
        f"the next, because {reason}: {effect}; use {cure}"
    )


def _is_strip(membrane):
    """True for a plane rectangle with straight yarns at 10 deg or more to its sides."""
    blank, yarns, cells = membrane.blank, membrane.part.straight, membrane.part.cells
    if not yarns or blank.mesh.geometry.dim == 3:
        return False
    area = blank.mesh.comm.allreduce(float(blank.areas()[cells].sum()))
    is_off = np.abs(blank.along(np.transpose(yarns))).max() < math.cos(math.radians(9.9))
    return is_off and math.isclose(area, blank.sides().prod(), rel_tol=1e-6)


def _is_at_rest(membrane):
    """True if the strain energy is at most that of yarns strained by 1e-4 all over."""
    energy, areas = membrane.state()[0].energy, membrane.blank.areas()[membrane.part.cells]
    strains = 1e-4 * np.eye(3)[:, :2]
    most = membrane.fabric.derivatives(*strains, second=False).parts.max()
    sums = np.array([areas @ (energy @ membrane.weights), areas.sum()])
    whole, area = membrane.blank.mesh.comm.allreduce(sums)
    return bool(whole <= most * area)


def alternating_energy(membrane: Membrane) -> float:
    """Share of the strain energy that goes when yarn strains are smoothed over neighbours."""
    blank, cells, strains = membrane.blank, membrane.part.cells, membrane.strains_at_points().copy()
    areas, shape = blank.areas()[cells], strains[0].shape
    strains[:2] = blank.smoothed((strains[:2] @ membrane.weights).T, cells).T[..., None]
    a, b, gamma = strains.reshape(3, -1)
    density = membrane.law_of_points.derivatives(a, b, gamma, second=False).parts.sum(-1)
    densities = membrane.state()[0].energy, density.reshape(shape)
    parts = np.array([areas @ (each @ membrane.weights) for each in densities])
    whole, smoothed = blank.mesh.comm.allreduce(parts)
    return float((whole - smoothed) / whole) if whole > 0 else 0.0


def range_warnings(membrane: Membrane) -> list[str]:
    """A sentence for each end of the law's ranges that the present state leaves: in which share of
    the sheet's area, and how far. Collective."""
    comm, part = membrane.blank.mesh.comm, membrane.part
    ranges, areas = membrane.fabric.ranges(), membrane.blank.areas()[part.cells]
    if not ranges:
        return []
    eps_a, eps_b, gamma = membrane.strains_at_points()
    strains = {"eps_a": eps_a, "eps_b": eps_b, "gamma": abs(gamma)}
    whole, texts = comm.allreduce(float(areas.sum())), []
    as_angle = lambda v: f"{rounded(math.degrees(v), 4)} deg"  # noqa: E731
    for limits in ranges:
        text = as_angle if limits.strain == "gamma" else partial(percent, digits=4)
        for sign, end in ((1, limits.high), (-1, limits.low)):
            beyond = sign * (strains[limits.strain] - end)
            share = comm.allreduce(float(areas @ ((beyond > 1e-9) @ membrane.weights))) / whole
            if share > 0:
                furthest = end + sign * comm.allreduce(beyond.max(initial=-math.inf), MPI.MAX)
                texts.append(
                    f"in {percent(share, 3)} of {part.name or membrane.blank.name} "
                    f"{limits.strain} is beyond {limits.source}, which ends at {text(end)}: it "
                    f"reaches {text(furthest)}; {limits.beyond}"
                )
    return texts
