"""Connected parts of things that pairs join."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


def connected(count: int, pairs: ArrayLike) -> tuple[int, np.ndarray]:
    """Number of parts of `count` things that pairs (2, k) join, and the part of each (count,)."""
    first, second = pairs = np.asarray(pairs)
    graph = coo_matrix((np.ones(pairs.shape[1]), (first, second)), shape=(count, count))
    return connected_components(graph, directed=False)
