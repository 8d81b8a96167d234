"""Material stability at n states at once, in NumPy: convexity in the yarn strains, ellipticity in
and out of the plane.

Convexity: the Hessian of W in (eps_a, eps_b) at fixed gamma has no negative eigenvalue.
Ellipticity (Legendre-Hadamard, the local form of rank-one convexity; Ball 1977, Arch. Rational
Mech. Anal. 63, 337-403): m·Q(N) m >= 0 for all unit N of the undeformed and m of the deformed
sheet, Q_ij(N) = d2W/dF_iA dF_jB N_A N_B. Where it fails, the law itself allows a band normal to N.
m lies in the plane here; for m out of the plane Q is N·S N, so that a membrane is stable against
wrinkling where its smallest principal S is not negative.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .laws import Law
from .strains import nominal_strain


class Stability(NamedTuple):
    """Result of `evaluate`; arrays in the leading shape of its input.

    - convexity, ellipticity: hessian and acoustic over their values at rest [-], negative where
      they are lost
    - hessian: smallest eigenvalue of d2W/d(eps_a, eps_b)2 [MPa]
    - acoustic: smallest eigenvalue of Q over all directions N [MPa]
    - direction: its N, angle from a0 towards b0 [rad], above -pi/2 and up to pi/2
    - out_of_plane: smallest principal S, the smallest N·S N [MPa]
    - shear: d2W/dgamma2 [MPa]
    """

    convexity: np.ndarray
    ellipticity: np.ndarray
    hessian: np.ndarray
    acoustic: np.ndarray
    direction: np.ndarray
    out_of_plane: np.ndarray
    shear: np.ndarray


def invariants(
    eps_a: ArrayLike, eps_b: ArrayLike, gamma: ArrayLike = 0.0, angle: ArrayLike = np.pi / 2
) -> np.ndarray:
    """I4, I6, I8, I10 (..., 4) of eqs (5)-(8) from yarn strains [-], shear angle and initial angle
    between the yarns [rad]."""
    each = (np.asarray(v, float) for v in (eps_a, eps_b, gamma, angle))
    ea, eb, g, rest = np.broadcast_arrays(*each)
    la, lb = 1 + ea, 1 + eb
    return np.stack([la**2, la * lb * np.cos(rest - g), lb**2, g], -1)


def evaluate(fabric: Law, invariants: ArrayLike) -> Stability:
    """Stability at states given by their invariants (..., 4) as in `kernel.State`, nan where one is
    not finite."""
    states = np.asarray(invariants, float)
    W, Q, out_of_plane = _second(fabric, states.reshape(-1, 4))
    hessian, (acoustic, direction) = _hessian(W), smallest_eigenvalue(Q)
    ones = np.ones(fabric.count)
    at_rest = _in_strains(fabric, ones, ones, 0 * ones)
    rest, shear = _hessian(at_rest), at_rest[-1]
    convexity = hessian / np.where(rest == 0, 1.0, rest)
    ellipticity = acoustic / np.where(shear == 0, 1.0, shear)
    values = convexity, ellipticity, hessian, acoustic, direction, out_of_plane, W[-1]
    return Stability(*(v.reshape(states.shape[:-1]) for v in values))


def least_ellipticity(fabric: Law, invariants: ArrayLike) -> float:
    """The least of `evaluate`'s ellipticity indicators over all states, at about half the cost; inf
    without states."""
    if fabric.count != 1:
        return float(evaluate(fabric, invariants).ellipticity.min(initial=np.inf))
    _, Q, _ = _second(fabric, np.asarray(invariants, float).reshape(-1, 4))
    least = float(smallest_eigenvalue(Q, only_least=True)[0].min(initial=np.inf))
    return least / (fabric.shear_stiffness or 1.0)


def _in_strains(fabric, I4, I8, gamma):
    """dW/d(a, b, g) and d2W (aa, ab, bb, ag, bg, gg) in eps_a, eps_b, gamma."""
    # |I - 1| up to which a yarn counts as unstrained: the softer side is taken, compression (d <<
    # b)
    eps_a, eps_b = (nominal_strain(np.where(np.abs(I - 1) <= 1e-10, 1.0, I)) for I in (I4, I8))
    _, first, second = fabric.derivatives(eps_a, eps_b, gamma)
    return *first, *second


def _second(fabric, invariants):
    """`_in_strains` and `_acoustic` at states (n, 4)."""
    I4, I6, I8, gamma = invariants.T
    W = _in_strains(fabric, I4, I8, gamma)
    with np.errstate(invalid="ignore"):
        now = np.arctan2(np.sqrt(I4 * I8 - I6 * I6), I6)
    return W, *_acoustic(W, np.sqrt(I4), np.sqrt(I8), now, now + gamma)


def _hessian(W):
    _, _, _, aa, ab, bb, *_ = W
    return (aa + bb) / 2 - np.hypot((aa - bb) / 2, ab)


def _acoustic(W, la, lb, now, rest):
    """Q(N) in a frame along the deformed a, as half trace, half difference and off-diagonal over 1,
    cos, sin of 2 theta, (3, 3, n); and the smallest N·S N.

    now, rest: angle between the yarns, deformed and not. With F + s m N the yarns change by
    s (N·a0) m and s (N·b0) m, so that Q = (N·a0)^2 A + (N·b0)^2 B + 2 (N·a0)(N·b0) X with three
    blocks of the Hessian of W in (fa, fb).
    """
    Wa, Wb, Wg, aa, ab, bb, ag, bg, gg = W
    c, s = np.cos(now), np.sin(now)

    def block(xx, xy, yx, yy):
        return (xx + yy) / 2, (xx - yy) / 2, (xy + yx) / 2

    # along and across each yarn: eps'' = across^2 / l, gamma' = across_a / la - across_b / lb,
    # gamma'' = -+2 along across / l^2
    off_a, off_b = ag / la - Wg / la**2, Wg / lb**2 - bg / lb
    A = block(aa, off_a, off_a, gg / la**2 + Wa / la)
    B = block(bb, off_b, off_b, gg / lb**2 + Wb / lb)
    C, S = c * c - s * s, 2 * c * s
    B = B[0], B[1] * C - B[2] * S, B[1] * S + B[2] * C  # turned from b's frame to a's
    x, y, z, w = ab, -ag / lb, bg / la, -gg / (la * lb)
    X = block(x * c - y * s, x * s + y * c, z * c - w * s, z * s + w * c)
    # (N·b0)^2 and (N·a0)(N·b0) in cos and sin of 2 theta
    c0, s0 = np.cos(rest), np.sin(rest)
    C0, S0 = c0 * c0 - s0 * s0, 2 * c0 * s0

    def harmonics(p, q, r):
        return (p + q) / 2 + r * c0, (p + q * C0) / 2 + r * c0, q * S0 / 2 + r * s0

    # the same for m out of the plane, where only lengths and angle change
    with np.errstate(invalid="ignore", divide="ignore"):
        p, q, r = Wa / la - Wg * c / (s * la**2), Wb / lb - Wg * c / (s * lb**2), Wg / (s * la * lb)
    mean, *rest = harmonics(p, q, r)
    return np.array([harmonics(*each) for each in zip(A, B, X)]), mean - np.hypot(*rest)


def smallest_eigenvalue(Q: np.ndarray, only_least: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Smallest eigenvalue over all directions (n,) and its theta (n,), from `_acoustic`'s
    coefficients (3, 3, n).

    det(Q - l) for a given l is a quadratic function of x = (cos, sin) of 2 theta. One secular
    equation gives its global minimum on the unit circle (More and Sorensen 1983, SIAM J. Sci. Stat.
    Comput. 4, 553-572). If that is negative, the smaller eigenvalue at its x is the next l. So l
    falls until no direction has an eigenvalue below it. only_least: of all n, so that most end
    where they start, at the value of a likely point.
    """
    n = Q.shape[2]
    (t0, t1, t2), (h0, h1, h2), (o0, o1, o2) = Q
    half = (t1 * t1 - h1 * h1 - o1 * o1 - t2 * t2 + h2 * h2 + o2 * o2) / 2
    off = t1 * t2 - h1 * h2 - o1 * o2
    # difference of the quadratic's two curvatures; axis of the smaller one
    gap, turn = 2 * np.hypot(half, off), (np.arctan2(off, half) + np.pi) / 2
    c, s = np.cos(turn), np.sin(turn)
    pairs = (t1, t2), (h1, h2), (o1, o2)
    (t1, t2), (h1, h2), (o1, o2) = ((x * c + y * s, y * c - x * s) for x, y in pairs)
    tiny = np.finfo(float).tiny
    # from the least half trace, which no larger eigenvalue is below, so that a negative det means
    # one eigenvalue below l, never both
    half_trace = np.hypot(t1, t2)
    x1, x2 = -t1 / np.maximum(half_trace, tiny), -t2 / np.maximum(half_trace, tiny)
    value = t0 - half_trace - np.hypot(h0 + h1 * x1 + h2 * x2, o0 + o1 * x1 + o2 * x2)
    if only_least and n:
        first = value.argmin()
        value = np.minimum(value, smallest_eigenvalue(Q[:, :, first : first + 1])[0])
    close = 1e-14 * np.abs(Q).sum((0, 1))
    q, live = np.array([t0, t1, t2, h0, h1, h2, o0, o1, o2, gap, close]), np.arange(n)
    shift = np.zeros(n)
    for _ in range(60):  # most points end after 2 to 5
        t0, t1, t2, h0, h1, h2, o0, o1, o2, gap, close = q
        t = t0 - value[live]
        b1, b2 = t * t1 - h0 * h1 - o0 * o1, t * t2 - h0 * h2 - o0 * o2
        # from here Newton's method does not overshoot
        low = np.maximum(np.maximum(np.abs(b1), np.abs(b2) - gap), tiny)
        shift = np.maximum(shift, low)
        for _ in range(4):
            r1, r2 = (b1 / shift) ** 2, (b2 / (shift + gap)) ** 2
            length = r1 + r2
            slope = np.maximum(r1 / shift + r2 / (shift + gap), tiny)
            shift = np.maximum(shift + length * (np.sqrt(length) - 1) / slope, low)
        y2 = np.clip(-b2 / (shift + gap), -1, 1)
        y1 = -np.copysign(np.sqrt(1 - y2 * y2), b1)
        h, o = h0 + h1 * y1 + h2 * y2, o0 + o1 * y1 + o2 * y2
        new = t0 + t1 * y1 + t2 * y2 - np.sqrt(h * h + o * o)
        less = new < value[live]
        moves = (np.abs(length - 1) > 1e-6) & (shift > low)  # shift is still on its way
        more = (new < value[live] - close) | moves
        at = live[less]
        value[at], x1[at], x2[at] = new[less], y1[less], y2[less]
        live, q, shift = live[more], q[:, more], shift[more]
        if not live.size:
            break
    theta = (np.arctan2(x2, x1) + turn) / 2
    return value, theta - np.pi * np.ceil(theta / np.pi - 0.5)
