"""Laws of contact: pressure over the depth to which faces overlap."""

import functools
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from ...material import kernel
from ...material.compaction import growth, log_compaction
from ...material.laws.base import Law, Material
from ...material.metal import Metal

PENALTY_STRAIN = 0.02  # along all directions; its pull over the tightest radius sets the penalty
PENETRATION = 0.0125  # of the thickness, under the default penalty
SMOOTHING = 0.3  # of that penetration
HARD_PRESSURE = 10.0  # MPa, above which fabric is compacted along a straight line


def default_penalty(material: Material, radius: float) -> float:
    """Penalty [N/mm^3] for a tool of least `radius` [mm].

    With it, a fabric or metal stretched by `PENALTY_STRAIN` over that radius presses into the tool
    by `PENETRATION` of the thickness. A flat tool (inf) counts as one of 10 thicknesses.
    """
    t = material.thickness
    radius = radius if np.isfinite(radius) else 10 * t
    return _pull(material) / radius / (PENETRATION * t)


def _pull(material):
    """Tensions along two directions, added up [N/mm]."""
    if isinstance(material, Metal):
        stress = float(material.hardening.stress(np.array(2 * PENALTY_STRAIN)))
        return 2 * stress * material.thickness
    stretched = kernel.evaluate(
        material, gradient=[(1 + PENALTY_STRAIN) * np.eye(3)[:, :2]], fibres=np.eye(2)[:, None]
    )
    return float(np.trace(stretched.cauchy[0])) * material.thickness


