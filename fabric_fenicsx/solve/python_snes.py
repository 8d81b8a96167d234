"""What PETSc's SNES calls of a solver that is written in Python."""

import weakref
from collections.abc import Callable
from typing import Any


class IterationEnded(Exception):
    """Carries the SNES reason out of the iteration."""


class Callbacks:
    """Methods of a solver, held weakly: Python does not see PETSc's references and would never free
    the scene."""

    def __init__(
        self,
        solve: Callable[..., None],
        function: Callable[..., None],
        jacobian: Callable[..., None],
    ) -> None:
        self.solve, self.function, self.jacobian = map(_weak, (solve, function, jacobian))


def _weak(method):
    known: Callable[[], Any] = weakref.WeakMethod(method)
    return lambda *arguments: known()(*arguments)
