"""Laws of contact: pressure over the depth to which faces overlap, and forces of pressed points."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Self

import numpy as np

from ..material.compaction import growth, log_compaction
from ..material.homogeneous import nominal
from ..material.laws.base import Law, Material
from ..material.metal import Metal

PENALTY_STRAIN = 0.02  # along all directions; its pull over the tightest radius sets the penalty
PENETRATION = 0.0125  # of the thickness, under the default penalty
SMOOTHING = 0.3  # of that penetration
HARD_PRESSURE = 10.0  # MPa, above which fabric is compacted along a straight line

Values = float | np.ndarray


def default_penalty(material: Material, radius: float) -> float:
    """Penalty [N/mm^3] for a tool of least `radius` [mm].

    With it, a fabric or metal stretched by `PENALTY_STRAIN` over that radius presses into the tool
    by `PENETRATION` of the thickness. A flat tool (inf) counts as one of 10 thicknesses.
    """
    t = material.thickness
    radius = radius if np.isfinite(radius) else 10 * t
    if isinstance(material, Metal):
        stress = 2 * float(material.hardening.stress(np.array(2 * PENALTY_STRAIN)))
    else:
        assert isinstance(material, Law)
        along_both = nominal(material, np.array([[PENALTY_STRAIN, PENALTY_STRAIN, 0.0]]))[0, :2]
        stress = float(along_both.sum()) / (1 + PENALTY_STRAIN)
    return stress * t / radius / (PENETRATION * t)


class FaceLaw(NamedTuple):
    """A face of a sheet, or two that touch: pressure over the depth by which they overlap. It grows
    with the depth, from 0.

    A rigid face has p = k e^2 / (2 s) at depths e up to s; beyond, p grows with the slope k, so the
    slope is continuous. Compacted fabric has p = p_0 (e^y - 1 - y), y = n ln(L / (L - e)), see
    `Compaction`; above `HARD_PRESSURE` it grows with the slope that it has there. Each is 0 with
    the defaults of its numbers. All are numbers, or arrays (points,) where they differ.

    - penalty: k [N/mm^3]; smoothing: s [mm]
    - length: L [mm], half the thickness without pressure of one ply, or of two added up; exponent:
      n; onset: p_0 [MPa]; hardest: depth under `HARD_PRESSURE` [mm]
    - growth: how many times as thick as L or s says the faces are
    - thickness: of the sheet without pressure [mm]; thickening: the power of the area by which a
      sheared ply is thicker
    - beside: another fabric that is under the same pressure: both depths add up
    """

    penalty: Values = 0.0
    smoothing: Values = 1.0
    length: Values = 1.0
    exponent: Values = 2.0
    onset: Values = 0.0
    hardest: Values = 0.0
    growth: Values = 1.0
    thickness: Values = 1.0
    thickening: Values = 0.0
    beside: "FaceLaw | None" = None

    @classmethod
    def compacted(cls, length: float, exponent: float, onset: float) -> Self:
        """The face of a fabric."""
        y = log_compaction(np.array(HARD_PRESSURE / onset))
        hardest = -length * float(np.expm1(-y / exponent))
        return cls(length=length, exponent=exponent, onset=onset, hardest=hardest)

    @classmethod
    def of_points(cls, laws: Sequence[Self], which: np.ndarray) -> Self:
        """One of several single `laws` at each of n points: `which` (n,) counts from 0."""
        if len(laws) == 1:
            return laws[0]._replace(thickness=np.full(len(which), laws[0].thickness))
        return cls(*(np.array(each)[which] for each in zip(*(law[:-1] for law in laws))))

    def grown(self, growth: np.ndarray) -> Self:
        """Faces of a sheet `growth` (points,) times as thick; rigid ones are as stiff."""
        of_law = self.growth * np.where(self.is_rigid, 1.0, growth)
        return self._replace(thickness=growth * self.thickness, growth=of_law)

    def at(self, points: np.ndarray) -> Self:
        """The law at these `points` (k,), by their numbers."""
        return type(self)(*(v[points] if isinstance(v, np.ndarray) else v for v in self))

    @property
    def is_rigid(self) -> np.ndarray:
        """Whether the face is rigid, of all points, or of each."""
        return np.greater(self.penalty, 0)

    def __call__(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy [N/mm], pressure [MPa] and its slope [N/mm^3] at depths e (n,) from 0 [mm]."""
        e = e / self.growth
        if self.beside:
            energy, pressure, slope = self._in_series(e, self.beside)
        else:
            energy, pressure, slope = map(np.add, self._rigid(e), self._compacted(e))
        return energy * self.growth, pressure, slope / self.growth

    def depth(self, p: np.ndarray) -> np.ndarray:
        """Depths (n,) [mm] at pressures p (n,) from 0 [MPa]."""
        if self.beside:
            alone = self._replace(growth=1.0, beside=None)
            return self.growth * (alone.depth(p) + self.beside.depth(p))
        k, s = np.maximum(self.penalty, 1e-300), self.smoothing
        rigid = np.where(p < k * s / 2, np.sqrt(2 * s * p / k), p / k + s / 2)
        y = log_compaction(np.minimum(p, HARD_PRESSURE) / np.maximum(self.onset, 1e-300))
        soft, beyond = -self.length * np.expm1(-y / self.exponent), p - HARD_PRESSURE
        if np.any(beyond > 0):
            slope = self._compacted(np.asarray(self.hardest))[2]
            soft = soft + np.maximum(beyond, 0.0) / np.maximum(slope, 1e-300)
        return self.growth * np.where(self.is_rigid, rigid, soft)

    def _rigid(self, e):
        k, s = self.penalty, self.smoothing
        soft, beyond = np.minimum(e, s), np.maximum(e - s, 0.0)
        energy = k * (soft**3 / (6 * s) + beyond * (s + beyond) / 2)
        return energy, k * (soft**2 / (2 * s) + beyond), k * soft / s

    def _compacted(self, e):
        L, n, p_0 = self.length, self.exponent, self.onset
        soft = np.minimum(e, self.hardest)
        beyond = e - soft
        left = L - soft
        log = -np.log1p(-soft / L)
        pressure, slope = p_0 * growth(n * log), p_0 * n / left * np.expm1(n * log)
        energy = L / (n - 1) * np.expm1((n - 1) * log) - soft + n * (left * log - soft)
        energy *= p_0
        energy += beyond * (pressure + slope * beyond / 2)
        return energy, pressure + slope * beyond, slope

    def _in_series(self, e, other):
        """As `_compacted`, of this fabric and another one, whose depths add up to e."""
        one = self._replace(growth=1.0, beside=None)
        onset = min(one.onset, other.onset)
        low, high = np.zeros_like(e), np.array(e, dtype=float)
        depth = e * one.length / (one.length + other.length)
        for _ in range(20):  # of which Newton's method takes four or five
            (_, p, k), (_, p_2, k_2) = one(depth), other(e - depth)
            low, high = np.where(p < p_2, depth, low), np.where(p < p_2, high, depth)
            p, p_2 = p + onset, p_2 + onset
            slope = np.maximum(k / p + k_2 / p_2, 1e-300)
            new = depth + np.log(p_2 / p) / slope  # logarithms are all but straight
            depth = np.where((low <= new) & (new <= high), new, (low + high) / 2)
        (W, p, k), (W_2, _, k_2) = one(depth), other(e - depth)
        return W + W_2, p, k * k_2 / np.maximum(k + k_2, 1e-300)


