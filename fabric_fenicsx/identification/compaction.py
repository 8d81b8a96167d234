"""Compaction of a fabric from tests across its thickness."""

import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import curve_fit

from ..core.errors import InputError, SolverFailure
from ..core.formatting import rounded
from ..material.compaction import Compaction, log_compaction
from .curves import CompactionTest, Sheet
from .problem import Assumed, Determined, by_logarithm, numbers_report

UNITS = {"exponent": "-", "onset": "MPa", "pressure": "MPa"}
MARGIN = 1.1  # times the measured thicknesses, up to which they show the pressure of the sheet
MIN_PRESSURE = 1e-3  # of the lowest measured one: onset and pressure of the sheet


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

    Least squares of the logarithm of thickness over pressure, in logarithms of the three numbers,
    so their 95 % intervals (t-distribution) are factors. An onset that the data do not
    determine, as where they begin far above it, is the default or the lowest measured pressure, if
    that is less. The intervals of the others are then those of a fit of all three.
    """
    (p, h, sd), assumed = _data(sheet), {}
    found, scatter = _fit(p, h, sd)
    lowest, onset = float(p.min()), found["onset"]
    if onset.value < 1.01 * MIN_PRESSURE * lowest or _factor(onset) > 10.0:
        value = min(Compaction.onset, lowest)
        source = "default" if value == Compaction.onset else "lowest measured pressure"
        why = "the data do not tell it: they begin too far above it or scatter too much"
        assumed["onset"] = Assumed(value, UNITS["onset"], source, why, {})
        all_three, (found, scatter) = found, _fit(p, h, sd, value)
        for name, each in found.items():
            error = max(x.standard_error / x.value for x in (each, all_three[name]))
            half = math.log(max(_factor(each), _factor(all_three[name])))
            found[name] = by_logarithm(each.value, error, half, UNITS[name])
    for name, each in found.items():
        if _factor(each) > (3.0 if name == "exponent" else 10.0):
            low, high = (rounded(end, 2) for end in each.interval)
            flaw = f"the compaction tests leave the {name} at {low} to {high} {UNITS[name]}"
            allowed = "allowed are tests of more points, a wider range of pressure or less scatter"
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


def _data(sheet):
    """Pressures [MPa], thicknesses and their standard deviations over the sheet's; (n,) each."""
    tests = sheet.compaction
    p = np.concatenate([test.pressure for test in tests])
    h = np.concatenate([sheet.measured_thickness(test) for test in tests])
    if not h.min() / MARGIN <= sheet.thickness <= h.max() * MARGIN:
        raise InputError(
            f"sheet.toml: thickness is {rounded(sheet.thickness, 4)} mm, and plies of the "
            f"compaction tests have {rounded(h.max(), 4)} to {rounded(h.min(), 4)} mm; allowed is "
            "that of one ply under a measured pressure (divide that of a stack by its plies)"
        )
    sd = np.ones(len(p))
    if all(test.noise for test in tests):  # over the value, which is that over the thickness
        responses = [(test.response, test.response.values, test.noise) for test in tests]
        sd = np.concatenate([r.deviation(noise, v) / v for r, v, noise in responses])
    return p, h / sheet.thickness, sd


def _fit(p, h, sd, onset=None):
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
    dof = len(p) - len(names)
    errors, wide = np.sqrt(np.diag(covariance)), float(stats.t.ppf(0.975, dof))
    numbers = zip(names, np.exp(x), errors)
    found = {name: by_logarithm(v, e, wide * e, UNITS[name]) for name, v, e in numbers}
    return found, float(np.sqrt(np.sum((info["fvec"] * sd) ** 2) / dof))
