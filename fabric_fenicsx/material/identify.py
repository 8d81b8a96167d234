"""The parameters of a woven fabric from test curves: two-stage nonlinear regression with confidence intervals.

Stage 1 fits a, b, d and s1..s3 to the points at which no coupling acts (other yarns unstrained, no shear: k_TC = 1 in
eq. (17)); stage 2 fits c, p_min, s_T, s_C to all points with the former held, as in the paper. A joint fit of all of them
from there gives the result, since stage 2 alone would hide what stage 1 leaves uncertain. A parameter is fitted only if the
data determine it: a test excites it, its interval at 1 % noise or more is narrow enough (`_Problem.undetermined`), and p_min
only from tension with a negative strain across, as tension-tension data hardly tell it from c. All others keep an assumed
value, and say so; `[assumed]` of the data set's sheet.toml replaces those of Table 1, and is also where the fit starts.

Stresses are those of `pointwise.evaluate`; nothing of the law is repeated here.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, overload

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from ..errors import InputError, SolverFailure
from . import curves as data
from .baseline import Fabric
from .curves import Curve, Response, Sheet
from .parameters import RULES, SHEAR, YARN, WovenFabric, Yarn
from .pointwise import evaluate
from .presets import PRESETS

DEFAULTS = PRESETS["komeili"]  # Table 1; d, p_min and s_C were assumed there, too
STAGE_1 = ("a", "b", "d", *SHEAR)
# Of the parameters that the data can't tell apart, the first of these becomes an assumption.
GIVEN_UP = ("s_C", "p_min", "d", "c", "s_T", "s3", "s2", "a", "s1", "b")
HIGHER = {"a": "b", "s2": "s1", "s3": "s1"}  # higher terms are 0 by default if the lower one is fitted
NOISE = 0.01  # of each peak, at which the data must determine a parameter
SOFTEST = 0.999  # tau' > 0 is kept by c1 > -SOFTEST sqrt(c0 c2), see _Problem._to_x


@overload
def nominal(fabric: Fabric | SimpleNamespace, strains: np.ndarray, tangent: Literal[False] = ...) -> np.ndarray: ...
@overload
def nominal(
    fabric: Fabric | SimpleNamespace, strains: np.ndarray, tangent: Literal[True]
) -> tuple[np.ndarray, np.ndarray]: ...
def nominal(
    fabric: Fabric | SimpleNamespace, strains: np.ndarray, tangent: bool = False
) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
    """Stresses (n, 3) [MPa] conjugate to strains (n, 3) = eps_a, eps_b, gamma, for yarns that start at right angles.

    From dW = S11 dI4/2 + S22 dI8/2 + S12 dI6: sigma_a = S11 la + S12 lb sin g (the nominal stress P = F S along yarn a),
    sigma_b alike, and tau = S12 la lb cos g. With tangent=True also (n, 3), right at gamma = 0: d(sigma_a)/d(eps_a),
    d(sigma_b)/d(eps_b), d(sigma_a)/d(eps_b).
    """
    la, lb = 1 + strains[:, 0], 1 + strains[:, 1]
    sin, cos = np.sin(strains[:, 2]), np.cos(strains[:, 2])
    C = np.stack([la**2, la * lb * sin, la * lb * sin, lb**2], -1).reshape(-1, 2, 2)
    state = evaluate(fabric, cauchy_green=C, tangent=tangent)
    S11, S12, S22 = state.S[:, 0, 0], state.S[:, 0, 1], state.S[:, 1, 1]
    stress = np.stack([S11 * la + S12 * lb * sin, S22 * lb + S12 * la * sin, S12 * la * lb * cos], -1)
    if not tangent:
        return stress
    D = state.tangent
    assert D is not None
    return stress, np.stack([S11 + la**2 * D[:, 0, 0], S22 + lb**2 * D[:, 1, 1], la * lb * D[:, 0, 1]], -1)


def lateral_strain(
    fabric: Fabric | SimpleNamespace, along: int, strain: np.ndarray, start: np.ndarray | None = None
) -> np.ndarray:
    """Strain (n,) across a tension of `strain` (n,) along yarn a (0) or b (1), where the stress across is zero.

    The stress across is convex and rises with the strain across, so Newton from any start comes down on the root
    monotonically after one step. Raises SolverFailure if it doesn't.
    """
    across = 1 - along
    e = np.zeros((len(strain), 3))
    e[:, along] = strain
    e[:, across] = 0 if start is None else np.clip(start, -0.8, 0)
    for _ in range(200):
        stress, stiffness = nominal(fabric, e, tangent=True)
        step = stress[:, across] / stiffness[:, across]
        e[:, across] = np.clip(e[:, across] - step, -0.99, 0)
        if np.all(np.abs(step) < 1e-8):  # quadratic, so the next step would be below rounding
            return e[:, across]
    raise SolverFailure("the strain across a free tension was not found in 200 Newton steps")


def _names(balanced):
    yarns = YARN if balanced else [f"{yarn}.{name}" for yarn in ("warp", "weft") for name in YARN]
    return (*yarns, *SHEAR)


def _base(name):
    return name.rpartition(".")[2]


def true_values(fabric: WovenFabric, balanced: bool) -> dict[str, float]:
    """Parameters of `fabric` by the names used here: 10 if balanced, otherwise 17 with warp. and weft. before the yarns'."""
    return {
        n: getattr(fabric if n in SHEAR else getattr(fabric, n.split(".")[0] if "." in n else "warp"), _base(n))
        for n in _names(balanced)
    }


