"""Work of tools and supports, summed over accepted states."""

import numpy as np

STATES = 3  # that are remembered
GROWTH = 10  # of the bend from one step to the next, beyond which it is a kink


class Work:
    """Work of forces (n,) [N] whose points move: of a tool, or of the supports.

    Between two accepted states forces and places are parabolas in the load. So work over few steps
    is as exact as energies are, also where forces grow as a power of the load or turn with the
    tool. A parabola goes through the last three states. It is bent at most `GROWTH` times as much
    as the one before it, and to the same side: so a kink, as where friction begins to slip, stays a
    kink. Sizes and sides are those of all forces, or places, together: axes don't matter.
    """

    def __init__(self) -> None:
        # loads, forces and places: the last accepted
        self._states: list[tuple[float, np.ndarray]] = []

    def accept(self, load: float, force: np.ndarray, place: np.ndarray) -> None:
        """Take load, force and place (n,) [mm] as those of the last accepted state."""
        before = [state for state in self._states if state[0] < load]
        self._states = [*before, (load, np.array([force, place]))][-STATES:]

    def since(self, load: float, force: np.ndarray, place: np.ndarray) -> float:
        """Work since the last accepted state, up to this load, force and place [N mm]."""
        loads, states = zip(*self._states, (load, np.array([force, place])))
        rise, moved = states[-1] - states[-2]
        work = (states[-2][0] + states[-1][0]) @ moved / 2
        if load > loads[-2]:
            bend, turn = (load - loads[-2]) ** 2 * _curvature(loads, states)
            work += (turn @ rise - bend @ moved) / 6
        return float(work)

    def memory(self) -> np.ndarray:
        """Load, force and place of up to three states, (3, 2 + 2 n); the first column is 0 where
        there is none yet."""
        rows = np.zeros((STATES, 2 + (self._states[0][1].size if self._states else 0)))
        for row, (load, state) in zip(rows, self._states):
            row[:] = 1.0, load, *state.ravel()
        return rows

    def recall(self, rows: np.ndarray) -> None:
        """Take back what `memory` gave."""
        self._states = [(float(row[1]), row[2:].reshape(2, -1).copy()) for row in rows if row[0]]


def _curvature(loads, states):
    """Second divided differences of the last states, bounded by those before them."""
    slopes = [(b - a) / (y - x) for a, b, x, y in zip(states, states[1:], loads, loads[1:])]
    bends = [(b - a) / (y - x) for a, b, x, y in zip(slopes, slopes[1:], loads, loads[2:])]
    if not bends:
        return np.zeros_like(states[0])
    before, now = bends[0], bends[-1]  # the same after two steps
    bound, size = (np.linalg.norm(bend, axis=1, keepdims=True) for bend in (GROWTH * before, now))
    along = (before * now).sum(1, keepdims=True) > 0
    return now * np.where(along, np.minimum(1.0, bound / np.maximum(size, 1e-300)), 0.0)
