"""The faces of two sheets, lagged during a solve."""

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from .contact_points import ContactPairs, ContactPoints


class Aitken:
    """Relaxation of what is lagged, from the solutions that followed: all of the way at first, then
    as far as A. C. Aitken's rule says (U. Küttler and W. A. Wall, 2008), less where solutions
    alternate. The first `owned` numbers of a solution are this rank's."""

    def __init__(self, comm: MPI.Comm, owned: int, state: np.ndarray) -> None:
        self._comm, self._owned = comm, owned
        self.start(state)

    def start(self, state: np.ndarray) -> None:
        """Begin at this state."""
        self._state, self.share = state, 1.0
        self._missed: np.ndarray | None = None

    def next(self, solution: np.ndarray) -> np.ndarray:
        """State to take after this solution."""
        missed = solution - self._state
        if self._missed is not None:
            less, before = (missed - self._missed)[: self._owned], self._missed[: self._owned]
            along, square = self._comm.allreduce(np.array([before @ less, less @ less]))
            self.share = float(np.clip(-self.share * along / max(square, 1e-300), 0.1, 1.0))
        self._state = solution.copy() if self.share == 1 else self._state + self.share * missed
        self._missed = missed
        return self._state


class LaggedFaces:
    """The `ContactPairs` that contact uses within a solve, so that its energy has no kinks.

    After a solve the faces are looked at again. If that changes the forces on the points by more
    than `lag` of their sum, they are taken anew, and the solve is to be repeated. Where solutions
    alternate, they are taken only part of the way there (see `Aitken`).

    accepted, now: those of the last accepted state and of the present solve
    """

    def __init__(self, points: ContactPoints, lag: float, owned: int) -> None:
        self._points, self.lag = points, lag
        self._place = self._u.copy()  # of the last accepted state
        self._aitken = Aitken(points.blank.mesh.comm, owned, self._place)
        self.accepted = self.now = points.pairs()

    @property
    def _u(self):
        return self._points.blank.u.x.array

    def restore(self) -> None:
        """Go back to the faces of the last accepted state."""
        self._aitken.start(self._place)
        self.now = self.accepted

    def on_prediction(self) -> None:
        """Take the faces of a predicted state, with the areas of the last accepted one."""
        points, present = self._points, self._points.pairs()
        before = points.of_all(self.accepted, self.accepted.areas, np.nan)[present.points]
        areas = np.where(np.isnan(before), present.areas, before)
        self._aitken.start(self._u.copy())
        self.now = present._replace(areas=areas)

    def accept(self) -> None:
        self._place = self._u.copy()
        self.accepted = self.now = self._points.pairs()

    def update(self, forces: Callable[[ContactPairs], np.ndarray]) -> bool:
        """Take the faces anew if they are off by more than `lag`; true if so, the same on all
        ranks. forces: function of a `ContactPairs` to the forces on all points (count, 3) [N]."""
        present = self._points.pairs()
        before, after = forces(self.now), forces(present)
        sizes = [np.linalg.norm(each, axis=1).sum() for each in (after - before, after)]
        changed, total = self._points.blank.mesh.comm.allreduce(np.array(sizes))
        if changed <= self.lag * total:
            return False
        place, solution = self._aitken.next(self._u), self._u.copy()
        if self._aitken.share < 1:
            self._u[:] = place
            present = self._points.pairs()
            self._u[:] = solution
        self.now = present
        return True
