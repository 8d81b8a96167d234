"""The explicit kernel: any law at n points at once, in NumPy, with the arithmetic of a VUMAT.

Against Abaqus' VUMAT interface:

| VUMAT | here |
|---|---|
| `nblock` | n: the points of any leading shape of the input, in one row in what is given back |
| `stretchNew` | `stretch`, U in the plane of the membrane, (n, 2, 2) |
| `defgradNew` | `gradient`, F, (n, 2, 2), or (n, 3, 2) from tangent plane to space |
| `props` | `fabric`, a `Law` |
| `stressNew` | `State.cauchy` [MPa]: corotational if U or C was given, in space if F was |
| `enerInternNew` | `State.energy` / density; `State.energy` is per undeformed volume [N mm/mm3] |
| `stateOld` | `sliding`, of friction between yarns |
| `stateNew` | `State.sliding`; `State.invariants`, `State.energy_parts`, `State.strain_state` |
| `charLength` etc. | not needed: the law has no rate |

The membrane keeps its thickness (lambda_3 = 1), so J of eq. (4) is the change of area. The
formulas from C to strains and stress are the kernel's own: each run compares its stress with that
of the elements, from `strains.py` and `membrane_energy.py`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.rules import Rule
from .laws import Law


class State(NamedTuple):
    """Result of `evaluate` at n points; tensors are in the orthonormal basis in which C, U or F
    was given."""

    invariants: np.ndarray
    energy: np.ndarray
    energy_parts: np.ndarray
    S: np.ndarray
    cauchy: np.ndarray
    strain_state: np.ndarray
    tangent: np.ndarray | None
    sliding: np.ndarray | None = None


State.invariants.__doc__ = "(n, 4): I4, I6, I8 [-] and I10 = gamma [rad], signed; eqs (5)-(8)"
State.energy.__doc__ = "(n,): W_tot [MPa]"
State.energy_parts.__doc__ = "(n, 3): along a, along b, shear with its couplings [MPa]"
State.S.__doc__ = "(n, 2, 2): second Piola-Kirchhoff stress, eq. (12) [MPa]"
State.cauchy.__doc__ = "(n, 2, 2), or (n, 3, 3) from a gradient into space: eq. (4) [MPa]"
State.strain_state.__doc__ = "(n,): 1 both in tension, 2 only a, 3 only b, 4 none; eq. (13)"
State.tangent.__doc__ = "(n, 3, 3): dS/dE on (11, 22, 12), E in Voigt's (E11, E22, 2 E12) [MPa]"
State.sliding.__doc__ = "(n, k): slip of friction elements after the step [rad], if it was given"


def evaluate(
    fabric: Law,
    *,
    stretch: ArrayLike | None = None,
    gradient: ArrayLike | None = None,
    cauchy_green: ArrayLike | None = None,
    fibres: tuple[ArrayLike, ArrayLike] | np.ndarray | None = None,
    tangent: bool = False,
    weave_angle: float | None = None,
    sliding: ArrayLike | None = None,
) -> State:
    """Evaluate the law of `fabric` from one of U `stretch`, F `gradient` or C `cauchy_green`,
    (..., 2, 2), or (..., 3, 2) of a gradient into space.

    fibres: unit vectors a0, b0, each (2,) or (..., 2), by default the base vectors. weave_angle:
    between the yarns, from which gamma counts [rad], by default the initial one. sliding: (n, k) or
    (k,), of the elements of `shear_friction` before the step [rad], which has no part without it.
    """
    measure, C = _deformation(stretch, gradient, cauchy_green)
    (a1, a2), (b1, b2) = a0, b0 = _directions(fibres)
    C11, C12, C22 = C[:, 0, 0], C[:, 0, 1], C[:, 1, 1]
    J = np.sqrt(C11 * C22 - C12**2)
    # stretches of the yarns, and cosine and sine of the angle between them
    I4, I8 = (C11 * x**2 + 2 * C12 * x * y + C22 * y**2 for x, y in (a0, b0))
    la, lb = np.sqrt(I4), np.sqrt(I8)
    cosine = (a1 * (C11 * b1 + C12 * b2) + a2 * (C12 * b1 + C22 * b2)) / (la * lb)
    flat = np.abs(a1 * b2 - a2 * b1)  # the sine before
    sine = J * flat / (la * lb)
    start = np.arctan2(flat, a1 * b1 + a2 * b2)
    if weave_angle is not None:
        start = check_weave_angle(weave_angle)
    gamma = start - np.arctan2(sine, cosine)

    # lambda - 1 would lose digits
    eps_a, eps_b = (np.expm1(np.log(I) / 2) for I in (I4, I8))
    W = fabric.derivatives(eps_a, eps_b, gamma, tangent)
    slid = None if sliding is None else _add_friction(fabric, W, gamma, sliding)
    a, b = a0 / la, b0 / lb
    aa, bb, ab = (np.einsum("in,jn->ijn", *pair) for pair in ((a, a), (b, b), (a, b)))
    # of lambda_a, lambda_b, gamma in E; eq. (12)
    slopes = np.array([la * aa, lb * bb, (ab + ab.swapaxes(0, 1) - cosine * (aa + bb)) / sine])
    S = np.einsum("kn,kijn->nij", W.first, slopes)
    push = measure
    if cauchy_green is not None:  # U of C in closed form (Cayley-Hamilton)
        push = (C + J[:, None, None] * np.eye(2)) / np.sqrt(C11 + C22 + 2 * J)[:, None, None]
    return State(
        invariants=np.stack([I4, cosine * la * lb, I8, gamma], -1),
        energy=W.parts.sum(-1),
        energy_parts=W.parts,
        S=S,
        cauchy=np.einsum("nij,njk,nlk->nil", push, S, push) / J[:, None, None],
        strain_state=1 + (I8 <= 1) + 2 * (I4 <= 1),
        tangent=_tangent(W, slopes, la, lb, cosine / sine) if tangent else None,
        sliding=slid,
    )


def _tangent(W, slopes, la, lb, cotangent):
    """dS/dE (n, 3, 3), by the second derivatives of W and those of the strains in E."""
    Wa, Wb, Wg = W.first
    turn = cotangent * Wg
    aa, ab, bb = turn / la**2 - Wa / la, -turn / (la * lb), turn / lb**2 - Wb / lb
    second = W.second + [aa, ab, bb, -Wg / la, -Wg / lb, turn]
    square, voigt = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]]), slopes[:, [0, 1, 0], [0, 1, 1]]
    return np.einsum("ijn,ipn,jqn->npq", second[square], voigt, voigt)


def _add_friction(fabric, W, gamma, sliding):
    """Add friction between yarns to the derivatives W; the sliding after the step (n, k)."""
    friction = fabric.shear_friction
    places = len(gamma), len(friction.stiffness)
    more = friction.respond(gamma, np.broadcast_to(sliding, places))
    W.parts[:, 2] += more.energy
    W.first[2] += more.stress
    if W.second is not None:
        W.second[5] += more.tangent
    return more.sliding


def _deformation(stretch, gradient, cauchy_green):
    """The measure that is given, (n, rows, 2), and C (n, 2, 2) of it."""
    measures = [x for x in (stretch, gradient, cauchy_green) if x is not None]
    if len(measures) != 1:
        raise InputError(
            f"of stretch, gradient and cauchy_green, {len(measures)} were given; expected one"
        )
    measure = np.asarray(measures[0], dtype=float)
    rows = measure.shape[-2]
    measure = measure.reshape(-1, rows, 2)
    C = measure if cauchy_green is not None else np.einsum("nki,nkj->nij", measure, measure)
    with np.errstate(invalid="ignore"):
        J2 = C[:, 0, 0] * C[:, 1, 1] - C[:, 0, 1] ** 2
        inverted = (np.linalg.det(measure) <= 0) if rows == 2 else (J2 <= 0)
        bad = np.flatnonzero(~np.isfinite(J2) | (J2 <= 0) | (C[:, 0, 0] <= 0) | inverted)
    if bad.size:
        place = f"point {bad[0]} is {measure[bad[0]].tolist()}"
        raise InputError(f"the deformation at {place}; expected finite ones with J > 0")
    return measure, C


def _directions(fibres):
    """Components of a0 and b0, two arrays (2, 1 or n)."""
    a, b = (np.asarray(v, float).reshape(-1, 2) for v in (np.eye(2) if fibres is None else fibres))
    unit = all((np.abs((v**2).sum(1) - 1) < 1e-9).all() for v in (a, b))
    if not unit or (np.abs((a * b).sum(1)) > 1 - 1e-9).any():
        raise InputError("fibres a0 and b0 must be unit vectors, and not parallel")
    return a.T, b.T


def check_weave_angle(angle: float) -> float:
    """`angle` between the yarns of a weave without shear [rad]; InputError unless it is above 0
    and below pi."""
    rule = Rule("an angle above 0 and below pi", lambda v: 0 < v < np.pi)
    return rule.check("`weave_angle` [rad]", angle)
