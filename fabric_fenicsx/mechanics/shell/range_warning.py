"""What speaks against a result though nothing failed: strains beyond those that a law is for."""

import math
from typing import Protocol

import numpy as np
from mpi4py import MPI

from ...material.laws import Law, Range
from ...runtime.formatting import percent, rounded
from ...sheets.blank import Blank, Part

STRAINS = "eps_a", "eps_b", "gamma"
ROUNDING = 1e-9  # of a strain at the end of a range, which is then within


class StrainedPoints(Protocol):
    """What these warnings ask of a `Membrane`."""

    blank: Blank
    part: Part
    fabric: Law

    @property
    def weights(self) -> np.ndarray:
        """Weights of a cell's quadrature points (points,)."""

    def strains_at_points(self) -> np.ndarray:
        """eps_a, eps_b [-] and gamma [rad] there, (3, cells, points)."""


def range_warnings(membrane: StrainedPoints) -> list[str]:
    """A sentence for each of the law's ranges that the present state leaves: in which share of the
    sheet's area, and how far. Collective."""
    ranges = membrane.fabric.ranges()
    if not ranges:
        return []
    strains = dict(zip(STRAINS, membrane.strains_at_points()))
    strains["gamma"] = abs(strains["gamma"])
    return [
        words for each in ranges for words in _beyond(membrane, each, strains[each.strain]) if words
    ]


def _beyond(membrane, known, strains):
    """A sentence for strains (cells, points) above the range `known`, and one for those below."""
    comm, part = membrane.blank.mesh.comm, membrane.part
    areas = membrane.blank.areas()[part.cells]
    whole = comm.allreduce(float(areas.sum()))
    for end, sign in ((known.high, 1), (known.low, -1)):
        if not math.isfinite(end):
            continue
        out = sign * (strains - end) > ROUNDING
        share = comm.allreduce(float(areas @ (out @ membrane.weights))) / whole
        furthest = sign * comm.allreduce((sign * strains).max(initial=-math.inf), MPI.MAX)
        if share > 0:
            yield (
                f"in {percent(share, 3)} of {part.name or membrane.blank.name} {known.strain} is "
                f"beyond {known.source}, which ends at {_told(end, known)}: it reaches "
                f"{_told(furthest, known)}; {known.beyond}"
            )


def _told(strain: float, known: Range) -> str:
    angle = known.strain == "gamma"
    return f"{rounded(math.degrees(strain), 4)} deg" if angle else percent(strain, 4)
