"""Work of the tools, summed over accepted states."""

import numpy as np


class Work:
    """Work of a force (3,) [N] that a tool exerts as it moves.

    Between the last two accepted states the force is the parabola in the load through the last three (the line
    through the first two), so that early, when forces grow as a power of the stroke, work is as exact as energies are.
    """

    def __init__(self) -> None:
        self._states: list[tuple[float, np.ndarray]] = []  # loads and forces of the last two accepted states
        self._place = np.zeros(3)

    def accept(self, load: float, force: np.ndarray, place: np.ndarray) -> None:
        """Take load, force and place (3,) [mm] of the tool as those of the last accepted state."""
        before = [state for state in self._states if state[0] < load]
        self._states = [*before, (load, force)][-2:]
        self._place = np.array(place)

    def since(self, load: float, force: np.ndarray, place: np.ndarray) -> float:
        """Work since the last accepted state, up to this load, force and place [N mm]."""
        *before, (last, start) = self._states
        mean = (start + force) / 2
        if before and load > last:
            ((first, earlier),) = before
            bend = ((force - start) / (load - last) - (start - earlier) / (last - first)) / (load - first)
            mean = mean - (load - last) ** 2 / 6 * bend
        return float(mean @ (place - self._place))

    def memory(self) -> np.ndarray:
        """Loads and forces of the accepted states that it remembers, (10,); a 0 before those that it lacks."""
        row = np.zeros((2, 5))
        for k, (load, force) in enumerate(self._states):
            row[k] = 1.0, load, *force
        return row.ravel()

    def recall(self, row: np.ndarray) -> None:
        """Take back what `memory` gave; `accept` then gives the place."""
        states = row.reshape(2, 5)
        self._states = [(float(load), np.array(force)) for known, load, *force in states if known]
