"""Quantities of formed sheets: shear, shortening of yarns, strains and thickness of fabric, plastic
strain of metal, draw-in and wrinkles; doubts about shear and shortening.

A membrane stores as shortening what a real ply folds into wrinkles. Where yarns are shortened much,
cells crumple, and the largest shear angle says little.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..core.collective_errors import on_root
from ..core.formatting import of_sheet, percent, rounded
from ..energy.bending import Bending, shortest_wave
from ..energy.materials import fabric_of
from ..material.strains import CRUMPLED, SHORTENED, share_name
from ..scene.scene import Scene
from ..sheet.blank import Part
from . import measures, shape
from .measures import cells_of
from .result import Result
from .verdict import Numbers, Reason


def fabric_quantities(result: Result, parts: Sequence[Part]) -> Numbers:
    """Shear, shortening, strains and thickness of all cells of the `parts`, which are of fabric,
    and the angle of 99 % of the area of means over two cells. What is not known is None."""
    comm, blank, cells = result.scene.comm, result.scene.blank, cells_of(parts)
    fields = {name: values[cells] for name, values in result.fields.items()}
    ellipticity, states = fields["stability_ellipticity"], fields["strain_state"]
    extremes, areas = partial(measures.extremes, comm), blank.areas()[cells]
    shear = blank.smoothed(blank.smoothed(fields["shear_angle"][:, None], cells), cells)[:, 0]
    smooth = measures.quantiles(comm, np.degrees(np.abs(shear)), areas, (0.99,))
    shares = [measures.mean(comm, (states == k) * 1.0, areas) for k in (1, 2, 3, 4)]
    return {
        "shear_angle_deg": extremes(np.degrees(fields["shear_angle"])),
        **shear_quantities(result, parts),
        "shear_angle_99_percent_of_means_deg": smooth[0],
        **shortening_quantities(result, parts),
        "log_eps_11": extremes(fields["log_eps_11"]),
        "log_eps_22": extremes(fields["log_eps_22"]),
        "stability_ellipticity_min": extremes(ellipticity)[0],
        "cells_that_lost_ellipticity": comm.allreduce(int((ellipticity < 0).sum())),
        "share_of_state_1_to_4": shares,
        "thickness_min_mm": _known(np.fmin, comm, fields.get("thickness_under_pressure")),
        "fibre_volume_fraction_max": _known(np.fmax, comm, fields.get("fibre_volume_fraction")),
    }


def _known(extreme, comm, values):
    """Least (`np.fmin`) or largest number of all ranks in a field (cells,), None without any."""
    mine = np.nan if values is None else extreme.reduce(values, initial=np.nan)
    number = extreme.reduce(comm.allgather(float(mine)))
    return None if np.isnan(number) else float(number)


def metal_quantities(result: Result, parts: Sequence[Part]) -> Numbers:
    """Plastic strain, thickness and von Mises' stress of all cells of the `parts`, of metal."""
    cells, fields = cells_of(parts), result.fields
    extremes = partial(measures.extremes, result.scene.comm)
    thickness = fields["metal_thickness"][cells]
    before = np.repeat([part.thickness or 1.0 for part in parts], [len(p.cells) for p in parts])
    stress = np.fmax(*(fields[f"von_mises_{face}"][cells] for face in ("top", "bottom")))
    return {
        "plastic_strain_max": extremes(fields["equivalent_plastic_strain"][cells])[1],
        "thinning_max": extremes(1 - thickness / before)[1],
        "thickness_mm": extremes(thickness),
        "von_mises_max_MPa": extremes(stress)[1],
    }


def stack_quantities(
    result: Result, plies: Mapping[str, Numbers], fabrics: Sequence[Part], metals: Sequence[Part]
) -> Numbers:
    """Quantities of a stack: those of cells over all cells of its plies of fabric and of metal, and
    of the shapes of its `plies` {name: quantities} the largest ones; others each ply has."""
    quantities = fabric_quantities(result, fabrics) if fabrics else {}
    quantities |= metal_quantities(result, metals) if metals else {}
    of_shapes = {"draw_in": "largest_mm", "wrinkles": "height_mm ripples_mm rim_mm folds"}
    for name, keys in of_shapes.items():
        shapes = [ply[name] for ply in plies.values()]
        largest = None not in shapes and {k: max(s[k] for s in shapes) for k in keys.split()}
        quantities[name] = largest or None
    return quantities