class _Problem:
    """Residuals of all curves in the parameters `names` (10 or 17), with all points in one call of the kernel."""

    def __init__(self, sheet: Sheet, curves: Sequence[Curve]):
        self.names, self.thickness, self.curves = _names(sheet.balanced), sheet.thickness, curves
        if not curves:
            raise InputError("there is no curve; allowed is one or more")
        parts = [(curve, response) for curve in curves for response in curve.responses]
        sizes = [len(response.values) for _, response in parts]
        self.slices = [slice(end - size, end) for size, end in zip(sizes, np.cumsum(sizes))]
        self.parts = list(zip(parts, self.slices))
        self.measured = np.concatenate([response.values for _, response in parts])
        self.peak = np.concatenate([np.full(size, response.peak) for size, (_, response) in zip(sizes, parts)])
        self.gain = np.concatenate([response.gain for _, response in parts])
        self.half = np.concatenate(
            [np.zeros(size) if response.half is None else response.half for size, (_, response) in zip(sizes, parts)]
        )
        self.component = np.concatenate(
            [np.full(size, response.component) for size, (_, response) in zip(sizes, parts)]
        )
        self.strains = np.concatenate([curve.strains for curve, _ in parts])
        self.halves = np.flatnonzero(self.half)
        self.free = {}
        for along in (0, 1):  # points under free tension, and where to start the strain across
            pieces = [(s, curve.responses[-1].values) for (curve, _), s in self.parts if curve.free == along]
            if pieces:
                self.free[along] = np.concatenate([np.r_[s] for s, _ in pieces]), np.concatenate([v for _, v in pieces])
        self.angle = max(
            (np.abs(self.strains[s, 2]).max() for (_, response), s in self.parts if response.component == 2),
            default=0.0,
        )
        self.extent = max(np.abs(self.strains[:, :2]).max(), 1e-3)

    def material(self, theta):
        """What the kernel reads of a WovenFabric, without its checks, so that derivatives can be taken at bounds."""
        v = dict(zip(self.names, theta))
        fabric = DEFAULTS.symbols(float)
        vars(fabric).update({n: v[n] for n in SHEAR}, thickness=self.thickness)
        for yarn in ("warp", "weft"):
            vars(getattr(fabric, yarn)).update({n: v[n] if n in v else v[f"{yarn}.{n}"] for n in YARN})
        return fabric

    def predict(self, theta):
        """What the law says to every measured value, (N,)."""
        fabric, strains = self.material(theta), self.strains
        if self.free:
            strains = strains.copy()
            for along, (points, start) in self.free.items():
                strains[points, 1 - along] = lateral_strain(fabric, along, strains[points, along], start)
        stress = nominal(
            fabric, np.concatenate([strains, strains[self.halves] * [1, 1, 0.5]]) if self.halves.size else strains
        )
        N = len(strains)
        rows = np.arange(N)
        across = np.zeros(N)
        for along, (points, _) in self.free.items():
            across[points] = strains[points, 1 - along]
        value = self.gain * np.where(self.component == 3, across, stress[rows, np.minimum(self.component, 2)])
        value[self.halves] += self.half[self.halves] * stress[N:, 2]
        return value

    def sizes(self, theta):
        """What change of each parameter is a large one, (len(theta),)."""
        natural = np.where(np.isfinite(self.natural), 1e-3 * self.natural, 0)
        return np.max([np.abs(theta), np.abs(self.start), natural], 0)

    def jacobian(self, theta, free):
        """d(predict)/d(theta) (N, len(free)) by central differences."""
        columns, sizes = [], self.sizes(theta)
        for k in free:
            step = np.zeros(len(theta))
            step[k] = 1e-5 * sizes[k]
            columns.append((self.predict(theta + step) - self.predict(theta - step)) / (2 * step[k]))
        return np.array(columns).T.reshape(len(self.measured), len(free))

    def prepare(self, start):
        """Set the size of steps, and `natural`: the change of each parameter that moves a response by its peak."""
        self.start, self.natural = start, np.full(len(start), np.inf)
        self.rescale(start)

    def rescale(self, theta):
        effect = np.abs(self.jacobian(theta, range(len(theta))) / self.peak[:, None])
        # 1e-9 of the peak for a large change is rounding, which differs from machine to machine
        effect[(effect < 1e-7 * effect.max(0)) | (effect * self.sizes(theta) < 1e-9)] = 0
        most = effect.max(0)
        self.natural = np.where(most > 0, 1 / np.where(most > 0, most, 1), self.natural)
        self.effect = effect

    def deviation(self, predicted, common=NOISE):
        """Standard deviations (N,): as stated by the curves, otherwise `common` times the peak of each column."""
        sd = common * self.peak
        for (curve, _), s in self.parts:
            if curve.noise:
                kind, size = curve.noise
                scale = {"absolute": 1.0, "maximum": self.peak[s]}.get(
                    kind, np.maximum(np.abs(predicted[s]), 0.05 * self.peak[s])
                )
                sd[s] = size * scale
        return sd

    def has_contraction(self, name):
        """Whether a point shows the yarns of p_min `name` in tension under a negative strain across."""
        for i in (0, 1) if "." not in name else (("warp.p_min", "weft.p_min").index(name),):
            prescribed = (self.strains[:, i] > 0) & (self.strains[:, 1 - i] < 0) & (self.component < 2)
            if i in self.free or prescribed.any():
                return True
        return False

    def undetermined(self, theta, free, sd=0.0, slack=1.0):
        """Of the parameters `free`, those whose 95 % half-width, at the noise `sd` but at least NOISE, is larger than `slack`
        times both the value and its natural change (p_min: 0.5); as pairs of index and half-width."""
        weight = np.maximum(sd, NOISE * self.peak)
        J = self.jacobian(theta, free) * self.natural[free] / weight[:, None]
        _, s, Vt = np.linalg.svd(J, full_matrices=len(free) > len(J))
        s = np.maximum(np.pad(s, (0, len(free) - len(s))), 1e-8 * s.max())
        half = 1.96 * np.sqrt(((Vt.T / s) ** 2).sum(1))
        limit = np.array(
            [
                0.5 / self.natural[k] if _base(self.names[k]) == "p_min" else max(abs(theta[k]) / self.natural[k], 1)
                for k in free
            ]
        )
        return [(k, h * self.natural[k]) for k, h, most in zip(free, half, limit) if h > slack * most]

    def _box(self, k):
        name = _base(self.names[k])
        low = 1e-9 * self.natural[k] if name in ("b", "d", "s1") else -np.inf if name == "s2" else 0.0
        return low, {"p_min": 1.0, "c": 50 / self.extent}.get(name, np.inf)

    def _shear(self, free):
        """The shear parameters that are fitted through the stiffness tau' at points of [0, angle]."""
        place = [self.names.index(n) for n in SHEAR]
        return place if place[0] in free and place[1] in free else []

    def _to_x(self, theta, free):
        """Scaled unknowns. Shear goes through tau' = c0 (1-x)^2 + 2 c1 x (1-x) + c2 x^2, x = gamma/angle, which is positive on
        all of [0, angle] exactly if c0, c2 > 0 and c1 > -sqrt(c0 c2): bounds on c0, c1/sqrt(c0 c2) and c2."""
        x = np.array([theta[k] / self.natural[k] for k in free])
        low, high = np.array([self._box(k) for k in free]).T / self.natural[free]
        if place := self._shear(free):
            G, (s1, s2, s3) = self.angle, theta[place]
            c0, c1, c2 = s1, s1 + s2 * G, s1 + 2 * s2 * G + 3 * s3 * G**2
            unit = self.natural[place[0]]
            i, j = free.index(place[0]), free.index(place[1])
            low[[i, j]], high[[i, j]] = 1e-9, np.inf
            x[[i, j]] = c0 / unit, c2 / unit
            if place[2] in free:
                m = free.index(place[2])
                x[m], low[m], high[m] = c1 / math.sqrt(c0 * max(c2, 1e-9 * unit)), -SOFTEST, np.inf
        return x, low, high

    def _from_x(self, x, theta, free):
        theta = theta.copy()
        theta[free] = x * self.natural[free]
        if place := self._shear(free):
            G, unit = self.angle, self.natural[place[0]]
            c0, c2 = x[free.index(place[0])] * unit, x[free.index(place[1])] * unit
            if place[2] in free:
                c1 = x[free.index(place[2])] * math.sqrt(c0 * c2)
                theta[place] = c0, (c1 - c0) / G, (c0 - 2 * c1 + c2) / (3 * G**2)
            else:
                theta[place[:2]] = c0, (c2 - c0 - 3 * theta[place[2]] * G**2) / (2 * G)
        return theta

    def fit(self, theta, free, sd, rows=slice(None)):
        """theta with the parameters `free` fitted to the values `rows`; SolverFailure if least_squares gives up."""
        if not free:
            return theta
        x, low, high = self._to_x(theta, free)
        margin = np.minimum(1e-3, 1e-3 * (high - low))
        result = least_squares(
            lambda x: ((self.predict(self._from_x(x, theta, free)) - self.measured) / sd)[rows],
            np.clip(x, low + margin, high - margin),
            bounds=(low, high),
            x_scale="jac",
            **dict.fromkeys(("ftol", "xtol", "gtol"), 1e-12),
            max_nfev=300,
        )
        if result.status <= 0:
            raise SolverFailure(
                f"the fit of {', '.join(self.names[k] for k in free)} did not converge in {result.nfev} evaluations"
            )
        found = self._from_x(result.x, theta, free)
        s3 = self.names.index("s3")
        if s3 in free and found[s3] < 0:  # the law allows none; refit on the bound
            found[s3] = 0.0
            return self.fit(found, [k for k in free if k != s3], sd, rows)
        return found


