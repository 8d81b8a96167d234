"""Limits beyond which a result is invalid."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..core.fields import check_fields, documented, quantity
from ..core.formatting import percent, rounded
from ..core.rules import ABOVE_ZERO_OR_INF, POSITIVE
from ..material.strains import CRUMPLED

GROUP = "limits, beyond which a result is invalid (exit status 3)"  # of options
SENTENCES = {
    "imbalance": "work of supports and tools differs from the energies by {} of these",
    "viscous": "regularisation took {} of the strain energy",
    "penetration": "the sheet is penetrated by {} of its thickness",
    "shear": "a cell is sheared by {}",
    "shear_99_percent": "1 % of the area is sheared by more than {}",
    "fibre_share": "fibres fill {} of the volume, and round ones side by side 90.7 %",
    "shortening": "compression shortens yarns by more than "
    f"{percent(CRUMPLED)} in {{}} of the area, where a real ply folds",
    "cell_size": "cells are {} of the least radius of a touched tool",
    "located": "supports that only locate the sheet bear {} of the forces on it",
}
EDGES = 1e-2  # of the area, in which yarns at singular points may be stretched further


def _limit(default, text):
    return quantity(default, POSITIVE, text, GROUP)


@documented
@dataclass(frozen=True)
class Limits:
    """Limits beyond which a result is invalid: angles, and shares, of which 0.05 is 5 %.

    Examples
    --------
    >>> ff.Limits(viscous=0.1).exceeded({"viscous": 0.2, "imbalance": 0.01})
    ['regularisation took 20 % of the strain energy; allowed is 10 % (`Limits.viscous`)']
    """

    imbalance: float = _limit(0.05, "difference between external work and energies, over these")
    viscous: float = _limit(0.05, "energy that regularisation took, over the strain energy")
    penetration: float = _limit(0.1, "penetration of tools into the sheet, over its thickness")
    strain: float = _limit(
        0.1, "nominal strain of yarns in tension, but in 1 % of the area for singular points"
    )
    shear: float = _limit(85.0, "largest shear angle of a cell of a sheet in space [deg]")
    shear_99_percent: float = _limit(75.0, "shear angle that 99 % of its area stay below [deg]")
    fibre_share: float = _limit(0.907, "fibre volume fraction of a cell, where it is known")
    shortening: float = _limit(
        0.05, "area in which compression shortens yarns by more than 5 % (1: no limit)"
    )
    cell_size: float = quantity(
        math.inf, ABOVE_ZERO_OR_INF, "cells, over the least radius of a touched tool", GROUP
    )
    located: float = _limit(0.05, "forces of supports that only locate, over all from outside")

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
                sentences.append(f"{sentence}; allowed is {bound} (`Limits.{name}`)")
        return sentences
