"""Compaction of a fabric from tests across its thickness."""

import dataclasses
import math
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import stats
from scipy.optimize import curve_fit

from ..material.compaction import Compaction, log_compaction
from ..runtime.errors import InputError, SolverFailure
from ..runtime.formatting import rounded
from .curves import CompactionTest, Sheet
from .problem import Assumed, Determined, by_logarithm

UNITS = {"exponent": "-", "onset": "MPa", "pressure": "MPa"}
MARGIN = 1.1  # times the measured thicknesses, up to which they show the pressure of the sheet
# of an interval, to either side
MAX_FACTOR = {"exponent": 3.0, "onset": 10.0, "pressure": 10.0}
EXPONENTS = 1.01, 1e3
LEAST_PRESSURE = 1e-3  # of the lowest measured one: onset and pressure of the sheet


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

    def report(self) -> dict[str, Any]:
        """The result for JSON."""
        return {
            "determined": {n: dataclasses.asdict(p) for n, p in self.determined.items()},
            "assumed": {n: dataclasses.asdict(p) for n, p in self.assumed.items()},
            "scatter_of_thickness": self.scatter,
            "tests": [
                {
                    "file": test.file,
                    "points": len(measured),
                    "rms_error_mm": float(np.sqrt(np.mean((fitted - measured) ** 2))),
                }
                for test, measured, fitted in self.tests
            ],
        }


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
    fit, lowest = _fit(p, h, sd), float(p.min())
    least, widest = 1.01 * LEAST_PRESSURE * lowest, math.log(MAX_FACTOR["onset"])
    if fit.values["onset"] < least or fit.half["onset"] > widest:
        onset = min(Compaction.onset, lowest)
        source = "default" if onset == Compaction.onset else "lowest measured pressure"
        why = "the data do not tell it: they begin too far above it or scatter too much"
        assumed["onset"] = Assumed(onset, UNITS["onset"], source, why, {})
        all_three, fit = fit, _fit(p, h, sd, onset)
        for kept, of_all in ((fit.error, all_three.error), (fit.half, all_three.half)):
            kept.update({name: max(size, of_all[name]) for name, size in kept.items()})
    held = not 1.001 * EXPONENTS[0] < fit.values["exponent"] < 0.999 * EXPONENTS[1]
    determined = {
        n: by_logarithm(fit.values[n], fit.error[n], half, UNITS[n], held and n == "exponent")
        for n, half in fit.half.items()
    }
    for name, half in fit.half.items():
        if half > math.log(MAX_FACTOR[name]):
            low, high = determined[name].interval
            interval = f"{rounded(low, 2)} to {rounded(high, 2)} {UNITS[name]}".removesuffix(" -")
            raise InputError(
                f"the compaction tests leave the {name} at {interval}; allowed are tests that tell "
                "more: of more points, a wider range of pressure or less scatter"
            )
    compaction = Compaction(**fit.values)
    tests = [
        (t, sheet.measured_thickness(t), sheet.thickness * compaction.thickness(t.pressure))
        for t in sheet.compaction
    ]
    warnings = [*_warnings(p, compaction.pressure, determined)]
    return CompactionFit(compaction, determined, assumed, fit.scatter, tests, warnings)


def _data(sheet):
    """Pressures [MPa], thicknesses and their standard deviations over the sheet's; (n,) each."""
    tests = sheet.compaction
    if not tests:
        raise InputError("there is no test of compaction; allowed is one or more")
    p = np.concatenate([test.pressure for test in tests])
    h = np.concatenate([sheet.measured_thickness(test) for test in tests])
    if not h.min() / MARGIN <= sheet.thickness <= h.max() * MARGIN:
        raise InputError(
            f"sheet.toml: thickness is {rounded(sheet.thickness, 4)} mm, and plies of the "
            f"compaction tests have {rounded(h.max(), 4)} to {rounded(h.min(), 4)} mm; allowed is "
            "that of one ply under a measured pressure (divide that of a stack by its plies)"
        )
    sd = np.ones(len(p))
    if all(test.noise for test in tests):
        sd = np.concatenate([_noise(test) for test in tests])
    return p, h / sheet.thickness, sd


def _noise(test):
    """The stated noise over the value, which is that over the thickness (n,)."""
    kind, size = test.noise
    values = test.response.values
    scale = {"absolute": 1.0, "maximum": test.response.peak}.get(kind, values)
    return np.broadcast_to(size * scale / values, values.shape)


class _Fit(NamedTuple):
    """All `values` by name, and of those that were fitted the standard errors and half widths of
    95 % intervals of their logarithms; scatter of thickness, relative."""

    values: dict[str, float]
    error: dict[str, float]
    half: dict[str, float]
    scatter: float


def _fit(p, h, sd, onset=None):
    """The three numbers; onset: a fixed one [MPa], None if it is fitted."""
    names = [name for name in UNITS if name != "onset" or onset is None]

    def log_thickness(p, *x):
        v = {"onset": onset} | dict(zip(names, np.exp(x)))
        y = log_compaction(np.array([v["pressure"], *p]) / v["onset"])
        return (y[0] - y[1:]) / v["exponent"]

    order, edges = np.argsort(h), (LEAST_PRESSURE * p.min(), p.max() / LEAST_PRESSURE)
    bounds = np.log([EXPONENTS if name == "exponent" else edges for name in names]).T
    # about the pressure under which plies of the tests are as thick as the sheet
    near = math.exp(np.interp(1.0, h[order], np.log(p[order])))
    how = {"bounds": bounds, "max_nfev": 300, "full_output": True}
    how |= dict.fromkeys(("ftol", "xtol", "gtol"), 1e-12)
    fits = []
    for begin in p.min() * np.array([0.1, 1.0, 10.0]) if onset is None else [onset]:
        start = {"exponent": 10.0, "onset": begin, "pressure": near}
        x = np.clip(np.log([start[name] for name in names]), bounds[0] + 1e-6, bounds[1] - 1e-6)
        with suppress(RuntimeError):  # it did not converge
            x, covariance, info, *_ = curve_fit(log_thickness, p, np.log(h), x, sd, **how)
            fits.append((info["fvec"] @ info["fvec"], x, covariance, info["fvec"]))
    if not fits:
        raise SolverFailure("the fit of compaction did not converge in 300 evaluations")
    _, x, covariance, residual = min(fits, key=lambda each: each[0])
    dof = len(p) - len(names)
    error = dict(zip(names, np.sqrt(np.diag(covariance)).tolist()))
    half = {name: float(stats.t.ppf(0.975, dof)) * each for name, each in error.items()}
    values = {"onset": onset} | dict(zip(names, np.exp(x).tolist()))
    scatter = float(np.sqrt(np.sum((residual * sd) ** 2) / dof))
    return _Fit({name: values[name] for name in UNITS}, error, half, scatter)


def _warnings(measured, pressure, determined):
    """Doubts about the fit."""
    if not measured.min() / MARGIN <= pressure <= measured.max() * MARGIN:
        yield (
            f"by the compaction tests the fabric has the thickness of sheet.toml under "
            f"{rounded(pressure)} MPa; they measured from {rounded(measured.min())} to "
            f"{rounded(measured.max())} MPa"
        )
    for name, each in determined.items():
        if each.at_bound:
            yield f"compaction.{name} is held by a bound"
        elif each.weak and name != "onset":  # forces hardly depend on the onset
            yield f"compaction.{name} is weakly determined"