@dataclass(frozen=True)
class Determined:
    """A fitted parameter: value, standard error and 95 % interval (t-distribution, from the linearised joint fit, bounds
    not applied), all in `unit`; two_stage: its value before the joint fit; weak: the interval is wider than +-100 %;
    at_bound: a bound from physics holds it, so the interval is a rough guide."""

    value: float
    standard_error: float
    interval: tuple[float, float]
    unit: str
    two_stage: float
    weak: bool
    at_bound: bool


@dataclass(frozen=True)
class Assumed:
    """A parameter that was not fitted: value in `unit`, where that is from, and why the data don't determine it."""

    value: float
    unit: str
    source: str
    reason: str


@dataclass(frozen=True)
class Identification:
    """The result of `identify`. fits: for each measured column (curve, response, predicted (n,), deviation (n,));
    correlation (m, m) in the order of `determined`; variance: of the weighted residuals (1: as the noise was stated)."""

    fabric: WovenFabric
    determined: dict[str, Determined]
    assumed: dict[str, Assumed]
    correlation: np.ndarray
    fits: list[tuple[Curve, Response, np.ndarray, np.ndarray]]
    degrees_of_freedom: int
    variance: float
    noise_estimated: float | None  # of each peak, for the curves that state none
    shear_stiffness_min: float | None  # of tau' over the measured angles [MPa]
    convex_in_tension: bool | None  # of W in (eps_a, eps_b) at gamma = 0 over the measured tension
    warnings: list[str]

    def report(self) -> dict[str, Any]:
        """All of it for JSON, with the r.m.s. error of each curve."""
        names = list(self.determined)
        return {
            "material": self.fabric.name,
            "balanced": self.fabric.is_balanced,
            "parameters": len(names) + len(self.assumed),
            "determined": {n: dataclasses.asdict(p) for n, p in self.determined.items()},
            "assumed": {n: dataclasses.asdict(p) for n, p in self.assumed.items()},
            "correlation": {"names": names, "matrix": np.round(self.correlation, 4).tolist()},
            "curves": [self._error(*fit) for fit in self.fits],
            "degrees_of_freedom": self.degrees_of_freedom,
            "variance_of_weighted_residuals": self.variance,
            "noise_estimated_of_peak": self.noise_estimated,
            "shear_stiffness_min_MPa": self.shear_stiffness_min,
            "convex_in_tension": self.convex_in_tension,
            "warnings": self.warnings,
        }

    def _error(self, curve, response, predicted, _):
        rms = float(np.sqrt(np.mean((predicted - response.values) ** 2)))
        noise = None
        if curve.noise:
            kind, size = curve.noise
            noise = f"{size:g} {response.unit}" if kind == "absolute" else f"{100 * size:g} % of {kind}"
        return {"file": curve.file, "test": curve.test, "column": response.column, "unit": response.unit, "points": len(predicted),
                "rms_error": rms, "rms_error_of_peak": rms / response.peak, "noise_stated": noise}  # fmt: skip


