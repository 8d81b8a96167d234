"""Compaction from tests across the thickness and friction between yarns from loops in shear, which
are fitted beside the law, by the logarithms of their numbers.

So 95 % intervals (t-distribution) are factors.
"""

import dataclasses
import itertools
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import curve_fit, least_squares

from ..core.errors import InputError, SolverFailure
from ..core.formatting import rounded
from ..material.compaction import Compaction, log_compaction
from ..material.friction import ShearFriction
from .curves import CompactionTest, Curve, Sheet
from .problem import NOISE, Assumed, Determined, numbers_report

UNITS = {"exponent": "-", "onset": "MPa", "pressure": "MPa"}
MARGIN = 1.1  # times the measured thicknesses, up to which they show the pressure of the sheet
MIN_PRESSURE = 1e-3  # of the lowest measured one: onset and pressure of the sheet


def _determined(logarithm, error, half, unit):
    """A number by its logarithm, and standard error and half interval of that."""
    value, half = float(np.exp(logarithm)), min(float(half), 100.0)
    interval = value * math.exp(-half), value * math.exp(half)
    is_weak = half > math.log(2)
    return Determined(value, float(value * error), interval, unit, value, is_weak, False)


@dataclass(frozen=True)
class CompactionFit:
    """The result of `fit_compaction`. determined, assumed: as of an `Identification`, by the names
    exponent, onset and pressure; scatter: standard deviation of measured over fitted thickness,
    less 1; tests: with the measured thicknesses (n,) [mm] and those of the fit."""

    compaction: Compaction
    determined: dict[str, Determined]
    assumed: dict[str, Assumed]
    scatter: float
    tests: list[tuple[CompactionTest, np.ndarray, np.ndarray]]
    warnings: list[str]

    def report(self) -> dict:
        """The result for JSON."""
        tests = []
        for test, measured, fitted in self.tests:
            error = float(np.sqrt(np.mean((fitted - measured) ** 2)))
            tests.append({"file": test.file, "points": len(measured), "rms_error_mm": error})
        numbers = numbers_report(self.determined, self.assumed)
        return numbers | {"scatter_of_thickness": self.scatter, "tests": tests}


def fit_compaction(sheet: Sheet) -> CompactionFit:
    """Exponent, onset and pressure of the `Compaction` that follows the sheet's compaction tests
    best. InputError for tests that do not determine the exponent, or of plies of another thickness;
    SolverFailure if the fit fails.

    Least squares of the logarithm of thickness over pressure. An onset that the data do not
    determine, as where they begin far above it, is the default or the lowest measured pressure, if
    that is less. The intervals of the others are then those of a fit of all three.
    """
    (p, h, sd), assumed = _compression(sheet), {}
    found, scatter = _fitted_compaction(p, h, sd)
    lowest, onset = float(p.min()), found["onset"]
    if onset.value < 1.01 * MIN_PRESSURE * lowest or _factor(onset) > 10.0:
        value = min(Compaction.onset, lowest)
        source = "default" if value == Compaction.onset else "lowest measured pressure"
        why = "the data do not determine it: they begin too far above it or scatter too much"
        assumed["onset"] = Assumed(value, UNITS["onset"], source, why, {})
        all_three, (found, scatter) = found, _fitted_compaction(p, h, sd, value)
        for name, each in found.items():
            error = max(x.standard_error / x.value for x in (each, all_three[name]))
            half = math.log(max(_factor(each), _factor(all_three[name])))
            found[name] = _determined(math.log(each.value), error, half, UNITS[name])
    for name, each in found.items():
        if _factor(each) > (3.0 if name == "exponent" else 10.0):
            low, high = (rounded(end, 2) for end in each.interval)
            flaw = f"compaction tests determine the {name} only to {low} to {high} {UNITS[name]}"
            allowed = "expected tests of more points, a wider range of pressure or less scatter"
            raise InputError(f"{flaw.removesuffix(' -')}; {allowed}")
    compaction = Compaction(**{n: x.value for n, x in (found | assumed).items()})
    tests = [
        (t, sheet.measured_thickness(t), sheet.thickness * compaction.thickness(t.pressure))
        for t in sheet.compaction
    ]
    warnings = []
    if not lowest / MARGIN <= compaction.pressure <= p.max() * MARGIN:
        warnings.append(
            "by the compaction tests the fabric has the thickness of sheet.toml under "
            f"{rounded(compaction.pressure)} MPa; they measured from {rounded(lowest)} to "
            f"{rounded(p.max())} MPa"
        )
    return CompactionFit(compaction, found, assumed, scatter, tests, warnings)


def _factor(number):
    return number.interval[1] / number.value