def middle_of(sheets: Sequence[Any]) -> str:
    """Name of the middle sheet, if it is of fabric with metal on both sides of it; otherwise ""."""
    k = len(sheets) // 2
    between = all(any(each.metal for each in side) for side in (sheets[:k], sheets[k + 1 :]))
    return sheets[k].name if sheets[k].fabric and between else ""


def middle_quantities(result: Result, name: str) -> dict[str, float]:
    """Shear angle of ply `name` at 45 deg at most, and its `shape.contrast` [deg]."""

    def on_middle():
        ply = result.grids[name]
        most = float(abs(shape.along_paths(ply, (45,))[45].shear_angle).max())
        contrast = float(np.degrees(shape.contrast(ply, "shear_angle")))
        return {"shear_angle_on_45_deg_path_deg": most, "shear_contrast_deg": contrast}

    return on_root(result.scene.comm, on_middle)


def shear_quantities(result: Result, parts: Sequence[Part]) -> Numbers:
    """Shear of all cells of the `parts`, which are of fabric: the largest magnitude of the angle,
    its place (x, y) of the flat sheet [mm], of several parts with the name of that part, and the
    shortening of yarns there; the angle that 99 % of the area stay below [deg]."""
    comm, blank, cells = result.scene.comm, result.scene.blank, cells_of(parts)
    angle = np.degrees(np.abs(result.fields["shear_angle"][cells]))
    also = shortening(result.fields)[cells]
    largest, place, there = measures.largest_in(blank, parts, angle, also)
    below = measures.quantiles(comm, angle, blank.areas()[cells], (0.99,))
    return {
        "shear_angle_max_deg": largest,
        **{f"shear_angle_max_{key}": value for key, value in place.items()},
        "shear_angle_99_percent_deg": below[0],
        "shortening_at_shear_angle_max": there,
    }


def shortening(fields: Mapping[str, np.ndarray]) -> np.ndarray:
    """The larger shortening of a cell's two yarns under compression, (cells,) [-]."""
    return np.maximum(fields["shortening_a"], fields["shortening_b"])


def shortening_quantities(result: Result, parts: Sequence[Part]) -> Numbers:
    """Shortening of yarns under compression in all cells of the `parts`, which are of fabric: the
    largest (nominal strain, 0 if there is none) with its place as of `shear_quantities`, the shares
    of the area in which it is more than 1 %, `SHORTENED` and `CRUMPLED`, and the `excess_length`.
    """
    comm, blank, cells = result.scene.comm, result.scene.blank, cells_of(parts)
    values, areas = shortening(result.fields)[cells], blank.areas()[cells]
    largest, place, _ = measures.largest_in(blank, parts, values, values)
    lost = [excess_length(result, part) for part in parts]
    limits = 0.01, SHORTENED, CRUMPLED
    return {
        "shortening_max": largest,
        **{f"shortening_max_{key}": value for key, value in place.items()},
        **{share_name(k): measures.mean(comm, (values > k) * 1.0, areas) for k in limits},
        "excess_length_mm": None if None in lost else max(filter(None, lost), default=0.0),
    }


def excess_length(result: Result, part: Part) -> float | None:
    """The length that a yarn of the `part` has lost at most [mm], in what is modelled: a real one
    would have to put it into a wrinkle. None where yarns are not straight on the flat sheet.
    Shortening is gathered over strips along the yarns, two cells wide, of both directions."""
    comm, blank = result.scene.comm, result.scene.blank
    if not part.straight:
        return None
    x, areas = blank.midpoints()[:2, part.cells], blank.areas()[part.cells]
    count, area = comm.allreduce(np.array([len(areas), areas.sum()]))
    width, lengths = 2 * np.sqrt(area / count), []
    for yarn, name in zip(part.straight, ("shortening_a", "shortening_b")):
        lost = areas * result.fields[name][part.cells]
        across = (yarn[0] * x[1] - yarn[1] * x[0]) / width
        low, high = measures.extremes(comm, across)
        at = across - low
        # a cell counts for the two strips beside its centre, the nearer one more
        left, size = np.floor(at).astype(int), int(high - low) + 3
        strips = np.bincount(left, (1 - (at - left)) * lost, size)
        strips += np.bincount(left + 1, (at - left) * lost, size)
        lengths.append(comm.allreduce(strips).max() / width)
    return float(max(lengths))


def _of_fabric(result):
    """Each part of fabric of a sheet in space, which can fold, with its shear and shortening."""
    blank, fields = result.scene.blank, result.fields
    if blank.mesh.geometry.dim == 2 or "shear_angle" not in fields:
        return
    for part in blank.parts.values() or [blank.whole]:
        if not result.scene.comm.allreduce(np.isnan(fields["shear_angle"][part.cells]).sum()):
            yield part, shear_quantities(result, [part]) | shortening_quantities(result, [part])


