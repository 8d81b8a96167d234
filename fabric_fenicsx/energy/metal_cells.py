"""Loops over cells of sheet metal: their shape, and their forces and stiffness at the nodes."""

import numpy as np

from ..core.compiled import compiled
from .morley import Section, Shape


@compiled
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def shape(
    corners: np.ndarray,
    slopes: np.ndarray,
    operator: np.ndarray,
    own: np.ndarray,
    U: np.ndarray,
    columns: np.ndarray,
) -> Shape:
    """The shape of cells of `corners` (cells, 3, 3), with slopes (cells, 3, 2) of the corners'
    functions, from the motion U (count, 3) of nodes, of which `columns` (cells, 12) are theirs, as
    many as `operator` has.

    kappa = n . x,ab, of the twist 2 x,ab; along the motion of nodes it changes by n . (x,ab of the
    motion), less what n turns: n . motion's slope, along x,ab. x,ab is `own` (cells, 3, 3) plus
    `operator` (cells, 3, nodes) times the motion.
    """
    n = len(corners)
    base, normal, gradients = np.zeros((n, 3, 2)), np.empty((n, 3)), np.zeros((n, 3, 3))
    bends, curvature = operator.copy(), np.zeros((n, 3))
    curved = np.empty((3, 3))
    for c in range(n):
        for i in range(3):
            for x in range(3):
                for k in range(2):
                    base[c, x, k] += (corners[c, i, x] + U[columns[c, i], x]) * slopes[c, i, k]
        a, b = base[c, :, 0], base[c, :, 1]
        aa, ab, bb = _dot(a, a), _dot(a, b), _dot(b, b)
        square = aa * bb - ab * ab
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            normal[c, x] = (a[y] * b[z] - a[z] * b[y]) / np.sqrt(square)
        for i in range(3):
            s, t = slopes[c, i]
            by_a, by_b = (bb * s - ab * t) / square, (aa * t - ab * s) / square
            for x in range(3):
                gradients[c, i, x] = a[x] * by_a + b[x] * by_b
        for k in range(3):
            for x in range(3):
                curved[k, x] = own[c, k, x]
            for i in range(operator.shape[2]):
                for x in range(3):
                    curved[k, x] += operator[c, k, i] * U[columns[c, i], x]
            for x in range(3):
                curvature[c, k] += curved[k, x] * normal[c, x]
            for i in range(3):
                for x in range(3):
                    bends[c, k, i] -= curved[k, x] * gradients[c, i, x]
    return Shape(base, normal, gradients, bends, curvature)


def forces(
    shape: Shape, slopes: np.ndarray, stretching: np.ndarray, moments: np.ndarray
) -> np.ndarray:
    """Forces on the cells' nodes (cells, 12, 3) [N] from what is conjugate to the mid-surface's
    strains, `stretching` (cells, 3), and to its curvature, `moments` (cells, 3) [N mm]."""
    across = np.einsum("ck,ckn->cn", moments, shape.bends)
    nodal = across[:, :, None] * shape.normal[:, None]
    N = stretching[:, [[0, 2], [2, 1]]]
    nodal[:, :3] += slopes @ N @ shape.base.swapaxes(1, 2)
    return nodal