def _compression(sheet):
    """Pressures [MPa], thicknesses and their standard deviations over the sheet's; (n,) each."""
    tests = sheet.compaction
    p = np.concatenate([test.pressure for test in tests])
    h = np.concatenate([sheet.measured_thickness(test) for test in tests])
    if not h.min() / MARGIN <= sheet.thickness <= h.max() * MARGIN:
        raise InputError(
            f"sheet.toml: thickness is {rounded(sheet.thickness, 4)} mm, and plies of the "
            f"compaction tests have {rounded(h.max(), 4)} to {rounded(h.min(), 4)} mm; expected "
            "that of one ply under a measured pressure (divide that of a stack by its plies)"
        )
    sd = np.ones(len(p))
    if all(test.noise for test in tests):  # over the value, which is that over the thickness
        responses = [(test.response, test.response.values, test.noise) for test in tests]
        sd = np.concatenate([r.deviation(noise, v) / v for r, v, noise in responses])
    return p, h / sheet.thickness, sd


def _fitted_compaction(p, h, sd, onset=None):
    """The fitted numbers {name: `Determined`} and the relative scatter of thickness; onset: a fixed
    one [MPa], None if it is fitted."""
    names = [name for name in UNITS if name != "onset" or onset is None]

    def log_thickness(p, *x):
        v = {"onset": onset} | dict(zip(names, np.exp(x)))
        y = log_compaction(np.array([v["pressure"], *p]) / v["onset"])
        return (y[0] - y[1:]) / v["exponent"]

    order, edges = np.argsort(h), (MIN_PRESSURE * p.min(), p.max() / MIN_PRESSURE)
    bounds = np.log([(1.01, 1e3) if name == "exponent" else edges for name in names]).T
    # about the pressure under which plies of the tests are as thick as the sheet
    near = math.exp(np.interp(1.0, h[order], np.log(p[order])))
    how = {"bounds": bounds, "max_nfev": 300, "full_output": True}
    how |= dict.fromkeys(("ftol", "xtol", "gtol"), 1e-12)
    fits = []
    for begin in p.min() * np.array([0.1, 1.0, 10.0]) if onset is None else [onset]:
        start = {"exponent": 10.0, "onset": begin, "pressure": near}
        x = np.clip(np.log([start[name] for name in names]), bounds[0] + 1e-6, bounds[1] - 1e-6)
        with suppress(RuntimeError):  # it did not converge
            fits.append(curve_fit(log_thickness, p, np.log(h), x, sd, **how))
    if not fits:
        raise SolverFailure("the fit of compaction did not converge in 300 evaluations")
    x, covariance, info, *_ = min(fits, key=lambda fit: fit[2]["fvec"] @ fit[2]["fvec"])
    dof, errors = len(p) - len(names), np.sqrt(np.diag(covariance))
    wide = stats.t.ppf(0.975, dof) * errors
    numbers = zip(names, x, errors, wide)
    found = {name: _determined(v, e, half, UNITS[name]) for name, v, e, half in numbers}
    return found, float(np.sqrt(np.sum((info["fvec"] * sd) ** 2) / dof))


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
    less that on the way back, is of friction alone. Least squares; the noise counts as `NOISE` of
    half the width at least. The number of elements is that of the lower Bayesian information
    criterion.
    """
    if not (loops := [_width(curve) for curve in curves if curve.back]):
        return None
    points = np.concatenate(loops, axis=1)
    fits = [fit for count in (1, 2) if (fit := _fitted_friction(count, *points))]
    return min(fits, key=lambda fit: fit[0])[1] if fits else None


def _width(curve):
    """Of a loop: its turn, angles on the way back [rad] and widths there [MPa], (3, n)."""
    (response,), (angle, back) = curve.responses, curve.back
    order = np.argsort(curve.strains[:, 2], kind="stable")
    gamma, there = curve.strains[order, 2], (response.values / response.gain)[order]
    width = np.interp(angle, gamma, there) - back.values / back.gain
    inside = (angle >= gamma[0]) & (angle < gamma[-1])
    return np.array([0 * angle + gamma[-1], angle, width])[:, inside]


def _fitted_friction(count, turn, angle, width):
    """The criterion and the fit with so many elements; None if loops do not tell their numbers."""
    half, dof, fits = width.max(initial=0.0) / 2, len(width) - 2 * count, []
    if half <= 0 or dof < 1:
        return None

    def off(x):
        friction = ShearFriction(*map(tuple, np.exp(x).reshape(2, -1)))
        way = lambda g: friction.respond(g, np.zeros(1)).stress  # noqa: E731
        # the way back is the first way, twice as large (Masing)
        return way(angle) - way(turn) + 2 * way((turn - angle) / 2) - width

    # shares of the loop's angle at which elements begin to slide in a first guess
    for places in itertools.combinations((0.03, 0.1, 0.3), count):
        strength = np.full(count, half / count)
        start = np.log([*strength / (np.array(places) * turn.max()), *strength])
        fits.append(least_squares(off, start, bounds=(start - 15, start + 15)))
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
        f"shear_friction.{name}_{i}": _determined(best.x[at], spread[at], wide[at], "MPa")
        for k, name in enumerate(friction.rules)
        for i, at in enumerate(order + k * count, 1)
    }
    criterion = len(width) * math.log(variance) + 2 * count * math.log(len(width))
    return criterion, FrictionFit(friction, determined, math.sqrt(2 * best.cost / len(width)))
