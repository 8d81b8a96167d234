"""The parameters of the law, residuals of test curves in them, and what the curves determine."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from scipy.optimize import least_squares

from ..core.errors import InputError, SolverFailure
from ..material.friction import ShearFriction
from ..material.homogeneous import lateral_strain, nominal
from ..material.laws.coupled import SHEAR, YARN, WovenFabric
from ..material.presets import PRESETS
from .curves import Curve, Response, Sheet

DEFAULTS = PRESETS["komeili"]  # Table 1; d, p_min and s_C were assumed there, too
NOISE = 0.01  # share of each peak: noise at which the data must determine a parameter


def names_of(balanced: bool) -> tuple[str, ...]:
    """Names of the parameters: 10 if balanced, otherwise 17."""
    yarns = YARN if balanced else [f"{yarn}.{name}" for yarn in ("warp", "weft") for name in YARN]
    return (*yarns, *SHEAR)


def base(name: str) -> str:
    """A parameter's name without its yarn."""
    return name.rpartition(".")[2]


def unit_of(name: str) -> str:
    """Unit of a parameter, "-" of a number."""
    return "MPa" if (YARN | SHEAR)[base(name)].unit else "-"


def true_values(fabric: WovenFabric, balanced: bool) -> dict[str, float]:
    """Parameters of `fabric` by the names used here: 10 if balanced, otherwise 17 with warp. and
    weft. before the yarns'."""
    return {
        name: getattr(getattr(fabric, yarn or "warp") if own in YARN else fabric, own)
        for name in names_of(balanced)
        for yarn, _, own in [name.rpartition(".")]
    }


def yarns_of(values: Mapping[str, float]) -> list[dict[str, float]]:
    """Parameters of warp and of weft in `values` by the names used here."""
    return [
        {n: values[n] if n in values else values[f"{yarn}.{n}"] for n in YARN}
        for yarn in ("warp", "weft")
    ]


@dataclass(frozen=True)
class Determined:
    """A fitted parameter: value, standard error and 95 % interval (t-distribution, from the
    linearised joint fit, bounds not applied; upwards that of c is at least as wide in its
    logarithm), all in `unit`; two_stage: its value before the joint fit; weak: the interval is
    wider than +-100 %; at_bound: a bound from physics holds it, so the interval is a rough guide.
    """

    value: float
    standard_error: float
    interval: tuple[float, float]
    unit: str
    two_stage: float
    weak: bool
    at_bound: bool


@dataclass(frozen=True)
class Assumed:
    """A parameter that was not fitted: value in `unit`, where that is from, and why the data don't
    determine it.

    moves: changes of fitted parameters, in their units, if this one were 10 % larger. Only those
    beyond half the width of their intervals are listed: the intervals hold for the assumed values.
    """

    value: float
    unit: str
    source: str
    reason: str
    moves: dict[str, float]

    def __str__(self) -> str:
        moves = [f"{n} by {v:+.3g} {unit_of(n)}".removesuffix(" -") for n, v in self.moves.items()]
        more = f"; 10 % more of it changes {', '.join(moves)}" if moves else ""
        return f"assumed ({self.source}): {self.reason}{more}"


def numbers_report(determined: Mapping[str, Determined], assumed: Mapping[str, Assumed]) -> dict:
    """Fitted and assumed numbers {name: number} for JSON."""
    found = {name: asdict(number) for name, number in determined.items()}
    return {"determined": found, "assumed": {n: asdict(each) for n, each in assumed.items()}}


class NotConverged(SolverFailure):
    """A fit that gave up at the parameters `theta`."""

    def __init__(self, message: str, theta: np.ndarray) -> None:
        super().__init__(message)
        self.theta = theta