def identify(sheet: Sheet, curves: Sequence[Curve]) -> Identification:
    """Fit the law to the curves; InputError if they determine nothing or are too few, SolverFailure if the fit fails."""
    problem = _Problem(sheet, curves)
    names, values = problem.names, true_values(DEFAULTS, sheet.balanced)
    source = dict.fromkeys(names, "Table 1 of Schäfer et al.")
    for name in names:
        for key in (_base(name), name):
            if key in sheet.assumed:
                values[name], source[name] = sheet.assumed[key], "sheet.toml"
    default = np.array([values[n] for n in names])
    problem.prepare(np.array(list(true_values(DEFAULTS, sheet.balanced).values())))
    reason = {}
    for k, name in enumerate(names):
        if not math.isfinite(problem.natural[k]):
            reason[k] = "no test excites it"
        elif _base(name) == "p_min" and not problem.has_contraction(name):
            reason[k] = "no test shows tension with a negative strain across; c is fitted for this value"
    theta, staged, fitted = _regression(problem, default, reason, source)
    free = [k for k in range(len(names)) if k not in reason]

    sd, estimated = _weights(problem, theta)
    by_prediction = estimated is not None or any(c.noise and c.noise[0] == "value" for c in curves)
    for _ in range(3 if by_prediction else 0):  # deviations depend on the fit
        theta = problem.fit(theta, fitted, sd)
        sd, estimated = _weights(problem, theta)
    predicted = problem.predict(theta)
    residual = (predicted - problem.measured) / sd
    dof = len(residual) - len(free)
    variance = float(residual @ residual) / dof
    J = problem.jacobian(theta, free) * problem.natural[free] / sd[:, None]
    inverse = np.linalg.inv(np.linalg.qr(J, "r"))
    covariance = variance * inverse @ inverse.T
    error = np.sqrt(np.diag(covariance)) * problem.natural[free]
    spread = np.sqrt(np.diag(inverse @ inverse.T))
    correlation = inverse @ inverse.T / np.outer(spread, spread)
    quantile = stats.t.ppf(0.975, dof)
    if estimated is None and not all(c.noise for c in curves):
        estimated = NOISE * math.sqrt(variance)

    units = {n: "MPa" if RULES[_base(n)].kind else "-" for n in names}
    bound = _at_bound(problem, theta, free, fitted)
    determined = {
        names[k]: Determined(float(theta[k]), float(e), (float(theta[k] - quantile * e), float(theta[k] + quantile * e)), units[names[k]],
                             float(staged[k]), bool(quantile * e > abs(theta[k])), k in bound)
        for k, e in zip(free, error)
    }  # fmt: skip
    assumed = {
        names[k]: Assumed(float(theta[k]), units[names[k]], source[names[k]], why) for k, why in sorted(reason.items())
    }
    value = dict(zip(names, map(float, theta)))
    warp, weft = (
        Yarn(**{n: value[n] if n in value else value[f"{yarn}.{n}"] for n in YARN}) for yarn in ("warp", "weft")
    )
    shear = {n: value[n] for n in SHEAR}
    fabric = WovenFabric(warp, weft, **shear, thickness=sheet.thickness, density=sheet.density, name=sheet.name)
    softest, convex = _physics(problem, fabric)
    warnings = []
    if all(c.noise for c in curves) and variance > stats.chi2.ppf(0.999, dof) / dof:
        warnings.append(
            f"the curves lie {math.sqrt(variance):.2g} times their stated noise from the law, and the intervals are widened by that"
        )
    if softest is not None and softest <= 0:
        warnings.append(f"the shear stiffness falls to {softest:.3g} MPa over the measured angles")
    if convex is False:
        warnings.append("the energy is not convex in (eps_a, eps_b) over the measured tension")
    warnings += [f"{n} is held by a bound from physics" for n, p in determined.items() if p.at_bound]
    warnings += [
        f"{n} is weakly determined, as its interval is wider than +-100 %" for n, p in determined.items() if p.weak
    ]
    fits = [(curve, response, predicted[s], sd[s]) for (curve, response), s in problem.parts]
    return Identification(
        fabric, determined, assumed, correlation, fits, dof, variance, estimated, softest, convex, warnings
    )


