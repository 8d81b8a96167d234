"""Dead loads on a blank."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import ufl
from numpy.typing import ArrayLike

from ..core.rules import FINITE, Rule
from ..sheet.blank import Blank
from ..surfaces.values import checked_vector
from .assembly import assembled
from .term import SceneFacts, Term
from .work import Work


def vector_on(blank: Blank, name: str, vector: ArrayLike, unit: bool = False) -> np.ndarray:
    """`vector` (gdim,), if `unit` at length 1; InputError, which calls it `name`, if it is none."""
    if blank.mesh.geometry.dim == 3:
        return checked_vector(name, vector, unit)
    return checked_vector(f"{name}, on a blank without `spatial=True`,", vector, unit, "two")


def at_load(name: str, rule: Rule, given: float | Callable[[float], float], load: float) -> float:
    """A number, or a function's at a load factor; InputError unless that is one by `rule`."""
    if callable(given):
        name, given = f"{name} at load {load:g}", given(load)
    return rule.check(name, given)


class _DeadLoad(Term):
    """A load of fixed direction whose size depends on the load factor alone. A subclass gives its
    direction, and where it acts as a measure of UFL, to `_start`, and `_size(load)`."""

    _size: Callable[[float], float]

    def _start(self, name, direction, measure):
        unit = vector_on(self.blank, name, direction, unit=True)
        test = self.blank.in_space(ufl.TestFunction(self.blank.V))
        form = ufl.dot(test, ufl.as_vector(unit.tolist())) * measure
        self._forces, self._u = assembled(form), self.blank.u  # at owned degrees of freedom
        self._work = Work(follows=True)
        self.set_load(0.0)
        self.accept()

    def set_load(self, load: float) -> None:
        self._load, self._now = load, self._size(load)

    def accept(self) -> None:
        self._work.accept(*self._state())

    def reject(self) -> None:
        self._work.reject()

    def work(self) -> float:
        """Done on all of the sheet since the last accepted state, on rank 0 [N mm]."""
        done = self._work.since(*self._state())
        return done if self.blank.mesh.comm.rank == 0 else 0.0

    def stored(self) -> float:
        return -self._now * self._travel()

    def add_forces(self, f: np.ndarray) -> None:
        f[: len(self._forces)] -= self.applied_forces()

    def applied_forces(self) -> np.ndarray:
        return self._now * self._forces

    def _travel(self):
        """Travel of this rank's part of what is loaded, times its size [mm^2 or mm^3]."""
        return float(self._forces @ self._u.x.array[: len(self._forces)])

    def _state(self):
        travel = self.blank.mesh.comm.allreduce(self._travel())
        return self._load, np.array([self._now]), np.array([travel])


class DeadPressure(_DeadLoad):
    """Pressure per undeformed area along a fixed direction, growing with the load factor. Its
    potential is minus int p u . n dA.

    Parameters
    ----------
    pressure : float
        At full load [MPa].
    direction : array_like, (gdim,)
        Along which it pushes; of any length.

    Raises
    ------
    InputError
        For numbers that are not finite, and a direction of length 0.

    Examples
    --------
    >>> ply = ff.Blank.rectangle(20, 10, nx=2, spatial=True)
    >>> gas = ff.DeadPressure(0.02, (0, 0, -1))
    >>> terms = [ff.Membrane(ff.load("komeili")), gas]
    >>> scene = ff.Scene(ply, terms, ff.clamped_ends(0.1))
    >>> scene.set_load(0.5)
    >>> ply.u.interpolate(lambda x: (0 * x[0], 0 * x[0], 0 * x[0] - 2.0))
    >>> round(gas.work(), 6)  # the mean force, 0.005 MPa of 200 mm^2, over 2 mm [N mm]
    2.0
    """

    name = "dead pressure"

    def __init__(self, pressure: float, direction: ArrayLike) -> None:
        self._pressure = FINITE.check("dead pressure [MPa]", pressure)
        self._direction = direction

    def set_up(self, scene: SceneFacts) -> None:
        self._start(f"direction of {self.name}", self._direction, self.part.dx())

    def _size(self, load):
        return load * self._pressure


class EdgeTension(_DeadLoad):
    """Pull of grippers along a fixed direction on an undeformed edge.

    Parameters
    ----------
    tension : float or callable
        Per length of edge [N/mm]: a number, there from the start, or a function of the load factor.
    direction : array_like, (gdim,)
        Along which it pulls; of any length.
    edge : callable
        Function of points (3, n) [mm] to a mask (n,), true at both ends of the edge's sides.

    Raises
    ------
    InputError
        If `edge` marks no side, and for numbers that are not finite.

    Examples
    --------
    >>> strip = ff.Blank.rectangle(20, 10, nx=2)
    >>> pull = ff.EdgeTension(0.3, (1, 0), lambda x: x[0] > 19.9)
    >>> held = ff.Support("left", lambda x: x[0] < 0.1, (0, 1))
    >>> scene = ff.Scene(strip, [ff.Membrane(ff.load("komeili")), pull], [held])
    >>> round(float(pull.applied_forces().sum()), 6)  # [N]
    3.0
    """

    name = "edge tension"

    def __init__(
        self,
        tension: float | Callable[[float], float],
        direction: ArrayLike,
        edge: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        at_load(f"{self.name} [N/mm]", FINITE, tension, 0.0)
        self._tension, self.direction, self.edge = tension, direction, edge

    def set_up(self, scene: SceneFacts) -> None:
        name = f"direction of {self.name} on {scene.blank.name}"
        self._start(name, self.direction, self.part.ds(self.edge))

    def _size(self, load):
        return at_load(f"{self.name} [N/mm]", FINITE, self._tension, load)