class Points:
    """The N values `measured` by the parts [(curve, response)], and the `peak` of the column of
    each (N,), its `component` and `strains` (N, 3), and `along` (N,): the yarns 0 or 1 that are
    pulled with free sides, else -1. friction: between yarns, which they move for the first time."""

    def __init__(
        self, parts: Sequence[tuple[Curve, Response]], friction: ShearFriction | None
    ) -> None:
        def joined(value):
            """A number of each part or of each of its points, (N,)."""
            return np.concatenate([np.broadcast_to(value(c, r), r.values.shape) for c, r in parts])

        self.measured = joined(lambda _, response: response.values)
        self.peak = joined(lambda _, response: response.peak)
        self.component = joined(lambda _, response: response.component)
        self.along = joined(lambda curve, _: -1 if curve.free is None else curve.free)
        self.strains = np.concatenate([curve.strains for curve, _ in parts])
        self._gain = joined(lambda _, response: response.gain)
        self._half = joined(lambda _, response: 0.0 if response.half is None else response.half)
        # (N, 4), of 1, s1, s2, s3: friction, or all of a simulated specimen
        linear = [np.zeros((len(r.values), 4)) if r.linear is None else r.linear for _, r in parts]
        self._linear, simulated = np.concatenate(linear), joined(lambda _, r: r.linear is not None)
        self._gain = np.where(simulated, 0.0, self._gain)
        if friction:
            at = np.flatnonzero((self.component == 2) & ~simulated)
            for share, gain in ((1.0, self._gain), (0.5, self._half)):
                rubbed = friction.respond(share * self.strains[at, 2], np.zeros(1)).stress
                self._linear[at, 0] += gain[at] * rubbed
        # points under free tension, and where to start the strain across
        places = {along: np.flatnonzero(self.along == along) for along in (0, 1)}
        self.free = {along: (at, np.zeros(at.size)) for along, at in places.items() if at.size}

    @property
    def angle(self) -> float:
        """Largest shear angle under a measured shear force [rad]."""
        return float(np.abs(self.strains[self.component == 2, 2]).max(initial=0.0))

    def predict(self, fabric: WovenFabric) -> np.ndarray:
        """The law's prediction of every measured value, (N,)."""
        strains, halves = self.strains.copy(), np.flatnonzero(self._half)
        for along, (points, start) in self.free.items():
            across = lateral_strain(fabric, along, strains[points, along], start)
            strains[points, 1 - along] = start[:] = across  # near that of the next parameters
        at_half = strains[halves] * [1, 1, 0.5]
        stress, N = nominal(fabric, np.concatenate([strains, at_half])), len(strains)
        across = np.where(self.along == 0, strains[:, 1], strains[:, 0])
        value = self._gain * np.column_stack([stress[:N], across])[np.arange(N), self.component]
        value[halves] += self._half[halves] * stress[N:, 2]
        return value + self._linear @ [1.0, fabric.s1, fabric.s2, fabric.s3]


