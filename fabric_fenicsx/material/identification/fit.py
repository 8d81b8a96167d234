"""Two-stage nonlinear regression of the law's parameters, with confidence intervals."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

from ...runtime.errors import InputError
from ..curves import Curve, Sheet, unit_warnings
from ..homogeneous import nominal
from ..laws.coupled import SHEAR, YARN, WovenFabric, Yarn
from .problem import DEFAULTS, NOISE, NotConverged, Problem, base, true_values, unit_of
from .result import Assumed, Determined, Identification
from .toe import toe_warning

STAGE_1 = ("a", "b", "d", *SHEAR)
# Of the parameters that the data can't tell apart, the first of these becomes an assumption.
GIVEN_UP = ("s_C", "p_min", "d", "c", "s_T", "s3", "s2", "a", "s1", "b")
QUICK = 60  # evaluations of a fit after which it is asked whether the data determine its parameters
HIGHER = {
    "a": "b",
    "s2": "s1",
    "s3": "s1",
}  # higher terms are 0 by default if the lower one is fitted


def identify(sheet: Sheet, curves: Sequence[Curve]) -> Identification:
    """Fit the law to the curves; InputError if they determine nothing or are too few, SolverFailure
    if the fit fails."""
    problem = Problem(sheet, curves)
    names, values = problem.names, true_values(DEFAULTS, sheet.balanced)
    source = dict.fromkeys(names, "Table 1 of Schäfer et al.")
    for name in names:
        for key in (base(name), name):
            if key in sheet.assumed:
                values[name], source[name] = sheet.assumed[key], "sheet.toml"
    default = np.array([values[n] for n in names])
    problem.prepare(np.array(list(true_values(DEFAULTS, sheet.balanced).values())))
    reason = {}
    for k, name in enumerate(names):
        if not math.isfinite(problem.natural[k]):
            reason[k] = "no test depends on it"
        elif base(name) == "p_min" and not problem.has_contraction(name):
            reason[k] = (
                "no test shows tension with a negative strain across; c is fitted for this value"
            )
    _check_yarns(sheet, names, reason, source)
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

    units = {n: unit_of(n) for n in names}
    bound = _at_bound(problem, theta, free, fitted)
    determined = {
        names[k]: Determined(
            float(theta[k]),
            float(e),
            tuple(np.clip([theta[k] - quantile * e, theta[k] + quantile * e], *box).tolist()),
            units[names[k]],
            float(staged[k]),
            bool(quantile * e > abs(theta[k])),
            k in bound,
        )
        for k, e, box in zip(free, error, map(problem.box, free))
    }
    assumed = {
        names[k]: Assumed(
            float(theta[k]),
            units[names[k]],
            source[names[k]],
            why,
            _moves(problem, theta, free, J, sd, k, quantile * error),
        )
        for k, why in sorted(reason.items())
    }
    value = dict(zip(names, map(float, theta)))
    warp, weft = (
        Yarn(**{n: value[n] if n in value else value[f"{yarn}.{n}"] for n in YARN})
        for yarn in ("warp", "weft")
    )
    shear: dict[str, Any] = {n: value[n] for n in SHEAR}
    fabric = WovenFabric(
        warp, weft, **shear, thickness=sheet.thickness, density=sheet.density, name=sheet.name
    )
    softest, convex = _physics(problem, fabric)
    warnings = []
    if all(c.noise for c in curves) and variance > stats.chi2.ppf(0.999, dof) / dof:
        warnings.append(
            f"the curves lie {math.sqrt(variance):.2g} times their stated noise from the law, "
            "and the intervals are widened by that"
        )
    if softest is not None and softest <= 0:
        warnings.append(f"the shear stiffness falls to {softest:.3g} MPa over the measured angles")
    if convex is False:
        warnings.append("the energy is not convex in (eps_a, eps_b) over the measured tension")
    warnings += [
        f"{n} is held by a bound from physics" for n, p in determined.items() if p.at_bound
    ]
    warnings += [
        f"{n} is weakly determined, as its interval is wider than +-100 %"
        for n, p in determined.items()
        if p.weak
    ]
    fits = [(curve, response, predicted[s], sd[s]) for (curve, response), s in problem.parts]
    warnings += filter(None, (toe_warning(*each) for each in fits))
    warnings += [*unit_warnings(curves), *fabric.plausibility_warnings()]
    return Identification(
        fabric,
        determined,
        assumed,
        correlation,
        fits,
        dof,
        variance,
        estimated,
        softest,
        convex,
        warnings,
        sheet.areal_weight,
    )


def _check_yarns(sheet, names, reason, source):
    """InputError for an unbalanced fabric of which one direction was not pulled and is not given
    otherwise."""
    if sheet.balanced:
        return
    said = {n for k, n in enumerate(names) if k not in reason or source[n] == "sheet.toml"}
    for yarn, other, i in (("warp", "weft", "a"), ("weft", "warp", "b")):
        if f"{other}.b" in said and (missing := [n for n in "ab" if f"{yarn}.{n}" not in said]):
            raise InputError(
                f"sheet.toml: balanced is false, but no test tells the {yarn}'s "
                f"{' and '.join(missing)}; "
                f"allowed is a test uniaxial_{i} or biaxial, values in [assumed.{yarn}], "
                f"or balanced = true, which gives the {yarn} the parameters of the {other}"
            )


def _moves(problem, theta, free, weighted, sd, k, half):
    """How the fitted parameters change if the assumed one k is 10 % larger: {name: change}.

    Only changes beyond `half` count, half the widths of the intervals (len(free),). weighted: the
    Jacobian of the fitted ones over the deviations, per natural change."""
    if not free or not np.isfinite(problem.natural[k]):
        return {}
    more = 0.1 * theta[k] * (problem.jacobian(theta, [k])[:, 0] / sd)
    change = -np.linalg.lstsq(weighted, more, rcond=None)[0] * problem.natural[free]
    least = np.maximum(half, 1e-3 * np.abs(theta[free]))
    return {problem.names[f]: float(c) for f, c, most in zip(free, change, least) if abs(c) > most}


def _regression(problem, default, reason, source):
    """Stage 1, stage 2 and the joint fit.

    They are repeated with one parameter less, its reason in `reason`, until the data determine all
    that is fitted. Returns values after the joint fit, after the stages, and
    the parameters that were free in it."""
    names = problem.names
    couplings = [k for k, n in enumerate(names) if base(n) not in STAGE_1]
    uncoupled = ~np.any(problem.effect[:, couplings] > 0, axis=1)
    while True:
        free = [k for k in range(len(names)) if k not in reason]
        if not free:
            tests = ", ".join(sorted({c.test for c in problem.curves}))
            raise InputError(
                f"the curves, of the tests {tests}, determine no parameter; allowed are more tests"
            )
        if len(problem.measured) <= len(free):
            raise InputError(
                f"there are {len(problem.measured)} measured values for {len(free)} parameters; "
                "allowed are more values than parameters"
            )
        theta = default.copy()
        for k in reason:
            lower = names[k].replace(base(names[k]), HIGHER.get(base(names[k]), "-"))
            if lower in names and names.index(lower) in free and source[names[k]] != "sheet.toml":
                theta[k], source[names[k]] = 0.0, "0, as the lower term alone is fitted"
        for k in free:
            if names[k] in SHEAR:  # a straight line through the largest angle
                theta[k] = problem.natural[k] if names[k] == "s1" else 0.0
        sd = problem.deviation(problem.measured)
        first = [
            k
            for k in free
            if base(names[k]) in STAGE_1 and np.any(problem.effect[uncoupled, k] > 0)
        ]
        theta = problem.fit(theta, first, sd, uncoupled)
        # tension that is coupled at every point, as with free sides alone
        lone = [k for k in free if base(names[k]) in ("a", "b") and k not in first]
        theta = problem.fit(theta, lone, sd)
        problem.rescale(theta)
        bad = problem.undetermined(
            theta, free, slack=1e3
        )  # what no values could separate; the rest is judged at the fit
        if not bad:
            rest = [k for k in free if k not in first]
            try:
                staged = problem.fit(theta, rest, sd, most=QUICK)
                theta = problem.fit(staged, free, sd, most=QUICK)
            except (
                NotConverged
            ) as stuck:  # in a valley of parameters that the data do not separate?
                bad = problem.undetermined(stuck.theta, free)
                if not bad:
                    staged = problem.fit(stuck.theta, rest, sd)
                    theta = problem.fit(staged, free, sd)
        if not bad:
            residual = (problem.predict(theta) - problem.measured) / sd
            bad = problem.undetermined(
                theta, free, sd * math.sqrt(residual @ residual / (len(residual) - len(free)))
            )
        if not bad:
            s3 = names.index("s3")
            return theta, staged, [k for k in free if k != s3 or theta[s3] > 0]
        k, half = min(bad, key=lambda item: GIVEN_UP.index(base(names[item[0]])))
        yarn = names[k].removesuffix(base(names[k]))
        rival = yarn + "p_min"
        tied = k in lone or (base(names[k]) == "c" and any(names[f] == f"{yarn}a" for f in lone))
        if tied and rival in (names[f] for f in free):
            # where all tension is coupled, little but the products p_min a and p_min b is seen
            k, why = names.index(rival), f"the data cannot tell it from {names[k]}"
        elif half > (1 if base(names[k]) == "p_min" else 1e2 * max(abs(theta[k]), abs(default[k]))):
            why = "the data cannot tell it from others"
        else:
            why = f"the data leave it at +-{half:.2g}"
        if lone and base(names[k]) == "p_min":
            why += "; a and b are fitted for this value, "
            why += "a test with held sides or a biaxial one would tell"
        reason[k] = why


def _weights(problem, theta):
    """Deviations (N,), and the noise estimated for curves that state none. It is None unless others
    state theirs: the variance of the residuals then gives it."""
    predicted = problem.predict(theta)
    silent = np.concatenate(
        [np.full(s.stop - s.start, curve.noise is None) for (curve, _), s in problem.parts]
    )
    if silent.all() or not silent.any():
        return problem.deviation(predicted), None
    estimated = max(
        float(np.sqrt(np.mean(((predicted - problem.measured) / problem.peak)[silent] ** 2))), 1e-9
    )
    return problem.deviation(predicted, estimated), estimated


def _at_bound(problem, theta, free, fitted):
    """Parameters of `free` that a bound holds."""
    x, low, high = problem._to_x(theta, fitted)
    near = {
        k for k, v, lo, hi in zip(fitted, x, low, high) if v - lo < 1e-6 or hi - v < 1e-6
    } | set(free) - set(fitted)
    shear = set(problem._shear(fitted))  # a bound on tau' holds all three
    return near | shear & set(free) if near & shear else near


def _physics(problem, fabric):
    """Smallest tau' over the measured angles [MPa], and whether W(eps_a, eps_b) is convex over the
    measured tension."""
    softest = convex = None
    if problem.angle:
        g = np.linspace(0, problem.angle, 1001)
        softest = float((fabric.s1 + (2 * fabric.s2 + 3 * fabric.s3 * g) * g).min())
    tension = problem.strains[
        (problem.strains[:, :2].max(1) > 0) & (problem.strains[:, :2].min(1) >= 0)
    ]
    if tension.size:
        # by the kernel's tangent just inside tension; the kink at 0 belongs to compression
        _, H = nominal(fabric, np.maximum(tension * [1, 1, 0], [1e-9, 1e-9, 0]), tangent=True)
        convex = bool(np.all((H[:, 0] > 0) & (H[:, 0] * H[:, 1] - H[:, 2] ** 2 > 0)))
    return softest, convex
