"""States that are sought by turns: how far to go each time."""

import numpy as np
from mpi4py import MPI

LEAST = 0.1  # share of the way


class Aitken:
    """Where to take what is held during a solve, from the solutions that followed: all of the way
    at first, then as far as A. C. Aitken's rule says (U. Küttler and W. A. Wall, 2008), less where
    solutions alternate. The first `owned` numbers of a solution are this rank's."""

    def __init__(self, comm: MPI.Comm, owned: int, taken: np.ndarray) -> None:
        self._comm, self._owned = comm, owned
        self.start(taken)

    def start(self, taken: np.ndarray) -> None:
        """Begin where it was `taken` last."""
        self._taken, self.share = taken, 1.0
        self._missed: np.ndarray | None = None

    def next(self, found: np.ndarray) -> np.ndarray:
        """Where to take it after the solution `found`."""
        missed = found - self._taken
        if self._missed is not None:
            less, before = (missed - self._missed)[: self._owned], self._missed[: self._owned]
            along, square = self._comm.allreduce(np.array([before @ less, less @ less]))
            self.share = float(np.clip(-self.share * along / max(square, 1e-300), LEAST, 1.0))
        self._taken = found.copy() if self.share == 1 else self._taken + self.share * missed
        self._missed = missed
        return self._taken