def _regression(problem, default, reason, source):
    """Stage 1, stage 2 and the joint fit, given up by one parameter at a time (into `reason`) until the data determine all
    that is fitted. Returns values after the joint fit, after the stages, and the parameters that were free in it."""
    names = problem.names
    couplings = [k for k, n in enumerate(names) if _base(n) not in STAGE_1]
    uncoupled = ~np.any(problem.effect[:, couplings] > 0, axis=1)
    while True:
        free = [k for k in range(len(names)) if k not in reason]
        if not free:
            raise InputError(
                f"the curves determine no parameter; they are of the tests {', '.join(sorted({c.test for c in problem.curves}))}"
            )
        if len(problem.measured) <= len(free):
            raise InputError(
                f"there are {len(problem.measured)} measured values for {len(free)} parameters; allowed are more values than parameters"
            )
        theta = default.copy()
        for k in reason:
            lower = names[k].replace(_base(names[k]), HIGHER.get(_base(names[k]), "-"))
            if lower in names and names.index(lower) in free and source[names[k]] != "sheet.toml":
                theta[k], source[names[k]] = 0.0, "0, as the lower term alone is fitted"
        for k in free:
            if names[k] in SHEAR:  # a straight line through the largest angle
                theta[k] = problem.natural[k] if names[k] == "s1" else 0.0
        sd = problem.deviation(problem.measured)
        first = [k for k in free if _base(names[k]) in STAGE_1 and np.any(problem.effect[uncoupled, k] > 0)]
        theta = problem.fit(theta, first, sd, uncoupled)
        problem.rescale(theta)
        bad = problem.undetermined(
            theta, free, slack=1e3
        )  # what no values could separate; the rest is judged at the fit
        if not bad:
            staged = problem.fit(theta, [k for k in free if k not in first], sd)
            theta = problem.fit(staged, free, sd)
            residual = (problem.predict(theta) - problem.measured) / sd
            bad = problem.undetermined(theta, free, sd * math.sqrt(residual @ residual / (len(residual) - len(free))))
        if not bad:
            s3 = names.index("s3")
            return theta, staged, [k for k in free if k != s3 or theta[s3] > 0]
        k, half = min(bad, key=lambda item: GIVEN_UP.index(_base(names[item[0]])))
        reason[k] = f"the data leave it at +-{half:.2g}"


