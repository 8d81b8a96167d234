"""Stiffness between the nodes that are coupled by touching points."""

import numpy as np
from petsc4py import PETSc

from ...runtime.compiled import compiled


class Coupled:
    """Pairs of nodes that n points couple, each all of its k `nodes` (n, k). These are places in
    `known`, global numbers.

    rows, cols (m,): global degrees of freedom of the pairs' 3 x 3 blocks
    """

    def __init__(self, nodes: np.ndarray, known: np.ndarray) -> None:
        nodes = nodes.astype(np.int64)
        keys, self._places = np.unique(
            nodes[:, :, None] * len(known) + nodes[:, None], return_inverse=True
        )
        self._places = self._places.reshape(*nodes.shape, nodes.shape[1]).astype(np.int32)
        self._count = len(keys)
        i, j = np.divmod(keys, max(len(known), 1))
        axis = np.arange(3)
        rows = (known[i] * 3)[:, None, None] + axis[:, None]
        cols = (known[j] * 3)[:, None, None] + axis
        self.rows, self.cols = (
            each.astype(PETSc.IntType).ravel() for each in np.broadcast_arrays(rows, cols)
        )

    def weighted(self, weights: np.ndarray, blocks: np.ndarray) -> np.ndarray:
        """Stiffness (m,) [N/mm] at `rows` and `cols` of points that move as `weights` (n, k) times
        their nodes. blocks (n, 3, 3): growth of the force on each as it moves."""
        return _weighted(weights, blocks, self._places, self._count).ravel()

    def moved(self, motions: np.ndarray, blocks: np.ndarray) -> np.ndarray:
        """As `weighted`, of points that move as matrices `motions` (n, 3, 3 k) times their
        nodes."""
        return _moved(motions, blocks, self._places, self._count).ravel()


@compiled
def _weighted(weights, blocks, places, count):
    """Sums (count, 9) of weight times block times weight."""
    values = np.zeros((count, 9))
    for n in range(len(weights)):
        block = blocks[n].ravel()
        if not block.any():
            continue
        for i in range(weights.shape[1]):
            for j in range(weights.shape[1]):
                share, value = weights[n, i] * weights[n, j], values[places[n, i, j]]
                for m in range(9):
                    value[m] += share * block[m]
    return values


@compiled
def _moved(motions, blocks, places, count):
    """Sums (count, 3, 3) of transposed matrix times block times matrix."""
    values, pulled = np.zeros((count, 3, 3)), np.empty(motions.shape[1:])
    for n in range(len(motions)):
        L, B = motions[n], blocks[n]
        if not B.any():
            continue
        for a in range(3):
            for j in range(L.shape[1]):
                pulled[a, j] = B[a, 0] * L[0, j] + B[a, 1] * L[1, j] + B[a, 2] * L[2, j]
        for i in range(places.shape[1]):
            for j in range(places.shape[2]):
                mine, others, value = L[:, 3 * i :], pulled[:, 3 * j :], values[places[n, i, j]]
                for a in range(3):
                    for b in range(3):
                        value[a, b] += (
                            mine[0, a] * others[0, b]
                            + mine[1, a] * others[1, b]
                            + mine[2, a] * others[2, b]
                        )
    return values
