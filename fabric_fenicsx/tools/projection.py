"""The nearest point on curved patches by Newton's method, and the curvature of patches."""

import math
from copy import copy
from typing import NamedTuple

import numpy as np

from . import patches
from .curved_triangles import CurvedTriangles, row_dots
from .facets import LAST, NEXT
from .surfaces import Nearest

BENT = 0.99  # share of a surface's turning that has a larger radius than the least one given


class Projection:
    """Projects points on to the patches of a surface.

    surface: the `CurvedTriangles`; side: 1.0 or -1.0, of the gap beyond the rim of an open surface.
    """

    def __init__(self, surface: CurvedTriangles, side: float = 1.0) -> None:
        self.surface, self.side = surface, side

    def from_behind(self) -> "Projection":
        """The same, for the body on the other side."""
        other = copy(self)
        other.side = -self.side
        return other

    def nearest(self, points: np.ndarray, triangle: np.ndarray, b: np.ndarray) -> Nearest:
        """Gap, normal and curvature at points (n, 3) [mm], sought from barycentric coordinates b
        (3, n) on the patches of `triangle` (n,)."""
        search = _Search(self.surface, self.side, points, triangle, b)
        for _ in range(100):
            if not len(search.rows):
                return search.found
            search.advance()
        search.end()
        return search.found


class _Local(NamedTuple):
    """Patches at places and the way from there to points: places and derivatives (n, 6, 3), arms
    (n, 3) and their squares (n,), normals (n, 3), fundamental forms (3, n), heights over the
    tangent planes (n,), distances beside them (n,), and the slope (2, n) and a convex second
    derivative (3, n) of half the square."""

    at: np.ndarray
    arm: np.ndarray
    square: np.ndarray
    normal: np.ndarray
    metric: np.ndarray
    bend: np.ndarray
    height: np.ndarray
    aside: np.ndarray
    pull: np.ndarray
    stiff: np.ndarray

    def newton_step(self) -> np.ndarray:
        """Newton's step in barycentric coordinates (3, n)."""
        pull, stiff = self.pull, self.stiff
        det = stiff[0] * stiff[2] - stiff[1] ** 2
        du, dv = (
            (stiff[2] * pull[0] - stiff[1] * pull[1]) / det,
            (stiff[0] * pull[1] - stiff[1] * pull[0]) / det,
        )
        return np.array([-du - dv, du, dv])


def _local(surface, triangle, b, x):
    """The `_Local` of barycentric coordinates b (3, n) on patches of `triangle` (n,) and points x
    (n, 3)."""
    at = patches.evaluate(surface.patches, triangle, b)
    arm = x - at[:, 0]
    square = row_dots(arm, arm)
    normal, metric, bend, height = fundamental_forms(at, arm)
    aside = np.sqrt(np.maximum(square - height**2, 0))
    small = aside < 1e-4 * abs(height)  # where the difference cancels
    if small.any():
        aside[small] = np.linalg.norm(arm[small] - height[small, None] * normal[small], axis=1)
    pull = np.einsum("nai,ni->an", at[:, 1:3], arm)
    stiff = _convex(metric, metric - height * bend)
    return _Local(at, arm, square, normal, metric, bend, height, aside, pull, stiff)


