"""Work of tools and supports, summed over accepted states."""

import numpy as np
from mpi4py import MPI

STATES = 3  # that are remembered


class Work:
    """Work of forces (n,) [N] whose points move: of a tool, of a load, or of the supports.

    Between two accepted states forces and places are parabolas in the load. So work over few steps
    is as exact as energies are, also where forces grow as a power of the load or turn with the
    tool. A parabola goes through the last three states. It is bent at most 10 times as much
    as the one before it, and to the same side: so a kink, as where friction begins to slip, stays a
    kink. Sizes and sides are those of all forces, or places, together: axes don't matter.

    With less than three states forces and places are straight lines. If `since` was asked of states
    on the way before, they are polynomials through all of these: so the work of a step that is
    doubted is recomputed. `reject` forgets these.

    comm: of the ranks that share the forces, and ask together; by default each knows them all.
    follows: whether places follow from the forces, as those of a dead load. They are no polynomials
    in the load, as a flat sheet sags by its cube root. So lines are straight, and polynomials are
    in load and travel together, each over its change in the step.
    """

    def __init__(self, follows: bool = False, comm: MPI.Comm = MPI.COMM_SELF) -> None:
        self._follows, self._most, self._comm = follows, 1 if follows else STATES, comm
        # loads, forces and places: the last accepted, and those asked of since
        self._states: list[tuple[float, np.ndarray]] = []
        self._asked: dict[float, np.ndarray] = {}

    def accept(self, load: float, force: np.ndarray, place: np.ndarray) -> None:
        """Take load, force and place (n,) [mm] as those of the last accepted state."""
        before = [state for state in self._states if state[0] < load]
        self._states = [*before, (load, np.array([force, place]))][-self._most :]
        self._asked = {}

    def reject(self) -> None:
        """Forget the states asked of since the last accepted one, as the step is retried."""
        self._asked = {}

    def since(self, load: float, force: np.ndarray, place: np.ndarray) -> float:
        """Work since the last accepted state, up to this load, force and place [N mm]."""
        start, now = self._states[-1], (load, np.array([force, place]))
        self._asked[load] = now[1]
        on_the_way = [each for each in self._asked.items() if start[0] < each[0] < load]
        if on_the_way:
            return _polynomial_work(sorted([start, *on_the_way, now]), self._follows)
        rise, moved = now[1] - start[1]
        work = (start[1][0] + now[1][0]) @ moved / 2
        if load > start[0]:
            bend, turn = (load - start[0]) ** 2 * self._curvature(*zip(*self._states, now))
            work += (turn @ rise - bend @ moved) / 6
        return float(work)

    def _curvature(self, loads, states):
        """Second divided differences of the last states, bounded by those before them."""
        slopes = [(b - a) / (y - x) for a, b, x, y in zip(states, states[1:], loads, loads[1:])]
        bends = [(b - a) / (y - x) for a, b, x, y in zip(slopes, slopes[1:], loads, loads[2:])]
        if not bends:
            return np.zeros_like(states[0])
        before, now = bends[0], bends[-1]  # the same after two steps
        products = [(a * b).sum(1) for a, b in ((before, before), (now, now), (before, now))]
        bound, size, along = self._comm.allreduce(np.array(products))[..., None]
        most = 10 * np.sqrt(bound / np.maximum(size, 1e-300))
        return now * np.where(along > 0, np.minimum(1.0, most), 0.0)

    def keep(self, points: np.ndarray) -> None:
        """Go on with these `points` (n,) of bool alone."""
        self._states = [(load, state[:, points]) for load, state in self._states]

    def memory(self) -> np.ndarray:
        """Whether there is a state (1 or 0), its load, force and place, (states, 2 + 2 n)."""
        rows = np.zeros((self._most, 2 + (self._states[0][1].size if self._states else 0)))
        for row, (load, state) in zip(rows, self._states):
            row[:] = 1.0, load, *state.ravel()
        return rows

    def recall(self, rows: np.ndarray) -> None:
        """Take back what `memory` gave."""
        self._states = [(float(row[1]), row[2:].reshape(2, -1).copy()) for row in rows if row[0]]


def _polynomial_work(known, follows):
    """Work over the `known` states, by polynomials in load, or load and travel (`follows`)."""
    loads, values = (np.array(each) for each in zip(*known))
    at = (loads - loads[0]) / (loads[-1] - loads[0])
    if follows:
        travel = np.linalg.norm(np.diff(values[:, 1], axis=0), axis=1).cumsum()
        at[1:] = (at[1:] + travel / travel[-1]) / 2 if travel[-1] else at[1:]
    powers = np.arange(len(at))
    forces, places = np.tensordot(np.linalg.inv(at[:, None] ** powers), values, 1).swapaxes(0, 1)
    # the integral of s^i d(s^j) over 0 to 1
    shares = powers / np.maximum(powers[:, None] + powers, 1)
    return float((shares * (forces @ places.T)).sum())
