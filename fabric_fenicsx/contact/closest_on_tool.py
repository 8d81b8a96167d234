"""What of a tool is closest to the nodes of a sheet, on the side from which they came."""

import numpy as np

from ..core.formatting import coordinates
from ..energy.nodes import Nodes
from ..surfaces.curved_triangles import row_dots
from ..surfaces.surfaces import Nearest
from ..surfaces.tool import Tool

# cosine between normals where a way enters and leaves a body: below, a wall; above, an edge
THROUGH_A_WALL = -0.5


class ClosestOnTool:
    """What of a `tool` is closest to the `nodes` of a sheet; exact within the `reach` [mm], and in
    the body.

    Where a wall of the tool is thin, the face closest to a node that was pushed into it may be the
    one behind. So each node keeps the last place in which it was accepted outside the body. One
    that went straight through a wall since then is in the body, as deep as it is behind the tangent
    plane where it went in.

    - outside (nodes, 7): those places, relative to the tool, the gap there, inf of none, and the
      normal, 0 where that is not known
    - passed (k,): numbers of the nodes that have gone through a wall, in the last state asked of
    - undefined_at: a place where the surface gave no number since the last accepted state, or ""
    """

    def __init__(self, tool: Tool, nodes: Nodes) -> None:
        self.tool, self.nodes, self.reach = tool, nodes, 0.0
        self.undefined_at, self.passed = "", np.zeros(0, int)
        self.recall(np.tile([0.0, 0.0, 0.0, np.inf, 0.0, 0.0, 0.0], (nodes.count, 1)))

    def recall(self, outside: np.ndarray) -> None:
        """Take `outside` of a last accepted state."""
        self.outside = outside
        self._last: tuple[np.ndarray, Nearest] | None = None  # places from the tool's, and answer

    @property
    def _x(self):
        return self.nodes.places + self.nodes.view() - self.tool.displacement

    def now(self) -> Nearest:
        """Where nodes and tool are now."""
        x = self._x
        if self._last and np.array_equal(x, self._last[0]):
            return self._last[1]
        nearest = self.tool.surface.evaluate(x, self.reach)
        # their gaps may be bounds, of which forces are no derivatives
        self._make_exact(nearest, x, nearest.gap < -0.9 * self.reach)
        lost = np.flatnonzero(np.isnan(nearest.gap) & np.isfinite(x).all(1))
        if len(lost):
            self.undefined_at = f"{coordinates((x + self.tool.displacement)[lost[0]])} mm"
        self._hold(nearest, x)
        self._last = x, nearest
        return nearest

    def anywhere(self, exact: np.ndarray) -> Nearest:
        """As `now`, and exact however far off where `exact` (nodes,) is true."""
        nearest = Nearest(*(values.copy() for values in self.now()))
        self._make_exact(nearest, self._x, exact & (nearest.gap > 0.9 * self.reach))
        return nearest

    def _make_exact(self, nearest, x, where):
        at = np.flatnonzero(where)
        if len(at):
            exact = self.tool.surface.evaluate(x[at])
            known = np.isfinite(exact.gap)
            for values, there in zip(nearest, exact):
                values[at[known]] = there[known]

    def accept(self) -> None:
        """Take the present state as accepted."""
        gap, normal, _ = self.now()
        rows = np.column_stack([self._x, gap, np.where(abs(gap) <= self.reach, normal.T, 0.0).T])
        self.outside = np.where(gap[:, None] > 0, rows, self.outside)
        self.undefined_at = ""

    def _hold(self, nearest, x):
        """Put into `nearest` what belongs to nodes that have gone through a wall to x."""
        place, gap, normal = self.outside[:, :3], self.outside[:, 3], self.outside[:, 4:]
        way = x - place
        length = np.sqrt(row_dots(way, way))
        at = np.flatnonzero(self.nodes.mask & (length >= gap + abs(nearest.gap)))
        now = nearest.normal[at]
        came_along, is_same = (row_dots(each[at], now) > 0 for each in (way, normal))
        at = at[(nearest.gap[at] > self.reach) | came_along & ~is_same]
        # no face is nearer to either end than the gap there
        ends = gap[at], length[at] - np.maximum(nearest.gap[at], 0.0)
        foot, across, through = self._walls(place[at], way[at] / length[at, None], *ends)
        self.passed = at = at[through]
        nearest.normal[at], nearest.curvature[at] = across[through], 0.0
        nearest.gap[at] = row_dots(x[at] - foot[through], across[through])

    def _walls(self, start, along, gone, last):
        """Foot (k, 3) and normal (k, 3) where ways from `start` (k, 3) along unit vectors (k, 3)
        last enter the body, looked at from distances `gone` to `last` (k,) on, and whether they go
        through a wall there, or beyond its middle (k,)."""
        foot, across = np.zeros((2, *start.shape))
        inside, through = np.zeros((2, len(start)), bool)
        left, farthest = np.arange(len(start)), max(self.reach, last.max(initial=0.0))
        for _ in range(100):  # places on a way, at most
            if not len(left):
                break
            y = start[left] + gone[left, None] * along[left]
            gap, normal, _ = self.tool.surface.evaluate(y, farthest)
            enters = (gap < 0) & ~inside[left]
            foot[left[enters]] = (y - gap[:, None] * normal)[enters]
            across[left[enters]] = normal[enters]
            is_last = gone[left] >= last[left]
            ends = inside[left] & ((gap >= 0) | is_last)
            through[left] = ends & (row_dots(normal, across[left]) < THROUGH_A_WALL)
            inside[left] = gap < 0
            onwards = gone[left] + np.maximum(abs(gap), 1e-2 * self.reach)
            is_last |= (gap > 0) & (onwards >= last[left]) | through[left] | np.isnan(gap)
            gone[left] = np.minimum(onwards, last[left])
            left = left[~is_last]
        return foot, across, through
