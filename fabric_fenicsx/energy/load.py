"""Loads on a blank: dead ones, and the forces of what formed a sheet, which fade."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from numpy.typing import ArrayLike
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..core.errors import InputError
from ..core.rules import FINITE, POSITIVE, Rule
from ..material.laws import Law
from ..material.metal import Metal
from ..sheet.blank import Blank
from ..surfaces.surfaces import checked_vector
from .assembly import assembled
from .materials import materials_of, sheets_of, thickness_shares
from .output import Value
from .term import SceneFacts, Term, Triplets
from .work import Work


def vector_on(blank: Blank, name: str, vector: ArrayLike, unit: bool = False) -> np.ndarray:
    """`vector` (gdim,), if `unit` at length 1; InputError, which calls it `name`, if it is none."""
    if blank.mesh.geometry.dim == 3:
        return checked_vector(name, vector, unit)
    return checked_vector(f"{name}, on a blank without `spatial=True`,", vector, unit, "two")


def at_load(name: str, rule: Rule, given: float | Callable[[float], float], load: float) -> float:
    """A number, or a function's at a load factor; InputError unless that is one by `rule`."""
    if callable(given):
        name, given = f"{name} at load {load:g}", given(load)
    return rule.check(name, given)


class _Load(Term):
    """Forces whose size depends on the load factor alone: `_size(load)` times `_forces`, of this
    rank's degrees of freedom, at the displacements `_u`; `_work` is done on them."""

    _size: Callable[[float], float]
    _forces: np.ndarray
    _u: np.ndarray
    _work: Work

    def set_load(self, load: float) -> None:
        self._load, self._now = load, self._size(load)

    def accept(self) -> None:
        self._work.accept(*self._state())

    def reject(self) -> None:
        self._work.reject()

    def stored(self) -> float:
        return -self._now * self._travel()

    def add_forces(self, f: np.ndarray) -> None:
        f[: len(self._forces)] -= self.applied_forces()

    def applied_forces(self) -> np.ndarray:
        return self._now * self._forces

    def _travel(self):
        """Travel of this rank's part of what is loaded, times its size [mm^2 or mm^3]."""
        return float(self._forces @ self._u)

    def _state(self):
        travel = self.blank.mesh.comm.allreduce(self._travel())
        return self._load, np.array([self._now]), np.array([travel])


class _DeadLoad(_Load):
    """A load of fixed direction. A subclass gives it, and where it acts as a measure of UFL, to
    `_start`."""

    def _start(self, name, direction, measure, weight=1.0):
        unit = vector_on(self.blank, name, direction, unit=True)
        test = self.blank.in_space(ufl.TestFunction(self.blank.V))
        self._forces = assembled(weight * ufl.dot(test, ufl.as_vector(unit.tolist())) * measure)
        self._u = self.blank.u.x.array[: len(self._forces)]
        self._work = Work(follows=True)
        self.set_load(0.0)
        self.accept()

    def work(self) -> float:
        """Done on all of the sheet since the last accepted state, on rank 0 [N mm]."""
        done = self._work.since(*self._state())
        return done if self.blank.mesh.comm.rank == 0 else 0.0


class DeadPressure(_DeadLoad):
    """Pressure per undeformed area along a fixed direction, growing with the load factor. Its
    potential is minus int p u . n dA.

    pressure: at full load [MPa]; direction: along which it pushes, (gdim,) of any length. Raises
    InputError for numbers that are not finite, and a direction of length 0.

    Examples
    --------
    >>> ply = ff.Blank.rectangle(20, 10, nx=2, spatial=True)
    >>> gas = ff.DeadPressure(0.02, (0, 0, -1))
    >>> terms = [ff.Membrane(ff.load("komeili")), gas]
    >>> scene = ff.Scene(ply, terms, ff.clamped_ends(0.1))
    >>> scene.set_load(0.5)
    >>> ply.u.interpolate(lambda x: (0 * x[0], 0 * x[0], 0 * x[0] - 2.0))
    >>> round(gas.work(), 6)  # the mean force, 0.005 MPa of 200 mm^2, over 2 mm [N mm]
    2.0
    """

    name = "dead pressure"

    def __init__(self, pressure: float, direction: ArrayLike) -> None:
        self._pressure = FINITE.check("dead pressure [MPa]", pressure)
        self._direction = direction

    def set_up(self, scene: SceneFacts) -> None:
        self._start(f"direction of {self.name}", self._direction, self.part.dx())

    def _size(self, load):
        return load * self._pressure


