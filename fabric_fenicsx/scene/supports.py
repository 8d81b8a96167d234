"""Supports: nodes whose displacement is prescribed."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..runtime.rules import FINITE, Rule, shown
from ..sheets.blank import Blank
from ..tools.values import checked_vector, length_of

AXIS = Rule("0, 1 or 2", lambda v: 0 <= v <= 2, int)


@dataclass(frozen=True)
class Support:
    """Prescribed displacement of some nodes along the axes of the blank's frame.

    - where: function of points (3, n) [mm] to a mask (n,)
    - components: the axes held
    - value: displacement at full load (gdim,) [mm], growing with the load factor, or a function of
      points (3, n) and load factor to (gdim, n)
    - locates: only keeps the sheet from moving as a rigid body and should bear nothing. It lets go
      of a single sheet as soon as friction of tools holds that. Otherwise a run warns if such
      supports bear more than 0.5 % of all forces on nodes from outside, added up by size, and is
      not believed beyond `Limits.located`
    """

    name: str
    where: Callable[[np.ndarray], np.ndarray]
    components: tuple[int, ...]
    value: Sequence[float] | Callable[[np.ndarray, float], np.ndarray] = (0.0, 0.0, 0.0)
    locates: bool = False

    def __post_init__(self) -> None:
        try:
            axes = tuple(AXIS.check("", each) for each in self.components)
        except (TypeError, InputError):
            raise InputError(
                f"components of support {self.name} are {shown(self.components)}; allowed are "
                "some of 0, 1 and 2, as (0, 1)"
            ) from None
        object.__setattr__(self, "components", axes)
        if not callable(self.value):
            size = 2 if length_of(self.value) == 2 else 3
            vector = checked_vector(f"value of support {self.name}", self.value, size=size)
            object.__setattr__(self, "value", (*vector.tolist(), 0.0)[:3])


# what a scene takes: supports, or a function that makes them for its blank
Supports = Iterable[Support] | Callable[[Blank], Iterable[Support]]


def clamped_ends(stroke: float = 0.0) -> Callable[[Blank], list[Support]]:
    """Supports of a strip clamped at both ends, "fixed grip" and "moving grip", of which the second
    is pulled by `stroke` [mm] along the frame's first axis.

    Raises InputError for a stroke that is not finite; they do if an end is not straight, over half
    the strip's width or more.
    """
    stroke = FINITE.check("`stroke`", stroke)
    return lambda blank: _ends(blank, stroke, tuple(range(blank.mesh.geometry.dim)))


def rolling_ends(stroke: float = 0.0) -> Callable[[Blank], list[Support]]:
    """As `clamped_ends`, with ends that are free to move across the strip but for one corner."""
    stroke = FINITE.check("`stroke`", stroke)

    def supports(blank: Blank) -> list[Support]:
        low, high = blank.extent()
        near, corner = 1e-6 * (high - low).max(), low[:2, None]
        at_corner = Support(
            "corner", lambda x: (np.abs(blank.along(x)[:2] - corner) <= near).all(0), (1,)
        )
        return [*_ends(blank, stroke, (0, *range(2, len(low)))), at_corner]

    return supports


def _ends(blank, stroke, components):
    low, high = blank.extent()
    x, comm, near = blank.along(blank.coordinates().T), blank.mesh.comm, 1e-6 * (high - low).max()
    for name, position in (("low", low[0]), ("high", high[0])):
        at_end = x[1][np.abs(x[0] - position) <= near]
        first = comm.allreduce(at_end.min(initial=np.inf), MPI.MIN)
        held = comm.allreduce(at_end.max(initial=-np.inf), MPI.MAX) - first
        if held < 0.5 * (high - low)[1]:
            raise InputError(
                f"the {name} end of {blank.name} along its length can be gripped over "
                f"{rounded(held, 4)} of {rounded((high - low)[1], 4)} mm; allowed is a straight "
                "end, half the width or more"
            )

    def end(position):
        return lambda x: np.abs(blank.along(x)[0] - position) <= near

    return [
        Support("fixed grip", end(low[0]), components),
        Support("moving grip", end(high[0]), components, (stroke, 0.0, 0.0)),
    ]


def on_edge(blank: Blank) -> Callable[[np.ndarray], np.ndarray]:
    """Function of points (3, n) to whether they lie on the edge of a rectangular blank, (n,)."""
    low, high = (corner[:2, None] for corner in blank.extent())
    near = 1e-6 * (high - low).max()

    def edge(x):
        x = blank.along(x)[:2]
        return (np.minimum(np.abs(x - low), np.abs(x - high)) <= near).any(0)

    return edge


def frame(deformation: Callable[[float], np.ndarray]) -> Callable[[Blank], list[Support]]:
    """Support of a rectangle's whole edge, "frame", that deforms it homogeneously.

    deformation: function of the load factor to the deformation gradient (2, 2).
    """

    def supports(blank: Blank) -> list[Support]:
        corner = blank.extent()[0]

        def value(x, load):
            x = blank.along(x)
            moved = np.zeros_like(x)
            moved[:2] = (deformation(load) - np.eye(2)) @ (x[:2] - corner[:2, None])
            return moved

        return [Support("frame", on_edge(blank), tuple(range(len(corner))), value)]

    return supports