@compiled
def at_edges(
    spread: np.ndarray,
    slope: np.ndarray,
    growth: np.ndarray,
    moments: np.ndarray,
    section: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """What is conjugate to slopes at the edges (cells, 3) and its derivative (cells, 3, 3), of
    `moments` (cells, 3) and the diagonal `section` (cells, 3) of curvatures that are `spread`
    (cells, 3, 3) times angles, whose first and second derivatives are `slope` and `growth` (cells,
    3)."""
    of_edges, sections = np.zeros((len(spread), 3)), np.zeros((len(spread), 3, 3))
    for c in range(len(spread)):
        for e in range(3):
            for k in range(3):
                of_edges[c, e] += spread[c, k, e] * moments[c, k]
                for f in range(3):
                    sections[c, e, f] += spread[c, k, e] * section[c, k] * spread[c, k, f]
            for f in range(3):
                sections[c, e, f] *= slope[c, e] * slope[c, f]
            sections[c, e, e] += growth[c, e] * of_edges[c, e]
            of_edges[c, e] *= slope[c, e]
    return of_edges, sections


@compiled
def bending_forces(
    shape: Shape, moments: np.ndarray, columns: np.ndarray, count: int
) -> np.ndarray:
    """Forces (count, 3) [N] from `moments` alone, summed at nodes `columns` (cells, 12)."""
    nodal = np.zeros((count, 3))
    for c in range(len(moments)):
        n, B, M = shape.normal[c], shape.bends[c], moments[c]
        for i in range(12):
            across = M[0] * B[0, i] + M[1] * B[1, i] + M[2] * B[2, i]
            for x in range(3):
                nodal[columns[c, i], x] += across * n[x]
    return nodal


def sections(
    first: np.ndarray, tangent: np.ndarray, second: np.ndarray, volumes: np.ndarray, z: np.ndarray
) -> np.ndarray:
    """Derivatives of `stretching` in strains, of it in curvatures, and of `moments` in curvatures,
    (3, cells, 3, 3), from points at heights z (cells, points): derivatives `first` (n, 3, 3) of
    their strains in C's parts 11, 22, 2 12, `tangent` (n, 3, 3) of stresses in strains, and what
    the strains' second derivatives add (n, 3, 3)."""
    D = second + first.swapaxes(1, 2) @ tangent @ first
    powers = np.stack([volumes, -z * volumes, z**2 * volumes])
    return np.einsum("kcp,cpij->kcij", powers, D.reshape(*z.shape, 3, 3))


@compiled
def stiffness(
    shape: Shape,
    slopes: np.ndarray,
    stretching: np.ndarray,
    moments: np.ndarray,
    across: np.ndarray,
    places: np.ndarray,
    count: int,
) -> np.ndarray:
    """Second derivatives of the energy for pairs of nodes (count, 3, 3) [N/mm]. places (cells, 12,
    12): which pair each pair of a cell's nodes is, -1 for those that do not count; across: as
    `sections` gives them; stretching, moments: as in `forces`."""
    nodes = shape.bends.shape[2]
    values, V = np.zeros((count, 3, 3)), np.empty((nodes, nodes, 3))
    along, bend, mixed = np.empty((3, 3, 3)), np.empty((3, nodes)), np.empty((3, nodes))
    for c in range(len(slopes)):
        n, g, B, M = shape.normal[c], shape.gradients[c], shape.bends[c], moments[c]
        pairs = places[c]
        _stretch_along(shape.base[c], slopes[c], along)
        _times(across[2, c], B, bend)
        _times(across[1, c], B, mixed)
        torque = _dot(M, shape.curvature[c])
        # of a node's motion with another's along the normal
        for i in range(nodes):
            by_node = M[0] * B[0, i] + M[1] * B[1, i] + M[2] * B[2, i]
            for j in range(nodes):
                bent = B[0, i] * bend[0, j] + B[1, i] * bend[1, j] + B[2, i] * bend[2, j]
                if i < 3 and j < 3:
                    bent -= torque * _dot(g[i], g[j])
                for x in range(3):
                    V[i, j, x] = 0.5 * bent * n[x]
                    if i < 3:
                        for k in range(3):
                            V[i, j, x] += along[k, i, x] * mixed[k, j]
                    if j < 3:
                        V[i, j, x] -= by_node * g[j, x]
        for i in range(nodes):
            for j in range(nodes):
                if pairs[i, j] >= 0:
                    value = values[pairs[i, j]]
                    for x in range(3):
                        for y in range(3):
                            value[x, y] += V[i, j, x] * n[y] + n[x] * V[j, i, y]
        _add_stretching(along, slopes[c], across[0, c], stretching[c], pairs, values)
    return values


@compiled
def add_bending(
    shape: Shape, moments: np.ndarray, section: np.ndarray, places: np.ndarray, values: np.ndarray
) -> None:
    """Add to `values` what `stiffness` gives for cells whose energy has no strains of the
    mid-surface, with a `section` (cells, 3, 3) [N mm]: a third of the work."""
    nodes = shape.bends.shape[2]
    bend, by_node, squares = np.empty((3, nodes)), np.empty(nodes), np.empty((3, 3))
    for c in range(len(section)):
        n, g, B, M = shape.normal[c], shape.gradients[c], shape.bends[c], moments[c]
        torque = _dot(M, shape.curvature[c])
        for x in range(3):
            for y in range(3):
                squares[x, y] = n[x] * n[y]
        for i in range(nodes):
            by_node[i] = M[0] * B[0, i] + M[1] * B[1, i] + M[2] * B[2, i]
        _times(section[c], B, bend)
        for i in range(nodes):
            for j in range(i, nodes):
                pair, mirrored = places[c, i, j], places[c, j, i]
                if pair < 0:
                    continue
                bent = B[0, i] * bend[0, j] + B[1, i] * bend[1, j] + B[2, i] * bend[2, j]
                if i >= 3:
                    for x in range(3):
                        for y in range(3):
                            values[pair, x, y] += bent * squares[x, y]
                            if i != j:
                                values[mirrored, x, y] += bent * squares[x, y]
                    continue
                by_i = by_node[i] if j < 3 else 0.0
                at = j if j < 3 else 0
                if j < 3:
                    bent -= torque * _dot(g[i], g[j])
                for x in range(3):
                    for y in range(3):
                        value = bent * squares[x, y]
                        value -= by_i * g[at, x] * n[y] + n[x] * by_node[j] * g[i, y]
                        values[pair, x, y] += value
                        if i != j:
                            values[mirrored, y, x] += value


@compiled
def add_bending_along(
    section: Section,
    slopes: np.ndarray,
    columns: np.ndarray,
    v: np.ndarray,
    factor: float,
    forces: np.ndarray,
) -> None:
    """Add to `forces` (count, 3) `factor` times what a section's stiffness gives along v, without
    that of stretching alone."""
    shape, moments, bending, mixed = section
    nodes, is_mixed = shape.bends.shape[2], mixed.any()
    by_node, turned, rest = np.empty(nodes), np.empty(3), np.empty(3)
    bent, more, pull = np.empty(3), np.empty(3), np.empty(3)
    strain, stretch = np.empty(3), np.empty((3, 3, 3))
    for c in range(len(moments)):
        n, g, B, M = shape.normal[c], shape.gradients[c], shape.bends[c], moments[c]
        turned[:], rest[:], bent[:], strain[:] = 0.0, 0.0, 0.0, 0.0
        if is_mixed:
            _stretch_along(shape.base[c], slopes[c], stretch)
        for i in range(nodes):
            at = v[columns[c, i]]
            along = _dot(at, n)
            by_node[i] = M[0] * B[0, i] + M[1] * B[1, i] + M[2] * B[2, i]
            for k in range(3):
                bent[k] += B[k, i] * along
                rest[k] += by_node[i] * at[k]
                if i < 3:
                    turned[k] += g[i, k] * along
                    if is_mixed:
                        strain[k] += _dot(stretch[k, i], at)
        torque = _dot(M, shape.curvature[c])
        for k in range(3):
            rest[k] += torque * turned[k]
            more[k] = _dot(bending[c, k], bent) + _dot(mixed[c, :, k], strain)
            pull[k] = _dot(mixed[c, k], bent)
        for i in range(nodes):
            across = B[0, i] * more[0] + B[1, i] * more[1] + B[2, i] * more[2]
            if i < 3:
                across -= _dot(g[i], rest)
            for x in range(3):
                force = across * n[x] - by_node[i] * turned[x]
                if i < 3 and is_mixed:
                    force += _dot(pull, stretch[:, i, x])
                forces[columns[c, i], x] += factor * force


@compiled
def _stretch_along(base, slopes, along):
    """Derivatives of strains 11, 22, 2 12 (3,) by the corners' motion (3, 3) of a cell."""
    for i in range(3):
        s, t = slopes[i]
        for x in range(3):
            along[0, i, x] = s * base[x, 0]
            along[1, i, x] = t * base[x, 1]
            along[2, i, x] = s * base[x, 1] + t * base[x, 0]


@compiled
def _times(section, B, product):
    for k in range(3):
        for j in range(B.shape[1]):
            product[k, j] = section[k, 0] * B[0, j] + section[k, 1] * B[1, j]
            product[k, j] += section[k, 2] * B[2, j]


@compiled
def _add_stretching(along, slopes, section, N, pairs, values):
    """Add the stiffness by strains of the mid-surface for the pairs of a cell's corners."""
    for i in range(3):
        for j in range(3):
            s, t = slopes[i]
            q, r = slopes[j]
            pull, value = N[0] * s * q + N[1] * t * r + N[2] * (s * r + t * q), values[pairs[i, j]]
            for x in range(3):
                value[x, x] += pull
                for k in range(3):
                    pulled = 0.0
                    for m in range(3):
                        pulled += section[k, m] * along[m, i, x]
                    for y in range(3):
                        value[x, y] += pulled * along[k, j, y]
