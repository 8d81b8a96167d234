"""Friction between yarns, beside the elastic law: why fabric keeps most of its shape."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.errors import InputError
from ..core.rules import above_zero
from .files import Several
from .functions import Number, negative, positive
from .material import Parameters


class Response(NamedTuple):
    """Of points (...): potential of the step, stress, its derivative, sliding (..., k) of the
    elements, and dissipation, in units of the numbers."""

    energy: np.ndarray
    stress: np.ndarray
    tangent: np.ndarray
    sliding: np.ndarray
    dissipated: np.ndarray


@dataclass(frozen=True)
class YarnFriction(Parameters):
    """Elements in parallel, each a spring in series with a slider, which a strain moves: with
    z = strain - sliding its stress is `stiffness` z up to its `strength`, where it slides."""

    stiffness: tuple[float, ...]
    strength: tuple[float, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        counts = len(self.stiffness), len(self.strength)
        if counts[0] != counts[1]:
            raise InputError(
                f"friction between yarns has {counts[0]} stiffnesses and {counts[1]} strengths; "
                "expected one of both for each element"
            )

    def energy(self, strain: Number, sliding: Sequence[Number]) -> Number:
        """The potential of a step, an expression as those of laws; sliding: of each element."""
        W = 0.0
        for k, f, s in zip(self.stiffness, self.strength, sliding):
            up, down = positive(strain - s - f / k), negative(strain - s + f / k)
            W += k * (strain - s - up - down) ** 2 / 2 + f * (up - down)
        return W

    def respond(self, strain: np.ndarray, sliding: np.ndarray) -> Response:
        """The response at points, strain (...), that slid by `sliding` (..., k) before."""
        k = np.array(self.stiffness)
        return respond(k, np.array(self.strength) / k, strain, sliding)


def respond(k: np.ndarray, most: np.ndarray, strain: np.ndarray, sliding: np.ndarray) -> Response:
    """As of `YarnFriction`, of elements of stiffness k (k,) or, of strains that differ, (m, k),
    that slide where springs are strained by `most`, of the same shape."""
    z = strain[..., None] - sliding
    elastic = np.clip(z, -most, most)
    lost = (k * most * abs(z - elastic)).sum(-1)
    return Response(
        energy=(k * elastic**2 / 2).sum(-1) + lost,
        stress=(k * elastic).sum(-1),
        tangent=(k * (abs(z) <= most)).sum(-1),
        sliding=sliding + z - elastic,
        dissipated=lost,
    )


@dataclass(frozen=True)
class ShearFriction(YarnFriction):
    """Friction in shear: shear stress against the shear angle, conjugate to it as in the law.

    Raises InputError for numbers that are not above 0, and for more of one than of the other.

    Parameters
    ----------
    stiffness, strength : float or sequence of float
        Of each element [MPa].

    Examples
    --------
    >>> friction = ff.ShearFriction(stiffness=0.2, strength=0.01)
    >>> friction.respond(np.array([0.04, 0.3]), np.zeros((2, 1))).stress.tolist()  # [MPa]
    [0.008, 0.01]
    """

    rules = {name: Several(above_zero("stress")) for name in ("stiffness", "strength")}


@dataclass(frozen=True)
class BendingFriction(YarnFriction):
    """Friction in bending of both yarns: moment per width against curvature.

    Raises InputError as for `ShearFriction`.

    Parameters
    ----------
    stiffness : float or sequence of float
        Of each element [N mm], comparable with D of `Bending`.
    strength : float or sequence of float
        Moment per width at which each slides [N mm/mm].

    Examples
    --------
    >>> ff.BendingFriction(stiffness=8.0, strength=0.02).strength
    (0.02,)
    """

    rules = {
        "stiffness": Several(above_zero("bending_stiffness")),
        "strength": Several(above_zero("line_moment")),
    }