class PressureLaw(Protocol):
    """Pressure over the depth by which two faces overlap; it grows with the depth, from 0."""

    def __call__(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy per area [N/mm], pressure [MPa] and its slope [N/mm^3] at depths e (n,) from 0
        [mm]."""

    def depth(self, p: np.ndarray) -> np.ndarray:
        """Depths (n,) [mm] at pressures p (n,) from 0 [MPa]."""


class Rigid(NamedTuple):
    """A face that is not soft: p = k e^2 / (2 s) at depths e up to s; beyond, p grows with the
    slope k, so the slope is continuous. penalty: k [N/mm^3]; smoothing: s [mm]."""

    penalty: float
    smoothing: float

    def __call__(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        k, s = self
        soft, beyond = np.minimum(e, s), np.maximum(e - s, 0.0)
        energy = k * (soft**3 / (6 * s) + beyond * (s + beyond) / 2)
        return energy, k * (soft**2 / (2 * s) + beyond), k * soft / s

    def depth(self, p: np.ndarray) -> np.ndarray:
        """See `PressureLaw`."""
        k, s = self
        return np.where(p < k * s / 2, np.sqrt(2 * s * p / k), p / k + s / 2)


class Compacted(NamedTuple):
    """Compacted fabric: p = p_0 (e^y - 1 - y), y = n ln(L / (L - e)), at depths e, see
    `Compaction`; above `HARD_PRESSURE` it grows with the slope that it has there.

    - length: L [mm], half the thickness without pressure of one ply, or of two added up
    - exponent: n; onset: p_0 [MPa]
    """

    length: float
    exponent: float
    onset: float

    def __call__(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        L, n, p_0 = self
        soft = np.minimum(e, _hardest(self))
        beyond = e - soft
        left = L - soft
        log = -np.log1p(-soft / L)
        pressure, slope = p_0 * growth(n * log), p_0 * n / left * np.expm1(n * log)
        energy = L / (n - 1) * np.expm1((n - 1) * log) - soft + n * (left * log - soft)
        energy *= p_0
        energy += beyond * (pressure + slope * beyond / 2)
        return energy, pressure + slope * beyond, slope

    def depth(self, p: np.ndarray) -> np.ndarray:
        """See `PressureLaw`."""
        beyond = np.maximum(p - HARD_PRESSURE, 0.0)
        if beyond.any():
            beyond = beyond / self(np.asarray(_hardest(self)))[2]
        return self._soft_depth(np.minimum(p, HARD_PRESSURE)) + beyond

    def _soft_depth(self, p):
        return -self.length * np.expm1(-log_compaction(p / self.onset) / self.exponent)


@functools.cache
def _hardest(law):
    """Depth of `Compacted` under `HARD_PRESSURE` [mm]."""
    return float(law._soft_depth(np.asarray(HARD_PRESSURE)))


class InSeries(NamedTuple):
    """Two faces of different fabrics, under the same pressure: their depths add up."""

    first: Compacted
    second: Compacted

    def __call__(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        mine, others = self._shared(e)
        (W, p, k), (W_2, _, k_2) = self.first(mine), self.second(others)
        return W + W_2, p, k * k_2 / np.maximum(k + k_2, 1e-300)

    def depth(self, p: np.ndarray) -> np.ndarray:
        """See `PressureLaw`."""
        return self.first.depth(p) + self.second.depth(p)

    def _shared(self, e):
        """Depths (n,) of the first and of the second, which add up to e."""
        onset = min(self.first.onset, self.second.onset)
        low, high = np.zeros_like(e), np.array(e, dtype=float)
        mine = e * self.first.length / (self.first.length + self.second.length)
        for _ in range(20):  # of which Newton's method takes four or five
            (_, p, k), (_, p_2, k_2) = self.first(mine), self.second(e - mine)
            low, high = np.where(p < p_2, mine, low), np.where(p < p_2, high, mine)
            p, p_2 = p + onset, p_2 + onset
            slope = np.maximum(k / p + k_2 / p_2, 1e-300)
            new = mine + np.log(p_2 / p) / slope  # logarithms are all but straight
            mine = np.where((low <= new) & (new <= high), new, (low + high) / 2)
        return mine, e - mine


class ByPlace:
    """One of several `laws` at each of n places: `which` (n,) counts from 0."""

    def __init__(self, laws: Sequence[PressureLaw], which: np.ndarray) -> None:
        self.laws, self.which = list(laws), which

    def __call__(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        energy, pressure, slope = self._of_each(lambda law: law, e, 3)
        return energy, pressure, slope

    def depth(self, p: np.ndarray) -> np.ndarray:
        """See `PressureLaw`."""
        return self._of_each(lambda law: law.depth, p, 1)[0]

    def _of_each(self, function, x, count):
        """`count` values (count, n) of the laws' functions at x, each at its own places."""
        values, x = np.zeros((count, len(self.which))), np.broadcast_to(x, len(self.which))
        for k, law in enumerate(self.laws):
            values[:, self.which == k] = function(law)(x[self.which == k])
        return values


class Grown(NamedTuple):
    """A law of n places whose faces are `growth` (n,) times as thick as its own."""

    law: PressureLaw
    growth: np.ndarray

    def __call__(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        energy, pressure, slope = self.law(e / self.growth)
        return energy * self.growth, pressure, slope / self.growth

    def depth(self, p: np.ndarray) -> np.ndarray:
        """See `PressureLaw`."""
        return self.law.depth(p) * self.growth


def thickening_of(material: Material) -> float:
    """Power of the area by which a sheared ply is thicker, 0 where its faces are rigid."""
    compaction = material.compaction if isinstance(material, Law) else None
    return compaction.thickening if compaction else 0.0


def face_of(material: Material, radius: float, penalty: float | None = None) -> PressureLaw:
    """The law of a face of this material on a tool of least `radius` [mm]: `Compacted` fabric, or
    `Rigid` for metal, and for all if a penalty is given [N/mm^3]."""
    compaction = material.compaction if isinstance(material, Law) else None
    if compaction and not penalty:
        length = material.thickness_under(0.0) / 2
        return Compacted(length, compaction.exponent, compaction.onset)
    t = material.thickness
    return Rigid(penalty or default_penalty(material, radius), SMOOTHING * PENETRATION * t)


def between_faces(first: PressureLaw, second: PressureLaw) -> PressureLaw:
    """The law of two faces that press each other. Beside a fabric a rigid face is not pressed in;
    of two rigid faces the one of the lower penalty counts."""
    if isinstance(first, Rigid) and isinstance(second, Rigid):
        return min(first, second)
    if isinstance(first, Compacted) and isinstance(second, Compacted):
        if first[1:] == second[1:]:
            return first._replace(length=first.length + second.length)
        return InSeries(first, second)
    return second if isinstance(first, Rigid) else first


def only(law: PressureLaw, points: np.ndarray) -> PressureLaw:
    """The law at these `points` (k,), by their numbers."""
    if isinstance(law, Grown):
        return Grown(only(law.law, points), law.growth[points])
    return ByPlace(law.laws, law.which[points]) if isinstance(law, ByPlace) else law
