"""The faces of two sheets, lagged during a solve."""

from collections.abc import Callable

import numpy as np

from .contact_points import ContactPairs, ContactPoints


class LaggedFaces:
    """The `ContactPairs` that contact uses within a solve, so that its energy has no kinks.

    After a solve the faces are looked at again. If that changes the forces on the points by more
    than `lag` of their sum, they are taken anew, and the solve is to be repeated: all of the way to
    the solution at first, then as far as A. C. Aitken's rule says (U. Küttler and W. A. Wall,
    2008), less where solutions alternate. The first `owned` degrees of freedom are this rank's.

    accepted, now: those of the last accepted state and of the present solve
    """

    def __init__(self, points: ContactPoints, lag: float, owned: int) -> None:
        self._points, self.lag, self._owned = points, lag, owned
        self.accept()
        self.restore()

    @property
    def _u(self):
        return self._points.blank.u.x.array

    def _begin(self, place, pairs):
        """Take the faces of this displacement."""
        self._place, self._share, self.now = place, 1.0, pairs
        self._missed: np.ndarray | None = None

    def restore(self) -> None:
        """Go back to the faces of the last accepted state."""
        self._begin(self._accepted_place, self.accepted)

    def on_prediction(self) -> None:
        """Take the faces of a predicted state, with the areas of the last accepted one."""
        points, present = self._points, self._points.pairs()
        before = points.of_all(self.accepted, self.accepted.areas, np.nan)[present.points]
        areas = np.where(np.isnan(before), present.areas, before)
        self._begin(self._u.copy(), present._replace(areas=areas))

    def accept(self) -> None:
        self._accepted_place = self._u.copy()
        self.accepted = self.now = self._points.pairs()

    def update(self, forces: Callable[[ContactPairs], np.ndarray]) -> bool:
        """Take the faces anew if they are off by more than `lag`; true if so, the same on all
        ranks. forces: function of a `ContactPairs` to the forces on all points (count, 3) [N]."""
        comm, present, solution = self._points.blank.mesh.comm, self._points.pairs(), self._u.copy()
        before, after = forces(self.now), forces(present)
        sizes = [np.linalg.norm(each, axis=1).sum() for each in (after - before, after)]
        changed, total = comm.allreduce(np.array(sizes))
        if changed <= self.lag * total:
            return False
        missed = solution - self._place
        if self._missed is not None:
            less, last = (missed - self._missed)[: self._owned], self._missed[: self._owned]
            along, square = comm.allreduce(np.array([last @ less, less @ less]))
            self._share = float(np.clip(-self._share * along / max(square, 1e-300), 0.1, 1.0))
        self._missed, self._place = missed, solution
        if self._share < 1:
            self._u[:] = self._place = solution - (1 - self._share) * missed
            present = self._points.pairs()
            self._u[:] = solution
        self.now = present
        return True