class Gravity(_DeadLoad):
    """Weight of the sheets, constant over the load: density [g/cm^3] times thickness [mm], together
    kg/m^2, of each one's fabric or metal, on the undeformed area. Its potential is minus int rho t
    g . u dA.

    gravity: acceleration [m/s^2], downwards or as a vector (gdim,). Raises InputError for others,
    and for a sheet whose mass is not known, as no term has a fabric or metal for it.

    Examples
    --------
    >>> ply, weight = ff.Blank.rectangle(1000, 500, nx=2, spatial=True), ff.Gravity()
    >>> fabric = ff.load("komeili").replace(thickness=1.0, density=0.8)  # 0.8 kg/m2
    >>> scene = ff.Scene(ply, [ff.Membrane(fabric), weight], ff.clamped_ends(0.1))
    >>> round(float(weight.applied_forces().sum()), 6)  # of 0.4 kg [N]
    -3.924
    """

    name = "gravity"

    def __init__(self, gravity: Any = 9.81) -> None:
        if not np.iterable(gravity):
            gravity = 0, 0, -FINITE.check("`gravity`", gravity)
        self.acceleration = checked_vector("`gravity`", gravity, size="two or three")

    def set_up(self, scene: SceneFacts) -> None:
        blank = scene.blank
        mass = fem.Function(compat.vector_space(blank.mesh, "DG", 0, 1))  # kg/m^2
        for part in sheets_of(blank) if self.part.is_whole else [self.part]:
            material = next(materials_of(scene, part), None)
            if not isinstance(material, Law | Metal):
                name = part.name or blank.name
                raise InputError(f"gravity needs the mass of {name}: a fabric or metal of a term")
            shares = thickness_shares(scene, part, blank.centres()[part.cells])
            mass.x.array[part.cells] = material.density * material.thickness * shares
        self._start(f"gravity on {blank.name}", self.acceleration, self.part.dx(), mass[0])

    def _size(self, load):
        return 1e-6 * float(np.linalg.norm(self.acceleration))  # N/mm^2 of 1 kg/m^2


