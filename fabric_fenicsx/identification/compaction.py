"""Compaction of a fabric from tests across its thickness."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from ..material.compaction import Compaction, log_compaction
from ..runtime.errors import InputError, SolverFailure
from ..runtime.formatting import rounded
from .curves import CompactionTest, Sheet
from .parameter import Assumed, Determined

NAMES = "exponent", "onset", "pressure"
UNITS = {"exponent": "-", "onset": "MPa", "pressure": "MPa"}
BEYOND = 1.1  # times the measured thicknesses, up to which they show the pressure of the sheet
WIDEST = {"exponent": 3.0, "onset": 10.0, "pressure": 10.0}  # factor of an interval
EXPONENTS = 1.01, 1e3
PRESSURES = 1e-3  # of the lowest measured pressure: least onset and pressure of the sheet
EVALUATIONS = 300


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
    problem, assumed = _Problem(sheet), {}
    fit = problem.fit()
    least = 1.01 * PRESSURES * problem.p.min()
    if fit.values["onset"] < least or fit.half["onset"] > math.log(WIDEST["onset"]):
        onset = min(Compaction.onset, float(problem.p.min()))
        source = "default" if onset == Compaction.onset else "lowest measured pressure"
        why = "the data do not tell it: they begin too far above it or scatter too much"
        assumed["onset"] = Assumed(onset, UNITS["onset"], source, why, {})
        all_three, fit = fit, problem.fit(onset)
        fit = fit._replace(
            error={name: max(e, all_three.error[name]) for name, e in fit.error.items()},
            half={name: max(h, all_three.half[name]) for name, h in fit.half.items()},
        )
    determined = {name: _determined(name, fit) for name in fit.half}
    for name, half in fit.half.items():
        if half > math.log(WIDEST[name]):
            low, high = determined[name].interval
            interval = f"{rounded(low, 2)} to {rounded(high, 2)} {UNITS[name]}".removesuffix(" -")
            raise InputError(
                f"the compaction tests leave the {name} at {interval}; allowed are tests that tell "
                "more: of more points, a wider range of pressure or less scatter"
            )
    compaction = Compaction(**fit.values)
    tests = []
    for test in sheet.compaction:
        fitted = sheet.thickness * compaction.thickness(test.pressure)
        tests.append((test, sheet.measured_thickness(test), fitted))
    warnings = problem.warnings(compaction, determined)
    return CompactionFit(compaction, determined, assumed, fit.scatter, tests, warnings)


class _Fit(NamedTuple):
    """All `values` by name, and of those that were fitted the standard errors and half widths of
    95 % intervals of their logarithms; scatter of thickness, relative."""

    values: dict[str, float]
    error: dict[str, float]
    half: dict[str, float]
    scatter: float


def _determined(name, fit):
    value, half = fit.values[name], fit.half[name]
    interval = value * math.exp(-half), value * math.exp(half)
    at_bound = name == "exponent" and not 1.001 * EXPONENTS[0] < value < 0.999 * EXPONENTS[1]
    weak = half > math.log(2)
    return Determined(value, value * fit.error[name], interval, UNITS[name], value, weak, at_bound)


class _Problem:
    """Residuals in the logarithms of exponent, onset and pressure."""

    def __init__(self, sheet: Sheet) -> None:
        if not sheet.compaction:
            raise InputError("there is no test of compaction; allowed is one or more")
        self.t = sheet.thickness
        self.p = np.concatenate([test.pressure for test in sheet.compaction])
        self.h = np.concatenate([sheet.measured_thickness(test) for test in sheet.compaction])
        low, high = self.h.min(), self.h.max()
        if not low / BEYOND <= self.t <= high * BEYOND:
            raise InputError(
                f"sheet.toml: thickness is {rounded(self.t, 4)} mm, and plies of the compaction "
                f"tests have {rounded(high, 4)} to {rounded(low, 4)} mm; allowed is a thickness of "
                "one ply under a measured pressure (divide that of a stack by its plies)"
            )
        self.sd = np.ones(len(self.p))
        if all(test.noise for test in sheet.compaction):
            self.sd = np.concatenate([_noise(test) for test in sheet.compaction])

    def residual(self, x: np.ndarray) -> np.ndarray:
        """Residuals of all points (n,), in standard deviations."""
        n, onset, pressure = np.exp(x)
        y = log_compaction(np.array([pressure, *self.p]) / onset)
        return (np.log(self.t / self.h) + (y[0] - y[1:]) / n) / self.sd

    def fit(self, onset: float | None = None) -> _Fit:
        """The three numbers; onset: a fixed one [MPa], None if it is fitted."""
        free = [k for k, name in enumerate(NAMES) if name != "onset" or onset is None]
        edges = PRESSURES * self.p.min(), self.p.max() / PRESSURES
        low, high = np.log([EXPONENTS, edges, edges]).T[:, free]
        order = np.argsort(self.h)
        # about the pressure under which plies of the tests are as thick as the sheet
        near = math.exp(np.interp(self.t, self.h[order], np.log(self.p[order])))
        found: list[tuple[float, int, np.ndarray, Any]] = []
        starts = np.array([0.1, 1.0, 10.0]) * self.p.min()
        for begin in starts if onset is None else [onset]:
            x = np.log([10.0, begin, near])
            solved = least_squares(
                lambda v, x=x: self.residual(_with(x, free, v)),
                np.clip(x[free], low + 1e-6, high - 1e-6),
                bounds=(low, high),
                **dict.fromkeys(("ftol", "xtol", "gtol"), 1e-12),
                max_nfev=EVALUATIONS,
            )
            found.append((solved.cost, len(found), _with(x, free, solved.x), solved))
        _, _, x, solved = min(found)
        if solved.status <= 0:
            raise SolverFailure(
                f"the fit of compaction did not converge in {solved.nfev} evaluations"
            )
        dof = len(self.p) - len(free)
        variance = 2 * solved.cost / dof
        _, s, Vt = np.linalg.svd(solved.jac, full_matrices=False)
        spread = np.sqrt(((Vt.T / np.maximum(s, 1e-8 * s.max())) ** 2).sum(1) * variance)
        scatter = float(np.sqrt(np.sum((solved.fun * self.sd) ** 2) / dof))
        error = dict(zip([NAMES[k] for k in free], spread.tolist()))
        half = {name: float(stats.t.ppf(0.975, dof)) * each for name, each in error.items()}
        return _Fit(dict(zip(NAMES, np.exp(x).tolist())), error, half, scatter)

    def warnings(self, compaction: Compaction, determined: dict[str, Determined]) -> list[str]:
        """Doubts about the fit."""
        found, p = [], compaction.pressure
        if not self.p.min() / 1.1 <= p <= self.p.max() * 1.1:
            found.append(
                "by the compaction tests the fabric has the thickness of sheet.toml under "
                f"{rounded(p)} MPa; they measured from {rounded(self.p.min())} to "
                f"{rounded(self.p.max())} MPa"
            )
        for name, each in determined.items():
            if each.at_bound:
                found.append(f"compaction.{name} is held by a bound")
            elif each.weak and name != "onset":  # forces hardly depend on the onset
                found.append(f"compaction.{name} is weakly determined")
        return found


def _with(x, at, values):
    x = x.copy()
    x[at] = values
    return x


def _noise(test):
    """The stated noise over the value, which is that over the thickness (n,)."""
    kind, size = test.noise
    values = test.response.values
    scale = {"absolute": 1.0, "maximum": test.response.peak}.get(kind, values)
    return np.broadcast_to(size * scale / values, values.shape)
