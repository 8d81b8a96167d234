"""The explicit kernel: the law at n points at once, in NumPy and closed form, with the arithmetic of a VUMAT.

Against Abaqus' VUMAT interface:

| VUMAT | here |
|---|---|
| `nblock` | n, any leading shape of the input |
| `stretchNew` | `stretch`, U in the plane of the membrane, (n, 2, 2) |
| `defgradNew` | `gradient`, F, (n, 2, 2), or (n, 3, 2) from tangent plane to space |
| `props` | `fabric`, a `WovenFabric` |
| `stressNew` | `State.cauchy`, corotational if U or C came in, in space if F came in [MPa] |
| `enerInternNew` | `State.energy` / density; `State.energy` is per undeformed volume [N mm/mm3] |
| `stateNew` | `State.invariants`, `State.energy_parts`, `State.strain_state` |
| `charLength` etc. | not needed: the law is elastic and has no rate |

The membrane keeps its thickness (lambda_3 = 1), so J of eq. (4) is the change of area.
"""

from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError

if TYPE_CHECKING:  # the kernel itself needs NumPy alone
    from .baseline import Fabric
    from .parameters import WovenFabric


class State(NamedTuple):
    """Result of `evaluate` at n points; tensors refer to the orthonormal basis in which C, U or F came."""

    invariants: np.ndarray  # (n, 4): I4, I6, I8 [-] and I10 = gamma [rad], signed; eqs (5)-(8)
    energy: np.ndarray  # (n,) W_tot, eq. (30) [MPa]
    energy_parts: np.ndarray  # (n, 3): along a (W_a), along b (W_b), shear with its couplings [MPa]
    S: np.ndarray  # (n, 2, 2) second Piola-Kirchhoff stress, eq. (12) [MPa]
    cauchy: np.ndarray  # (n, 2, 2), or (n, 3, 3) from a gradient into space; eq. (4) [MPa]
    strain_state: np.ndarray  # (n,) 1: both in tension, 2: b compressed, 3: a compressed, 4: both; eq. (13)
    tangent: np.ndarray | None  # (n, 3, 3) dS/dE on (11, 22, 12) with E in Voigt's (E11, E22, 2 E12) [MPa]


def check_weave_angle(angle: float) -> float:
    """`angle` between the yarns of a weave without shear [rad]; InputError unless it is above 0 and below pi."""
    if not 0 < angle < np.pi:
        raise InputError(f"the weave's angle is {angle!r} rad; allowed is one between yarns, above 0 and below pi")
    return float(angle)