class _Search:
    """Points on their way to the nearest ones: numbers `rows` in what is `found`, places as
    barycentric coordinates `b` on patches of `tri`."""

    def __init__(self, surface, side, points, triangle, b):
        n = len(points)
        self.surface, self.side = surface, side
        self.found = Nearest(
            np.full(n, np.nan), np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
        )
        self.rows, self.x, self.tri = np.arange(n), points, triangle
        self.b = np.maximum(b, 0.0)
        self.b /= self.b.sum(0)
        self.came = np.full(n, -1)  # the edge across which it came without moving
        self.step, self.factor = np.zeros_like(self.b), np.ones(n)
        # where the step began, and the squared distance from there
        self.last_tri, self.last_b = self.tri.copy(), self.b.copy()
        self.last_square = np.full(n, np.inf)
        self.tolerance = 1e-11 + 1e-14 * abs(points).max(1, initial=0)

    def advance(self):
        """One step of each point; those that arrive leave the search."""
        here = _local(self.surface, self.tri, self.b, self.x)
        ended = here.aside <= self.tolerance
        if ended.any():
            where = self.rows[ended]
            self.found.gap[where], self.found.normal[where] = here.height[ended], here.normal[ended]
            self.found.curvature[where] = _hessian(
                here.at[ended], here.metric[:, ended], here.bend[:, ended], here.height[ended]
            )
        # a step to a place that is further away is halved
        worse = ~ended & (here.square > self.last_square * (1 + 1e-12)) & (self.factor > 1e-3)
        new = here.newton_step()
        out = (self.b <= 0) & (new < 0)
        go = ~ended & ~worse
        stopped = go & out.any(0)
        corner = stopped & ((self.b <= 0).sum(0) == 2)
        edge = stopped & ~corner
        self._step(new, here.square, go, worse, (go & ~stopped) | worse)
        if edge.any():
            ended |= self._at_edges(np.flatnonzero(edge), out, here)
        for i in np.flatnonzero(corner):
            ended[i] = self._at_corner(i, here.arm)
            self.came[i], self.last_square[i] = -1, np.inf
        if ended.any():
            self._keep(~ended)

    def _step(self, new, square, go, worse, moving):
        """Take steps `new` (3, n) from where points `go`, half the last ones again where they are
        `worse`, up to the patch's edges; of the points `moving`."""
        self.factor = np.where(worse, self.factor / 2, 1.0)
        self.tri = np.where(worse, self.last_tri, self.tri)
        self.b = np.where(worse, self.last_b, self.b)
        self.step = np.where(worse, self.step, new)
        self.last_tri = np.where(go, self.tri, self.last_tri)
        self.last_b = np.where(go, self.b, self.last_b)
        self.last_square = np.where(go, square, self.last_square)
        self.came[moving] = -1
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(self.step < 0, self.b / -self.step, np.inf)
        share = np.minimum(room.min(0), self.factor)
        moved = np.where(room <= share, 0.0, np.maximum(self.b + share * self.step, 0.0))
        self.b = np.where(moving, moved / np.maximum(moved.sum(0), 1e-300), self.b)

    def _keep(self, on):
        for name in ("x", "rows", "tri", "came", "factor", "tolerance", "last_tri", "last_square"):
            setattr(self, name, getattr(self, name)[on])
        for name in ("b", "step", "last_b"):
            setattr(self, name, getattr(self, name)[:, on])

    def end(self):
        """Give the points that are left the nearest places by now: none was found where the
        distance has no minimum, as at centres of curvature."""
        at = patches.evaluate(self.surface.patches, self.tri, self.b)
        arm = self.x - at[:, 0]
        normal, _, _, height = fundamental_forms(at, arm)
        self._put(self.rows, arm, np.copysign(1.0, height), normal, 0.0)

    def _at_edges(self, i, out, here):
        """Points i whose step leaves the patch at an edge: to the neighbour, or if that leads back,
        along the edge. Which of all have ended (n,)."""
        across, b = self.surface.across, self.b
        k = out[:, i].argmax(0)
        other, there = across.triangle[self.tri[i], k], across.edge[self.tri[i], k]
        cross = (other >= 0) & (self.came[i] != k)
        j, nxt, last = i[cross], np.array(NEXT), np.array(LAST)
        old = b[:, j]
        moved = np.zeros_like(old)
        every = np.arange(len(j))
        moved[nxt[there[cross]], every] = old[last[k[cross]], every]
        moved[last[there[cross]], every] = old[nxt[k[cross]], every]
        b[:, j], self.tri[j], self.came[j] = moved, other[cross], there[cross]
        ended = self._along_edges(i[~cross], k[~cross], here)
        self.last_square[self.came >= 0] = np.inf  # the same place but for rounding
        return ended

    def _along_edges(self, j, k, here):
        """Points j along edges k of their patches, from the edge's next to its last corner. Which
        of all have ended (n,)."""
        ended = np.zeros(len(self.rows), dtype=bool)
        if not len(j):
            return ended
        at, arm, b, nxt, last = here.at, here.arm, self.b, np.array(NEXT), np.array(LAST)
        # changes of u = b[1], v = b[2]
        du, dv = np.choose(k, [-1.0, 0.0, 1.0]), np.choose(k, [1.0, -1.0, 0.0])
        slope = du * here.pull[0, j] + dv * here.pull[1, j]
        first = du[:, None] * at[j, 1] + dv[:, None] * at[j, 2]
        second = (
            (du * du)[:, None] * at[j, 3]
            + (2 * du * dv)[:, None] * at[j, 4]
            + (dv * dv)[:, None] * at[j, 5]
        )
        speed = (first * first).sum(1)
        done = abs(slope) <= self.tolerance[j] * np.sqrt(speed)
        size = speed - (arm[j] * second).sum(1)
        size = np.where(size > 0.1 * speed, size, speed)
        start, end = b[nxt[k], j], b[last[k], j]
        share = np.clip(slope / size, -end, start)
        move = ~done
        b[nxt[k[move]], j[move]] = np.maximum(start[move] - share[move], 0)
        b[last[k[move]], j[move]] = np.maximum(end[move] + share[move], 0)
        self.came[j[move]] = -1
        if done.any():
            e, k, first, size = j[done], k[done], first[done], size[done]
            across, facets = self.surface.across.triangle, self.surface.facets
            beyond, tri = across[self.tri[e], k], self.tri[e]
            face = facets[tri] + np.where((beyond >= 0)[:, None], facets[beyond], 0)
            side = np.where(beyond >= 0, np.copysign(1.0, (arm[e] * face).sum(1)), self.side)
            along = first[:, :, None] * first[:, None] / size[:, None, None]
            self._put(self.rows[e], arm[e], side, face, along)
            ended[e] = True
        return ended

    def _at_corner(self, i, arm):
        """Point i, whose step leaves its patch at a corner: to where it comes nearest among the
        patches there. Whether it is nearest already."""
        surface, tri, b = self.surface, self.tri, self.b
        point = surface.triangles[tri[i], b[:, i].argmax()]
        t, c = surface.ring(point)
        legs = surface.patches.legs[t, c]
        pull = legs @ arm[i]
        gram = legs @ legs.swapaxes(1, 2)
        det = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
        along_first = gram[:, 1, 1] * pull[:, 0] - gram[:, 0, 1] * pull[:, 1]
        along_second = gram[:, 0, 0] * pull[:, 1] - gram[:, 0, 1] * pull[:, 0]
        inside = np.column_stack([along_first, along_second]) / det[:, None]
        options = np.zeros((3, len(t), 2))
        options[0] = np.where((inside >= 0).all(1)[:, None], inside, 0)
        options[1, :, 0] = np.maximum(pull[:, 0] / gram[:, 0, 0], 0)
        options[2, :, 1] = np.maximum(pull[:, 1] / gram[:, 1, 1], 0)
        gain = (options * pull).sum(2)  # the square of how far the tangent leads
        which, best = np.unravel_index(gain.argmax(), gain.shape)
        if gain[which, best] <= self.tolerance[i] ** 2:
            rim = surface.on_rim[point]
            normal = surface.normals[point]
            side = self.side if rim else math.copysign(1.0, arm[i] @ normal)
            self._put(self.rows[i : i + 1], arm[i : i + 1], np.array([side]), normal[None], 0.0)
            return True
        onwards, backwards = options[which, best] / 3  # legs are a third of the derivative
        scale = 1 / max(1.0, onwards + backwards)
        tri[i] = t[best]
        b[:, i] = 0
        b[NEXT[c[best]], i], b[LAST[c[best]], i] = scale * onwards, scale * backwards
        b[c[best], i] = max(0.0, 1 - scale * (onwards + backwards))
        return False

    def _put(self, rows, arm, side, normal, along):
        """Into `rows` of what is found what belongs to nearest points on edges and corners."""
        distance = np.linalg.norm(arm, axis=1)
        on = distance < 1e-12
        unit = np.where(on[:, None], normal, side[:, None] * arm)
        unit /= np.maximum(np.linalg.norm(unit, axis=1), 1e-300)[:, None]
        self.found.gap[rows], self.found.normal[rows] = side * distance, unit
        flat = np.eye(3) - unit[:, :, None] * unit[:, None] - along
        self.found.curvature[rows] = (
            np.where(on, 0, side / np.maximum(distance, 1e-12))[:, None, None] * flat
        )


