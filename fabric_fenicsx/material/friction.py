"""Friction between yarns, beside the elastic law: why fabric keeps most of its shape."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np

from ..readers.units import suffixes
from ..runtime.errors import InputError
from ..runtime.rules import Rule, above_zero, check_complete
from .files import read_numbers, take_table
from .functions import negative, positive
from .material import Parameters


class Each(NamedTuple):
    """The rule for one or several numbers that `rule` allows."""

    rule: Rule

    @property
    def unit(self) -> str:
        """That of the numbers, as of a `Rule`."""
        return self.rule.unit

    def check(self, name: str, value: Any) -> tuple[float, ...]:
        """The numbers; InputError, which calls them `name`, for one that is not allowed."""
        several = value if isinstance(value, (list, tuple)) and value else [value]
        return tuple(self.rule.check(name, each) for each in several)


class Response(NamedTuple):
    """Of points (...): potential of the step, stress, its derivative, sliding and dissipation.

    The units are those of the numbers; sliding has another axis, of the elements (..., k).
    """

    energy: np.ndarray
    stress: np.ndarray
    tangent: np.ndarray
    sliding: np.ndarray
    dissipated: np.ndarray


@dataclass(frozen=True)
class YarnFriction(Parameters):
    """Elements in parallel, each a spring in series with a slider, which a strain moves.

    With z = strain - sliding, an element has the stress `stiffness` z up to its `strength`, where
    it slides. Within a step its energy is that of the spring and, beyond, what sliding takes.
    """

    stiffness: tuple[float, ...]
    strength: tuple[float, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        counts = len(self.stiffness), len(self.strength)
        if counts[0] != counts[1]:
            raise InputError(
                f"friction between yarns has {counts[0]} stiffnesses and {counts[1]} strengths; "
                "allowed is one of both for each element"
            )

    def symbols(self, make: Callable[[float], Any]) -> Self:
        """As of `Parameters`."""
        new = super().symbols(make)
        for name in self.rules:
            object.__setattr__(new, name, tuple(map(make, getattr(self, name))))
        return new

    def energy(self, strain: Any, sliding: Sequence[Any]) -> Any:
        """The potential of a step, an expression as those of laws; sliding: of each element."""
        W = 0.0
        for k, f, s in zip(self.stiffness, self.strength, sliding):
            up, down = positive(strain - s - f / k), negative(strain - s + f / k)
            W += k * (strain - s - up - down) ** 2 / 2 + f * (up - down)
        return W

    def respond(self, strain: np.ndarray, sliding: np.ndarray) -> Response:
        """The response at points, strain (...), that slid by `sliding` (..., k) before."""
        k, f = np.array(self.stiffness), np.array(self.strength)
        z = strain[..., None] - sliding
        elastic = np.clip(z, -f / k, f / k)
        lost = (f * abs(z - elastic)).sum(-1)
        return Response(
            energy=(k * elastic**2 / 2).sum(-1) + lost,
            stress=(k * elastic).sum(-1),
            tangent=(k * (abs(z) <= f / k)).sum(-1),
            sliding=sliding + z - elastic,
            dissipated=lost,
        )

    def table(self) -> dict[str, list[float]]:
        """Its table in a material file."""
        units = {name: next(iter(suffixes(rule.unit))) for name, rule in self.rules.items()}
        return {f"{name}_{unit}": list(getattr(self, name)) for name, unit in units.items()}


@dataclass(frozen=True)
class ShearFriction(YarnFriction):
    """Friction against shear: shear stress over the shear angle, conjugate to it as the law's.

    Parameters
    ----------
    stiffness, strength : float or sequence of float
        Of each element [MPa].

    Raises
    ------
    InputError
        For numbers that are not above 0, and for more of one than of the other.

    Examples
    --------
    >>> friction = ff.ShearFriction(stiffness=0.2, strength=0.01)
    >>> friction.respond(np.array([0.04, 0.3]), np.zeros((2, 1))).stress.tolist()  # [MPa]
    [0.008, 0.01]
    """

    rules = {name: Each(above_zero("stress")) for name in ("stiffness", "strength")}


@dataclass(frozen=True)
class BendingFriction(YarnFriction):
    """Friction against bending of both yarns: moment per width over curvature.

    Parameters
    ----------
    stiffness : float or sequence of float
        Of each element [N mm], to be compared with D of `Bending`.
    strength : float or sequence of float
        Moment per width at which each slides [N mm/mm].

    Raises
    ------
    InputError
        As for `ShearFriction`.

    Examples
    --------
    >>> ff.BendingFriction(stiffness=8.0, strength=0.02).strength
    (0.02,)
    """

    rules = {
        "stiffness": Each(above_zero("bending_stiffness")),
        "strength": Each(above_zero("line_moment")),
    }


# fields of a law and tables of its file
FRICTIONS: dict[str, type[YarnFriction]] = {
    "shear_friction": ShearFriction,
    "bending_friction": BendingFriction,
}


def frictions_of(document: dict[str, Any], units: Mapping[str, str]) -> dict[str, Any]:
    """The tables of `FRICTIONS` of a material file, taken out of its document, by field; None for
    one that it does not have. units: its table [units]. Raises InputError by key."""
    found: dict[str, Any] = dict.fromkeys(FRICTIONS)
    for key, kind in FRICTIONS.items():
        if key in document:
            numbers = read_numbers(take_table(document, key), kind.rules, units, f"{key}.")
            check_complete(numbers, kind.rules, f"{key}.", f"in [{key}]")
            found[key] = kind(**numbers)
    return found
