"""Friction between yarns from loops in shear."""

import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from ..material.friction import ShearFriction
from .curves import Curve
from .problem import NOISE, Determined, by_logarithm


@dataclass(frozen=True)
class FrictionFit:
    """The result of `fit_friction`. determined: as of an `Identification`, by names as
    shear_friction.stiffness_1; scatter: r.m.s. difference from the widths of loops [MPa]."""

    friction: ShearFriction
    determined: dict[str, Determined]
    scatter: float

    def report(self) -> dict:
        """The result for JSON."""
        numbers = {name: dataclasses.asdict(p) for name, p in self.determined.items()}
        return {"determined": numbers, "scatter_MPa": self.scatter}


def fit_friction(curves: Sequence[Curve]) -> FrictionFit | None:
    """Stiffness and strength of one or, if the loops tell them, two elements of the friction that
    follows the widths of loops best; None where they do not tell even one.

    The law has the same stress on both ways, so the width of a loop, the stress on the way there
    less that on the way back, is of friction alone. Least squares in logarithms, so the 95 %
    intervals (t-distribution, noise at least `NOISE` of half the width) are factors. The number of
    elements is that of the lower Bayesian information criterion.
    """
    loops = [_width(curve) for curve in curves if curve.back]
    if not loops:
        return None
    points = np.concatenate(loops, axis=1)
    fits = [fit for count in (1, 2) if (fit := _fit(count, *points))]
    return min(fits, key=lambda fit: fit[0])[1] if fits else None


def _width(curve):
    """Of a loop: its turn, angles on the way back [rad] and widths there [MPa], (3, n)."""
    (response,), (angle, back) = curve.responses, curve.back
    order = np.argsort(curve.strains[:, 2], kind="stable")
    gamma, there = curve.strains[order, 2], (response.values / response.gain)[order]
    width = np.interp(angle, gamma, there) - back.values / back.gain
    inside = (angle >= gamma[0]) & (angle < gamma[-1])
    return np.array([0 * angle + gamma[-1], angle, width])[:, inside]


def _model(x, turn, angle):
    """Widths (n,) [MPa] of loops by the logarithms x of stiffnesses and strengths."""
    friction = ShearFriction(*map(tuple, np.exp(x).reshape(2, -1)))

    def first(g):
        return friction.respond(g, np.zeros(1)).stress

    # the way back is the first way, twice as large (Masing)
    return first(angle) - first(turn) + 2 * first((turn - angle) / 2)


def _fit(count, turn, angle, width):
    """The criterion and the fit with so many elements; None if loops do not tell their numbers."""
    half, dof, fits = width.max(initial=0.0) / 2, len(width) - 2 * count, []
    if half <= 0 or dof < 1:
        return None
    # shares of the loop's angle at which elements begin to slide in a first guess
    for places in itertools.combinations((0.03, 0.1, 0.3), count):
        strength = np.full(count, half / count)
        start = np.log([*strength / (np.array(places) * turn.max()), *strength])
        bounds = start - 15, start + 15
        fits.append(least_squares(lambda x: _model(x, turn, angle) - width, start, bounds=bounds))
    best = min(fits, key=lambda each: each.cost)
    variance = max(2 * best.cost / dof, (NOISE * half) ** 2)
    _, s, Vt = np.linalg.svd(best.jac, full_matrices=False)
    spread = np.sqrt(((Vt.T / np.maximum(s, 1e-8 * s.max())) ** 2).sum(1) * variance)
    wide = stats.t.ppf(0.975, dof) * spread
    if (wide > math.log(3.0)).any():  # an interval of a factor of 3 to either side
        return None
    stiffness, strength = np.exp(best.x).reshape(2, -1)
    order = np.argsort(strength / stiffness)
    friction = ShearFriction(*(tuple(each[order].tolist()) for each in (stiffness, strength)))
    determined = {
        f"shear_friction.{name}_{i}": by_logarithm(np.exp(best.x[at]), spread[at], wide[at], "MPa")
        for k, name in enumerate(friction.rules)
        for i, at in enumerate(order + k * count, 1)
    }
    criterion = len(width) * math.log(variance) + 2 * count * math.log(len(width))
    return criterion, FrictionFit(friction, determined, math.sqrt(2 * best.cost / len(width)))
