"""Plane-stress plasticity after von Mises with isotropic hardening, as an incremental potential.

In terms of mean and shears (m, d, o), see `hencky`, elasticity and yielding are both diagonal: the
stress is (K_1 m, K_2 d, K_2 o) with K_1 = E / (1 - nu), K_2 = E / (1 + nu), its von Mises stress
sqrt(m^2 + 3 d^2 + 3 o^2) (Simo and Taylor, Int. J. Numer. Methods Eng. 22, 1986). What an implicit
step does minimises elastic energy plus dissipation over the plastic increment (Ortiz and Stainier,
Comput. Methods Appl. Mech. Eng. 171, 1999); the minimum's derivative in the strain is the stress.
"""

from typing import NamedTuple

import numpy as np

from .metal import Metal


class Response(NamedTuple):
    """After a step: elastic strain (n, 3), equivalent plastic strain (n,), stress (n, 3) [MPa],
    half the energy's derivative, as (m, d, o), and its derivative in strain (n, 3, 3) or None."""

    elastic: np.ndarray
    plastic: np.ndarray
    stress: np.ndarray
    tangent: np.ndarray | None


def von_mises(stress: np.ndarray) -> np.ndarray:
    """Equivalent stresses (...) of stresses (..., 3) as (m, d, o)."""
    return np.sqrt(stress[..., 0] ** 2 + 3 * (stress[..., 1] ** 2 + stress[..., 2] ** 2))


def elastic_energy(metal: Metal, elastic: np.ndarray) -> np.ndarray:
    """Per volume (...) [N mm/mm^3] of elastic strains (..., 3)."""
    return elastic**2 @ _stiffness(metal)


def volume_change(metal: Metal, elastic: np.ndarray) -> np.ndarray:
    """Logarithm of the volume's ratio (...), all of it elastic, from elastic strains (..., 3)."""
    return 2 * elastic[..., 0] * (1 - 2 * metal.nu) / (1 - metal.nu)


def respond(metal: Metal, trial: np.ndarray, plastic: np.ndarray, tangent: bool = True) -> Response:
    """Implicit step to the strain at which, without plastic flow in the step, elastic strains were
    `trial` (n, 3), from equivalent plastic strains `plastic` (n,)."""
    K = _stiffness(metal)
    stress, plastic = trial * K, plastic.copy()
    equivalent, strength = von_mises(stress), metal.hardening.stress(plastic)
    # excess over the yield stress, relative, from which a stress yields
    at = np.flatnonzero(equivalent > (1 + 1e-13) * strength)
    D = np.zeros((len(trial), 3, 3)) if tangent else None
    if D is not None:
        D[:, [0, 1, 2], [0, 1, 2]] = K
    if not at.size:
        return Response(trial.copy(), plastic, stress, D)
    parts = np.stack([stress[at, 0] ** 2, equivalent[at] ** 2 - stress[at, 0] ** 2])
    flow, softer = _flow(metal, parts, plastic[at], equivalent[at], strength[at])
    plastic[at] += flow
    stress[at] *= softer[:, [0, 1, 1]]
    elastic = trial.copy()
    elastic[at] = stress[at] / K
    if D is not None:
        Y, slope = metal.hardening.stress(plastic[at]), metal.hardening.slope(plastic[at])
        less = softer[:, [0, 1, 1]] * K
        along = less * [1, 3, 3] * stress[at]
        m = (1 - flow * slope / Y) / (2 * Y)
        share = m / ((along * [1, 3, 3] * stress[at]).sum(1) * m + Y * slope)
        D[at] = -share[:, None, None] * along[:, :, None] * along[:, None]
        D[at[:, None], [0, 1, 2], [0, 1, 2]] += less
    return Response(elastic, plastic, stress, D)


def _stiffness(metal):
    """K_1, K_2, K_2 [MPa]."""
    return metal.E / np.array([1 - metal.nu, 1 + metal.nu, 1 + metal.nu])


def _flow(metal, parts, plastic, equivalent, strength):
    """Growth g of the equivalent plastic strain (n,), and what is left of mean and shears of the
    trial stress, 1 / (1 + K x) with x = g / 2 Y(plastic + g) and K of K_1, 3 K_2, (n, 2); parts:
    squares of both in the trial stress (2, n). Newton's method in a bracket."""
    K = _stiffness(metal)[:2] * [1, 3]
    low, high = np.zeros(len(plastic)), 2 * (equivalent - strength) / K.min()
    flow, before = np.minimum((equivalent - strength) / K.max(), high), np.inf
    # at most; each halves what is left of either excess or bracket, so they suffice
    for _ in range(100):
        Y, slope = metal.hardening.stress(plastic + flow), metal.hardening.slope(plastic + flow)
        softer = 1 / (1 + K * (flow / (2 * Y))[:, None])
        left = parts.T * softer**2
        now = np.sqrt(left.sum(1))
        excess = now - Y
        # tolerance, relative to the yield stress and to the stress of an increment
        converged = np.abs(excess) <= 4e-15 * (Y + 0.1 * K.max() * flow)
        if converged.all():
            break
        low, high = np.where(excess > 0, flow, low), np.where(excess > 0, high, flow)
        fall = (left * K * softer).sum(1) * (1 - flow * slope / Y) / (2 * Y * now) + slope
        newton = flow + excess / fall
        halves = (newton <= low) | (newton >= high) | (np.abs(excess) > before / 2)
        flow = np.where(converged, flow, np.where(halves, (low + high) / 2, newton))
        before = np.abs(excess)
    Y = metal.hardening.stress(plastic + flow)
    return flow, 1 / (1 + K * (flow / (2 * Y))[:, None])