def _weights(problem, theta):
    """Deviations (N,), and the noise estimated for curves that state none if others do (else None, as then the variance
    of the residuals gives it)."""
    predicted = problem.predict(theta)
    silent = np.concatenate([np.full(s.stop - s.start, curve.noise is None) for (curve, _), s in problem.parts])
    if silent.all() or not silent.any():
        return problem.deviation(predicted), None
    estimated = max(float(np.sqrt(np.mean(((predicted - problem.measured) / problem.peak)[silent] ** 2))), 1e-9)
    return problem.deviation(predicted, estimated), estimated


def _at_bound(problem, theta, free, fitted):
    """Parameters of `free` that a bound holds."""
    x, low, high = problem._to_x(theta, fitted)
    near = {k for k, v, lo, hi in zip(fitted, x, low, high) if v - lo < 1e-6 or hi - v < 1e-6} | set(free) - set(fitted)
    shear = set(problem._shear(fitted))  # a bound on tau' holds all three
    return near | shear & set(free) if near & shear else near


def _physics(problem, fabric):
    """Smallest tau' over the measured angles [MPa], and whether W(eps_a, eps_b) is convex over the measured tension."""
    softest = convex = None
    if problem.angle:
        g = np.linspace(0, problem.angle, 1001)
        softest = float((fabric.s1 + (2 * fabric.s2 + 3 * fabric.s3 * g) * g).min())
    tension = problem.strains[(problem.strains[:, :2].max(1) > 0) & (problem.strains[:, :2].min(1) >= 0)]
    if tension.size:
        # by the kernel's tangent just inside tension; the kink at 0 belongs to compression
        _, H = nominal(fabric, np.maximum(tension * [1, 1, 0], [1e-9, 1e-9, 0]), tangent=True)
        convex = bool(np.all((H[:, 0] > 0) & (H[:, 0] * H[:, 1] - H[:, 2] ** 2 > 0)))
    return softest, convex


