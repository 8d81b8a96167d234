"""How far yarns are shortened: a membrane stores so what a real ply folds into wrinkles."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..material.strains import SHORTENED, share_name
from ..runtime.formatting import of_sheet, percent, rounded
from ..sheets.blank import Part
from . import measures
from .result import Result

SHARES = 0.01, SHORTENED, 0.05  # shortenings, beyond which shares of the area are told
TOLD = 0.01  # share of the area in which yarns are shortened, from which on a run warns
STRIP = 2.0  # width of the strips that yarns are gathered in, in mean lengths of cells


def shortening(fields: Mapping[str, np.ndarray]) -> np.ndarray:
    """The larger shortening of a cell's two yarns under compression, (cells,) [-]."""
    return np.maximum(fields["shortening_a"], fields["shortening_b"])


def shortening_quantities(result: Result, parts: Sequence[Part]) -> dict[str, Any]:
    """Of all cells of the `parts`, which are of fabric: the largest shortening of a yarn under
    compression (nominal strain, 0 if there is none) and its place (x, y) of the flat sheet [mm], of
    several parts with the name of that part; the shares of the area in which it is more than each
    of `SHARES`; and `excess_length_mm`, the length that a yarn has lost at most, see
    `excess_length`."""
    comm, blank = result.scene.comm, result.scene.blank
    cells = np.concatenate([part.cells for part in parts])
    values, areas = shortening(result.fields)[cells], measures.areas(blank)[cells]
    largest, place, _ = measures.largest_in(blank, parts, values, values)
    lost = [excess_length(result, part) for part in parts]
    return {
        "shortening_max": largest,
        **{f"shortening_max_{key}": value for key, value in place.items()},
        **{share_name(k): measures.mean(comm, (values > k) * 1.0, areas) for k in SHARES},
        "excess_length_mm": None if None in lost else max(filter(None, lost), default=0.0),
    }


def excess_length(result: Result, part: Part) -> float | None:
    """The length that a yarn of the `part` has lost at most [mm], in what is modelled: a real one
    would have to put it into a wrinkle. None where yarns are not straight on the flat sheet.

    Shortening is gathered over strips along the yarns, `STRIP` cells wide, of both directions.
    """
    comm, blank = result.scene.comm, result.scene.blank
    if not part.straight:
        return None
    x, areas = blank.midpoints()[:2, part.cells], measures.areas(blank)[part.cells]
    count, area = comm.allreduce(np.array([len(areas), areas.sum()]))
    width, found = STRIP * np.sqrt(area / count), []
    for yarn, name in zip(part.straight, ("shortening_a", "shortening_b")):
        lost = areas * result.fields[name][part.cells]
        across = (yarn[0] * x[1] - yarn[1] * x[0]) / width
        low, high = measures.extremes(comm, across)
        at = across - low
        # a cell counts for the two strips beside its centre, the nearer one more
        left = np.floor(at).astype(int)
        strips = np.zeros(int(high - low) + 3)
        np.add.at(strips, left, (1 - (at - left)) * lost)
        np.add.at(strips, left + 1, (at - left) * lost)
        found.append(comm.allreduce(strips).max() / width)
    return float(max(found))


def shortening_warning(name: str, found: Mapping[str, Any]) -> str:
    """A sentence if yarns of the sheet of this name, whose `shortening_quantities` are `found`, are
    shortened in more than a little of its area, else ""."""
    share = found[share_name(SHORTENED)]
    if share <= TOLD:
        return ""
    lost = found["excess_length_mm"]
    excess = "" if lost is None else f"; a yarn loses up to {rounded(lost)} mm of its length"
    return (
        f"compression shortens yarns of {name} by up to {percent(found['shortening_max'], 3)}, as "
        f"at {of_sheet(found['shortening_max_at_mm'])}, and by more than {percent(SHORTENED, 6)} "
        f"in {percent(share, 3)} of the area{excess}. The law stores as shortening what a real "
        "ply folds into wrinkles"
    )