def evaluate(
    fabric: "Fabric | SimpleNamespace",
    *,
    stretch: ArrayLike | None = None,
    gradient: ArrayLike | None = None,
    cauchy_green: ArrayLike | None = None,
    fibres: tuple[ArrayLike, ArrayLike] | np.ndarray | None = None,
    tangent: bool = False,
    weave_angle: float | None = None,
) -> State:
    """Evaluate the law of eq. (30) from one of U `stretch`, F `gradient` or C `cauchy_green`.

    stretch, cauchy_green: (..., 2, 2), symmetric; gradient: (..., 2, 2) or (..., 3, 2); any memory layout.
    fabric: `WovenFabric`, `TabulatedFabric` or the `symbols` of one; fibres: pair of unit vectors a0, b0, each (2,) or
    (..., 2), not parallel; default the two base vectors. tangent: whether to return it, too. weave_angle: angle between
    the yarns from which gamma counts [rad], by default the initial one as in eq. (8).
    Raises InputError if not exactly one measure is given, if it is of another shape, not finite, inverted or not
    symmetric at a point, for fibres that are no unit vectors or parallel, and as `check_weave_angle` does.
    """
    measures = [x for x in (stretch, gradient, cauchy_green) if x is not None]
    if len(measures) != 1:
        raise InputError(f"evaluate takes one of stretch, gradient, cauchy_green; {len(measures)} were given")
    given = np.asarray(measures[0], dtype=float)
    rows, columns = given.shape[-2:] if given.ndim >= 2 else (0, 0)
    if (rows, columns) not in ((2, 2), (3, 2)) or (rows == 3 and gradient is None):
        raise InputError(f"the strain measure has shape {given.shape}; allowed is (n, 2, 2), for F also (n, 3, 2)")
    given = given.reshape(-1, rows, columns)
    C = given if cauchy_green is not None else np.einsum("nki,nkj->nij", given, given)
    C11, C12, C22 = C[:, 0, 0], C[:, 0, 1], C[:, 1, 1]
    with np.errstate(invalid="ignore"):
        J2 = C11 * C22 - C12**2
        inverted = (np.linalg.det(given) <= 0) if rows == 2 else (J2 <= 0)
        bad = np.flatnonzero(~np.isfinite(J2) | (J2 <= 0) | (C11 <= 0) | inverted)
    if bad.size:
        raise InputError(
            f"the deformation at point {bad[0]} is {given[bad[0]].tolist()}; allowed are finite ones with J > 0"
        )

    if gradient is None and np.abs(given[:, 0, 1] - given[:, 1, 0]).max(initial=0.0) > 1e-12 * np.abs(given).max(
        initial=0.0
    ):
        raise InputError("stretch or Cauchy-Green tensors are not symmetric; allowed are symmetric ones")
    a, b = (np.asarray(v, float).reshape(-1, 2) for v in (([1.0, 0.0], [0.0, 1.0]) if fibres is None else fibres))
    for name, v in (("a0", a), ("b0", b)):
        if len(v) not in (1, len(C)) or not (np.abs((v**2).sum(1) - 1) < 1e-9).all():
            raise InputError(
                f"fibres {name} of shape {v.shape} are not unit vectors, one or {len(C)}; allowed are unit vectors (2,) or (n, 2)"
            )
    if (np.abs((a * b).sum(1)) > 1 - 1e-9).any():
        raise InputError("fibres a0 and b0 are parallel; allowed is any other angle")
    (a1, a2), (b1, b2) = (np.moveaxis(v, 1, 0) for v in (a, b))
    Cb1, Cb2 = C11 * b1 + C12 * b2, C12 * b1 + C22 * b2
    I4 = a1 * (C11 * a1 + C12 * a2) + a2 * (C12 * a1 + C22 * a2)
    I6, I8 = a1 * Cb1 + a2 * Cb2, b1 * Cb1 + b2 * Cb2
    area = np.sqrt(J2) * np.abs(a1 * b2 - a2 * b1)
    gamma = np.arctan2(I6, area)
    if weave_angle is None:
        gamma -= np.arctan2(a1 * b1 + a2 * b2, np.abs(a1 * b2 - a2 * b1))
    else:
        gamma -= np.pi / 2 - check_weave_angle(weave_angle)

    parts, W1, W2 = derivatives(fabric, I4, I8, gamma, tangent)
    g4, g6, g8 = -I6 / (2 * I4 * area), 1 / area, -I6 / (2 * I8 * area)  # d(gamma)/d(I4, I6, I8)
    # S = 2 dW/dC with dI4/dC = a a, dI8/dC = b b, dI6/dC = sym(a b); eqs (11), (12)
    M4 = np.stack(np.broadcast_arrays(a1 * a1, a2 * a2, a1 * a2), -1)
    M8 = np.stack(np.broadcast_arrays(b1 * b1, b2 * b2, b1 * b2), -1)
    M6 = np.stack(np.broadcast_arrays(a1 * b1, a2 * b2, (a1 * b2 + a2 * b1) / 2), -1)
    dW = [W1[0] + W1[2] * g4, W1[2] * g6, W1[1] + W1[2] * g8]
    S11, S22, S12 = np.moveaxis(2 * sum(w[:, None] * M for w, M in zip(dW, (M4, M6, M8))), 1, 0)
    S = np.stack([S11, S12, S12, S22], -1).reshape(-1, 2, 2)

    if cauchy_green is not None:  # U of C in closed form (Cayley-Hamilton)
        J = np.sqrt(J2)
        push = (C + J[:, None, None] * np.eye(2)) / np.sqrt(C11 + C22 + 2 * J)[:, None, None]
    else:
        push = given
    cauchy = np.einsum("nij,njk,nlk->nil", push, S, push) / np.sqrt(J2)[:, None, None]

    dSdE = None
    if W2:
        a3 = area**3
        second = {  # d2(gamma)/dI dI
            "44": I6 / (2 * I4**2 * area) + I6 * I8 / (4 * I4 * a3), "48": I6 / (4 * a3), "46": -I8 / (2 * a3),
            "66": I6 / a3, "68": -I4 / (2 * a3), "88": I6 / (2 * I8**2 * area) + I6 * I4 / (4 * I8 * a3),
        }  # fmt: skip
        Waa, Wab, Wbb, Wag, Wbg, Wgg = W2
        Wg = W1[2]
        H = {
            "44": Waa + 2 * Wag * g4 + Wgg * g4**2, "88": Wbb + 2 * Wbg * g8 + Wgg * g8**2, "66": Wgg * g6**2,
            "48": Wab + Wag * g8 + Wbg * g4 + Wgg * g4 * g8, "46": Wag * g6 + Wgg * g4 * g6, "68": Wbg * g6 + Wgg * g6 * g8,
        }  # fmt: skip
        M = {"4": M4, "6": M6, "8": M8}
        dSdE = np.zeros((len(C), 3, 3))
        for ij, h in H.items():
            i, j = ij[0], ij[1]
            pair = (4 * (h + Wg * second[ij]))[:, None, None] * M[i][:, :, None] * M[j][:, None, :]
            dSdE += pair if i == j else pair + pair.swapaxes(1, 2)

    return State(
        invariants=np.stack([I4, I6, I8, gamma], -1),
        energy=parts.sum(-1),
        energy_parts=parts,
        S=S,
        cauchy=cauchy,
        strain_state=1 + (I8 <= 1) + 2 * (I4 <= 1),
        tangent=dSdE,
    )


