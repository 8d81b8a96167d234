"""The width of the zones in a bias test in which a yarn turns from held to free."""

import math

import numpy as np
from mpi4py import MPI

from .pin_jointed import PinJointedStrip

RISE = 0.1, 0.9  # of the turn of a yarn, between which its transition zone is measured
OUTER = 2 / 3  # of the distance from a zone's edge, from where a turn counts as whole


def transition_width(
    comm: MPI.Comm, strip: PinJointedStrip, x: np.ndarray, y: np.ndarray, gamma: np.ndarray
) -> float | None:
    """Width [mm] of the zones beside the clamps in which a yarn's turn rises from 10 to 90 %; None
    where there is none.

    Of cells at x, y with shear angles `gamma` (n,), all ranks'. Both yarns and ends are averaged.
    The profile across a line is that of means over groups of cells at about the same distance; 0
    and 100 % are the means of its outer sixths.
    """
    widths = []
    for counts, into in strip.beside_clamps(x, y):
        parts = comm.allgather(np.stack([into[counts], gamma[counts]]))
        s, g = np.concatenate(parts, 1).round(12)
        outer = [k * s > OUTER * np.abs(s).max(initial=0) for k in (-1, 1)]
        if len(s) < 20 or not all(side.any() for side in outer):
            return None
        low, high = (g[side].mean() for side in outer)
        groups = np.array_split(np.lexsort((g, s)), math.ceil(math.sqrt(2 * len(s))))
        turned = (g - low) / (high - low)
        s, g = (np.array([values[group].mean() for group in groups]) for values in (s, turned))
        places = []
        for level in RISE:
            k = int(np.argmax(g >= level))
            if k == 0:
                return None
            places.append(s[k - 1] + (s[k] - s[k - 1]) * (level - g[k - 1]) / (g[k] - g[k - 1]))
        widths.append(places[1] - places[0])
    return float(np.mean(widths)) if widths else None
