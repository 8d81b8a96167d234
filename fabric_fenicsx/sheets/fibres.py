"""Fibre fields a0, b0 on a sheet, in its cells' tangent planes."""

from collections.abc import Callable

import numpy as np
from dolfinx import fem
from dolfinx.mesh import Mesh
from numpy.typing import ArrayLike

from .. import dolfinx_compat as compat
from ..runtime.errors import InputError

# an angle, a vector, or a function of points to either; see `Blank`
Direction = ArrayLike | Callable[[np.ndarray], ArrayLike]

# a projection shorter than this (about 84 deg out of plane) leaves no direction to speak of
NEARLY_NORMAL = 0.1


def fibre_fields(
    mesh: Mesh, a: Direction = 0.0, b: Direction | None = None, up: ArrayLike = (0.0, 0.0, 1.0)
) -> tuple[fem.Function, fem.Function]:
    """DG0 vector fields a0, b0 (gdim components) of unit length in the cells' tangent planes, along
    the directions of `Blank`, which also has what is raised."""
    centre, normal = _midpoints(mesh, up)
    a0 = _tangent(mesh, centre, normal, a, "a")
    b0 = np.cross(normal, a0) if b is None else _tangent(mesh, centre, normal, b, "b")
    parallel = abs((a0 * b0).sum(1)) > 1 - 1e-6
    _refuse(mesh, parallel, centre, "fibre directions a and b are parallel")
    space = compat.vector_space(mesh, "DG", 0, mesh.geometry.dim)
    fields = fem.Function(space), fem.Function(space)
    for field, values in zip(fields, (a0, b0)):
        field.x.array[:] = values[:, : mesh.geometry.dim].ravel()
    return fields


def _midpoints(mesh, up):
    """Centre and unit normal of each local cell, the normal on the side of `up`."""
    x = mesh.geometry.x[compat.geometry_dofmap(mesh)]
    if compat.cell_name(mesh) == "triangle":
        corners, ends = x[:, :3], (1, 0, 2, 0)
    else:  # in tensor-product order
        corners, ends = x[:, :4], (3, 0, 2, 1)
    p, q, r, s = (corners[:, end] for end in ends)
    normal = np.cross(p - q, r - s)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal[normal @ np.asarray(up, float) < 0] *= -1
    return corners.mean(1), normal


def _tangent(mesh, centre, normal, direction, name):
    gdim, n = mesh.geometry.dim, len(centre)
    if np.ndim(direction) == 0 and not callable(direction) and abs(float(direction)) > 2 * np.pi:
        found = f"fibre direction {name} is {direction:g}, an angle in radians"
        raise InputError(f"{found}; allowed is from -2 pi to 2 pi")
    value = np.asarray(direction(centre.T) if callable(direction) else direction, dtype=float)
    if value.ndim == 0 or value.shape == (n,) and callable(direction):
        value = np.stack(np.broadcast_arrays(np.cos(value), np.sin(value), 0.0), -1)
    elif callable(direction):
        value = value.T
    value = np.broadcast_to(value, (n, value.shape[-1])).astype(float)
    if value.shape[1] == 2:
        value = np.column_stack([value, np.zeros(n)])
    if value.shape[1] != 3:
        found = f"fibre direction {name} has {value.shape[1]} components"
        raise InputError(f"{found}; allowed is an angle or {gdim} components")

    def refuse(bad, flaw):
        _refuse(mesh, bad, centre, f"fibre direction {name} {flaw}")

    with np.errstate(invalid="ignore", divide="ignore"):
        value = value / np.linalg.norm(value, axis=1, keepdims=True)
        refuse(~np.isfinite(value).all(1), "is zero or not finite")
        out = (value * normal).sum(1)
    if gdim == 2:
        refuse(abs(out) > 1e-6, "leaves the plane of the plane blank")
    value = value - out[:, None] * normal
    length = np.linalg.norm(value, axis=1)
    refuse(length < NEARLY_NORMAL, "is normal to the sheet")
    return value / length[:, None]


def _refuse(mesh, bad, centre, flaw):
    """Raise the same InputError on all ranks if any rank has a bad cell."""
    mine = centre[bad][:1].round(6).tolist()
    found: list = sum(mesh.comm.allgather(mine), [])
    if found:
        where = f"in the cell at {tuple(found[0])} mm"
        raise InputError(f"{flaw} {where}; allowed are directions in its tangent plane")
