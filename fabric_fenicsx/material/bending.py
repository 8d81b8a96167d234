"""Bending of a fabric's yarns as tests tell it."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..runtime.errors import InputError
from ..runtime.rules import above_zero, not_negative
from .files import Several
from .material import Parameters

GRAVITY = 9.81e-6  # N/mm^2 of a sheet of 1 g/cm^3 and 1 mm


class Bent(NamedTuple):
    """Of curvatures (n, 2) along both yarns [1/mm], over the area: energy [N], moment [N mm/mm],
    and its slope [N mm]."""

    energy: np.ndarray
    moment: np.ndarray
    slope: np.ndarray


@dataclass(frozen=True)
class MeasuredBending(Parameters):
    """Moment over curvature of both yarns, elastic: from a cantilever test, or as a table.

    Parameters
    ----------
    cantilever_a, cantilever_b : float, optional
        Overhang of strips along a and b at which they droop by 41.5 deg under their weight [mm].
        The stiffness is weight times the bending length cubed, half of the overhang (F. T. Peirce,
        J. Text. Inst. 21 (1930) T377).
    curvature : sequence of float, optional
        From 0 on [1/mm]; beyond the last one the last slope goes on.
    moment_a, moment_b : sequence of float, optional
        Per width at these curvatures, rising from 0 [N mm/mm]; b is as a if it is not given. A
        monotone cubic joins them; bending the other way it is mirrored.

    Raises
    ------
    InputError
        For anything but both overhangs, or curvatures and moments, that rise from 0.

    Examples
    --------
    >>> test = ff.MeasuredBending(curvature=(0, 0.01, 0.05), moment_a=(0, 0.1, 0.2))
    >>> test.respond(np.array([[0.01, -0.07]]), 1e-5).moment.round(3).tolist()
    [[0.1, -0.25]]
    """

    rules = {
        "cantilever_a": above_zero("length"),
        "cantilever_b": above_zero("length"),
        "curvature": Several(not_negative("curvature")),
        "moment_a": Several(not_negative("line_moment")),
        "moment_b": Several(not_negative("line_moment")),
    }
    optional = tuple(rules)
    prefix = "bending."

    cantilever_a: float | None = None
    cantilever_b: float | None = None
    curvature: tuple[float, ...] = ()
    moment_a: tuple[float, ...] = ()
    moment_b: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        lengths = self.cantilever_a, self.cantilever_b
        object.__setattr__(self, "moment_b", self.moment_b or self.moment_a)
        curves = self.curvature, self.moment_a, self.moment_b
        if all(lengths) and not any(curves):
            return
        counts = {len(each) for each in curves}
        if any(lengths) or len(counts) > 1 or min(counts) < 2:
            raise InputError(
                "bending is incomplete, or told twice; allowed are cantilever_a and cantilever_b, "
                "or curvature and moment_a, and moment_b if it differs, of as many numbers"
            )
        for name, values in zip(("curvature", "moment_a", "moment_b"), curves):
            if values[0] or min(np.diff(values)) <= 0:
                raise InputError(
                    f"bending.{name} is {list(values)}; allowed are numbers that rise from 0"
                )

    def respond(self, curvature: np.ndarray, areal_weight: float) -> Bent:
        """At curvatures (n, 2) [1/mm] of a fabric of `areal_weight`, density times thickness
        [g/cm3 mm]."""
        yarns = [
            _along(curvatures, moment, values)
            for (curvatures, moment), values in zip(self._curves(areal_weight), curvature.T)
        ]
        return Bent(*(np.stack(each, axis=1) for each in zip(*yarns)))

    def stiffnesses(self, areal_weight: float) -> np.ndarray:
        """Slopes of both moments at the start (2,) [N mm]."""
        return self.respond(np.zeros((1, 2)), areal_weight).slope[0]

    def _curves(self, areal_weight):
        """Curvatures and moments of each yarn."""
        if self.curvature:
            return [(self.curvature, moment) for moment in (self.moment_a, self.moment_b)]
        weight = GRAVITY * areal_weight
        lengths = (self.cantilever_a or 0.0, self.cantilever_b or 0.0)
        return [((0.0, 1.0), (0.0, weight * (length / 2) ** 3)) for length in lengths]


def _along(curvature, moment, values):
    """Energy, moment and slope of one yarn at values (n,)."""
    from scipy.interpolate import PchipInterpolator  # takes long to import

    ends = [-curvature[1], *curvature, 2 * curvature[-1] - curvature[-2]]
    curve = PchipInterpolator(ends, [-moment[1], *moment, 2 * moment[-1] - moment[-2]])
    size, last = abs(values), curvature[-1]
    inside, beyond = np.minimum(size, last), np.maximum(size - last, 0.0)
    slope, at_last = curve.derivative()(inside), curve(inside)
    energy = curve.antiderivative()(inside) - curve.antiderivative()(0.0)
    energy = energy + (at_last + slope * beyond / 2) * beyond
    return energy, np.sign(values) * (at_last + slope * beyond), slope
