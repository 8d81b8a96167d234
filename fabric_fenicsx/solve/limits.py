"""Limits beyond which a result is invalid."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..core.fields import check_fields, documented, quantity
from ..core.formatting import percent, rounded
from ..core.rules import ABOVE_ZERO_OR_INF, POSITIVE
from ..material.strains import CRUMPLED

GROUP = "limits of a valid result (else exit status 3)"  # of options
SENTENCES = {
    "imbalance": "work of supports and tools differs from the energies by {} of these",
    "viscous": "regularisation took {} of the strain energy",
    "penetration": "the sheet is penetrated by {} of its thickness",
    "shear": "a cell is sheared by {}",
    "shear_99_percent": "1 % of the area is sheared by more than {}",
    "fibre_share": "fibres fill {} of the volume; parallel round fibres fill at most 90.7 %",
    "shortening": "compression shortens yarns by more than "
    f"{percent(CRUMPLED)} in {{}} of the area, where a real ply folds",
    "cell_size": "cells are {} of the smallest radius of a tool in contact",
    "located": "supports that only locate the sheet carry {} of the forces on it",
}
EDGES = 1e-2  # of the area, in which yarns at singular points may be stretched further


def _limit(default, text):
    return quantity(default, POSITIVE, text, GROUP)


@documented
@dataclass(frozen=True)
class Limits:
    """Limits of a valid result: angles, and shares (0.05 is 5 %).

    Examples
    --------
    >>> ff.Limits(viscous=0.1).exceeded({"viscous": 0.2, "imbalance": 0.01})
    ['regularisation took 20 % of the strain energy; the limit is 10 % (`Limits.viscous`)']
    """

    imbalance: float = _limit(0.05, "difference of external work and energies, relative to these")
    viscous: float = _limit(0.05, "energy of the regularisation, relative to the strain energy")
    penetration: float = _limit(0.1, "penetration of tools into the sheet, over its thickness")
    strain: float = _limit(
        0.1, "nominal strain of yarns in tension, except in 1 % of the area (singular points)"
    )
    shear: float = _limit(85.0, "maximum shear angle of a cell of a sheet in space [deg]")
    shear_99_percent: float = _limit(75.0, "99th percentile of the shear angle by area [deg]")
    fibre_share: float = _limit(0.907, "fibre volume fraction of a cell, if known")
    shortening: float = _limit(
        0.05, "share of the area where yarns are shortened by more than 5 % (1: no limit)"
    )
    cell_size: float = quantity(
        math.inf, ABOVE_ZERO_OR_INF, "cell size over the smallest radius of a tool", GROUP
    )
    located: float = _limit(0.05, "share of supports that only locate in all external forces")

    def __post_init__(self) -> None:
        check_fields(self, "`Limits.{}`".format)

    def exceeded(self, values: Mapping[str, float]) -> list[str]:
        """A sentence for each limit that is exceeded; values: by the names above, not strain."""
        sentences = []
        for name, value in values.items():
            limit = getattr(self, name)
            as_text = (lambda v, n: f"{rounded(v, n)} deg") if name.startswith("shear") else percent
            # as many digits as tell the two apart
            texts = [(as_text(value, n), as_text(limit, n)) for n in (3, 6, 17)]
            text, bound = next((pair for pair in texts if pair[0] != pair[1]), texts[-1])
            if not value <= limit:
                sentence = SENTENCES[name].format(text)
                sentences.append(f"{sentence}; the limit is {bound} (`Limits.{name}`)")
        return sentences
