"""Connected parts of things that pairs join."""

import numpy as np
import scipy
from numpy.typing import ArrayLike


def connected(count: int, pairs: ArrayLike) -> tuple[int, np.ndarray]:
    """Number of parts of `count` things that pairs (2, k) join, and the part of each (count,)."""
    first, second = pairs = np.asarray(pairs)
    ones = np.ones(pairs.shape[1])
    graph = scipy.sparse.coo_matrix((ones, (first, second)), shape=(count, count))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)
