"""Points of one sheet and the places on another one that lie below them."""

from functools import cached_property

import numpy as np
from scipy import sparse

from ...sheets.blank import Blank
from ..gathered import GatheredNodes
from .coupled import Coupled


class Pairs:
    """Points of a sheet that move relative to another one as `weights` (n, k) times the nodes (k,),
    which are global numbers. All points have as many weights. All ranks make and use it
    together."""

    def __init__(self, blank: Blank, nodes: np.ndarray, weights: sparse.csr_matrix) -> None:
        used = np.unique(weights.indices)
        self._relative = weights = weights[:, used].tocsr()
        self._transposed = weights.T.tocsr()
        self._known = nodes[used]
        self._gathered = GatheredNodes(blank, self._known)

    @cached_property
    def coupled(self) -> Coupled:
        """The nodes that the points couple."""
        return Coupled(self._by_point(self._relative.indices), self._known)

    def relative(self) -> np.ndarray:
        """Displacement of the points relative to the other sheet, (n, 3) [mm]."""
        return self._relative @ self._gathered.displacement()

    def apart(self, owned: np.ndarray) -> np.ndarray:
        """Values at the points less those on the other sheet below them, (n, 3); owned (nodes, 3):
        the values at this rank's owned nodes."""
        return self._relative @ self._gathered.values(owned)

    def add(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add forces (n, 3) on the points and their reactions to f, this rank's degrees of freedom
        [N]."""
        self._gathered.add(self._transposed @ forces, f)

    def values(self, blocks: np.ndarray) -> np.ndarray:
        """Stiffness (m,) [N/mm] at the rows and columns of `coupled`. blocks (n, 3, 3): growth of
        the force on each point as it moves."""
        return self.coupled.weighted(self._by_point(self._relative.data), blocks)

    def _by_point(self, entries):
        """Entries of all weights as rows (n, k)."""
        n = self._relative.shape[0]
        return entries.reshape(n, len(entries) // max(n, 1))
