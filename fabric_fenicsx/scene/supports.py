"""Supports: nodes whose displacement is prescribed."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.errors import InputError
from ..core.formatting import rounded
from ..core.rules import FINITE
from ..sheet.blank import Blank
from ..sheet.sheet_mesh import bounds
from ..surfaces.values import checked_vector


@dataclass(frozen=True)
class Support:
    """Prescribed displacement of some nodes along the axes of the blank's frame.

    Parameters
    ----------
    name
        In messages, and for `Scene.reaction`.
    where
        Function of points (3, n) [mm] that returns a mask (n,).
    components
        Axes that are fixed: 0, 1 and, for a sheet in space, 2.
    value
        Displacement at full load (gdim,) [mm], which grows with the load factor, or a function of
        points (3, n) and load factor that returns (gdim, n). Raises InputError if it is neither.
    locates
        The support only keeps the sheet from moving as a rigid body and should bear nothing. It is
        dropped from a single sheet as soon as friction of tools holds that. Otherwise a run warns
        if such supports bear more than 0.5 % of all forces on nodes from outside, added up by size,
        and is not believed beyond `Limits.located`.

    Examples
    --------
    >>> ff.Support("left end", lambda x: x[0] < 1e-6, (0, 1)).value
    (0.0, 0.0, 0.0)
    """

    name: str
    where: Callable[[np.ndarray], np.ndarray]
    components: tuple[int, ...]
    value: Sequence[float] | Callable[[np.ndarray, float], np.ndarray] = (0.0, 0.0, 0.0)
    locates: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "components", tuple(int(each) for each in self.components))
        if not callable(self.value):
            name = f"value of support {self.name}"
            vector = checked_vector(name, self.value, size="two or three")
            object.__setattr__(self, "value", (*vector.tolist(), 0.0)[:3])

    def at(self, x: np.ndarray, load: float) -> np.ndarray:
        """Displacements (2 or 3, n) [mm] of points x (3, n) at a load factor."""
        if not callable(self.value):
            return load * np.outer(self.value, np.ones(x.shape[1]))
        return np.asarray(self.value(x, load), float)


# of a scene: supports, or a function that makes them for its blank
Supports = Iterable[Support] | Callable[[Blank], Iterable[Support]]


def clamped_ends(stroke: float = 0.0) -> Callable[[Blank], list[Support]]:
    """Supports of a strip that is clamped at both ends and pulled along its length: a function of a
    blank, for `Scene`. It raises InputError if an end is not straight over half the strip's width
    or more.

    Parameters
    ----------
    stroke
        Displacement of the "moving grip" along the frame's first axis [mm]; the "fixed grip" stays.

    Examples
    --------
    >>> [s.name for s in ff.clamped_ends(2.0)(ff.Blank.rectangle(40, 20, nx=4))]
    ['fixed grip', 'moving grip']
    """
    stroke = FINITE.check("`stroke`", stroke)
    return lambda blank: _ends(blank, stroke, tuple(range(blank.mesh.geometry.dim)))


def rolling_ends(stroke: float = 0.0) -> Callable[[Blank], list[Support]]:
    """Supports of a strip that is pulled at both ends, which are free to move across it.

    One corner is fixed across, too. See `clamped_ends` for parameters, result and errors.

    Examples
    --------
    >>> [s.components for s in ff.rolling_ends(2.0)(ff.Blank.rectangle(40, 20, nx=4))]
    [(0,), (0,), (1,)]
    """
    stroke = FINITE.check("`stroke`", stroke)

    def supports(blank: Blank) -> list[Support]:
        low, high = blank.extent()
        near, corner = 1e-6 * (high - low).max(), low[:2, None]
        at_corner = lambda x: (np.abs(blank.along(x)[:2] - corner) <= near).all(0)  # noqa: E731
        ends = _ends(blank, stroke, (0, *range(2, len(low))))
        return [*ends, Support("corner", at_corner, (1,))]

    return supports


def _ends(blank, stroke, components):
    low, high = blank.extent()
    x, comm, near = blank.along(blank.coordinates().T), blank.mesh.comm, 1e-6 * (high - low).max()
    for name, position in (("low", low[0]), ("high", high[0])):
        first, last = bounds(comm, x[1:2, np.abs(x[0] - position) <= near])
        held = float((last - first)[0])
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
    """Function of points (3, n) that returns the mask (n,) of those on a rectangle's edge."""
    low, high = (corner[:2, None] for corner in blank.extent())
    near = 1e-6 * (high - low).max()

    def edge(x):
        x = blank.along(x)[:2]
        return (np.minimum(np.abs(x - low), np.abs(x - high)) <= near).any(0)

    return edge


def frame(deformation: Callable[[float], np.ndarray]) -> Callable[[Blank], list[Support]]:
    """Support "frame" of a rectangle's whole edge that deforms it homogeneously: a function of a
    blank, for `Scene`.

    Parameters
    ----------
    deformation
        Function of the load factor that returns the deformation gradient (2, 2).

    Examples
    --------
    >>> shear = ff.frame(lambda load: np.array([[1.0, 0.1 * load], [0.0, 1.0]]))
    >>> [support.name for support in shear(ff.Blank.rectangle(10, 10, nx=2))]
    ['frame']
    """

    def supports(blank: Blank) -> list[Support]:
        low = blank.extent()[0][:2, None]

        def value(x, load):
            x = blank.along(x)
            moved = np.zeros_like(x)
            moved[:2] = (deformation(load) - np.eye(2)) @ (x[:2] - low)
            return moved

        return [Support("frame", on_edge(blank), tuple(range(blank.mesh.geometry.dim)), value)]

    return supports
