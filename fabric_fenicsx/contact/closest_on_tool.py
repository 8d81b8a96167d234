"""What of a tool is closest to the nodes of a sheet, on the side from which they came."""

import numpy as np

from ..core.formatting import coordinates
from ..surfaces.surfaces import Nearest
from ..surfaces.tool import Tool

# cosine of the angle between the normals where a way enters a body and where it leaves it, below
# which it goes through a wall; above, over an edge
THROUGH_A_WALL = -0.5
MAX_PLACES = 100  # on a way at which the gap is looked at


class ClosestOnTool:
    """What of a `tool` is closest to the nodes of a sheet.

    Where a wall of the tool is thin, the face closest to a node that was pushed into it may be the
    one behind. So each node keeps the last place in which it was accepted outside the body. One
    that went straight through a wall since then is in the body, as deep as it is behind the tangent
    plane where it went in.

    - outside (nodes, 7): those places, relative to the tool, the gap there, inf of none, and the
      normal, 0 where that is not known
    - passed (k,): numbers of the nodes that have gone through a wall, in the last state asked of
    - undefined_at: a place where the surface gave no number since the last accepted state, or ""
    """

    def __init__(self, tool: Tool, count: int) -> None:
        self.tool, self.undefined_at, self.passed = tool, "", np.zeros(0, int)
        self.outside = np.zeros((count, 7))
        self.outside[:, 3] = np.inf
        self._last: tuple[np.ndarray, Nearest] | None = None  # places from the tool's, and answer

    def at(self, x: np.ndarray, reach: float) -> Nearest:
        """Of nodes at x (nodes, 3) [mm]; exact within the `reach` [mm], and in the body."""
        off = x - self.tool.displacement
        if self._last and np.array_equal(off, self._last[0]):
            return self._last[1]
        nearest = self.tool.evaluate(x, reach)
        # their gaps may be bounds, of which forces are no derivatives
        self._evaluate_at(np.flatnonzero(nearest.gap < -0.9 * reach), nearest, x)
        lost = np.flatnonzero(np.isnan(nearest.gap) & np.isfinite(x).all(1))
        if len(lost):
            self.undefined_at = f"{coordinates(x[lost[0]])} mm"
        self._hold(off, nearest, reach)
        self._last = off, nearest
        return nearest

    def anywhere(self, x: np.ndarray, reach: float, exact: np.ndarray) -> Nearest:
        """As `at`, and exact however far off where `exact` (nodes,) is true."""
        nearest = Nearest(*(values.copy() for values in self.at(x, reach)))
        self._evaluate_at(np.flatnonzero(exact & (nearest.gap > 0.9 * reach)), nearest, x)
        return nearest

    def _evaluate_at(self, nodes, nearest, x):
        if len(nodes):
            for values, there in zip(nearest, self.tool.evaluate(x[nodes])):
                values[nodes] = there

    def accept(self, x: np.ndarray, reach: float) -> None:
        """Take the state in which nodes are at x as accepted."""
        nearest = self.at(x, reach)
        known = np.where(abs(nearest.gap) <= reach, nearest.normal.T, 0.0).T
        rows = np.column_stack([x - self.tool.displacement, nearest.gap, known])
        self.outside = np.where(nearest.gap[:, None] > 0, rows, self.outside)
        self.undefined_at = ""

    def _hold(self, x, nearest, reach):
        """Put into `nearest` what belongs to nodes that have gone through a wall to x."""
        place, gap, normal = np.split(self.outside, [3, 4], axis=1)
        way = x - place
        is_long = np.linalg.norm(way, axis=1) >= gap[:, 0] + abs(nearest.gap)
        is_same_face = (nearest.gap <= reach) & ((normal * nearest.normal).sum(1) > 0)
        at = np.flatnonzero(is_long & ~is_same_face)
        foot, across, through = self._walls(place[at], way[at], 1e-2 * reach)
        self.passed = at = at[through]
        nearest.normal[at], nearest.curvature[at] = across[through], 0.0
        nearest.gap[at] = ((x[at] - foot[through]) * across[through]).sum(1)

    def _walls(self, start, way, least):
        """Foot (k, 3) and normal (k, 3) where ways (k, 3) from `start` (k, 3) last enter the body,
        and whether they go through a wall there (k,), or beyond its middle."""
        foot, across = np.zeros((2, *way.shape))
        inside, through = np.zeros((2, len(way)), bool)
        length, gone = np.linalg.norm(way, axis=1), np.zeros(len(way))
        left = np.flatnonzero(length > 0)
        for _ in range(MAX_PLACES):
            if not len(left):
                break
            y = start[left] + (gone[left] / length[left])[:, None] * way[left]
            gap, normal, _ = self.tool.surface.evaluate(y, float(length.max()))
            enters = (gap < 0) & ~inside[left]
            foot[left[enters]] = (y - gap[:, None] * normal)[enters]
            across[left[enters]] = normal[enters]
            is_last = gone[left] == length[left]
            ends = inside[left] & ((gap >= 0) | is_last)
            opposed = (normal * across[left]).sum(1) < THROUGH_A_WALL
            through[left[ends & opposed]] = True
            inside[left] = gap < 0
            gone[left] = np.minimum(gone[left] + np.maximum(abs(gap), least), length[left])
            left = left[~(is_last | through[left] | np.isnan(gap))]
        return foot, across, through
