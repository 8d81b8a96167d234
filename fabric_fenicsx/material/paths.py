"""Paths of homogeneous states: yarn strains and shear angle, their deformation gradient, and the
stresses that do work on them."""

from collections.abc import Callable

import numpy as np

from ..readers.units import DEG

# name -> function of s in [0, 1] (n,) to eps_a, eps_b [-], gamma [rad]; panel of Fig. 7
PATHS: dict[str, Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]] = {
    "constrained uniaxial a": lambda s: (-0.20 + 0.23 * s, 0 * s, 0 * s),
    "constrained uniaxial b": lambda s: (0 * s, -0.20 + 0.23 * s, 0 * s),
    "equibiaxial": lambda s: (-0.20 + 0.23 * s, -0.20 + 0.23 * s, 0 * s),
    "biaxial 2:1": lambda s: (0.03 * s, 0.015 * s, 0 * s),
    "biaxial 1:2": lambda s: (0.015 * s, 0.03 * s, 0 * s),
    "tension a, compression b": lambda s: (0.03 * s, -0.20 * s, 0 * s),
    "in-plane compression": lambda s: (-0.20 * s, -0.10 * s, 0 * s),
    "pure shear": lambda s: (0 * s, 0 * s, 60 * DEG * (2 * s - 1)),
    "simple shear": lambda s: (
        0 * s,
        1 / np.cos(s * np.arccos(1 / 1.03)) - 1,
        s * np.arccos(1 / 1.03),
    ),  # until b is 3 % longer
    "shear, 1 % pre-tension": lambda s: (0 * s + 0.01, 0 * s + 0.01, 60 * DEG * s),
    "shear, 3 % pre-tension": lambda s: (0 * s + 0.03, 0 * s + 0.03, 60 * DEG * s),
    "shear, 5 % pre-compression": lambda s: (0 * s - 0.05, 0 * s - 0.05, 60 * DEG * s),
    "shear, 20 % pre-compression": lambda s: (0 * s - 0.20, 0 * s - 0.20, 60 * DEG * s),
}


def gradient(eps_a: np.ndarray, eps_b: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """F (n, 2, 2) of yarn strains [-] and shear angle [rad], (n,) each, for yarns a0 = e1, b0 = e2,
    turned towards each other by gamma/2 each."""
    a = (1 + eps_a)[:, None] * np.stack([np.cos(gamma / 2), np.sin(gamma / 2)], -1)
    b = (1 + eps_b)[:, None] * np.stack([np.sin(gamma / 2), np.cos(gamma / 2)], -1)
    return np.stack([a, b], -1)


def conjugate(P: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Stresses conjugate to eps_a, eps_b, gamma, (n, 3) [MPa], from first Piola-Kirchhoff stresses
    P (n, 2, 2) at `gradient` F.

    The rates of F are a/|a| e1 for eps_a, b/|b| e2 for eps_b, and both yarns turning towards each
    other for gamma.
    """
    a, b = F[:, :, 0], F[:, :, 1]
    turn = 0.5 * np.stack(
        [np.stack([-a[:, 1], a[:, 0]], -1), np.stack([b[:, 1], -b[:, 0]], -1)], -1
    )
    along = [(P[:, :, k] * f).sum(1) / np.linalg.norm(f, axis=1) for k, f in ((0, a), (1, b))]
    return np.stack([*along, (P * turn).sum((1, 2))], -1)