# strains of synthetic tests: eps_a, eps_b [-], gamma [deg] at their end; the first and last are reached from 0 together
_Plan = dict[str, tuple[str, tuple[float | None, float | None, float | None]]]
_PAPER: _Plan = {
    "uniaxial_a": ("uniaxial_a", (0.03, 0, 0)), "uniaxial_b": ("uniaxial_b", (0, 0.03, 0)),
    "biaxial_1_1": ("biaxial", (0.02, 0.02, 0)), "biaxial_1_2": ("biaxial", (0.01, 0.02, 0)), "biaxial_2_1": ("biaxial", (0.02, 0.01, 0)),
    "shear": ("shear", (0, 0, 45)), "shear_tension_a": ("shear", (0.005, 0, 45)), "shear_tension_b": ("shear", (0, 0.005, 45)),
}  # fmt: skip
_MORE: _Plan = {
    "free_a": ("uniaxial_a", (0.03, None, 0)), "free_b": ("uniaxial_b", (None, 0.03, 0)),
    "tension_compression_a": ("biaxial", (0.03, -0.06, 0)), "tension_compression_b": ("biaxial", (-0.06, 0.03, 0)),
    "compression_a": ("compression_a", (-0.1, 0, 0)), "compression_b": ("compression_b", (0, -0.1, 0)),
    "shear_compression_a": ("shear", (-0.1, 0, 45)), "shear_compression_b": ("shear", (0, -0.1, 45)),
}  # fmt: skip
PLANS = {"paper": _PAPER, "all": _PAPER | _MORE}


def synthesise(
    fabric: WovenFabric,
    plan: str = "all",
    noise: float = 0.0,
    seed: int = 1,
    points: int = 30,
    balanced: bool | None = None,
) -> tuple[Sheet, tuple[Curve, ...]]:
    """Sheet and curves that the law predicts for the tests of a plan: "paper" (held uniaxial, biaxial, pure and pre-tensioned
    shear) or "all" (also free tension, tension-compression, compression, sheared compression).

    noise: standard deviation, normal, of each column's largest value; stated in the curves if above 0. points: of each
    curve; balanced: what the sheet says, by default what the fabric is. Raises KeyError for another plan.
    """
    random = np.random.default_rng(seed)
    balanced = fabric.is_balanced if balanced is None else balanced
    curves = []
    for name, (test, ends) in PLANS[plan].items():
        runs = data.TESTS[test].strains
        free = ends.index(None) if None in ends else None
        along = None if free is None else 1 - free
        ramp = np.arange(1, points + 1) / points
        strains = np.stack(
            [ramp * (e or 0) if c in runs else np.full(points, e or 0.0) for c, e in zip(data.STRAINS, ends)], -1
        )
        strains[:, 2] = np.radians(strains[:, 2])
        exact = strains.copy()
        if free is not None and along is not None:
            exact[:, free] = lateral_strain(fabric, along, strains[:, along])
        stress = nominal(fabric, exact)
        measured = {"biaxial": ("sigma_a", "sigma_b"), "shear": ("tau",)}.get(test, (f"sigma_{test[-1]}",))
        values = {c: stress[:, ("sigma_a", "sigma_b", "tau").index(c)] for c in measured}
        if free is not None:
            values[data.STRAINS[free]] = exact[:, free]
        values = {c: v + noise * np.abs(v).max() * random.standard_normal(points) for c, v in values.items()}
        responses = tuple(
            Response(c, "-" if c.startswith("eps") else "MPa", v, np.ones(points)) for c, v in values.items()
        )
        abscissa = data.STRAINS.index(max(runs, key=lambda c: np.ptp(strains[:, data.STRAINS.index(c)])))
        curves.append(
            Curve(
                f"{name}.csv",
                test,
                strains,
                responses,
                np.arange(points),
                abscissa,
                along,
                ("maximum", noise) if noise else None,
            )
        )
    return Sheet(fabric.name, fabric.thickness, fabric.density, balanced), tuple(curves)