class Problem:
    """Residuals of all curves in the parameters `names` (10 or 17), with all N `points` in one call
    of the kernel; friction: between yarns, which they move for the first time.

    parts: [((curve, response), slice of its points)]; natural, effect: see `rescale`; start: the
    values at which the fit begins."""

    def __init__(
        self, sheet: Sheet, curves: Sequence[Curve], friction: ShearFriction | None = None
    ) -> None:
        self.names, self.thickness, self.curves = names_of(sheet.balanced), sheet.thickness, curves
        if not curves:
            raise InputError("there is no curve; expected one or more")
        parts = [(curve, response) for curve in curves for response in curve.responses]
        ends = np.cumsum([len(response.values) for _, response in parts])
        self.parts = [(p, slice(end - len(p[1].values), end)) for p, end in zip(parts, ends)]
        self.points = Points(parts, friction)
        self.start = np.array([*true_values(DEFAULTS, sheet.balanced).values()])
        self.natural = np.full(len(self.start), np.inf)
        self.rescale(self.start)

    def material(self, theta: np.ndarray) -> WovenFabric:
        """A fabric without its checks, so that derivatives can be taken at bounds."""
        values, fabric = dict(zip(self.names, theta)), DEFAULTS.symbols(float)
        vars(fabric).update({n: values[n] for n in SHEAR}, thickness=self.thickness)
        for yarn, numbers in zip((fabric.warp, fabric.weft), yarns_of(values)):
            vars(yarn).update(numbers)
        return fabric

    def residual(self, theta: np.ndarray, sd: np.ndarray) -> np.ndarray:
        """Predicted less measured values over their deviations, (N,)."""
        return (self.predict(theta) - self.points.measured) / sd

    def predict(self, theta: np.ndarray) -> np.ndarray:
        """The law's prediction of every measured value, (N,)."""
        return self.points.predict(self.material(theta))

    def sizes(self, theta: np.ndarray) -> np.ndarray:
        """A large change of each parameter, (len(theta),)."""
        natural = np.where(np.isfinite(self.natural), 1e-3 * self.natural, 0)
        return np.max([np.abs(theta), np.abs(self.start), natural], 0)

    def jacobian(self, theta: np.ndarray, free: Sequence[int]) -> np.ndarray:
        """d(predict)/d(theta) (N, len(free)) by central differences."""
        steps = 1e-5 * np.diag(self.sizes(theta))
        pairs = [(self.predict(theta + steps[k]), self.predict(theta - steps[k])) for k in free]
        columns = [(high - low) / (2 * steps[k, k]) for k, (high, low) in zip(free, pairs)]
        return np.array(columns).T.reshape(len(self.points.measured), len(free))

    def rescale(self, theta: np.ndarray) -> None:
        """Set `effect` (N, len(theta)), of each parameter on each value over its peak, and from it
        `natural`: the change of each parameter that moves a response by its peak."""
        effect = np.abs(self.jacobian(theta, range(len(theta))) / self.points.peak[:, None])
        # 1e-9 of the peak for a large change is rounding, which differs from machine to machine
        effect[(effect < 1e-7 * effect.max(0)) | (effect * self.sizes(theta) < 1e-9)] = 0
        most = effect.max(0)
        self.natural = np.where(most > 0, 1 / np.where(most > 0, most, 1), self.natural)
        self.effect = effect

    def deviation(self, predicted: np.ndarray, common: float = NOISE) -> np.ndarray:
        """Standard deviations (N,): as the curves state them, else `common` times the peaks."""
        peak = self.points.peak
        sd = common * peak
        for (curve, response), s in self.parts:
            if curve.noise:
                values = np.maximum(np.abs(predicted[s]), 0.05 * peak[s])
                sd[s] = response.deviation(curve.noise, values)
        return sd

    def contraction(self, name: str) -> str:
        """What shows tension of the yarns of the p_min `name` under a negative strain across: ""
        for nothing; "form" if that of free tests alone, none of which has the strain across, and no
        test of those yarns in tension prescribes it; else "known"."""
        p, yarns = self.points, {"warp": [0], "weft": [1]}.get(name.rpartition(".")[0], [0, 1])
        e, is_stress = p.strains, p.component < 2
        narrowed = [(e[:, i] > 0) & (e[:, 1 - i] < 0) & is_stress for i in yarns]
        if not (np.any(narrowed) or {*yarns} & {*p.free}):
            return ""
        held, measured = is_stress & (p.along < 0), p.component == 3
        known = [held & (e[:, i] > 0) | measured & (p.along == i) for i in yarns]
        return "known" if np.any(known) else "form"

    def undetermined(
        self, theta: np.ndarray, free: list[int], sd: float | np.ndarray = 0.0, slack: float = 1.0
    ) -> list[tuple[int, float]]:
        """The parameters among `free` that the data do not determine, as pairs of index and
        half-width.

        The half-width is that of the 95 % interval at the noise `sd`, but at least NOISE. It is too
        large above `slack` times both the value and its natural change (p_min: above 0.5)."""
        weight = np.maximum(sd, NOISE * self.points.peak)
        J = self.jacobian(theta, free) * self.natural[free] / weight[:, None]
        _, s, Vt = np.linalg.svd(J, full_matrices=len(free) > len(J))
        s = np.maximum(np.pad(s, (0, len(free) - len(s))), 1e-8 * s.max())
        half = 1.96 * np.sqrt(((Vt.T / s) ** 2).sum(1)) * self.natural[free]
        size = np.maximum(np.abs(theta), self.natural)
        limit = [0.5 if base(self.names[k]) == "p_min" else size[k] for k in free]
        return [(k, h) for k, h, most in zip(free, half, limit) if h > slack * most]

    def box(self, k: int) -> tuple[float, float]:
        """Least and greatest value of parameter k that a fit takes: bounds from physics, and c no
        larger than the measured strains can show."""
        name, extent = base(self.names[k]), np.abs(self.points.strains[:, :2]).max()
        low = {"s2": -np.inf}.get(name, 1e-9 * self.natural[k] if name in ("b", "d", "s1") else 0.0)
        return low, {"p_min": 1.0, "c": 50 / max(extent, 1e-3)}.get(name, np.inf)

    def at_bound(self, theta: np.ndarray, free: list[int], fitted: list[int]) -> set[int]:
        """Parameters of `free` that a bound holds, or that are not among the `fitted` ones."""
        x, low, high = self._to_x(theta, fitted)
        held = (x - low < 1e-6) | (high - x < 1e-6)
        near = {k for k, at in zip(fitted, held) if at} | set(free) - set(fitted)
        shear = set(self._shear(fitted))  # a bound on tau' holds all three
        return near | shear & set(free) if near & shear else near

    def _shear(self, free):
        """The shear parameters that are fitted through tau' at points of [0, angle]."""
        place = [self.names.index(n) for n in SHEAR]
        return place if place[0] in free and place[1] in free else []

    def _to_x(self, theta, free):
        """Scaled unknowns. Shear goes through tau' = c0 (1-x)^2 + 2 c1 x (1-x) + c2 x^2, x =
        gamma/angle, which is positive on all of [0, angle] exactly if c0, c2 > 0 and c1 > -sqrt(c0
        c2): bounds on c0, c1/sqrt(c0 c2) and c2."""
        x = np.array([theta[k] / self.natural[k] for k in free])
        low, high = np.array([self.box(k) for k in free]).T
        if any(base(self.names[k]) == "d" for k in free):
            # at p_min = 1 only d / (1 - p_min) counts, d goes to 0, and no interval can be taken
            most = [0.99 if base(self.names[k]) == "p_min" else np.inf for k in free]
            high = np.minimum(high, most)
        low, high = low / self.natural[free], high / self.natural[free]
        if place := self._shear(free):
            G, (s1, s2, s3) = self.points.angle, theta[place]
            c0, c1, c2 = s1, s1 + s2 * G, s1 + 2 * s2 * G + 3 * s3 * G**2
            unit = self.natural[place[0]]
            i, j = free.index(place[0]), free.index(place[1])
            low[[i, j]], high[[i, j]] = 1e-3, np.inf  # of a straight line: 0 is hardly reached
            x[[i, j]] = c0 / unit, c2 / unit
            if place[2] in free:
                m = free.index(place[2])
                x[m], low[m], high[m] = c1 / math.sqrt(c0 * max(c2, 1e-9 * unit)), -0.999, np.inf
        return x, low, high

    def _from_x(self, x, theta, free):
        theta = theta.copy()
        theta[free] = x * self.natural[free]
        if place := self._shear(free):
            G, unit = self.points.angle, self.natural[place[0]]
            c0, c2 = x[free.index(place[0])] * unit, x[free.index(place[1])] * unit
            if place[2] in free:
                c1 = x[free.index(place[2])] * math.sqrt(c0 * c2)
                theta[place] = c0, (c1 - c0) / G, (c0 - 2 * c1 + c2) / (3 * G**2)
            else:
                theta[place[:2]] = c0, (c2 - c0 - 3 * theta[place[2]] * G**2) / (2 * G)
        return theta

    def fit(
        self,
        theta: np.ndarray,
        free: list[int],
        sd: np.ndarray,
        rows: np.ndarray | slice = slice(None),
    ) -> np.ndarray:
        """theta with `free` fitted to the values `rows`; NotConverged after 300 evaluations."""
        if not free:
            return theta
        x, low, high = self._to_x(theta, free)
        margin = np.minimum(1e-3, 1e-3 * (high - low))
        result = least_squares(
            lambda x: self.residual(self._from_x(x, theta, free), sd)[rows],
            np.clip(x, low + margin, high - margin),
            bounds=(low, high),
            x_scale="jac",
            **dict.fromkeys(("ftol", "xtol", "gtol"), 1e-12),
            max_nfev=300,
        )
        theta = self._from_x(result.x, theta, free)
        if result.status <= 0:
            fitted = ", ".join(self.names[k] for k in free)
            failure = f"the fit of {fitted} did not converge in {result.nfev} evaluations"
            raise NotConverged(failure, theta)
        s3 = self.names.index("s3")
        if s3 in free and theta[s3] < 0:  # the law allows none; refit on the bound
            theta[s3] = 0.0
            return self.fit(theta, [k for k in free if k != s3], sd, rows)
        return theta
