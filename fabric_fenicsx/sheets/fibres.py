"""Fibre fields a0, b0 on a sheet: one unit vector a cell and direction, in the cell's tangent
plane."""

from collections.abc import Callable

import numpy as np
from dolfinx import fem
from dolfinx.mesh import Mesh
from numpy.typing import ArrayLike

from .. import dolfinx_compat as compat
from ..runtime.errors import InputError

# an angle, a vector, or a function of points to either; see `fibre_fields`
Direction = ArrayLike | Callable[[np.ndarray], ArrayLike]

# a projection shorter than this (about 84 deg out of plane) leaves no direction to speak of
NEARLY_NORMAL = 0.1


def fibre_fields(
    mesh: Mesh, a: Direction = 0.0, b: Direction | None = None, up: ArrayLike = (0.0, 0.0, 1.0)
) -> tuple[fem.Function, fem.Function]:
    """DG0 vector fields a0, b0 (gdim components) from `a` and `b`.

    a, b: an angle from the x axis about the z axis [rad]; a vector (gdim,); or a function of points
    (3, n) that returns angles (n,) or vectors (gdim, n). Vectors are projected to the tangent plane
    and normalised. Without `b`, b0 is perpendicular to a0, turned counter-clockwise as seen from
    `up` (3,). Raises InputError, on all ranks, for directions that are not finite, normal to the
    sheet, out of the plane of a plane blank, or parallel to each other.
    """
    centre, normal = _midpoints(mesh, up)
    a0 = _tangent(mesh, centre, normal, a, "a")
    b0 = np.cross(normal, a0) if b is None else _tangent(mesh, centre, normal, b, "b")
    _collective(
        mesh, np.abs((a0 * b0).sum(1)) > 1 - 1e-6, centre, "fibre directions a and b are parallel"
    )
    space = compat.vector_space(mesh, "DG", 0, mesh.geometry.dim)
    fields = fem.Function(space), fem.Function(space)
    for field, values in zip(fields, (a0, b0)):
        field.x.array[:] = values[:, : mesh.geometry.dim].ravel()
    return fields


def _midpoints(mesh, up):
    """Centre and unit normal of each local cell, the normal on the side of `up`."""
    x = mesh.geometry.x[compat.geometry_dofmap(mesh)]
    corners = x[:, :3] if compat.cell_name(mesh) == "triangle" else x[:, :4]
    if corners.shape[1] == 3:
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    else:  # corners in tensor-product order
        normal = np.cross(corners[:, 3] - corners[:, 0], corners[:, 2] - corners[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal[normal @ np.asarray(up, float) < 0] *= -1
    return corners.mean(1), normal


def _tangent(mesh, centre, normal, direction, name):
    gdim, n = mesh.geometry.dim, len(centre)
    if np.ndim(direction) == 0 and not callable(direction) and abs(float(direction)) > 2 * np.pi:
        raise InputError(
            f"fibre direction {name} is {direction:g}, an angle in radians; allowed is from -2 pi "
            "to 2 pi, as `numpy.radians` gives of degrees"
        )
    value = np.asarray(direction(centre.T) if callable(direction) else direction, dtype=float)
    if value.ndim == 0 or value.shape == (n,) and callable(direction):
        value = np.stack(np.broadcast_arrays(np.cos(value), np.sin(value), 0.0), -1)
    elif callable(direction):
        value = value.T
    value = np.broadcast_to(value, (n, value.shape[-1])).astype(float)
    if value.shape[1] == 2:
        value = np.column_stack([value, np.zeros(n)])
    if value.shape[1] != 3:
        raise InputError(
            f"fibre direction {name} has {value.shape[1]} components; allowed is an angle or "
            f"{gdim} components"
        )
    length = np.linalg.norm(value, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        value = value / length[:, None]
        _collective(
            mesh,
            ~np.isfinite(value).all(1),
            centre,
            f"fibre direction {name} is zero or not finite",
        )
        out = (value * normal).sum(1)
    if gdim == 2:
        _collective(
            mesh,
            np.abs(out) > 1e-6,
            centre,
            f"fibre direction {name} leaves the plane of the plane blank",
        )
    value = value - out[:, None] * normal
    length = np.linalg.norm(value, axis=1)
    _collective(
        mesh, length < NEARLY_NORMAL, centre, f"fibre direction {name} is normal to the sheet"
    )
    return value / length[:, None]


def _collective(mesh, bad, centre, what):
    """Raise the same InputError on all ranks if any rank has a bad cell."""
    mine = tuple(centre[np.flatnonzero(bad)[0]].round(6).tolist()) if bad.any() else None
    found = [where for where in mesh.comm.allgather(mine) if where is not None]
    if found:
        raise InputError(
            f"{what} in the cell at {found[0]} mm; allowed are directions in its tangent plane"
        )