class EdgeTension(_DeadLoad):
    """Line load of grippers along a fixed direction on an undeformed edge.

    - tension: per length of edge [N/mm], a number, there from the start, or a function of the load
      factor
    - direction: along which it pulls, (gdim,) of any length
    - edge: function of points (3, n) [mm] to a mask (n,), true at both ends of the edge's sides

    Raises InputError if `edge` marks no side, and for numbers that are not finite.

    Examples
    --------
    >>> strip = ff.Blank.rectangle(20, 10, nx=2)
    >>> pull = ff.EdgeTension(0.3, (1, 0), lambda x: x[0] > 19.9)
    >>> held = ff.Support("left", lambda x: x[0] < 0.1, (0, 1))
    >>> scene = ff.Scene(strip, [ff.Membrane(ff.load("komeili")), pull], [held])
    >>> round(float(pull.applied_forces().sum()), 6)  # [N]
    3.0
    """

    name = "edge tension"

    def __init__(
        self,
        tension: float | Callable[[float], float],
        direction: ArrayLike,
        edge: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        at_load(f"{self.name} [N/mm]", FINITE, tension, 0.0)
        self._tension, self.direction, self.edge = tension, direction, edge

    def set_up(self, scene: SceneFacts) -> None:
        name = f"direction of {self.name} on {scene.blank.name}"
        self._start(name, self.direction, self.part.ds(self.edge))

    def _size(self, load):
        return at_load(f"{self.name} [N/mm]", FINITE, self._tension, load)


RELEASED = "released"  # kind of energy


class ReleaseForces(_Load):
    """Forces on the nodes, as tools exerted them, that fade with the load factor: all of them at
    load 0, none from 0.9 on.

    `take(forces)` sets them, at the displacement from which the sheet's motion counts. Dead forces
    would drive a sheet that yields, or that only the tools keep from buckling, far from where it
    was formed. Tools lose their force as a sheet leaves them. So a bed of springs fades with the
    forces: one at each node, of the same stiffness, as if all forces together were gone at a motion
    of `reach` [mm]. At load 0 and in the end it does nothing.

    What the sheet does on all this, as it springs back, is the energy "released". So energies and
    work balance, also where a sheet gives back all that it stored. Nodal field: `springback` [mm],
    the motion since then. Raises InputError for a reach that is not above 0.
    """

    name = "release forces"
    NO_FORCES_FROM = 0.9  # load factor; so what is lagged settles in the last step

    def __init__(self, reach: float) -> None:
        self.reach = POSITIVE.check("reach of release forces [mm]", reach)

    def set_up(self, scene: SceneFacts) -> None:
        dofs = scene.blank.V.dofmap.index_map.size_local * scene.blank.mesh.geometry.dim
        self._u = scene.blank.u.x.array[:dofs]
        self.set_load(0.0)
        self.take(np.zeros(dofs))

    def take(self, forces: np.ndarray) -> None:
        """Take forces (owned dofs,) [N] from here on, in the present state, on all ranks."""
        self._forces, self._start = forces.copy(), self._u.copy()
        nodes = self.blank.V.dofmap.index_map.size_global
        self._stiffness = self._whole() / (nodes * self.reach)
        self._work, self._released = Work(), 0.0  # done on the forces up to the accepted state
        self.accept()

    def check_start(self) -> None:
        """Raise InputError if the sheet was moved since the forces were taken."""
        if self.blank.mesh.comm.allreduce(not np.array_equal(self._u, self._start), MPI.LOR):
            raise InputError(
                "the sheets moved after their unloading was set up; set it up again and run it "
                "directly"
            )

    def springback(self) -> np.ndarray:
        """Motion since the forces were taken, along the frame's axes, (owned nodes, gdim) [mm]."""
        return (self._u - self._start).reshape(-1, self.blank.mesh.geometry.dim)

    def remaining(self) -> float:
        """Sizes of the forces that are left, added up on all ranks [N]."""
        return self._now * self._whole()

    def _whole(self):
        sizes = np.linalg.norm(self._forces.reshape(-1, self.blank.mesh.geometry.dim), axis=1)
        return self.blank.mesh.comm.allreduce(float(sizes.sum()))

    def _size(self, load):
        # a sheet gets soft as the forces go that keep it tight
        return max(1.0 - load / self.NO_FORCES_FROM, 0.0) ** 6

    def accept(self) -> None:
        if self._work.memory()[:, 0].any():
            self._released -= self._since_accepted()
        super().accept()

    def energies(self) -> dict[str | None, float]:
        """As in `Term`: their potential, and what was released up to the present state."""
        released = self._released - self._since_accepted()
        released *= self.blank.mesh.comm.rank == 0  # known to all
        return {None: self.stored() - released, RELEASED: released}

    def add_forces(self, f: np.ndarray) -> None:
        bed = self._stiffness * (self._u - self._start)
        f[: len(self._forces)] -= self._now * (self._forces - bed)

    def tangent(self) -> Triplets:
        first = self.blank.V.dofmap.index_map.local_range[0] * self.blank.mesh.geometry.dim
        dofs = (first + np.arange(len(self._u))).astype(PETSc.IntType)
        return dofs, dofs, np.full(len(dofs), self._now * self._stiffness)

    def applied_forces(self) -> np.ndarray:
        """As in `Term`: those at the start, as in the end no force is left to compare with."""
        return self._forces

    def memory(self) -> dict[str, np.ndarray]:
        """Work done, the same row at each node (nodes, k), and the nodes' start."""
        start = self._start.reshape(-1, self.blank.mesh.geometry.dim)
        work = np.tile(np.append(self._work.memory(), self._released), (len(start), 1))
        return {"work": work, "start": start}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        firsts = self.blank.mesh.comm.allgather(memory["work"][:1])
        *work, self._released = next(row[0].tolist() for row in firsts if len(row))
        self._work.recall(np.reshape(work, (-1, 4)))
        self._start = memory["start"].ravel().copy()

    def nodal_fields(self) -> dict[str, Value]:
        return {"springback": Value(self.springback() @ self.blank.frame, "mm")}

    def _travel(self):
        """Work of this rank's forces, less that of the springs [N mm]."""
        moved = self._u - self._start
        return float((self._forces - self._stiffness / 2 * moved) @ moved)

    def _since_accepted(self):
        """Work of the forces since the last accepted state, of all ranks [N mm]."""
        work = self._work.since(*self._state())
        gone = not self._now and self._work.memory()[:, 1].max() >= self.NO_FORCES_FROM
        return 0.0 if gone else work  # as a parabola through states with forces is not
