"""The nearest point on curved patches by Newton's method, and the curvature of patches."""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..core.compiled import compiled
from .curved_triangles import CurvedTriangles
from .newton_kernel import Local, dot, newton_step, put
from .patches import Patches, place
from .surfaces import Nearest


class Net(NamedTuple):
    """Parts of `CurvedTriangles` for the compiled search; across, back: the triangle and its edge
    across each edge; the corners around a point are those from `starts` on in `ring`."""

    patches: Patches
    triangles: np.ndarray
    facets: np.ndarray
    across: np.ndarray
    back: np.ndarray
    normals: np.ndarray
    on_rim: np.ndarray
    ring: np.ndarray
    starts: np.ndarray


def net_of(surface: CurvedTriangles) -> Net:
    """The `Net` of a surface."""
    of, across = surface, surface.across
    around = of.normals, of.on_rim, *of.corners_at
    return Net(of.patches, of.triangles, of.facets, across.triangle, across.edge, *around)


def nearest(
    net: Net, side: float, points: np.ndarray, triangle: np.ndarray, b: np.ndarray
) -> Nearest:
    """Gap, normal and curvature at points (n, 3) [mm], sought from barycentric coordinates b (n, 3)
    on the patches of `triangle` (n,); side: 1.0 or -1.0, of the gap beyond the rim."""
    n = len(points)
    feet = Nearest(np.empty(n), np.empty((n, 3)), np.empty((n, 3, 3)))
    if n:
        b = np.maximum(b, 0.0)
        b /= b.sum(1, keepdims=True)
        tolerance = 1e-11 + 1e-14 * abs(points).max(1)
        _search(net, side, points, triangle, b, tolerance, feet)
    return feet


class Seen(NamedTuple):
    """A patch at a place: the arm to a point and its square, its part beside the normal, its
    products with both tangents, and the patch's `Local` geometry."""

    arm: tuple[float, float, float]
    square: float
    aside: float
    pull: tuple[float, float]
    local: Local


@compiled
def _copy(a, b):  # compiles faster than b[:] = a
    b[0], b[1], b[2] = a[0], a[1], a[2]


@compiled
def _seen(at, x):
    """The `Seen` of place and derivatives (6, 3), as `place` gives them, and a point x (3,)."""
    u, v = (at[1, 0], at[1, 1], at[1, 2]), (at[2, 0], at[2, 1], at[2, 2])
    arm = (x[0] - at[0, 0], x[1] - at[0, 1], x[2] - at[0, 2])
    uu, uv, vv = dot(u, u), dot(u, v), dot(v, v)
    n0, n1, n2 = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
    size = math.sqrt(max(n0 * n0 + n1 * n1 + n2 * n2, 1e-300))
    n0, n1, n2 = normal = (n0 / size, n1 / size, n2 / size)
    high, p, q = dot(arm, normal), dot(u, arm), dot(v, arm)
    beside = (arm[0] - high * n0, arm[1] - high * n1, arm[2] - high * n2)
    det = max(uu * vv - uv * uv, 1e-300)
    g0, g1, g2 = vv / det, -uv / det, uu / det
    l0, l1, l2 = dot(at[3], normal), dot(at[4], normal), dot(at[5], normal)
    shape = (-g0 * l0 - g1 * l1, -g0 * l1 - g1 * l2, -g1 * l0 - g2 * l1, -g1 * l1 - g2 * l2)
    along = (g0 * p + g1 * q, g1 * p + g2 * q)
    local = Local(high, along, 0.0, normal, u, v, (g0, g1, g2), shape)
    return Seen(arm, dot(arm, arm), math.sqrt(dot(beside, beside)), (p, q), local)


class Sought(NamedTuple):
    """Aim of the search of one point: a `row` of `feet`; how near to the foot of the
    normal it must come [mm], and the side of the gap beyond a rim."""

    feet: Nearest
    row: int
    tolerance: float
    side: float


