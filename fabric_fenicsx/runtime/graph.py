"""Connected parts of things that pairs join."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


def connected(count: int, pairs: ArrayLike) -> tuple[int, np.ndarray]:
    """Number of connected parts of `count` things, and the part of each (count,), where `pairs`
    (2, k) are joined."""
    first, second = pairs = np.asarray(pairs)
    graph = coo_matrix((np.ones(pairs.shape[1]), (first, second)), shape=(count, count))
    return connected_components(graph, directed=False)