def limited(result: Result) -> Iterator[tuple[str, dict[str, tuple[float, list[float]]]]]:
    """Name of each sheet of fabric in space, with {name of a limit: (value, place [mm])}."""
    for part, found in _of_fabric(result):
        sheared, shortened = (found[f"{k}_max_at_mm"] for k in ("shear_angle", "shortening"))
        values = {
            "shear": (found["shear_angle_max_deg"], sheared),
            "shear_99_percent": (found["shear_angle_99_percent_deg"], sheared),
            "shortening": (found[share_name(CRUMPLED)], shortened),
        }
        if "fibre_volume_fraction" in result.fields:
            own = np.nan_to_num(result.fields["fibre_volume_fraction"][part.cells])
            most, place, _ = measures.largest_in(result.scene.blank, [part], own, own)
            values["fibre_share"] = most, place["at_mm"]
        yield part.name, values


def crumples(quantities: Mapping[str, float]) -> bool:
    """True if cells crumple where the shear angle is largest, or in more than 1 % of the area."""
    there, share = "shortening_at_shear_angle_max", share_name(CRUMPLED)
    return bool(quantities.get(there, 0.0) > CRUMPLED or quantities.get(share, 0.0) > 0.01)


def fabric_doubts(result: Result) -> list[Reason]:
    """Doubts about each part of fabric of a sheet in space: one where yarns are shortened, one
    where cells crumple, so that the largest shear angle depends on mesh and contact."""
    doubts = list[Reason]()
    for part, found in _of_fabric(result):
        share, lost = found[share_name(SHORTENED)], found["excess_length_mm"]
        place, most = of_sheet(found["shortening_max_at_mm"]), found["shortening_max"]
        name = part.name or result.scene.blank.name
        if share > 0.01:
            loses = "" if lost is None else f"; a yarn loses up to {rounded(lost)} mm of its length"
            words = (
                f"yarns of {name} are shortened by up to {percent(most, 3)}, e.g. at {place}, "
                f"and by more than {percent(SHORTENED, 6)} in {percent(share, 3)} of the area"
                f"{loses}. A real ply would wrinkle there"
            )
            if length := shortest_wave_of(result.scene, part):
                words += (
                    f". At {percent(SHORTENED, 6)} no wave shorter than {rounded(length)} mm forms"
                    " on any mesh: this depends on the stiffness in bending and in compression"
                )
                fabric = fabric_of(result.scene, part)
                if fabric and "d" in fabric.assumed_values():
                    words += ", and no test has determined d"
            doubts.append(Reason(words))
        if crumples(found):
            words = (
                f"cells of {name} crumple in {percent(found[share_name(CRUMPLED)])} of its area, "
                f"e.g. at {place}, where yarns are shortened by {percent(most)}: the largest shear "
                f"angle, {rounded(found['shear_angle_max_deg'])} deg at "
                f"{of_sheet(found['shear_angle_max_at_mm'])}, depends on mesh and contact; the 99th"
                f" percentile is {rounded(found['shear_angle_99_percent_deg'])} deg"
            )
            doubts.append(Reason(words, of="shear_angle_max"))
    return doubts


def shortest_wave_of(scene: Scene, part: Part) -> float | None:
    """Length [mm] of the shortest wave that a part folds into where its yarns are shortened by
    `SHORTENED`, on any mesh; None for one without a fabric and its bending, and in a plane."""
    bending = [t for t in scene.terms if isinstance(t, Bending) and t.part in (part, t.blank.whole)]
    fabric = fabric_of(scene, part)
    if not (bending and fabric) or scene.blank.mesh.geometry.dim == 2:
        return None
    return shortest_wave(fabric, float(bending[0].stiffnesses[:2].max()), SHORTENED)


def waves_that_do_not_form(scene: Scene) -> list[str]:
    """A sentence for each part of fabric whose law allows only waves longer than 60 mm."""
    parts = scene.blank.parts.values() or [scene.blank.whole]
    lengths = {p.name or scene.blank.name: shortest_wave_of(scene, p) for p in parts}
    return [
        f"no wrinkle of {name} shorter than {rounded(length)} mm can form with its stiffness in "
        "bending and in compression: measure both if wrinkles matter"
        for name, length in lengths.items()
        if length and 60.0 < length < np.inf
    ]
