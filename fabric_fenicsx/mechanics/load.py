"""Dead loads on a blank."""

from collections.abc import Callable

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from numpy.typing import ArrayLike
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..blank import Blank
from ..errors import InputError


def _direction(name: str, direction: ArrayLike, gdim: int) -> np.ndarray:
    """`direction` (gdim,) at length 1; InputError if it has none."""
    given = np.asarray(direction, float)
    if given.shape != (gdim,) or not (np.isfinite(given).all() and given.any()):
        raise InputError(f"direction of {name} is {given.tolist()}; allowed are {gdim} finite numbers, not all 0")
    return given / np.linalg.norm(given)


class DeadPressure:
    """Load of `pressure` [MPa] per undeformed area along a fixed `direction` (gdim,), growing with the load factor.
    Raises InputError for numbers that are not finite."""

    name, energy_kind = "dead pressure", None

    def __init__(self, blank: Blank, pressure: float, direction: ArrayLike) -> None:
        if not np.isfinite(pressure):
            raise InputError(f"dead pressure is {pressure} MPa; allowed is a finite number")
        self._pressure, self._now = pressure, fem.Constant(blank.mesh, 0.0)
        unit = _direction(self.name, direction, blank.mesh.geometry.dim)
        moved = ufl.dot(blank.displacement, ufl.as_vector(unit.tolist())) * ufl.dx(blank.mesh)
        self.energy = -self._now * moved
        self._way, self._last = compat.form(moved), (0.0, 0.0)

    def at(self, load: float) -> None:
        """Set the load factor."""
        self._now.value = load * self._pressure

    def accept(self) -> None:
        """Count `work` from the present state."""
        self._last = float(self._now.value), fem.assemble_scalar(self._way)

    def work(self) -> float:
        """Done on this rank's part since the last accepted state, by the trapezoidal rule [N mm]."""
        size, way = self._last
        return 0.5 * (size + float(self._now.value)) * (fem.assemble_scalar(self._way) - way)


class EdgeTension:
    """Pull of grippers: `tension` [N/mm] along a fixed `direction` (gdim,) on an undeformed edge.

    tension: a number, there from the start, or a function of the load factor. edge: function of points (3, n) [mm] to a
    mask (n,), true at both ends of the edge's sides. Raises InputError if it marks no side, and for numbers that are not
    finite.
    """

    name, energy_kind = "edge tension", None

    def __init__(
        self,
        blank: Blank,
        tension: float | Callable[[float], float],
        direction: ArrayLike,
        edge: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        mesh = blank.mesh
        unit = _direction(f"{self.name} on {blank.name}", direction, mesh.geometry.dim)
        mesh.topology.create_connectivity(1, 2)
        sides = np.unique(dolfinx.mesh.locate_entities_boundary(mesh, 1, edge)).astype(np.int32)
        if mesh.comm.allreduce(len(sides), MPI.SUM) == 0:
            raise InputError(f"edge tension marks no side of {blank.name}; allowed is a function that marks 1 or more")
        tags = dolfinx.mesh.meshtags(mesh, 1, sides, np.ones(len(sides), dtype=np.int32))
        along = ufl.dot(blank.in_space(ufl.TestFunction(blank.V)), ufl.as_vector(unit.tolist()))
        lengths = fem_petsc.assemble_vector(compat.form(along * ufl.Measure("ds", mesh, subdomain_data=tags)(1)))
        lengths.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        # of the edge at each owned degree of freedom; no form, as UFL wants one set of marked edges for a whole scene
        self._lengths, self._u = lengths.array.copy(), blank.u
        self._tension: Callable[[float], float] = tension if callable(tension) else lambda load: tension
        self.at(0.0)
        self.accept()

    def at(self, load: float) -> None:
        """Set the load factor; InputError if the tension there is not finite."""
        self._now = float(self._tension(load))
        if not np.isfinite(self._now):
            raise InputError(f"{self.name} is {self._now} N/mm at load {load:g}; allowed is a finite number")

    def accept(self) -> None:
        """Count `work` from the present state."""
        self._last = self._now, self._way()

    def work(self) -> float:
        """Done on this rank's part since the last accepted state, by the trapezoidal rule [N mm]."""
        tension, way = self._last
        return 0.5 * (tension + self._now) * (self._way() - way)

    def potential(self) -> float:
        """Of the load on this rank's part [N mm]."""
        return -self._now * self._way()

    def add_forces(self, f: np.ndarray) -> None:
        """Add the potential's derivative to f, of this rank's degrees of freedom [N]."""
        f[: len(self._lengths)] -= self._now * self._lengths

    def pushes(self) -> np.ndarray:
        """Forces on the owned degrees of freedom [N], that a residual is to be small beside."""
        return self._now * self._lengths

    def _way(self):
        """Of this rank's part of the edge, times its length [mm^2]."""
        return float(self._lengths @ self._u.x.array[: len(self._lengths)])
