"""Loops over points that rub."""

import numpy as np

from ..core.compiled import compiled


@compiled
def potential(z: np.ndarray, limit: np.ndarray, slip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `Coulomb.potential`, of elastic slips (n,) [mm]."""
    energy, forces = np.zeros(len(z)), np.zeros(z.shape)
    for n in range(len(z)):
        length, s = np.sqrt(z[n, 0] ** 2 + z[n, 1] ** 2 + z[n, 2] ** 2), slip[n]
        beyond = max(length - s, 0.0)
        energy[n] = limit[n] * ((length - beyond) ** 2 / (2 * s) + beyond)
        for x in range(3):
            forces[n, x] = -limit[n] / max(length, s) * z[n, x]
    return energy, forces


@compiled
def blocks(z: np.ndarray, limit: np.ndarray, normal: np.ndarray, slip: np.ndarray) -> np.ndarray:
    """As `Coulomb.blocks`, of elastic slips (n,) [mm]."""
    stiff = np.zeros((len(z), 3, 3))
    for n in range(len(z)):
        if limit[n]:
            length, s = np.sqrt(z[n, 0] ** 2 + z[n, 1] ** 2 + z[n, 2] ** 2), slip[n]
            stiffness, slides = limit[n] / max(length, s), 1.0 if length > s else 0.0
            for x in range(3):
                for y in range(3):
                    along = slides * z[n, x] * z[n, y] / max(length, s) ** 2
                    free = (1.0 if x == y else 0.0) - normal[n, x] * normal[n, y] - along
                    stiff[n, x, y] = stiffness * free
    return stiff


@compiled
def slipped(slip: np.ndarray, moved: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Slip (n, 3) and the parts of motions `moved` (n, 3) across unit normals (n, 3), added up."""
    total = np.empty(slip.shape)
    for n in range(len(slip)):
        along = 0.0
        for x in range(3):
            along += moved[n, x] * normals[n, x]
        for x in range(3):
            total[n, x] = slip[n, x] + (moved[n, x] - along * normals[n, x])
    return total


@compiled
def turned(vectors: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """Products of matrices (n, 3, 3) and vectors (n, 3)."""
    product = np.zeros(vectors.shape)
    for n in range(len(vectors)):
        for x in range(3):
            for y in range(3):
                product[n, x] += matrices[n, x, y] * vectors[n, y]
    return product
