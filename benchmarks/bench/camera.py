"""Strains and shear angles of a strip as a camera sees them: from displacements of points."""

import math

import numpy as np
from mpi4py import MPI

from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.scene.scene import Scene

from .strips import LENGTH, WIDTH

SPACING = 2.5  # mm, of the points whose displacements tell the fields


def camera_points() -> np.ndarray:
    """Undeformed positions of the camera's points on a strip, (n, m, 2) [mm]."""
    axes = (np.linspace(0, size, round(size / SPACING) + 1) for size in (LENGTH, WIDTH))
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1)


def camera_displacements(scene: Scene) -> np.ndarray:
    """Displacements of the camera's points on a strip, (n, m, 2) [mm], on all ranks."""
    x = camera_points()
    edge = 1e-9 * LENGTH  # points on the edge may be found outside, by rounding
    points = np.clip(x.reshape(-1, 2), edge, [LENGTH - edge, WIDTH - edge])
    values = compat.values_at(scene.blank.u, np.column_stack([points, np.zeros(len(points))]))
    values = np.where(np.isnan(values), -np.inf, values)
    scene.comm.Allreduce(MPI.IN_PLACE, values, MPI.MAX)
    return values.reshape(x.shape)


def field_distance(angle: float, u: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Distances of two displacements (n, m, 2) [mm] of the camera's points on a strip with yarns a
    at `angle` [deg]: of their Green-Lagrange strains, relative in L2, and of their shear angles,
    root mean square [deg]."""
    strains, angles = [], []
    cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    for v in (u, other):
        x = camera_points() + v
        along, across = np.diff(x, axis=0), np.diff(x, axis=1)
        F = np.stack([along[:, 1:] + along[:, :-1], across[1:] + across[:-1]], -1) / (2 * SPACING)
        C = np.swapaxes(F, -1, -2) @ F
        strains.append((C - np.eye(2)) / 2)
        a, b = F @ [cosine, sine], F @ [-sine, cosine]
        angles.append(np.degrees(np.arctan2((a * b).sum(-1), np.linalg.det(F))))
    strain = np.linalg.norm(strains[0] - strains[1]) / np.linalg.norm(strains[1])
    return float(strain), float(np.sqrt(np.mean((angles[0] - angles[1]) ** 2)))
