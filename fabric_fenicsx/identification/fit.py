"""Two-stage nonlinear regression of the law's parameters, with confidence intervals; of raw bias
tests maybe with the force of the simulated specimen."""

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats

from ..core.errors import InputError, SolverFailure
from ..core.formatting import rounded
from ..material.files import FIBRES, SHEET
from ..material.laws.coupled import SHEAR, WovenFabric, Yarn
from .curves import Curve, Sheet, curve_warnings
from .problem import NOISE, Assumed, Determined, NotConverged, Problem, base, unit_of, yarns_of
from .result import Identification
from .separate import fit_compaction, fit_friction

UNCOUPLED = "no coupling, so that held strips are not too stiff"  # source of a p_min of 1


def identify(sheet: Sheet, curves: Sequence[Curve]) -> Identification:
    """Fit the law to the curves, and compaction to the sheet's tests of it; InputError if they
    determine nothing or are too few, SolverFailure if a fit fails."""
    compaction = fit_compaction(sheet) if sheet.compaction else None
    friction = fit_friction(curves)
    problem = Problem(sheet, curves, friction.friction if friction else None)
    names, (default, source, reason) = problem.names, _assumptions(problem, sheet)
    theta, staged, fitted = _regression(problem, default, reason, source)
    theta, sd, estimated = _weighted_fit(problem, theta, fitted)
    free = [k for k in range(len(theta)) if k not in reason]
    variance, errors, halves, correlation, J = _statistics(problem, theta, free, sd)
    if estimated is None and not all(c.noise for c in curves):
        estimated = NOISE * math.sqrt(variance)
    bound, determined, dof = problem.at_bound(theta, free, fitted), {}, len(sd) - len(free)
    for k, error, half in zip(free, errors, halves):
        value = float(theta[k])
        high = value + half
        if base(names[k]) == "c":  # the larger it is the less the force depends on it
            high = max(high, value * math.exp(min(half / max(value, 1e-300), 50)))
        interval = tuple(np.clip([value - half, high], *problem.box(k)).tolist())
        how = unit_of(names[k]), float(staged[k]), bool(half > abs(value)), k in bound
        determined[names[k]] = Determined(value, float(error), interval, *how)
    assumed = {}
    for k, why in sorted(reason.items()):
        unit, moves = unit_of(names[k]), _moves(problem, theta, free, halves, J, sd, k)
        assumed[names[k]] = Assumed(float(theta[k]), unit, source[names[k]], why, moves)
    values = dict(zip(names, map(float, theta)))
    numbers: dict = {n: getattr(sheet, n) for n in ("name", *SHEET, *FIBRES)}
    numbers |= {n: values[n] for n in SHEAR} | {"assumed": tuple({*map(base, assumed)})}
    numbers |= {"compaction": compaction.compaction} if compaction else {}
    numbers |= {"shear_friction": friction and friction.friction}
    warp, weft = (Yarn(**yarn) for yarn in yarns_of(values))
    fabric = WovenFabric(warp, weft, **numbers)
    softest, convex = _physics(problem, fabric)
    predicted, lost = problem.predict(theta), not friction and any(c.back for c in curves)
    fits = [(curve, response, predicted[s], sd[s]) for (curve, response), s in problem.parts]
    warnings = [
        *(f"{curve.file}: {text}" for curve in curves for text in curve.remarks),
        *(f"{test.file}: {text}" for test in sheet.compaction for text in test.remarks),
        *_fit_warnings(problem, dof, variance, softest, convex, determined, assumed),
        *curve_warnings(curves),
        *(compaction.warnings if compaction else ()),
        *(["the loops do not determine friction between yarns; it is left out"] if lost else ()),
        *fabric.plausibility_warnings(),
    ]
    quality = correlation, fits, dof, variance, estimated, softest, convex, warnings
    others = sheet.areal_weight, compaction, friction
    result = Identification(fabric, determined, assumed, *quality, *others)
    for name, p in result.all_determined.items():
        if p.weak and name != "compaction.onset":  # forces hardly depend on it
            low, high = (rounded(end) for end in p.interval)
            warnings.append(f"{name} is weakly determined: it is from {low} to {high} {p.unit}")
    return result