def rigid_face(thickness: float, penalty: float) -> FaceLaw:
    """A rigid face of a sheet of this thickness [mm] and penalty [N/mm^3]."""
    return FaceLaw(penalty, SMOOTHING * PENETRATION * thickness, thickness=thickness)


def face_of(material: Material, radius: float, penalty: float | None = None) -> FaceLaw:
    """A face of a sheet on a tool of least `radius` [mm]: compacted fabric, or rigid for metal, and
    for all if a penalty is given [N/mm^3]."""
    compaction = material.compaction if isinstance(material, Law) else None
    if compaction and not penalty:
        t = material.thickness_under(0.0)
        law = FaceLaw.compacted(t / 2, compaction.exponent, compaction.onset)
        return law._replace(thickness=t, thickening=compaction.thickening)
    return rigid_face(material.thickness, penalty or default_penalty(material, radius))


def between_faces(one: FaceLaw, other: FaceLaw) -> FaceLaw:
    """The law of two faces that press each other, each the same at all points. Beside a fabric a
    rigid face is not pressed in; of two rigid faces that of the lower penalty counts."""
    if one.is_rigid and other.is_rigid:
        return min(one, other, key=lambda law: law[:2])
    if one.is_rigid or other.is_rigid:
        return other if one.is_rigid else one
    if (one.exponent, one.onset) != (other.exponent, other.onset):
        return one._replace(beside=other)
    length, hardest = one.length + other.length, one.hardest + other.hardest
    return one._replace(length=length, hardest=hardest)


