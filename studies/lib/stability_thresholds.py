"""Strains, parameters and shear angles from which the law loses convexity and ellipticity.

What can be done with `material.stability` at states, sought along paths of yarn strains.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from fabric_fenicsx.material import stability
from fabric_fenicsx.material.homogeneous import lateral_strain
from fabric_fenicsx.material.laws.coupled import WovenFabric

LOW, HIGH = -0.20, 0.08  # yarn strains of the maps
EPS_A = 0.03  # the paper's tests end here; up to it the worst tension-compression state is sought
REACH_AT = 0.025  # eps_a at which the reach in tension-compression is reported
DEEPEST = -0.60
P_MIN = (0.0, 0.1, 0.25, 0.4, 0.5, 0.75, 1.0)
INDICATORS = "convexity", "ellipticity"
SOFTEST_SHEAR = 0.111  # rad, where Table 1's fabric resists shear least


def first_loss(
    value: Callable[[np.ndarray], np.ndarray], start: ArrayLike, end: ArrayLike, samples: int = 500
) -> np.ndarray:
    """First negative `value` between `start` and `end`, (n,), nan where there is none.

    value: function of parameters (n, k) to values (n, k); start, end: (n,) or numbers. Bisected to
    rounding after a scan of `samples`.
    """
    first, last = (np.atleast_1d(np.asarray(v, float))[:, None] for v in (start, end))
    s = first + (last - first) * np.linspace(0, 1, samples)
    lost = value(s) < 0
    k = lost.argmax(1)[:, None]
    low, high = np.take_along_axis(s, np.maximum(k - 1, 0), 1), np.take_along_axis(s, k, 1)
    for _ in range(50):
        middle = (low + high) / 2
        bad = value(middle) < 0
        low, high = np.where(bad, low, middle), np.where(bad, middle, high)
    return np.where(lost.any(1), high[:, 0], np.nan)


def compression_reach(fabric: WovenFabric, eps_a: ArrayLike, indicator: str) -> np.ndarray:
    """eps_b to which the region that begins at eps_b = 0- goes, at each eps_a (n,), (n,); nan where
    none begins, -inf where it has no end above DEEPEST."""

    def value(eps_b):
        e = np.broadcast_to(np.reshape(eps_a, (-1, 1)), eps_b.shape)
        if indicator == "convexity":
            return stability.convexity(fabric, e, eps_b)
        return stability.evaluate(fabric, stability.invariants(e, eps_b)).ellipticity

    start = np.full(np.size(eps_a), -1e-9)
    end = first_loss(lambda e: -value(e), start, DEEPEST)
    begins = value(start[:, None])[:, 0] < 0
    return np.where(begins, np.nan_to_num(end, nan=-np.inf), np.nan)


def convex_tension(fabric: WovenFabric, largest: float = 0.3) -> tuple[float | None, float | None]:
    """Largest e such that W is convex for all eps_a, eps_b from 0 to e, and eps_b / eps_a of the
    first state that is not; None and None where all are up to `largest`."""
    # not 0: the other side of that kink is compression
    ratio = np.concatenate([np.linspace(0.01, 1, 100), 1 / np.linspace(0.01, 0.99, 99)])
    along = np.stack([np.minimum(1, 1 / ratio), np.minimum(ratio, 1)])[:, :, None]
    e = first_loss(
        lambda s: stability.convexity(fabric, *(along * s)), np.full(len(ratio), 1e-6), largest
    )
    if np.isnan(e).all():
        return None, None
    k = np.nanargmin(e)
    return float(e[k]), float(ratio[k])


def free_tension_onset(fabric: WovenFabric, indicator: str, n: int = 60) -> float | None:
    """First of `n` strains eps_a of free uniaxial tension along a, up to EPS_A, at which the
    indicator is lost; None where none is."""
    eps_a = np.linspace(0.0005, EPS_A, n)
    eps_b = lateral_strain(fabric, 0, eps_a)
    state = stability.evaluate(fabric, stability.invariants(eps_a, eps_b))
    lost = getattr(state, indicator) < 0
    return float(eps_a[lost.argmax()]) if lost.any() else None


def p_min_onset(fabric: WovenFabric) -> float | None:
    """Largest p_min with an indefinite Hessian at eps_b = 0- for some eps_a up to EPS_A, None if
    there is none."""
    eps_a = np.geomspace(1e-5, EPS_A, 2000)

    def least(p):
        return stability.convexity(fabric.replace(p_min=p), eps_a, -1e-9).min()

    return brentq(least, 0.0, 1.0, xtol=1e-10) if least(0.0) < 0 < least(1.0) else None


def gamma_onset(fabric: WovenFabric) -> float | None:
    """Shear angle [deg] from which W is not convex in tension-compression (eps_a to EPS_A, eps_b to
    LOW); None up to 60 deg."""
    eps_a, eps_b = np.meshgrid(np.linspace(0.001, EPS_A, 16), np.linspace(LOW, -1e-6, 41))

    def least(gamma):
        return np.array(
            [[stability.convexity(fabric, eps_a, eps_b, g).min() for g in row] for row in gamma]
        )

    found = first_loss(least, 0.0, np.radians(60), samples=121)[0]
    return None if np.isnan(found) else float(np.degrees(found))


def compression_onset(fabric: WovenFabric, gamma: float, other: float) -> float | None:
    """eps_a < 0 from which ellipticity is lost, with eps_b = `other` * eps_a and a shear angle
    gamma [rad]; None down to LOW."""

    def value(e):
        return stability.evaluate(fabric, stability.invariants(e, other * e, gamma)).ellipticity

    return _number(first_loss(value, -1e-9, LOW)[0])


def thresholds(fabric: WovenFabric) -> list[dict[str, Any]]:
    """Rows of thresholds.csv: quantity, p_min, value, unit, at."""
    rows: list[dict[str, Any]] = []

    def add(quantity, value, unit="-", at="", p_min=""):
        rows.append({"quantity": quantity, "p_min": p_min, "value": value, "unit": unit, "at": at})

    for p in P_MIN:
        changed = fabric.replace(p_min=p)
        for indicator in INDICATORS:
            _add_reach(add, changed, indicator, p)
        value, ratio = convex_tension(changed)
        at = "" if ratio is None else f"eps_b / eps_a = {ratio:.3g}"
        add("tension-tension: convex up to", value, at=at, p_min=p)
        for indicator in INDICATORS:
            name = f"free uniaxial tension: {indicator} lost from eps_a"
            onset = free_tension_onset(changed, indicator)
            add(name, onset, at=f"eps_a to {EPS_A}", p_min=p)
        name = "tension-compression: convexity lost from gamma"
        add(name, gamma_onset(changed), "deg", "gamma to 60", p_min=p)
    name = "tension-compression: p_min below which convexity is lost at eps_b = 0-"
    add(name, p_min_onset(fabric), at=f"eps_a to {EPS_A}")
    add("the same, d -> 0", p_min_onset(fabric.replace(d=1e-9)), at="eps_a -> 0+")
    for gamma in (0.0, SOFTEST_SHEAR):
        for name, other in (("one yarn", 0.0), ("both yarns", 1.0)):
            value = compression_onset(fabric, gamma, other)
            words = f"compression along {name}: ellipticity lost from"
            add(words, value, at=f"gamma = {gamma} rad")
    e = np.linspace(LOW, HIGH, 141)
    least = stability.convexity(fabric.decoupled(), e[:, None], e).min()
    stiffness = (2 * yarn.d for yarn in (fabric.warp, fabric.weft))
    least = float(least / min(stiffness))
    add("FABRIC baseline: least convexity indicator over the map", least)
    return rows


def _add_reach(add, fabric, indicator, p):
    """Rows of how far lost convexity or ellipticity reaches in tension-compression, for p_min p."""
    eps_a = np.linspace(0.0, EPS_A, 301)[1:]
    found = compression_reach(fabric, eps_a, indicator)
    begins = not np.isnan(found).all()
    worst = np.nanargmin(found) if begins else 0
    name = f"tension-compression: reach of lost {indicator} in eps_b"
    if indicator == "convexity":
        here = _number(compression_reach(fabric, np.array([REACH_AT]), indicator)[0])
        add(name, here, at=f"eps_a = {REACH_AT}", p_min=p)
        plain = float(np.log(p / (1 - p)) / fabric.warp.c) if 0 < p < 0.5 else None
        add(f"{name}, d and a neglected", plain, at="eps_a -> 0+", p_min=p)
    at = f"eps_a to {EPS_A}"
    if begins:
        endless = f"; no end down to {DEEPEST}" if np.isinf(found[worst]) else ""
        at = f"eps_a = {eps_a[worst]:.4f}{endless}"
    add(f"{name}, worst", max(float(found[worst]), DEEPEST) if begins else None, at=at, p_min=p)


def _number(value):
    return None if np.isnan(value) else float(value)
