"""Nominal stresses of homogeneous states, written straight from eqs (14)-(30): the curves that elements must hit."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from .baseline import Fabric


def nominal_stresses(
    fabric: "Fabric", eps_a: ArrayLike, eps_b: ArrayLike, gamma: ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """sigma_a = dW/d(eps_a), sigma_b = dW/d(eps_b), tau = dW/d(gamma), arrays (n,) [MPa].

    eps_a, eps_b: nominal yarn strains, eq. (9) [-]; gamma: shear angle, eq. (8) [rad]; each (n,) or a number.
    Per undeformed volume, so F:P-conjugate (eq. 14 calls sigma_a at eps_b = 0, gamma = 0 sigma-hat); at a kink the
    stresses are continuous.
    """
    ea, eb, gamma = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, float)) for v in (eps_a, eps_b, gamma)))
    if fabric.curves:
        sigma_a, sigma_b, tau = (curve(v) for curve, v in zip(fabric.curves, (ea, eb, gamma)))
        return sigma_a, sigma_b, tau
    g = np.abs(gamma)

    def tension(y, e):
        return np.where(e > 0, y.a * e**3 + y.b * e**2, 0), np.where(e > 0, 3 * y.a * e**2 + 2 * y.b * e, 0)

    def k_TC(y, e):
        if not fabric.biaxial:
            return np.ones_like(e), np.zeros_like(e)
        grown = (1 - y.p_min) * np.exp(y.c * e)
        return grown + y.p_min, y.c * grown

    def I_and_slope(e):
        return e * (2 + e), 2 * (1 + e)  # I - 1 and dI/d(eps)

    def W_ST(y, e):  # over gamma^3
        i, di = I_and_slope(e)
        on = (e > 0) * fabric.tension_shear
        return on * y.s_T * i**2 / 3, on * 2 * y.s_T * i * di / 3

    def k_SC(y, e):
        i, di = I_and_slope(e)
        i = np.minimum(i, 0) * fabric.compression_shear
        k = np.exp(y.s_C * i**3)
        return k, 3 * y.s_C * i**2 * di * k

    def W_C_slope(y, e):
        return np.where(e > 0, 0, 2 * y.d * e)

    a, b = fabric.warp, fabric.weft
    (Ta, dTa), (Tb, dTb) = tension(a, ea), tension(b, eb)
    (ka, dka), (kb, dkb) = k_TC(a, eb), k_TC(b, ea)  # k_TC,a grows with eps_b and the other way round
    (Sa, dSa), (Sb, dSb) = W_ST(a, ea), W_ST(b, eb)
    (qa, dqa), (qb, dqb) = k_SC(a, ea), k_SC(b, eb)
    shear = fabric.s1 * g**2 / 2 + fabric.s2 * g**3 / 3 + fabric.s3 * g**4 / 4 + (Sa + Sb) * g**3
    tau = fabric.s1 * g + fabric.s2 * g**2 + fabric.s3 * g**3 + 3 * (Sa + Sb) * g**2
    return (
        dTa * ka + Tb * dkb + W_C_slope(a, ea) + (dSa * g**3 * qa + shear * dqa) * qb,
        dTb * kb + Ta * dka + W_C_slope(b, eb) + (dSb * g**3 * qb + shear * dqb) * qa,
        np.sign(gamma) * tau * qa * qb,
    )