def coverage(
    fabric: WovenFabric,
    plan: str = "all",
    noise: float = 0.02,
    seeds: Sequence[int] = range(1, 101),
    stated: bool = True,
) -> dict[str, Any]:
    """Over synthetic data of each seed: how often each parameter was determined and its true value lay in its interval.

    stated: whether the curves state their noise. Returns {"seeds": how many, "noise", "plan", "inside": {name: n},
    "determined": {name: n}}.
    """
    truth = true_values(fabric, fabric.is_balanced)
    inside, determined = dict.fromkeys(truth, 0), dict.fromkeys(truth, 0)
    for seed in seeds:
        sheet, curves = synthesise(fabric, plan, noise, seed)
        if not stated:
            curves = tuple(dataclasses.replace(curve, noise=None) for curve in curves)
        for name, fitted in identify(sheet, curves).determined.items():
            determined[name] += 1
            inside[name] += fitted.interval[0] <= truth[name] <= fitted.interval[1]
    found = {n: d for n, d in determined.items() if d}
    return {
        "seeds": len(seeds),
        "noise": noise,
        "plan": plan,
        "inside": {n: inside[n] for n in found},
        "determined": found,
    }


def draw(result: Identification, stem: Path | str) -> list[str]:
    """Write stem_fit.png (measured and fitted curves), stem_residuals.png (in standard deviations) and stem_correlation.png;
    returns their names."""
    from matplotlib.figure import Figure

    n = len(result.fits)
    across = min(4, n)
    down = -(-n // across)
    written = []
    for kind in ("fit", "residuals"):
        figure = Figure(figsize=(0.6 + 3.1 * across, 0.4 + 2.5 * down), layout="constrained")
        axes = figure.subplots(down, across, squeeze=False).ravel()
        for ax, (curve, response, predicted, sd) in zip(axes, result.fits):
            column = data.STRAINS[curve.abscissa]
            x = np.degrees(curve.strains[:, 2]) if column == "gamma" else 100 * curve.strains[:, curve.abscissa]
            if kind == "fit":
                ax.errorbar(
                    x,
                    response.values,
                    sd * math.sqrt(result.variance),
                    fmt=".",
                    markersize=4,
                    elinewidth=0.6,
                    label="measured",
                )
                ax.plot(x, predicted, "-", label="fitted")
                ax.set_ylabel(f"{response.column} / {response.unit}", fontsize=8)
            else:
                ax.axhline(0, color="0.6", linewidth=0.8)
                ax.plot(x, (response.values - predicted) / (sd * math.sqrt(result.variance or 1)), ".", markersize=4)
                ax.set_ylabel("residual / std. deviation", fontsize=8)
            ax.set_xlabel(f"{column} / {'deg' if column == 'gamma' else '%'}", fontsize=8)
            ax.set_title(f"{curve.file.removesuffix('.csv')}: {response.column}", fontsize=8)
            ax.tick_params(labelsize=7)
        axes[0].legend(fontsize=7) if kind == "fit" else None
        for ax in axes[n:]:
            ax.set_axis_off()
        written.append(f"{stem}_{kind}.png")
        figure.savefig(written[-1], dpi=130)
    names = list(result.determined)
    figure = Figure(figsize=(1.8 + 0.45 * len(names), 1.2 + 0.45 * len(names)), layout="constrained")
    ax = figure.subplots()
    image = ax.imshow(result.correlation, cmap="coolwarm", vmin=-1, vmax=1)
    ax.set_xticks(range(len(names)), names, rotation=90)
    ax.set_yticks(range(len(names)), names)
    figure.colorbar(image, label="correlation")
    written.append(f"{stem}_correlation.png")
    figure.savefig(written[-1], dpi=130)
    return written