MAX_SECANT_PRESSURE = 4.0  # of the present one, up to which a secant stiffness looks


class ContactResponse(NamedTuple):
    """n points pressed into a face: gap (n,) [mm] between both, below 0 where they overlap, its
    gradient `normal` (n, 3) and Hessian `curvature` (n, 3, 3) [1/mm], depth (n,) [mm] to which the
    face is pressed in, pressure (n,) [MPa] and its slope (n,) [N/mm^3], forces (n, 3) [N], `blocks`
    (n, 3, 3) [N/mm] by which these fall as points move, and energy (n,) [N mm]."""

    gap: np.ndarray
    normal: np.ndarray
    curvature: np.ndarray
    depth: np.ndarray
    pressure: np.ndarray
    slope: np.ndarray
    forces: np.ndarray
    blocks: np.ndarray
    energy: np.ndarray


def contact_response(
    law: FaceLaw, areas: np.ndarray, gap: np.ndarray, normal: np.ndarray, curvature: np.ndarray
) -> ContactResponse:
    """Points of `areas` (n,) [mm^2] pressed at gaps (n,) [mm], with gradients and Hessians."""
    depth = np.maximum(0.0, -gap)
    energy, pressure, slope = np.zeros((3, len(gap)))
    at = np.flatnonzero(depth != 0)  # those that are not numbers among them
    energy[at], pressure[at], slope[at] = law.at(at)(depth[at])
    forces, blocks = np.zeros((len(gap), 3)), np.zeros((len(gap), 3, 3))
    force, n = (areas * pressure)[at, None], normal[at]
    forces[at] = force * n
    blocks[at] = _across((areas * slope)[at], n) - force[:, None] * curvature[at]
    return ContactResponse(
        gap, normal, curvature, depth, pressure, slope, forces, blocks, areas * energy
    )


def with_secant_stiffness(
    law: FaceLaw, areas: np.ndarray, now: ContactResponse, missing: np.ndarray
) -> ContactResponse:
    """The same points with other blocks: of the law's slope up to the pressure that balances the
    other forces. missing (n,): what is missing to that pressure [MPa].

    A point that nothing presses any more then leaves the face in one correction of Newton's method.
    With the tangent its depth is but halved, as the law starts with slope 0.
    """
    at = np.flatnonzero(now.pressure > 0)
    p = now.pressure[at]
    balancing = np.clip(p + missing[at], 0.0, MAX_SECANT_PRESSURE * p)
    changes = abs(balancing - p) > 1e-6 * p
    at, p, balancing = at[changes], p[changes], balancing[changes]
    chord = (balancing - p) / (law.at(at).depth(balancing) - now.depth[at])
    blocks = now.blocks.copy()
    blocks[at] += _across(areas[at] * (chord - now.slope[at]), now.normal[at])
    return now._replace(blocks=blocks)


def find_balance(
    force: float,
    look: Callable[[float], tuple[float, float, float]],
    start: float,
    reach: float,
    soft: float,
) -> bool:
    """Seek the travel at which a tool is resisted with `force` [N], by Newton's method between
    bounds; true if found. `look` was then called last there.

    look: of the travel, to the force along the tool's direction [N], its growth [N/mm], and the
    distance to touch [mm]; start: travel to begin with; reach: what the tool may pass a point by,
    or go back, in one step; soft: step where it touches nothing and none is ahead [mm].
    """
    travel, back, low, high = start, reach, -np.inf, np.inf
    for _ in range(100):
        resistance, stiffness, free = look(travel)
        missing = force - resistance
        if abs(missing) <= 1e-12 * force:
            return True
        low, high = (travel, high) if missing > 0 else (low, travel)
        # without contact as far as no point is passed
        step = missing / stiffness if stiffness > 0 else free + soft
        new = travel + float(np.clip(step, -back, free + reach))
        back = 2 * back if np.isfinite(high) and np.isinf(low) else back
        if np.isfinite(low + high) and not low < new < high:
            new = 0.5 * (low + high)
            if new in (low, high):
                return True
        travel = new
    return False


def _across(stiffness, normal):
    """Blocks (n, 3, 3) that are stiff (n,) along `normal` (n, 3)."""
    return stiffness[:, None, None] * normal[:, :, None] * normal[:, None]
