"""Coulomb's law of points that slip: an incremental potential of an elastic slip.

z (n, 3) [mm]: slip, in the plane normal to `normal` (n, 3). limit (n,): mu P [N], the resistance of
a point from |z| = `slip` [mm] on; up to there it grows in proportion to |z|.
"""

import numpy as np


def potential(z: np.ndarray, limit: np.ndarray, slip: float) -> np.ndarray:
    """mu P (|z|^2 / 2 s up to |z| = s, |z| - s / 2 beyond), (n,) [N mm]."""
    length = np.linalg.norm(z, axis=1)
    beyond = np.maximum(length - slip, 0.0)
    return limit * ((length - beyond) ** 2 / (2 * slip) + beyond)


def traction(z: np.ndarray, limit: np.ndarray, slip: float) -> np.ndarray:
    """The potential's derivative (n, 3) [N]."""
    return (limit / np.maximum(np.linalg.norm(z, axis=1), slip))[:, None] * z


def stiffness(z: np.ndarray, limit: np.ndarray, normal: np.ndarray, slip: float) -> np.ndarray:
    """The potential's second derivative (n, 3, 3) [N/mm]: mu P / max(|z|, s) times the projector on
    the tangent plane, where a point slides without the direction of slip."""
    length = np.linalg.norm(z, axis=1)
    blocks = np.eye(3) - normal[:, :, None] * normal[:, None]
    slides = length > slip
    along = z[slides] / length[slides, None]
    blocks[slides] -= along[:, :, None] * along[:, None]
    return blocks * (limit / np.maximum(length, slip))[:, None, None]


def elastic(z: np.ndarray, slip: float) -> np.ndarray:
    """The elastic part of the slip, at most `slip` long, (n, 3) [mm]."""
    return z * np.minimum(1.0, slip / np.maximum(np.linalg.norm(z, axis=1), 1e-300))[:, None]


def tangent(vectors: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The tangent part of vectors (n, 3)."""
    return vectors - (vectors * normal).sum(1, keepdims=True) * normal


def turned(z: np.ndarray, limit: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The slip turned into new tangent planes, as long as before; 0 where nothing presses."""
    length = np.linalg.norm(z, axis=1)
    flat = tangent(z, normal)
    flat *= (length / np.maximum(np.linalg.norm(flat, axis=1), 1e-300))[:, None]
    return np.where((limit > 0)[:, None], flat, 0.0)