def _assumptions(problem, sheet):
    """Values (parameters,) that hold unless they are fitted, their sources {name: source}, and why
    some can't be fitted {number: reason}. InputError for an unbalanced fabric of which one
    direction was neither pulled nor stated."""
    names, values = problem.names, dict(zip(problem.names, problem.start))
    source, reason = dict.fromkeys(names, "Table 1 of Schäfer et al."), {}
    for k, name in enumerate(names):
        for key in (base(name), name):
            if key in sheet.assumed:
                values[name], source[name] = sheet.assumed[key], "sheet.toml"
        contraction = problem.contraction(name) if base(name) == "p_min" else "known"
        if not math.isfinite(problem.natural[k]):
            reason[k] = "no test depends on it"
        elif not contraction:
            reason[k] = "no test has tension with a negative transverse strain; "
            reason[k] += "c is fitted for this value"
        elif contraction == "form":
            # of all that follow free strips the value with which held ones are softest: k_TC <= 1
            reason[k] = "tests of free strips without transverse strain do not determine it"
            if source[name] != "sheet.toml":
                values[name], source[name] = 1.0, UNCOUPLED
    known = {n for k, n in enumerate(names) if k not in reason or source[n] == "sheet.toml"}
    for yarn, other, i in (("warp", "weft", "a"), ("weft", "warp", "b")):
        missing = [n for n in "ab" if f"{yarn}.{n}" not in known]
        if not sheet.balanced and missing and f"{other}.b" in known:
            flaw = f"balanced is false, but no test determines the {yarn}'s {' and '.join(missing)}"
            raise InputError(
                f"sheet.toml: {flaw}; expected a test uniaxial_{i} or biaxial, values in "
                f"[assumed.{yarn}], or balanced = true, which gives the {yarn} those of the {other}"
            )
    return np.array([values[n] for n in names]), source, reason


def _weighted_fit(problem, theta, fitted):
    """Values fitted again while deviations (N,) depend on the fit, these, and the noise estimated
    for curves that state none. It is None unless others state theirs: the variance of the residuals
    then gives it."""
    points, kinds = problem.points, {curve.noise and curve.noise[0] for curve in problem.curves}
    estimated, is_estimated = None, None in kinds and len(kinds) > 1
    for left in reversed(range(4 if is_estimated or "value" in kinds else 1)):
        predicted = problem.predict(theta)
        if is_estimated:
            share = (predicted - points.measured) / points.peak
            silent = [share[s] for (curve, _), s in problem.parts if curve.noise is None]
            estimated = max(float(np.sqrt(np.mean(np.concatenate(silent) ** 2))), 1e-9)
        sd = problem.deviation(predicted, estimated or NOISE)
        theta = problem.fit(theta, fitted, sd) if left else theta
    return theta, sd, estimated


def _statistics(problem, theta, free, sd):
    """Variance of the weighted residuals, and for the parameters `free` (k,): standard errors, half
    widths of the 95 % intervals, correlation (k, k), and the weighted Jacobian (N, k), for natural
    changes."""
    residual, natural = problem.residual(theta, sd), problem.natural[free]
    dof = len(residual) - len(free)
    variance = float(residual @ residual) / dof
    J = problem.jacobian(theta, free) * natural / sd[:, None]
    inverse = np.linalg.inv(np.linalg.qr(J, "r"))
    covariance = inverse @ inverse.T  # over the variance
    spread = np.sqrt(np.diag(covariance))
    error = math.sqrt(variance) * spread * natural
    half = stats.t.ppf(0.975, dof) * error
    return variance, error, half, covariance / np.outer(spread, spread), J


def _moves(problem, theta, free, half, J, sd, k):
    """Changes {name: change} of fitted parameters, beyond half intervals, by 10 % more of k."""
    if not free or not np.isfinite(problem.natural[k]):
        return {}
    more = 0.1 * theta[k] * (problem.jacobian(theta, [k])[:, 0] / sd)
    change = -np.linalg.lstsq(J, more, rcond=None)[0] * problem.natural[free]
    least = np.maximum(half, 1e-3 * np.abs(theta[free]))
    return {problem.names[f]: float(c) for f, c, most in zip(free, change, least) if abs(c) > most}


