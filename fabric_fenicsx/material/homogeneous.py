"""Homogeneous states of a fabric: stresses, deformation gradient, and the state of free tension."""

import numpy as np

from ..core.errors import SolverFailure
from .laws import Law


def gradient(eps_a: np.ndarray, eps_b: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """F (n, 2, 2) of yarn strains [-] and shear angle [rad], (n,) each, for yarns a0 = e1, b0 = e2,
    turned towards each other by gamma/2 each."""
    a = (1 + eps_a)[:, None] * np.stack([np.cos(gamma / 2), np.sin(gamma / 2)], -1)
    b = (1 + eps_b)[:, None] * np.stack([np.sin(gamma / 2), np.cos(gamma / 2)], -1)
    return np.stack([a, b], -1)


def conjugate(P: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Stresses conjugate to eps_a, eps_b, gamma, (n, 3) [MPa], from first Piola-Kirchhoff stresses
    P (n, 2, 2) at `gradient` F."""
    turn = 0.5 * np.stack([-F[:, 1], F[:, 0]], 1) * [1, -1]  # of both yarns, each to the other
    along = (P * F).sum(1) / np.linalg.norm(F, axis=1)
    return np.column_stack([along, (P * turn).sum((1, 2))])


def nominal(law: Law, strains: np.ndarray) -> np.ndarray:
    """Stresses (n, 3) [MPa] conjugate to strains (n, 3) = eps_a, eps_b [-], gamma [rad]."""
    eps_a, eps_b, gamma = strains.T
    return law.derivatives(eps_a, eps_b, gamma, second=False).first.T


def lateral_strain(
    law: Law, along: int, strain: np.ndarray, start: np.ndarray | None = None
) -> np.ndarray:
    """Strain (n,) across a tension of `strain` (n,) along yarn a (0) or b (1), where the stress
    across is zero, from -99 % to 0. Raises SolverFailure if a stress is not a number."""
    across, narrowest = 1 - along, -0.99
    e = np.zeros((len(strain), 3))
    e[:, along] = strain
    e[:, across] = 0 if start is None else np.clip(start, -0.8, 0)
    low, high = np.full(len(strain), -np.inf), np.full(len(strain), np.inf)
    for _ in range(200):
        _, stress, second = law.derivatives(*e.T)
        before, pull, stiffness = e[:, across].copy(), stress[across], second[2 * across]
        if not np.isfinite(pull).all():
            raise SolverFailure("the stress across a free tension is not a number")
        high, low = np.where(pull > 0, before, high), np.where(pull > 0, low, before)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.clip(before - pull / stiffness, narrowest, 0)
        left, right = np.maximum(low, narrowest), np.minimum(high, 0)
        small = np.abs(step - before) < 1e-8  # quadratic, so the next step would be below rounding
        inside = small | ((step > low) & (step < high))
        e[:, across] = np.where(inside, step, (left + right) / 2)
        if np.all(small | (right - left < 1e-8)):
            return e[:, across]
    raise SolverFailure("the strain across a free tension was not found in 200 Newton steps")