def fundamental_forms(
    at: np.ndarray, arm: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Unit normals (n, 3), first and second fundamental forms (3, n), and heights (n,) of arms (n,
    3), at places and derivatives (n, 6, 3) of patches, as `patches.evaluate` gives them."""
    u, v = at[:, 1], at[:, 2]
    metric = np.array([row_dots(u, u), row_dots(u, v), row_dots(v, v)])
    normal = np.cross(u, v)
    normal /= np.sqrt(np.maximum(row_dots(normal, normal), 1e-300))[:, None]
    bend = np.einsum("nai,ni->an", at[:, 3:], normal)
    height = np.zeros(len(at)) if arm is None else row_dots(arm, normal)
    return normal, metric, bend, height


def _convex(metric, stiff):
    """`stiff` (3, n), raised by as much of the metric as makes its least eigenvalue 0.1 in that
    metric."""
    det = metric[0] * metric[2] - metric[1] ** 2
    mean = (metric[2] * stiff[0] + metric[0] * stiff[2] - 2 * metric[1] * stiff[1]) / (2 * det)
    gauss = (stiff[0] * stiff[2] - stiff[1] ** 2) / det
    least = mean - np.sqrt(np.maximum(mean**2 - gauss, 0))
    return stiff + np.maximum(0.1 - least, 0) * metric


def _hessian(at, metric, bend, gap):
    """Hessian (n, 3, 3) of the gap over patches: -E I^-1 L (I - gap L)^-1 E^T of tangents E and
    fundamental forms I, L."""

    def matrix(a):
        return np.array([[a[0], a[1]], [a[1], a[2]]]).transpose(2, 0, 1)

    def inverse(a):
        det = a[0] * a[2] - a[1] ** 2
        det = np.where(abs(det) < 1e-300, 1e-300, det)
        return matrix(np.array([a[2], -a[1], a[0]]) / det)

    tangents = at[:, 1:3]
    inner = inverse(metric) @ matrix(bend) @ inverse(metric - gap * bend)
    full = -tangents.swapaxes(1, 2) @ inner @ tangents
    return (full + full.swapaxes(1, 2)) / 2


def least_radii(surface: CurvedTriangles) -> tuple[float, float]:
    """Least radius of curvature [mm] as seen from inside the body and from outside, but for the
    last of the surface's turning; infinite where nothing bends to that side."""
    every = np.arange(len(surface.triangles))
    middles = np.full((3, len(every)), 1 / 3)
    _, metric, bend, _ = fundamental_forms(patches.evaluate(surface.patches, every, middles))
    det = np.maximum(metric[0] * metric[2] - metric[1] ** 2, 1e-300)
    mean = -(metric[2] * bend[0] + metric[0] * bend[2] - 2 * metric[1] * bend[1]) / (2 * det)
    gauss = (bend[0] * bend[2] - bend[1] ** 2) / det
    spread = np.sqrt(np.maximum(mean * mean - gauss, 0))
    larger, smaller = mean + spread, mean - spread
    return _least_radius(larger, surface.areas), _least_radius(-smaller, surface.areas)


def _least_radius(curvature, area):
    curvature = np.maximum(curvature, 0)
    weight = area * curvature**2
    turns = curvature * np.sqrt(area) > 1e-4  # less is rounding
    if not turns.any():
        return math.inf
    curvature, weight = curvature[turns], weight[turns]
    order = np.argsort(curvature)
    share = np.cumsum(weight[order])
    return 1 / float(curvature[order[np.searchsorted(share, BENT * share[-1])]])
