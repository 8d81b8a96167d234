"""Points of one sheet and the places on another one that lie below them."""

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from ...sheets.blank import Blank
from ..gathered import GatheredNodes

# the different entries of a symmetric 3 x 3 matrix, and where each of all nine is among them
ENTRIES = np.triu_indices(3)
SYMMETRIC = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])


class Pairs:
    """Points of a sheet that move relative to another one as `weights` (n, k) times the nodes (k,),
    which are global numbers. All ranks make and use it together."""

    def __init__(self, blank: Blank, nodes: np.ndarray, weights: sparse.csr_matrix) -> None:
        used = np.unique(weights.indices)
        self._relative = weights = weights[:, used].tocsr()
        self._transposed = weights.T.tocsr()
        known = nodes[used]
        self._gathered = GatheredNodes(blank, known)
        self._known = known
        self._shares: sparse.csr_matrix | None = None

    def _take_places(self):
        """The places of weights^T blocks weights, and what each point adds to them; not before a
        stiffness is asked for."""
        weights, known = self._relative, self._known
        weights.sort_indices()
        here = np.arange(weights.nnz)
        # each entry with itself and those behind it in its row: one half of a symmetric matrix
        behind = np.repeat(weights.indptr[1:], np.diff(weights.indptr)) - here
        first = np.repeat(here, behind)
        second = first + np.arange(len(first)) - np.repeat(behind.cumsum() - behind, behind)
        nodes = weights.indices.astype(np.int64)
        point = np.repeat(np.arange(weights.shape[0]), np.diff(weights.indptr))[first]
        keys, place = np.unique(nodes[first] * len(known) + nodes[second], return_inverse=True)
        shares = weights.data[first] * weights.data[second]
        self._shares = sparse.csr_matrix((shares, (place, point)), (len(keys), weights.shape[0]))
        i, j = np.divmod(keys, len(known))
        self._mirrored = np.flatnonzero(i != j)
        i, j = np.append(i, j[self._mirrored]), np.append(j, i[self._mirrored])
        axis = np.arange(3)
        rows, cols = (
            (known[i] * 3)[:, None, None] + axis[:, None],
            (known[j] * 3)[:, None, None] + axis,
        )
        self._rows, self._cols = (
            a.astype(PETSc.IntType).ravel() for a in np.broadcast_arrays(rows, cols)
        )

    @property
    def rows(self) -> np.ndarray:
        """Global degrees of freedom (m,) of the rows of `values`."""
        if self._shares is None:
            self._take_places()
        return self._rows

    @property
    def cols(self) -> np.ndarray:
        """Likewise of the columns."""
        if self._shares is None:
            self._take_places()
        return self._cols

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
        """Stiffness (m,) [N/mm] at `rows` and `cols`. blocks (n, 3, 3), symmetric: by how much the
        force on each point grows as it moves."""
        if not blocks.any():
            return np.zeros(len(self.rows))
        if self._shares is None:
            self._take_places()
        half = (self._shares @ blocks[:, ENTRIES[0], ENTRIES[1]])[:, SYMMETRIC]
        return np.append(half, half[self._mirrored], axis=0).ravel()