def derivatives(
    fabric: "Fabric | SimpleNamespace", I4: np.ndarray, I8: np.ndarray, gamma: np.ndarray, hessian: bool
) -> tuple[np.ndarray, tuple[np.ndarray, ...], tuple[np.ndarray, ...] | None]:
    """W in parts (n, 3), dW/d(I4, I8, gamma), 3 arrays (n,), and, if asked for the `hessian`, the second derivatives
    (44, 48, 88, 4g, 8g, gg), 6 arrays (n,), all in MPa; I4, I8 [-] and gamma [rad]: (n,)."""
    la, lb = np.sqrt(I4), np.sqrt(I8)
    qa, qb = I4 - 1, I8 - 1
    ea, eb = qa / (la + 1), qb / (lb + 1)  # sqrt(I) - 1 without cancellation
    if fabric.curves:
        (A, A_a, A_aa), (B, B_b, B_bb), (H, H_g, H_gg) = (
            c.derivatives(v) for c, v in zip(fabric.curves, (ea, eb, gamma))
        )
        zero = np.zeros_like(A)
        second = (A_aa / (4 * I4) - A_a / (4 * la**3), zero, B_bb / (4 * I8) - B_b / (4 * lb**3), zero, zero, H_gg)
        return np.stack([A, B, H], -1), (A_a / (2 * la), B_b / (2 * lb), H_g), second
    fabric = cast("WovenFabric | SimpleNamespace", fabric)
    warp, weft, g = fabric.warp, fabric.weft, np.abs(gamma)

    def normal(y, q, e, e_other):  # one direction's W_TC with its derivatives in (e, e_other)
        k0, k1, k2 = np.ones_like(e), 0.0 * e, 0.0 * e
        if fabric.biaxial:
            k1 = (1 - y.p_min) * np.exp(y.c * e_other)
            k0, k1, k2 = k1 + y.p_min, y.c * k1, y.c**2 * k1
        T0, T1, T2 = (y.a * e + y.b) * e**2, (3 * y.a * e + 2 * y.b) * e, 6 * y.a * e + 2 * y.b
        t = q > 0
        return [
            np.where(t, T0 * k0, y.d * e**2), np.where(t, T1 * k0, 2 * y.d * e), np.where(t, T0 * k1, 0),
            np.where(t, T2 * k0, 2 * y.d), np.where(t, T1 * k1, 0), np.where(t, T0 * k2, 0),
        ]  # fmt: skip

    A, A_a, A_b, A_aa, A_ab, A_bb = normal(warp, qa, ea, eb)
    B, B_b, B_a, B_bb, B_ab, B_aa = normal(weft, qb, eb, ea)

    def tension(y, q):  # s_T (I-1)^2 with derivatives, zero in compression
        p = np.maximum(q, 0) if fabric.tension_shear else 0 * q
        return y.s_T * p**2, 2 * y.s_T * p, 2 * y.s_T * (p > 0)

    def compression(y, q):  # k_SC with derivatives, one in tension
        if not fabric.compression_shear:
            return np.ones_like(q), 0 * q, 0 * q
        m = np.minimum(q, 0)
        m2 = m * m  # NumPy takes ten times as long for m**3
        k = np.exp(y.s_C * m2 * m)
        return k, 3 * y.s_C * m2 * k, (6 * y.s_C * m + 9 * y.s_C**2 * m2 * m2) * k

    (Ta, Ta1, Ta2), (Tb, Tb1, Tb2) = tension(warp, qa), tension(weft, qb)
    (Ka, Ka1, Ka2), (Kb, Kb1, Kb2) = compression(warp, qa), compression(weft, qb)
    T, g3 = Ta + Tb, g**3 / 3
    tau = ((fabric.s3 * g + fabric.s2) * g + fabric.s1) * g  # eq. (24)
    H = ((fabric.s3 / 4 * g + fabric.s2 / 3) * g + fabric.s1 / 2) * g**2 + g3 * T
    H_g = tau + g**2 * T
    parts = np.stack([A, B, H * Ka * Kb], -1)
    w_a, w_b = A_a + B_a, A_b + B_b
    sign = np.sign(gamma)
    first = (
        w_a / (2 * la) + (g3 * Ta1 * Ka + H * Ka1) * Kb,
        w_b / (2 * lb) + (g3 * Tb1 * Kb + H * Kb1) * Ka,
        sign * H_g * Ka * Kb,
    )
    if not hessian:
        return parts, first, None
    H_gg = (3 * fabric.s3 * g + 2 * fabric.s2) * g + fabric.s1 + 2 * g * T
    second = (
        (A_aa + B_aa) / (4 * I4) - w_a / (4 * la**3) + (g3 * Ta2 * Ka + 2 * g3 * Ta1 * Ka1 + H * Ka2) * Kb,
        (A_ab + B_ab) / (4 * la * lb) + g3 * Ta1 * Ka * Kb1 + g3 * Tb1 * Kb * Ka1 + H * Ka1 * Kb1,
        (A_bb + B_bb) / (4 * I8) - w_b / (4 * lb**3) + (g3 * Tb2 * Kb + 2 * g3 * Tb1 * Kb1 + H * Kb2) * Ka,
        sign * (g**2 * Ta1 * Ka + H_g * Ka1) * Kb,
        sign * (g**2 * Tb1 * Kb + H_g * Kb1) * Ka,
        H_gg * Ka * Kb,
    )
    return parts, first, second