@compiled
def _search(net, side, points, triangle, b, tolerance, feet):
    """Put what belongs to the nearest points of `points` (n, 3) into what is found, sought from
    `triangle` (n,) and b (n, 3), to within `tolerance` (n,)."""
    way, w, at = np.empty((3, 3)), np.empty((6, 18)), np.empty((6, 3))
    for n in range(len(points)):
        _copy(b[n], way[0])
        sought = Sought(feet, n, tolerance[n], side)
        _find(net, points[n], triangle[n], way, w, at, sought)


@compiled
def _find(net, x, t, way, w, at, sought):
    """One point's way, from triangle t. way (3, 3): barycentric coordinates now, of the last step's
    start, and that step; w (6, 18), at (6, 3): as in `place`."""
    b, last_b, step = way[0], way[1], way[2]
    last_t, last_square, factor = t, math.inf, 1.0
    came = -1  # the edge across which it came without moving
    for _ in range(100):
        place(net.patches, t, b, w, at)
        here = _seen(at, x)
        if here.aside <= sought.tolerance:
            put(sought.feet, sought.row, here.local)
            return
        edge, ended = -1, False
        if here.square > last_square * (1 + 1e-12) and factor > 1e-3:
            # a step to a place that is further away is halved
            t, factor = last_t, factor / 2
            _copy(last_b, b)
        else:
            last_t, last_square, factor = t, here.square, 1.0
            _copy(b, last_b)
            edge, corner = _step(here, b, step)
            if corner:
                t, ended = _at_corner(net, t, b, here.arm, sought)
                came, last_square = -1, math.inf
            elif edge >= 0 and net.across[t, edge] >= 0 and came != edge:
                t, came = _cross(net, t, edge, b)
                last_square = math.inf  # the same place but for rounding
            elif edge >= 0:
                ended = _along_edge(net, t, edge, b, at, here, sought)
                came = -1
        if ended:
            return
        if edge < 0:
            _move(b, step, factor)
            came = -1
    # none was found where the distance has no minimum, as at centres of curvature
    place(net.patches, t, b, w, at)
    here = _seen(at, x)
    normal = here.local.normal
    _put(sought, here.arm, math.copysign(1.0, here.local.gap), normal, normal, math.inf)


@compiled
def _step(here, b, step):
    """Put Newton's step in barycentric coordinates into `step` (3,); the edge at which it leaves
    the patch, -1 if at none, and whether b is at a corner there."""
    step[1], step[2] = newton_step(here.local)
    step[0] = -step[1] - step[2]
    edge, ends = -1, 0
    for k in range(2, -1, -1):
        ends += b[k] <= 0
        edge = k if b[k] <= 0 and step[k] < 0 else edge
    return edge, edge >= 0 and ends == 2


@compiled
def _move(b, step, factor):
    """Take a share of the step, up to the patch's edges."""
    share = factor
    for k in range(3):
        if step[k] < 0:
            share = min(share, b[k] / -step[k])
    total = 0.0
    for k in range(3):
        out = step[k] < 0 and b[k] / -step[k] <= share
        b[k] = 0.0 if out else max(b[k] + share * step[k], 0.0)
        total += b[k]
    for k in range(3):
        b[k] /= max(total, 1e-300)


@compiled
def _cross(net, t, k, b):
    """Go over edge k to the neighbour: which it is, and which of its edges."""
    other, there = net.across[t, k], net.back[t, k]
    start, end = b[(k + 1) % 3], b[(k + 2) % 3]
    b[there], b[(there + 1) % 3], b[(there + 2) % 3] = 0.0, end, start
    return other, there


@compiled
def _along_edge(net, t, k, b, at, here, sought):
    """Go along edge k to its last corner, if that is nearer; whether the search is at its end."""
    du, dv = (-1.0, 0.0, 1.0)[k], (1.0, -1.0, 0.0)[k]  # changes of u = b[1], v = b[2]
    slope = du * here.pull[0] + dv * here.pull[1]
    first = du * at[1] + dv * at[2]
    second = du * du * at[3] + 2 * du * dv * at[4] + dv * dv * at[5]
    speed = dot(first, first)
    size = speed - dot(here.arm, second)
    size = size if size > 0.1 * speed else speed
    if abs(slope) <= sought.tolerance * math.sqrt(speed):
        face, side, beyond = net.facets[t].copy(), sought.side, net.across[t, k]
        if beyond >= 0:
            face += net.facets[beyond]
            side = math.copysign(1.0, dot(here.arm, face))
        _put(sought, here.arm, side, face, first, size)
        return True
    start, end = (k + 1) % 3, (k + 2) % 3
    share = min(max(slope / size, -b[end]), b[start])
    b[start], b[end] = max(b[start] - share, 0.0), max(b[end] + share, 0.0)
    return False


