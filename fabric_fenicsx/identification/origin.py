"""Where a measured curve begins: the slack of its specimen, and the zero of its load cell."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from .curves import MIN_POINTS, Curve
from .curves.forces import of_fabric, response
from .curves.model import Origin

LEAST_POINTS = 12  # of a test that tells where it begins
TRIALS = 61  # values of the slack that are tried, and tried again where it is likely


def with_origins(curves: Sequence[Curve], thickness: float) -> list[Curve]:
    """The curves from where they begin, with a remark where nothing tells slack or zero."""
    is_rubbed = any(curve.back for curve in curves)
    return [
        _with_origin(curve, thickness, is_rubbed) if curve.unknown else curve for curve in curves
    ]


def _with_origin(curve, thickness, is_rubbed):
    x = _abscissa(curve)
    why = "friction, which loops show, looks like them" if is_rubbed else ""
    if x[0] > 0.1 * x[-1]:
        why = f"it begins at {100 * x[0] / x[-1]:.0f} % of its way"
    elif len(x) < LEAST_POINTS:
        why = f"it has {len(x)} points, and {LEAST_POINTS} would tell"
    if why:
        unknown = " and ".join(curve.unknown)
        lines = " and ".join(f"`# {name}: 0 {_unit(curve, name)}`" for name in curve.unknown)
        text = f"nothing tells its {unknown}, taken as 0, as {why}; state {lines} if that is right"
        return replace(curve, unknown=(), remarks=(*curve.remarks, text))
    return _fitted(curve, thickness)


def _abscissa(curve):
    """What the slack is a part of: displacements [mm] or shear angles [rad]."""
    return curve.strains[:, 2] if curve.displacement is None else curve.displacement


def _unit(curve, name):
    return "N" if name == "zero" else "deg" if curve.displacement is None else "mm"


def _strain(curve, x, thickness):
    """Strains at displacements or angles x from the end of the slack."""
    if curve.displacement is None:
        return x
    return of_fabric("displacement", x, curve.test, curve.keys, thickness)


def _fitted(curve, thickness):
    """Least squares in slack, zero and the stiffness of the specimen, a power series.

    Points weigh by the scatter of their neighbours and 3 % of the force: so a law that is off at
    the peak does not move the beginning. Intervals of 95 % follow the sum of squares over the
    slack, of which the force is not a linear function. What may be 0 by its interval is taken as 0,
    and widens those of the parameters all the same.
    """
    x, y = _abscissa(curve), curve.responses[0].values
    powers, has_zero = min(5, len(y) // 4), "zero" in curve.unknown  # the law has fewer
    noise = np.median(np.abs(np.diff(y, 4))) / 5.64  # where it is normal
    scatter = max(noise, 1e-4 * np.abs(y).max())  # to which a load cell is right at best

    def columns(slack):
        e = _strain(curve, np.maximum(x - slack, 0.0), thickness)
        force = response(curve.responses[0].column, y, e, curve.test, curve.keys, thickness)
        half = 0.0 if force.half is None else force.half
        series = [force.gain * e**k + half * (e / 2) ** k for k in range(1, powers + 1)]
        return np.column_stack([np.full(len(x), float(has_zero)), *series])

    def fit(slack, A, sd):
        """Sum of squares, slack, zero, its standard error, and the force of the specimen."""
        scaled = A / sd[:, None]
        inverse = np.linalg.pinv(scaled)
        values = inverse @ (y / sd)
        off = scaled @ values - y / sd
        return off @ off, slack, values[0], np.linalg.norm(inverse[0]), A[:, 1:] @ values[1:]

    def likely(fits):
        """The fits in the interval of the slack, and the largest sum of squares there."""
        dof = len(y) - powers - len(curve.unknown)
        best = min(fits)[0]
        most = best + max(best / dof, 1.0) * stats.t.ppf(0.975, dof) ** 2
        return [each for each in fits if each[0] <= most], most

    slacks = np.linspace(0.0, min(0.5 * x[-1], x[-MIN_POINTS - powers]), TRIALS)
    slacks = slacks if "slack" in curve.unknown else np.zeros(1)
    force, tried = y, [(slack, columns(slack)) for slack in slacks]
    for _ in range(3):
        sd = np.hypot(scatter, 0.03 * np.abs(force))
        fits = [fit(*each, sd) for each in tried]
        force = min(fits, key=lambda each: each[0])[-1]
    if len(slacks) > 1:
        near, step = [each[1] for each in likely(fits)[0]], slacks[1]
        finer = np.linspace(max(near[0] - step, 0.0), near[-1] + step, TRIALS)
        fits = [fit(slack, columns(slack), sd) for slack in finer]
    near, most = likely(fits)
    kept = near if near[0][1] else near[:1]
    spans = [np.sqrt(most - each[0]) * each[3] for each in near]
    lows, highs = zip(*((each[2] - span, each[2] + span) for each, span in zip(kept, spans)))
    intervals = {"slack": (near[0][1], near[-1][1]), "zero": (min(lows), max(highs))}
    told = [name for name in curve.unknown if intervals[name][0] > 0 or intervals[name][1] < 0]
    has_zero = "zero" in told
    _, slack, zero, *_ = min(fit(each[1], columns(each[1]), sd) for each in kept)
    ends = [(near[k][1] - slack, near[k][2] - zero) for k in (0, -1)]
    per = {"zero": curve.per_newton, "slack": np.pi / 180 if curve.displacement is None else 1.0}
    numbers = {}
    for name, value in (("slack", slack), ("zero", zero)):
        if name in told:
            three = (float(each / per[name]) for each in (value, *intervals[name]))
            numbers[f"{name} of {curve.file}"] = *three, _unit(curve, name)
    begun = _from(curve, slack, zero, thickness)
    return replace(begun, origin=Origin(numbers, ends, float(max(spans))), unknown=())


def _from(curve, slack, zero, thickness):
    """The curve without its slack and zero."""
    x = _abscissa(curve)
    kept = x > slack if slack else np.full(len(x), True)
    x, strains = x[kept] - slack, curve.strains[kept].copy()
    strains[:, curve.abscissa] = _strain(curve, x, thickness)
    test = strains[:, 2], curve.test, curve.keys, thickness
    offsets = zero, *[0.0] * len(curve.responses[1:])
    responses = (
        response(each.column, each.values[kept] - offset, *test)
        for each, offset in zip(curve.responses, offsets)
    )
    moved = None if curve.displacement is None else x
    new = {"strains": strains, "responses": tuple(responses), "rows": curve.rows[kept]}
    return replace(curve, **new, displacement=moved)


def effects(curve: Curve, origin: Origin, predicted: np.ndarray, index: int) -> list[np.ndarray]:
    """Changes (n,) of response `index` of a curve, of which `predicted` (n,) is fitted, that
    moving its origin makes: to both ends of the slack, and by half the interval of the zero."""
    x = _abscissa(curve)
    at, first = np.unique(x, return_index=True)
    slope = np.interp(x, at, np.gradient(predicted[first], at))
    has_zero = float(index == 0)
    moved = [slope * slack - has_zero * zero for slack, zero in origin.ends]
    return [*moved, np.full(len(x), has_zero * origin.half)]
