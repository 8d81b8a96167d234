"""The law of contact: pressure over depth, and its default numbers."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from ...material import kernel
from ...material.laws.base import Material
from ...material.metal import Metal
from ...runtime.rules import FROM_ZERO, POSITIVE

STRAIN = 0.02  # along all directions; its pull over the tightest radius sets the penalty
FLAT_RADIUS = 10.0  # thicknesses: what counts as the least radius of a tool that is flat
PERMITTED = 0.0125  # of the thickness, the penetration under it
SMOOTHING = 0.3  # of the permitted penetration
INVERSIONS = 8  # of Newton's method for the depth beyond a soft layer; three or four do


def default_penalty(material: Material, radius: float, permitted: float | None = None) -> float:
    """Penalty [N/mm^3] for a tool of least `radius` [mm].

    With it, a fabric or metal stretched by `STRAIN` over that radius presses into the tool by
    `permitted` [mm], by default `PERMITTED` of the thickness. A flat tool (inf) counts as one of
    `FLAT_RADIUS` thicknesses.
    """
    t = material.thickness
    return (
        _pull(material)
        / (radius if np.isfinite(radius) else FLAT_RADIUS * t)
        / (permitted or PERMITTED * t)
    )


def stack_penalty(materials: Iterable[Material], radius: float) -> float:
    """Penalty [N/mm^3] of contact with tools and between sheets of several materials: the least of
    their `default_penalty`, or with sheet metal among them the largest, as metal presses through
    the plies that it lies on."""
    known = list(materials)
    choose = max if any(isinstance(material, Metal) for material in known) else min
    return choose(default_penalty(material, radius) for material in known)


def _pull(material):
    """Tensions along two directions, added up [N/mm]."""
    if isinstance(material, Metal):
        return 2 * float(material.hardening.stress(np.array(2 * STRAIN))) * material.thickness
    stretched = kernel.evaluate(
        material, gradient=[(1 + STRAIN) * np.eye(3)[:, :2]], fibres=np.eye(2)[:, None]
    )
    return float(np.trace(stretched.cauchy[0])) * material.thickness


class PressureLaw(NamedTuple):
    """Pressure p = k e^2 / (2 s) at depths e up to s; beyond, it grows with the slope k, so the
    slope is continuous. penalty k [N/mm^3], smoothing s [mm]: numbers, or one for each place
    (n,)."""

    penalty: float | np.ndarray
    smoothing: float | np.ndarray

    def at(self, places: np.ndarray) -> Self:
        """The law at some of the places (k,)."""
        return self._replace(
            **{name: v[places] for name, v in self._asdict().items() if np.ndim(v)}
        )

    def __call__(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy per area [N/mm], pressure [MPa] and its slope [N/mm^3] at depths e (n,) from 0
        [mm]."""
        k, s = self
        soft, beyond = np.minimum(e, s), np.maximum(e - s, 0.0)
        energy = k * (soft**3 / (6 * s) + beyond * (s + beyond) / 2)
        return energy, k * (soft**2 / (2 * s) + beyond), k * soft / s

    def depth(self, p: np.ndarray) -> np.ndarray:
        """Depths (n,) [mm] at pressures p (n,) from 0 [MPa]."""
        k, s = self
        return np.where(p < k * s / 2, np.sqrt(2 * s * p / k), p / k + s / 2)


@dataclass(frozen=True)
class SoftLayer:
    """A soft layer on a face: its thickness L [mm], 0 for none, and the pressure p_L [MPa] that
    presses it out. Raises InputError for other numbers."""

    thickness: float
    pressing: float = 5.0

    def __post_init__(self) -> None:
        FROM_ZERO.check("thickness of the soft layer", self.thickness)
        POSITIVE.check("pressing of the soft layer", self.pressing)


class LayeredLaw(NamedTuple):
    """Pressure p = p_L (e / L)^2 at depths e in a soft `layer`; beyond it that of the `face` below
    is added, at the depth e - L."""

    layer: SoftLayer
    face: PressureLaw

    def at(self, places: np.ndarray) -> Self:
        """As in `PressureLaw`."""
        return self._replace(face=self.face.at(places))

    def __call__(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As in `PressureLaw`."""
        L, p_L, face = self.layer.thickness, self.layer.pressing, self.face
        energy, pressure, slope = face(np.maximum(e - L, 0.0))
        share = e / L
        return (
            energy + p_L * share**2 * e / 3,
            pressure + p_L * share**2,
            slope + 2 * p_L * share / L,
        )

    def depth(self, p: np.ndarray) -> np.ndarray:
        """As in `PressureLaw`."""
        L, p_L, face = self.layer.thickness, self.layer.pressing, self.face
        e, beyond = np.asarray(L * np.sqrt(np.minimum(p, p_L) / p_L)), p > p_L
        p = np.asarray(p)[beyond]
        deep = L + face.depth(p - p_L)
        for _ in range(INVERSIONS):  # the law is convex, so each comes nearer from one side
            _, now, slope = self(deep)
            deep = deep - (now - p) / slope
        e[beyond] = deep
        return e


def chord(law: PressureLaw | LayeredLaw, p: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Slope of a law between two pressures (n,) [N/mm^3]."""
    depths = law.depth(p), law.depth(other)
    changes = abs(other - p) > 1e-6 * p
    slope = law(depths[0])[2]
    return np.where(changes, (other - p) / np.where(changes, depths[1] - depths[0], 1.0), slope)
