"""Logarithmic strain in a plane, with both derivatives in closed form.

A symmetric tensor is its mean and its two shears here, (m, d, o): [[m + d, o], [o, m - d]].
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyval

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
