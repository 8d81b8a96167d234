"""Coulomb's law of friction, as a potential of points that slip."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..core.compiled import compiled
from ..core.errors import InputError
from ..core.rules import ABOVE_ZERO_OR_INF, FROM_ZERO, POSITIVE
from ..io.field import Field, of_place

# the double dome's curve is then 0.025 % off that of 0.00002, in 0.93 times the iterations
LAG = 0.0005
# mm, elastic slip of points that hardly touch, which stiffen as they are pressed, and of hard ones
MIN_SLIP, MAX_SLIP = 1e-4, 0.1


@dataclass(frozen=True)
class Coulomb:
    """Coulomb friction with an elastic slip.

    A point pressed by P that has slipped by z, in its tangent plane, has the energy
    mu P |z|^2 / (2 s) up to |z| = s and mu P (|z| - s / 2) beyond. In the methods z is (n, 3) [mm],
    limit (n,) [N] is mu P, the resistance of a point that slides, and stiffness (n,) [N/mm] is the
    least one of a point that sticks, given by the sheets.

    Parameters
    ----------
    coefficient
        mu, or a `Field`: on a tool of the place where it is touched, as the tool stands at first,
        between sheets of the place x, y of the flat sheet. On a tool that presses several sheets
        also one for each, {sheet name: mu}.
    slip
        s [mm], by which a sticking point slips at most. By default what sticks is as stiff as the
        sheets need over a few cells, and s follows from mu P, from 0.0001 to 0.1 mm.
    lag
        Normal forces, pressed areas and tangent planes are lagged during a solve. It is repeated if
        taking them as they are changes the forces by more than this share of their sum. With inf
        friction follows one step behind.

    Raises
    ------
    InputError
        For numbers out of range.

    Examples
    --------
    >>> law = ff.Coulomb(0.3, slip=0.1)
    >>> law.potential(np.array([[0.05, 0, 0], [2.0, 0, 0]]), np.array([3.0, 3.0]))[0]
    array([0.0375, 5.85  ])
    """

    coefficient: float | Field | Mapping[str, float | Field]
    slip: float | None = None
    lag: float = LAG

    def __post_init__(self) -> None:
        for value in self._coefficients():
            of_place(FROM_ZERO, "xyz").check("coefficient of friction", value)
        if self.slip is not None:
            POSITIVE.check("slip of friction", self.slip)
        ABOVE_ZERO_OR_INF.check("lag of friction", self.lag)

    def _coefficients(self):
        mu = self.coefficient
        return list(mu.values()) if isinstance(mu, Mapping) else [mu]

    @property
    def largest(self) -> float:
        """The largest coefficient, inf of a field."""
        values = (np.inf if isinstance(mu, Field) else mu for mu in self._coefficients())
        return max(values, default=0.0)

    def of(self, label: str, axes: str) -> "Coulomb":
        """The same with coefficients that are fields of these axes; label: in messages."""
        check = of_place(FROM_ZERO, axes).check
        mu = self.coefficient
        if isinstance(mu, Mapping):
            return replace(self, coefficient={k: check(label, each) for k, each in mu.items()})
        return replace(self, coefficient=check(label, mu))

    def slips(self, limit: np.ndarray, stiffness: float | np.ndarray = 0.0) -> np.ndarray:
        """s of each point (n,) [mm]."""
        if self.slip is not None:
            return np.full(len(limit), self.slip)
        return np.clip(limit / np.maximum(stiffness, 1e-300), MIN_SLIP, MAX_SLIP)

    def potential(
        self, z: np.ndarray, limit: np.ndarray, stiffness: float | np.ndarray = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Energies (n,) [N mm], and forces on the points (n, 3) [N], minus their derivatives."""
        return _potential(z, limit, self.slips(limit, stiffness))

    def blocks(
        self,
        z: np.ndarray,
        limit: np.ndarray,
        normal: np.ndarray,
        stiffness: float | np.ndarray = 0.0,
    ) -> np.ndarray:
        """Second derivatives of the energies (n, 3, 3) [N/mm]: mu P / max(|z|, s) times the
        projector across `normal` (n, 3), of a sliding point less the direction of its slip."""
        return _blocks(z, limit, normal, self.slips(limit, stiffness))

    def elastic(
        self, z: np.ndarray, limit: np.ndarray, stiffness: float | np.ndarray = 0.0
    ) -> np.ndarray:
        """Elastic part of the slip, at most s long, (n, 3) [mm]."""
        length = np.maximum(np.linalg.norm(z, axis=1), 1e-300)
        return z * np.minimum(1.0, self.slips(limit, stiffness) / length)[:, None]


Friction = float | Field | Mapping[str, float | Field] | Coulomb


def friction_law(friction: Friction, owner: str, axes: str) -> Coulomb | None:
    """Law of a term's `friction`, None if that is 0. owner: in errors; axes: of its fields."""
    try:
        law = friction if isinstance(friction, Coulomb) else Coulomb(friction)
        law = law.of("coefficient of friction", axes)
    except InputError as error:
        raise InputError(f"{owner}: {error}") from None
    return law if law.largest else None


@compiled
def _potential(z: np.ndarray, limit: np.ndarray, slip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `Coulomb.potential`, of elastic slips (n,) [mm]."""
    energy, forces = np.zeros(len(z)), np.zeros(z.shape)
    for n in range(len(z)):
        length, s = np.sqrt(z[n, 0] ** 2 + z[n, 1] ** 2 + z[n, 2] ** 2), slip[n]
        beyond = max(length - s, 0.0)
        energy[n] = limit[n] * ((length - beyond) ** 2 / (2 * s) + beyond)
        for x in range(3):
            forces[n, x] = -limit[n] / max(length, s) * z[n, x]
    return energy, forces


@compiled
def _blocks(z: np.ndarray, limit: np.ndarray, normal: np.ndarray, slip: np.ndarray) -> np.ndarray:
    """As `Coulomb.blocks`, of elastic slips (n,) [mm]."""
    stiff = np.zeros((len(z), 3, 3))
    for n in range(len(z)):
        if limit[n]:
            length, s = np.sqrt(z[n, 0] ** 2 + z[n, 1] ** 2 + z[n, 2] ** 2), slip[n]
            stiffness, slides = limit[n] / max(length, s), 1.0 if length > s else 0.0
            for x in range(3):
                for y in range(3):
                    along = slides * z[n, x] * z[n, y] / max(length, s) ** 2
                    free = (1.0 if x == y else 0.0) - normal[n, x] * normal[n, y] - along
                    stiff[n, x, y] = stiffness * free
    return stiff


@compiled
def slipped(slip: np.ndarray, moved: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Slip (n, 3) and the parts of motions `moved` (n, 3) across unit normals (n, 3), added up."""
    total = np.empty(slip.shape)
    for n in range(len(slip)):
        along = 0.0
        for x in range(3):
            along += moved[n, x] * normals[n, x]
        for x in range(3):
            total[n, x] = slip[n, x] + (moved[n, x] - along * normals[n, x])
    return total
