"""Shapes of flat triangles in space, and what the stiffness of bending them depends on."""

from typing import NamedTuple

import numpy as np


class Shape(NamedTuple):
    """Cells as they are deformed: base vectors (cells, 3, 2), normals (cells, 3), gradients of the
    corners' functions (cells, 3, 3), the normal curvature's derivative by each node's motion along
    the normal (cells, 3, nodes), and itself (cells, 3); or, in its place, what else the operator of
    `shape` gives along the normal."""

    base: np.ndarray
    normal: np.ndarray
    gradients: np.ndarray
    bends: np.ndarray
    curvature: np.ndarray


class Section(NamedTuple):
    """What bending's stiffness depends on: the shape, what is conjugate to its curvature (cells, 3)
    [N mm], its derivatives in curvatures (cells, 3, 3), and those of `stretching` in them."""

    shape: Shape
    moments: np.ndarray
    bending: np.ndarray
    mixed: np.ndarray