def _physics(problem, fabric):
    """Smallest tau' over the measured angles [MPa]; whether W is convex in measured tension."""
    softest = convex = None
    if angle := problem.points.angle:
        g = np.linspace(0, angle, 1001)
        softest = float((fabric.s1 + (2 * fabric.s2 + 3 * fabric.s3 * g) * g).min())
    e = problem.points.strains
    tension = e[(e[:, :2].max(1) > 0) & (e[:, :2].min(1) >= 0)]
    if tension.size:
        # by the kernel's tangent just inside tension; the kink at 0 belongs to compression
        inside = np.maximum(tension * [1, 1, 0], [1e-9, 1e-9, 0])
        aa, ab, bb, *_ = fabric.derivatives(*inside.T).second
        convex = bool(np.all((aa > 0) & (aa * bb - ab**2 > 0)))
    return softest, convex


def _fit_warnings(problem, dof, variance, softest, convex, determined, assumed):
    limit = stats.chi2.ppf(0.999, dof) / dof
    if all(c.noise for c in problem.curves) and variance > limit:
        times = rounded(math.sqrt(variance), 2)
        text = f"the curves deviate from the law by {times} times their stated noise"
        yield f"{text}, and the intervals are widened accordingly"
    if softest is not None and softest <= 0:
        yield f"the shear stiffness falls to {rounded(softest)} MPa over the measured angles"
    if convex is False:
        yield "the energy is not convex in (eps_a, eps_b) over the measured tension"
    for name, value in assumed.items():
        if value.source == UNCOUPLED:
            yield (
                f"{name} is set to 1, because strips were pulled with free sides and without the "
                "transverse strain: held strips may be too soft, and strips do not neck; measure "
                "the transverse strain (eps_a or eps_b), or hold the sides"
            )
    if held := [name for name, p in determined.items() if p.at_bound]:
        are = f"{'is' if len(held) == 1 else 'are'} at a physical bound"
        yield f"{', '.join(held)} {are}, e.g. a stiffness of 0, so their intervals are approximate"


def _regression(problem, default, reason, source):
    """Stage 1, stage 2 and the joint fit.

    They are repeated with one parameter less, its reason in `reason`, until the data determine all
    that is fitted. Returns values after the joint fit, after the stages, and the parameters that
    were free in it. InputError if there are none, or more than measured values."""
    names, couplings = problem.names, ("c", "p_min", "s_T", "s_C")
    coupled = [k for k, n in enumerate(names) if base(n) in couplings]
    uncoupled = ~np.any(problem.effect[:, coupled] > 0, axis=1)
    while True:
        free = [k for k in range(len(names)) if k not in reason]
        if not free:
            tests = ", ".join(sorted({c.test for c in problem.curves}))
            flaw = f"the curves, of the tests {tests}, determine no parameter"
            raise InputError(f"{flaw}; expected more tests")
        if (count := len(problem.points.measured)) <= len(free):
            flaw = f"there are {count} measured values for {len(free)} parameters"
            raise InputError(f"{flaw}; expected more values")
        theta = _start(problem, default, reason, source, free)
        sd = problem.deviation(problem.points.measured)
        seen = np.any(problem.effect[uncoupled] > 0, axis=0)
        first = [k for k in free if k not in coupled and seen[k]]
        theta = problem.fit(theta, first, sd, uncoupled)
        # tension that is coupled at every point, as with free sides alone
        lone = [k for k in free if base(names[k]) in ("a", "b") and k not in first]
        theta = problem.fit(theta, lone, sd)
        problem.rescale(theta)
        rest = [k for k in free if k not in first]
        theta, staged, bad = _joint_fit(problem, theta, free, rest, sd)
        if not bad:
            s3 = names.index("s3")
            return theta, staged, [k for k in free if k != s3 or theta[s3] > 0]
        k, why = _given_up(names, bad, free, lone, np.maximum(abs(theta), abs(default)))
        reason[k] = why


def _start(problem, default, reason, source, free):
    """Values that a fit begins with: 0, as `source` then says, for higher terms than are fitted."""
    names, theta = problem.names, default.copy()
    lower_terms = {"a": "b", "s2": "s1", "s3": "s1"}
    for k in reason:
        lower = names[k].replace(base(names[k]), lower_terms.get(base(names[k]), "-"))
        if lower in names and names.index(lower) in free and source[names[k]] != "sheet.toml":
            theta[k], source[names[k]] = 0.0, "0, as the lower term alone is fitted"
    for k in free:
        if names[k] in SHEAR:  # a straight line through the largest angle
            theta[k] = problem.natural[k] if names[k] == "s1" else 0.0
    return theta


