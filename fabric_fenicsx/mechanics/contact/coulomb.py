"""Coulomb's law of friction, as a potential of points that slip."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...runtime.errors import InputError
from ...runtime.rules import ABOVE_ZERO_OR_INF, FROM_ZERO, POSITIVE


@dataclass(frozen=True)
class Coulomb:
    """Coulomb friction that starts with an elastic slip.

    - coefficient: mu; on a tool that presses several sheets also one for each, {sheet name: mu}
    - slip s [mm]: how far a sticking point slips at most
    - lag: normal forces are held during a solve. It is repeated if they differ then from those held
      by more than this share of their sum. With inf they follow one step behind. By default inf on
      tools, 0.01 between sheets

    Raises InputError for numbers out of range.

    In the methods z (n, 3) [mm] is the slip of n points in their tangent planes, and limit (n,) [N]
    is mu P, the resistance of a point that slides under the normal force P.
    """

    coefficient: float | Mapping[str, float]
    slip: float = 0.1
    lag: float | None = None

    def __post_init__(self) -> None:
        for value in self.coefficients:
            FROM_ZERO.check("coefficient of friction", value)
        POSITIVE.check("slip of friction", self.slip)
        if self.lag is not None:
            ABOVE_ZERO_OR_INF.check("lag of friction", self.lag)

    @property
    def coefficients(self) -> list[float]:
        """The one of all sheets, or that of each."""
        given = self.coefficient
        return list(given.values()) if isinstance(given, Mapping) else [given]

    @property
    def largest(self) -> float:
        """The largest coefficient."""
        return max(self.coefficients, default=0.0)

    def energy(self, z: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """mu P |z|^2 / 2 s up to |z| = s, mu P (|z| - s / 2) beyond, (n,) [N mm]."""
        length = np.linalg.norm(z, axis=1)
        beyond = np.maximum(length - self.slip, 0.0)
        return limit * ((length - beyond) ** 2 / (2 * self.slip) + beyond)

    def forces(self, z: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Forces on the points, against the slip (n, 3) [N]: minus the derivative of `energy`."""
        return -(limit / np.maximum(np.linalg.norm(z, axis=1), self.slip))[:, None] * z

    def blocks(self, z: np.ndarray, limit: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """The second derivative of `energy` (n, 3, 3) [N/mm]: mu P / max(|z|, s) times the
        projector on the plane across `normal` (n, 3), of a sliding point less the direction of
        its slip."""
        length = np.linalg.norm(z, axis=1)
        blocks = np.eye(3) - normal[:, :, None] * normal[:, None]
        slides = length > self.slip
        along = z[slides] / length[slides, None]
        blocks[slides] -= along[:, :, None] * along[:, None]
        return blocks * (limit / np.maximum(length, self.slip))[:, None, None]

    def elastic(self, z: np.ndarray) -> np.ndarray:
        """The elastic part of the slip, at most s long, (n, 3) [mm]."""
        length = np.linalg.norm(z, axis=1)
        return z * np.minimum(1.0, self.slip / np.maximum(length, 1e-300))[:, None]


def as_coulomb(
    given: float | Mapping[str, float] | Coulomb, owner: str, lag: float
) -> Coulomb | None:
    """The law that a term is given as `friction`, with `lag` where it has none of its own; None if
    all coefficients are 0. owner: the term, named in errors."""
    try:
        law = given if isinstance(given, Coulomb) else Coulomb(given)
    except InputError as error:
        raise InputError(f"{owner}: {error}") from None
    if not law.largest:
        return None
    return law if law.lag else dataclasses.replace(law, lag=lag)
