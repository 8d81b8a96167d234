"""Bending of a fabric's yarns as tests tell it."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..core.errors import InputError
from ..core.rules import above_zero, of_either_sign
from .files import Several
from .functions import curve_through
from .material import Parameters, parameter, parameters

GRAVITY = 9.81e-6  # N/mm^2 of a sheet of 1 g/cm^3 and 1 mm


class Bent(NamedTuple):
    """Of curvatures (n, 2) along both yarns [1/mm], over the area: energy [N], moment [N mm/mm],
    and its slope [N mm]."""

    energy: np.ndarray
    moment: np.ndarray
    slope: np.ndarray


_LENGTH, _MOMENTS = above_zero("length"), Several(of_either_sign("line_moment"))


@parameters
@dataclass(frozen=True)
class MeasuredBending(Parameters):
    """Moment against curvature of both yarns: from a cantilever test, or as a table, which may be a
    loop.

    A moment at curvature 0, or half the width of a loop, is a threshold: friction between yarns.
    The rest is elastic, joined by a monotone cubic. Raises InputError for anything but both
    overhangs, or curvatures and moments, of which the elastic part rises through 0.

    In a cantilever test strips droop by 41.5 deg under their weight: the stiffness is weight times
    the bending length cubed, half of the overhang (F. T. Peirce, J. Text. Inst. 21 (1930) T377).

    Positive curvatures make the upper face concave: increasing from 0, and mirrored
    for the other face; or increasing from below 0, with 0 twice if there is a threshold; or a loop,
    up from 0 and back, or through both faces. Beyond its ends the last slope continues.

    Examples
    --------
    >>> test = ff.MeasuredBending(curvature=(0, 0.01, 0.05), moment_a=(0.02, 0.12, 0.22))
    >>> test.respond(np.array([[0.01, -0.07]]), 1e-5).moment.round(3).tolist()
    [[0.1, -0.25]]
    >>> test.thresholds  # of a and b, which friction takes
    (0.02, 0.02)
    """

    optional = "cantilever_a", "cantilever_b", "curvature", "moment_a", "moment_b"
    prefix = "bending."

    cantilever_a: float | None = parameter(_LENGTH, "overhang of strips along a [mm]", None)
    cantilever_b: float | None = parameter(_LENGTH, "the same along b", None)
    curvature: tuple[float, ...] = parameter(
        Several(of_either_sign("curvature")), "curvatures of the table [1/mm]", ()
    )
    moment_a: tuple[float, ...] = parameter(_MOMENTS, "moments per width along a [N mm/mm]", ())
    moment_b: tuple[float, ...] = parameter(_MOMENTS, "moments along b, if they differ", ())
    thresholds: tuple[float, ...] = field(init=False, repr=False, compare=False, default=(0.0, 0.0))
    # curvatures and moments of the elastic part of each yarn
    _elastic: tuple[tuple[np.ndarray, np.ndarray], ...] = field(
        init=False, repr=False, compare=False, default=()
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        lengths = self.cantilever_a, self.cantilever_b
        object.__setattr__(self, "moment_b", self.moment_b or self.moment_a)
        curves = self.curvature, self.moment_a, self.moment_b
        if all(lengths) and not any(curves):
            return
        counts = set(map(len, curves))
        if any(lengths) or len(counts) > 1 or min(counts) < 2 or not any(self.curvature):
            raise InputError(
                "bending is incomplete, or given twice; expected cantilever_a and cantilever_b, "
                "or as many numbers of curvature, not 0 alone, moment_a, and moment_b if it differs"
            )
        columns = zip(map(np.array, curves[1:]), ("moment_a", "moment_b"))
        elastic, thresholds = zip(*(_parted(np.array(curves[0]), *column) for column in columns))
        object.__setattr__(self, "_elastic", elastic)
        object.__setattr__(self, "thresholds", tuple(map(float, thresholds)))

    @property
    def stuck(self) -> float:
        """Curvature up to which yarns stick below the threshold, a 50th of the largest [1/mm]."""
        return 0.02 * max(map(abs, self.curvature), default=1.0)

    def respond(self, curvature: np.ndarray, areal_weight: float) -> Bent:
        """At curvatures (n, 2) [1/mm] of a fabric of `areal_weight`, density times thickness
        [g/cm3 mm], without thresholds."""
        yarns = map(_along, self._curves(areal_weight), curvature.T)
        return Bent(*(np.stack(each, axis=1) for each in zip(*yarns)))

    def stiffnesses(self, areal_weight: float) -> np.ndarray:
        """Slopes of both moments at the start (2,) [N mm]."""
        return self.respond(np.zeros((1, 2)), areal_weight).slope[0]

    def _curves(self, areal_weight):
        if self._elastic:
            return self._elastic
        weight, ends = GRAVITY * areal_weight, np.array([-1.0, 0.0, 1.0])
        lengths = (self.cantilever_a or 0.0, self.cantilever_b or 0.0)
        return [(ends, weight * (length / 2) ** 3 * ends) for length in lengths]


def _parted(curvature, moment, name):
    """The elastic part of a measured curve, curvatures and moments through 0, and its threshold.
    InputError, which calls the moment `name`, where that does not rise."""
    if min(np.diff(curvature)) < 0:
        curvature, moment, threshold = _of_loop(curvature, moment, name)
    else:
        threshold = np.abs(moment[curvature == 0]).max(initial=0.0)
        moment = moment - threshold * np.sign(curvature)
    curvature, first = np.unique(np.append(0.0, curvature), return_index=True)
    moment = np.append(0.0, moment)[first]
    if curvature[0] == 0:
        curvature, moment = (np.concatenate([-v[:0:-1], v]) for v in (curvature, moment))
    for k in np.flatnonzero(np.diff(moment) <= 0)[:1]:
        low, high = (f"{moment[i]:.4g} at {curvature[i]:.4g} 1/mm" for i in (k, k + 1))
        raise InputError(
            f"bending.{name} less its threshold is {low} and {high}; expected a curve that rises "
            "through 0 (thin out what scatters)"
        )
    return (curvature, moment), threshold


def _of_loop(curvature, moment, name):
    """Curvatures, elastic moments and the threshold of a loop."""
    branches = []
    for moves in (np.diff(curvature) > 0, np.diff(curvature) < 0):
        on = np.append(moves, False) | np.append(False, moves)
        on[0] &= curvature[0] != 0  # from rest nothing slides yet
        order = np.argsort(curvature[on], kind="stable")
        branches.append((curvature[on][order], moment[on][order]))
    if min(len(x) for x, _ in branches) < 1:
        raise InputError("bending.curvature falls; expected a rising one, or a loop")
    low, high = max(x[0] for x, _ in branches), min(x[-1] for x, _ in branches)
    at = np.unique(curvature[(curvature >= low) & (curvature <= high)])
    there, back = (np.interp(at, *branch) for branch in branches)
    half = (there - back) / 2
    if half.sum() < 0:
        raise InputError(f"bending.{name} is larger on unloading; expected a loop of friction")
    threshold = np.median(half[half >= 0.5 * half.max()])
    # where a branch begins nothing slides, and the other one tells
    ends = np.where(at > 0, there - threshold, back + threshold)
    elastic = np.where(half > threshold / 2, (there + back) / 2, ends)
    elastic -= np.interp(0.0, at, elastic) if low < 0 else 0.0
    return at, elastic, threshold


def _along(curve, values):
    """Energy, moment and slope of one yarn at values (n,)."""
    # beyond its ends as between the last two points there
    longer = (np.array([2 * v[0] - v[1], *v, 2 * v[-1] - v[-2]]) for v in curve)
    return [function(values) for function in curve_through(*longer)]
