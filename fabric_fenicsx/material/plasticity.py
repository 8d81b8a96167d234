"""Logarithmic strain in a plane, and plasticity in plane stress as an incremental potential.

A symmetric tensor is its mean and its two shears here, (m, d, o): [[m + d, o], [o, m - d]]. In
these terms elasticity and yielding are both diagonal: the stress is (K_1 m, K_2 d, K_2 o) with
K_1 = E / (1 - nu), K_2 = E / (1 + nu), its von Mises stress sqrt(m^2 + 3 d^2 + 3 o^2) (Simo and
Taylor, Int. J. Numer. Methods Eng. 22, 1986). Hardening is isotropic. What an implicit step does
minimises elastic energy plus dissipation over the plastic increment (Ortiz and Stainier, Comput.
Methods Appl. Mech. Eng. 171, 1999); the minimum's derivative in the strain is the stress.
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyval

from .metal import Metal

SERIES_LIMIT = 0.02  # value of u below which series replace quotients of differences


class Hencky(NamedTuple):
    """Strains (n, 3) as (m, d, o), their first derivatives (n, 3, 3) in C's (m, d, o), and what
    their second ones are made of. Not finite where C is not positive definite."""

    strain: np.ndarray
    first: np.ndarray
    parts: tuple[np.ndarray, ...]

    def second(self, stress: np.ndarray) -> np.ndarray:
        """Second derivatives in C's (m, d, o), summed with weights `stress` (n, 3), (n, 3, 3)."""
        m, d, o, D, slopes, bend = self.parts
        P, Q, R = stress.T
        L = Q * d + R * o
        cross = -L / D**2  # 2 d / o times this is the mixed derivative in m and d / o
        H = np.empty((len(m), 3, 3))
        H[:, 0, 0] = P * (1 / (2 * D) - (m / D) ** 2) + L * m / D**2
        H[:, 0, 1] = P * m * d / D**2 + d * cross - Q / (2 * D)
        H[:, 0, 2] = P * m * o / D**2 + o * cross - R / (2 * D)
        H[:, 1, 1] = -P * (1 / (2 * D) + (d / D) ** 2)
        H[:, 1, 1] += (2 * slopes + 4 * d**2 * bend) * L + 4 * d * slopes * Q
        H[:, 1, 2] = -P * d * o / D**2 + 4 * d * o * bend * L + 2 * slopes * (d * R + o * Q)
        H[:, 2, 2] = -P * (1 / (2 * D) + (o / D) ** 2)
        H[:, 2, 2] += (2 * slopes + 4 * o**2 * bend) * L + 4 * o * slopes * R
        for i, j in ((1, 0), (2, 0), (2, 1)):
            H[:, i, j] = H[:, j, i]
        return H


def hencky(C: np.ndarray) -> Hencky:
    """Strain 1/2 ln C of right Cauchy-Green tensors C (n, 3), both as (m, d, o)."""
    # with rho = d^2 + o^2, D = det C = m^2 - rho and u = rho / m^2 it is (ln(D) / 4, phi d, phi o),
    # phi = artanh(sqrt(u)) / (2 m sqrt(u)): smooth where C's two eigenvalues meet
    m, d, o = C.T
    with np.errstate(all="ignore"):
        rho = d * d + o * o
        D = np.where(m > 0, m * m - rho, np.nan)
        value, slope, bend = _artanh(rho / m**2)
        phi, by_rho = value / (2 * m), slope / (2 * m**3)
        strain = np.stack([np.log(D) / 4, phi * d, phi * o], -1)
        half = 1 / (2 * D)
    first = np.empty((len(m), 3, 3))
    first[:, 0] = np.stack([m * half, -d * half, -o * half], -1)
    first[:, 1] = np.stack([-d * half, phi + 2 * d * d * by_rho, 2 * d * o * by_rho], -1)
    first[:, 2] = np.stack([-o * half, 2 * d * o * by_rho, phi + 2 * o * o * by_rho], -1)
    return Hencky(strain, first, (m, d, o, D, by_rho, bend / (2 * m**5)))


def _artanh(u):
    """artanh(sqrt(u)) / sqrt(u) and its two derivatives."""
    # terms of the series; the next one is below 1e-17
    k, low = np.arange(10), np.minimum(u, SERIES_LIMIT)
    value, slope, bend = (
        polyval(low, factors / (2 * k + odd))
        for factors, odd in ((1.0, 1), (k + 1.0, 3), ((k + 1.0) * (k + 2), 5))
    )
    at = u > SERIES_LIMIT
    v = u[at]
    value[at] = np.arctanh(np.sqrt(v)) / np.sqrt(v)
    slope[at] = (1 / (1 - v) - value[at]) / (2 * v)
    bend[at] = (1 / (1 - v) ** 2 - 3 * slope[at]) / (2 * v)
    return value, slope, bend


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