def _joint_fit(problem, theta, free, rest, sd):
    """Stage 2, of the parameters `rest`, and the fit of all that are free: values after it, those
    before it, and what the data do not determine, as `Problem.undetermined` has it."""
    # what no values could separate; the rest is judged at the fit
    if bad := problem.undetermined(theta, free, slack=1e3):
        return theta, theta, bad
    try:
        staged = problem.fit(theta, rest, sd)
        theta = problem.fit(staged, free, sd)
    except NotConverged as stuck:  # in a valley of parameters that the data do not separate?
        if bad := problem.undetermined(stuck.theta, free):
            return theta, theta, bad
        raise
    residual = problem.residual(theta, sd)
    variance = residual @ residual / (len(residual) - len(free))
    return theta, staged, problem.undetermined(theta, free, sd * math.sqrt(variance))


def _given_up(names, bad, free, lone, size):
    """The parameter in `bad` that becomes an assumption, and why; lone: those of tension that is
    coupled at every point; size: of all parameters."""
    first = ("s_C", "p_min", "d", "c", "s_T", "s3", "s2", "a", "s1", "b")
    k, half = min(bad, key=lambda item: first.index(base(names[item[0]])))
    yarn = names[k].removesuffix(base(names[k]))
    rival = yarn + "p_min"
    tied = k in lone or (base(names[k]) == "c" and any(names[f] == f"{yarn}a" for f in lone))
    if tied and rival in (names[f] for f in free):
        # where all tension is coupled, little but the products p_min a and p_min b is seen
        k, why = names.index(rival), f"the data cannot distinguish it from {names[k]}"
    elif half > (1 if base(names[k]) == "p_min" else 1e2 * size[k]):
        why = "the data cannot distinguish it from others"
    else:
        why = f"the data determine it only to +-{rounded(half, 2)}"
    if lone and base(names[k]) == "p_min":
        why += "; a and b are fitted for this value, "
        why += "a biaxial test, or one with held sides, would determine it"
    return k, why


# Force (n,) [N] of the specimen of a raw bias test at its displacements, and its derivatives (n, 3)
# by s1, s2, s3 [N/MPa], as of `coupons.simulated.simulated_bias`.
Simulate = Callable[[WovenFabric, Curve], tuple[np.ndarray, np.ndarray]]


def identify_simulated(sheet: Sheet, curves: Sequence[Curve], simulate: Simulate) -> Identification:
    """As `identify`, with the specimens of raw bias tests simulated: no formula has to be trusted
    that makes an angle of a displacement and a stress of a force.

    The first fit is of homogeneous shear. Each other one takes forces as linear in s1, s2, s3 about
    the last values (Gauss-Newton). Where a specimen cannot be simulated, or its forces do not
    settle, the result is the first fit, with a warning.
    """
    start, raw = identify(sheet, curves), [curve for curve in curves if curve.is_raw]
    fit, first = start, dict[str, float]()
    try:
        for _ in range(8 if raw else 0):
            forces = {curve.file: simulate(fit.fabric, curve) for curve in raw}
            off, change = {}, 0.0
            for curve, response, expected, _ in fit.fits:
                if curve.is_raw:
                    force, peak = forces[curve.file][0], response.peak
                    off[curve.file] = float(np.sqrt(np.mean((force - response.values) ** 2)) / peak)
                    change = max(change, np.abs(force - expected).max() / peak)
            if first and change < 2e-3:  # of the peak
                shear = {name: getattr(start.fabric, name) for name in SHEAR}
                details = {"homogeneous": shear, "off_homogeneous": first, "off": off}
                return dataclasses.replace(fit, simulated=details)
            first = first or off
            fit = identify(sheet, [_linear(curve, fit.fabric, forces) for curve in curves])
        failure = "its force did not converge in 8 fits"
    except SolverFailure as error:
        failure = str(error)
    words = f"a bias test could not be simulated: {failure}; the fit is of homogeneous shear"
    return dataclasses.replace(start, warnings=[*start.warnings, words]) if raw else start


def _linear(curve, fabric, forces):
    """A raw bias test, its force linear about that of the simulated specimen; others unchanged."""
    if not curve.is_raw:
        return curve
    force, slopes = forces[curve.file]
    rest = force - slopes @ [getattr(fabric, name) for name in SHEAR]
    (response,) = curve.responses
    response = dataclasses.replace(response, half=None, linear=np.column_stack([rest, slopes]))
    return dataclasses.replace(curve, responses=(response,))