@compiled
def _at_corner(net, t, b, arm, sought):
    """Go from a corner of patch t to where it comes nearest among the patches there: which of them
    it goes to, and whether the corner is nearest already."""
    point = net.triangles[t, b.argmax()]
    best, corner, way = 0.0, -1, (0.0, 0.0)
    for option in range(3):  # inside, and along the edges to the next and the last corner
        for n in range(net.starts[point], net.starts[point + 1]):
            legs = net.patches.legs[net.ring[n] // 3, net.ring[n] % 3]
            p, q = dot(legs[0], arm), dot(legs[1], arm)
            pp, pq, qq = dot(legs[0], legs[0]), dot(legs[0], legs[1]), dot(legs[1], legs[1])
            u, v = max(p / pp, 0.0), max(q / qq, 0.0)
            if option == 0:
                det = pp * qq - pq * pq
                u, v = (qq * p - pq * q) / det, (pp * q - pq * p) / det
                if u < 0 or v < 0:
                    u, v = 0.0, 0.0
            u, v = u if option != 2 else 0.0, v if option != 1 else 0.0
            if u * p + v * q > best:  # the square of how far the tangent leads
                best, corner, way = u * p + v * q, net.ring[n], (u, v)
    if best <= sought.tolerance**2:
        normal, side = net.normals[point], sought.side
        if not net.on_rim[point]:
            side = math.copysign(1.0, dot(arm, normal))
        _put(sought, arm, side, normal, normal, math.inf)
        return t, True
    onwards, backwards = way[0] / 3, way[1] / 3  # legs are a third of the derivative
    scale = 1 / max(1.0, onwards + backwards)
    t, c = corner // 3, corner % 3
    b[(c + 1) % 3], b[(c + 2) % 3] = scale * onwards, scale * backwards
    b[c] = max(0.0, 1 - scale * (onwards + backwards))
    return t, False


@compiled
def _put(sought, arm, side, normal, first, size):
    """Fill in what belongs to a nearest point on an edge along `first`, of which `size` is the
    second derivative of half the squared distance; on a corner if that is infinite."""
    distance = math.sqrt(dot(arm, arm))
    on = distance < 1e-12
    a, b, c = normal[0], normal[1], normal[2]
    if not on:
        a, b, c = side * arm[0], side * arm[1], side * arm[2]
    length = max(math.sqrt(a * a + b * b + c * c), 1e-300)
    unit = (a / length, b / length, c / length)
    bend = 0.0 if on else side / max(distance, 1e-12)
    feet, row = sought.feet, sought.row
    feet.gap[row] = side * distance
    for i in range(3):
        feet.normal[row, i] = unit[i]
        for j in range(3):
            across = (1.0 if i == j else 0.0) - unit[i] * unit[j] - first[i] * first[j] / size
            feet.curvature[row, i, j] = bend * across


@compiled
def curvatures(patches: Patches) -> np.ndarray:
    """The larger and the smaller curvature (2, m) [1/mm] in the middle of each patch."""
    bends, b = np.empty((2, len(patches.origin))), np.full(3, 1 / 3)
    w, at = np.empty((6, 18)), np.empty((6, 3))
    for t in range(len(patches.origin)):
        place(patches, t, b, w, at)
        k11, k12, k21, k22 = _seen(at, at[0]).local.shape
        mean = (k11 + k22) / 2
        spread = math.sqrt(max((k11 - k22) ** 2 / 4 + k12 * k21, 0.0))
        bends[0, t], bends[1, t] = mean + spread, mean - spread
    return bends


def least_radii(surface: CurvedTriangles, length: float = 0.0) -> tuple[float, float]:
    """Least radius of curvature [mm] as seen from inside the body and from outside; infinite where
    nothing bends to that side. Where patches turn to and fro within a `length` [mm], or two edges,
    as on slivers of scans, it is that of the facets' mean turning over it."""
    larger, smaller = curvatures(surface.patches)
    bent, area = np.maximum([larger, -smaller], 0.0), surface.areas
    inside, outside = (_least_radius(each, area, 0.99) for each in bent)
    arms = surface.corners - np.roll(surface.corners, 1, 1)
    edge = float(np.median(np.linalg.norm(arms, axis=2)))
    if min(inside, outside) < max(length, edge):
        # median edges, the least length over which turning has a mean
        mean = _mean_turning(surface, max(length, 2.0 * edge))
        share = np.full(mean.shape[1], area.sum() / mean.shape[1])
        # times as much as over a length, from which turning is to and fro
        if (bent @ area).sum() > 1.3 * (mean @ share).sum():
            inside, outside = (_least_radius(each, share, 0.95) for each in mean)
    return inside, outside


def _least_radius(curvature, area, bent):
    """The radius than which a share `bent` of the turning has a larger one."""
    weight = area * curvature**2
    turns = curvature * np.sqrt(area) > 1e-4  # less is rounding
    if not turns.any():
        return math.inf
    curvature, weight = curvature[turns], weight[turns]
    order = np.argsort(curvature)
    share = np.cumsum(weight[order])
    return 1 / float(curvature[order[np.searchsorted(share, bent * share[-1])]])


def _mean_turning(surface, length):
    """Curvature (2, n) [1/mm], as seen from inside and from outside, at places spread over the
    surface: the turn at the edges within a `length`, over the area there (D. Cohen-Steiner, J.-M.
    Morvan, Restricted Delaunay triangulations and normal cycle, SoCG 2003)."""
    whole, random = surface.areas.sum(), np.random.default_rng(0)
    count, within = 2000, 25  # places that are asked for, and points in a circle of that length
    n = int(np.clip(within * whole / (math.pi * length**2), count, 60_000))
    length = max(length, math.sqrt(within * whole / (math.pi * n)))
    ends = np.cumsum(surface.areas)
    t = np.searchsorted(ends, (np.arange(n) + 0.5) / n * ends[-1])
    on = np.einsum("nc,nci->ni", random.dirichlet((1, 1, 1), n), surface.corners[t])
    normal = surface.facets[t]
    one, other, (foot, head) = surface.smooth_edges()
    step, facets = surface.points[head] - surface.points[foot], surface.facets
    size, turn = np.linalg.norm(step, axis=1), surface.turns()[1]
    rises = ((surface.middles[other] - surface.middles[one]) * facets[one]).sum(1) > 0
    weight = np.where(rises, -turn, turn) / size  # of the square of a piece along the edge
    pieces = np.ceil(2 * size / length).astype(int)
    of = np.repeat(np.arange(len(size)), pieces)
    along = (np.arange(len(of)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 0.5) / pieces[of]
    at = surface.points[foot][of] + along[:, None] * step[of]
    tensor = np.einsum("n,ni,nj->nij", weight / pieces, step, step)[of].reshape(-1, 9)
    seeds = np.linspace(0, n - 1, count).astype(int)

    def summed(places, normals, values):
        """Values (k, m) at places about the seeds, of facets that look to the same side."""
        neighbours = cKDTree(places).query_ball_point(on[seeds], length)
        row = np.repeat(np.arange(count), [len(each) for each in neighbours])
        near = np.concatenate(neighbours).astype(int)
        away = ((places[near] - on[seeds][row]) ** 2).sum(1) / length**2
        share = (1 - away) ** 2 * ((normals[near] * normal[seeds][row]).sum(1) > 0)
        return np.stack([np.bincount(row, share * v[near], count) for v in values.T], 1)

    area = summed(on, normal, np.full((n, 1), whole / n))
    bend = np.linalg.eigvalsh((summed(at, facets[one][of], tensor) / area).reshape(-1, 3, 3))
    return np.maximum([bend[:, 2], -bend[:, 0]], 0.0)
