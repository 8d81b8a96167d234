"""Dead loads on a blank."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import ArrayLike
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..runtime.errors import InputError
from ..runtime.rules import FINITE, Rule
from ..tools.values import checked_vector, length_of
from .term import SceneFacts, Term
from .work import Work


def _direction(name: str, direction: ArrayLike, gdim: int) -> np.ndarray:
    """`direction` (gdim,) at length 1; InputError if it has none."""
    plane = gdim == 2 and length_of(direction) == 3
    hint = ", or three on a blank made with `spatial=True`" if plane else ""
    return checked_vector(f"direction of {name}", direction, True, gdim, hint)


def check_over_load(name: str, rule: Rule, given: float | Callable[[float], float]) -> None:
    """InputError unless `given` is a number by `rule`, or a function, which `at_load` checks."""
    if not callable(given):
        rule.check(name, given)


def at_load(name: str, rule: Rule, given: float | Callable[[float], float], load: float) -> float:
    """A number, or what a function of the load factor gives there; InputError, which calls it
    `name`, unless that is a number by `rule`."""
    if not callable(given):
        return float(given)
    return rule.check(f"{name} at load {load:g}", given(load))


class DeadPressure(Term):
    """Load of `pressure` [MPa] per undeformed area along a fixed `direction` (gdim,), growing with
    the load factor. Raises InputError for numbers that are not finite."""

    name = "dead pressure"

    def __init__(self, pressure: float, direction: ArrayLike) -> None:
        self._pressure = FINITE.check("dead pressure [MPa]", pressure)
        self._direction = direction

    def set_up(self, scene: SceneFacts) -> None:
        """As in `Term`."""
        blank = scene.blank
        self._now = fem.Constant(blank.mesh, 0.0)
        unit = _direction(self.name, self._direction, blank.mesh.geometry.dim)
        moved = ufl.dot(blank.displacement, ufl.as_vector(unit.tolist())) * self.part.dx()
        self.energy = -self._now * moved
        self._moved, self._work = compat.form(moved), Work(1)
        self.set_load(0.0)
        self.accept()

    def set_load(self, load: float) -> None:
        """Set the load factor."""
        self._load, self._now.value = load, load * self._pressure

    def accept(self) -> None:
        """Count `work` from the present state."""
        self._work.accept(*self._state())

    def work(self) -> float:
        """Done on this rank's part since the last accepted state [N mm]."""
        return self._work.since(*self._state())

    def _state(self):
        pressure = float(self._now.value)
        return self._load, np.array([pressure]), np.array([fem.assemble_scalar(self._moved)])


class EdgeTension(Term):
    """Pull of grippers: `tension` [N/mm] along a fixed `direction` (gdim,) on an undeformed edge.

    tension: a number, there from the start, or a function of the load factor. edge: function of
    points (3, n) [mm] to a mask (n,), true at both ends of the edge's sides. Raises InputError if
    it marks no side, and for numbers that are not finite.
    """

    name = "edge tension"

    def __init__(
        self,
        tension: float | Callable[[float], float],
        direction: ArrayLike,
        edge: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        check_over_load(f"{self.name} [N/mm]", FINITE, tension)
        self._tension, self._direction, self._edge = tension, direction, edge

    def set_up(self, scene: SceneFacts) -> None:
        """As in `Term`."""
        blank = scene.blank
        unit = _direction(f"{self.name} on {blank.name}", self._direction, blank.mesh.geometry.dim)
        along = ufl.dot(blank.in_space(ufl.TestFunction(blank.V)), ufl.as_vector(unit.tolist()))
        try:
            ds = self.part.ds(self._edge)
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from error
        lengths = fem_petsc.assemble_vector(compat.form(along * ds))
        lengths.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        # of the edge at each owned degree of freedom
        self._lengths, self._u, self._work = lengths.array.copy(), blank.u, Work(1)
        self.set_load(0.0)
        self.accept()

    def set_load(self, load: float) -> None:
        """Set the load factor; InputError if the tension there is not finite."""
        self._load = load
        self._now = at_load(f"{self.name} [N/mm]", FINITE, self._tension, load)

    def accept(self) -> None:
        """Count `work` from the present state."""
        self._work.accept(*self._state())

    def work(self) -> float:
        """Done on this rank's part since the last accepted state [N mm]."""
        return self._work.since(*self._state())

    def _state(self):
        return self._load, np.array([self._now]), np.array([self._travel()])

    def stored(self) -> float:
        """As in `Term`."""
        return -self._now * self._travel()

    def add_forces(self, f: np.ndarray) -> None:
        """As in `Term`."""
        f[: len(self._lengths)] -= self._now * self._lengths

    def applied_forces(self) -> np.ndarray:
        """As in `Term`."""
        return self._now * self._lengths

    def _travel(self):
        """Travel of this rank's part of the edge, times its length [mm^2]."""
        return float(self._lengths @ self._u.x.array[: len(self._lengths)])
