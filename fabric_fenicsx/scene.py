"""A scene: a blank, the terms that store or take energy in it, and its supports."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc

from . import dolfinx_compat as compat
from .blank import Blank
from .errors import InputError
from .mechanics.work import Work
from .timing import phase


@dataclass(frozen=True)
class Support:
    """Prescribed displacement of some nodes along the axes of the blank's frame.

    where: function of points (3, n) [mm] to a mask (n,); components: the axes held; value: displacement at full
    load (gdim,) [mm], growing with the load factor, or a function of points (3, n) and load factor to (gdim, n).
    """

    name: str
    where: Callable[[np.ndarray], np.ndarray]
    components: tuple[int, ...]
    value: Sequence[float] | Callable[[np.ndarray, float], np.ndarray] = (0.0, 0.0, 0.0)


def grips(blank: Blank, stroke: float, clamped: bool = True) -> list[Support]:
    """Supports of a strip pulled by `stroke` [mm] along the frame's first axis: clamps at its ends, or rollers with
    one corner held. Raises InputError if an end is not straight, over half the strip's width or more."""
    low, high = blank.extent()
    x, comm = blank.along(blank.coordinates().T), blank.mesh.comm
    for name, position in (("low", low[0]), ("high", high[0])):
        at_end = x[1][np.abs(x[0] - position) <= 1e-6 * (high - low).max()]
        held = comm.allreduce(at_end.max(initial=-np.inf), MPI.MAX) - comm.allreduce(
            at_end.min(initial=np.inf), MPI.MIN
        )
        if held < 0.5 * (high - low)[1]:
            raise InputError(
                f"the {name} end of {blank.name} along its length can be gripped over {held:.4g} of {(high - low)[1]:.4g} mm only; allowed is a straight end, half the width or more"
            )
    near = 1e-6 * (high - low).max()
    components = tuple(range(len(low))) if clamped else (0, *range(2, len(low)))

    def end(position):
        return lambda x: np.abs(blank.along(x)[0] - position) <= near

    supports = [
        Support("fixed grip", end(low[0]), components),
        Support("moving grip", end(high[0]), components, (stroke, 0.0, 0.0)),
    ]
    if not clamped:
        corner = low[:2, None]
        supports.append(Support("corner", lambda x: (np.abs(blank.along(x)[:2] - corner) <= near).all(0), (1,)))
    return supports


def edge_of(blank: Blank) -> Callable[[np.ndarray], np.ndarray]:
    """Function of points (3, n) to whether they lie on the edge of a rectangular blank, (n,)."""
    low, high = (corner[:2, None] for corner in blank.extent())
    near = 1e-6 * (high - low).max()

    def edge(x):
        x = blank.along(x)[:2]
        return (np.minimum(np.abs(x - low), np.abs(x - high)) <= near).any(0)

    return edge


def framed(blank: Blank, deformation: Callable[[float], np.ndarray]) -> list[Support]:
    """Support of a rectangle's whole edge in a rigid frame; deformation: function of the load factor to F (2, 2)."""
    corner = blank.extent()[0]

    def value(x, load):
        x = blank.along(x)
        moved = np.zeros_like(x)
        moved[:2] = (deformation(load) - np.eye(2)) @ (x[:2] - corner[:2, None])
        return moved

    return [Support("frame", edge_of(blank), tuple(range(len(corner))), value)]


def pulled(stroke: float) -> "Callable[[Scene, float], tuple[float, float]]":
    """Function of a scene with `grips` and its load factor to the moving grip's displacement [mm] and reaction [N]."""
    return lambda scene, load: (load * stroke, float(scene.reaction("moving grip")[0]))


def _wall(blank):
    """Area of the cells that a plane displacement turns inside out: the law, in invariants of C alone, can't see it."""
    J = ufl.det(ufl.Identity(2) + ufl.grad(blank.displacement))
    degree = 1 if compat.is_affine(blank.mesh) and blank.degree == 1 else 4
    return ufl.conditional(ufl.gt(J, 0), 0.0, 1.0) * ufl.Measure(
        "dx", blank.mesh, metadata={"quadrature_degree": degree}
    )


def _variations(term, u, v, w):
    """First and second variation of a term's energy: its own if it has them, else UFL's."""
    if hasattr(term, "variations"):
        return term.variations(v, w)
    residual = ufl.derivative(term.energy, u, v)
    return residual, ufl.derivative(residual, u, w)


class Term(Protocol):
    """What a scene calls for of any term; what else a term may have, see `Scene`."""

    @property
    def name(self) -> str:
        """What summaries call it."""

    @property
    def energy_kind(self) -> str | None:
        """Under which name its energy is added up; None of loads, which store none."""


class FormTerm(Term, Protocol):
    """A term that is a UFL form."""

    @property
    def energy(self) -> ufl.Form:
        """Energy over the blank, or minus the work of a load, in `blank.u` [N mm]."""


class DiscreteTerm(Term, Protocol):
    """A term that is no form; each method speaks of this rank's part."""

    def stored(self) -> float:
        """Energy [N mm]."""

    def add_forces(self, f: np.ndarray) -> None:
        """Add the energy's derivative to f (local degrees of freedom,), ghosts included [N]."""

    def stiffness(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The second derivative as triplets: rows and columns (k,), global degrees of freedom, and values (k,)
        [N/mm]."""


class Scene:
    """Residual, tangent and energy of `terms` on a `blank` with `supports`, at a load factor in [0, 1].

    A term has a `name`, an `energy_kind` (None of loads) and its `energy`, a UFL form in `blank.u` [N mm]; residual and
    tangent are the energy's variations, which a term may write out by `variations(v, w)`. A term that is no form has
    `stored()`, the energy of this rank's part [N mm], `add_forces(f)` to add its derivative to this rank's degrees of
    freedom, ghosts included, and `stiffness()`, the second derivative as triplets (rows, columns, values) of global
    degrees of freedom, the same ones each time. Only the terms given are compiled and assembled.
    A term may also have, all of this rank's part: `potential()` of loads [N mm]; `compliance()`, c and k of a term
    -c c^T / k of the tangent; `pushes()`, forces [N] that a residual is to be small beside; `at(load)`, which also takes
    it back to the last accepted state; `revise()`, whether what it held during a solve had to change so that it must be
    repeated; `work()` done by it since the last accepted state [N mm]; `accept()` to take the present state as that;
    `memory()`, arrays (owned nodes, k) that such states leave, and `recall(memory)`; `holds`, the rigid motions ("move",
    "turn") that it may resist.
    """

    INVERTED = 1e30  # the energy told where a cell is turned inside out
    PINCH = 1e-3  # of forces that cancel in a node, by which residuals of an unloaded sheet are measured

    def __init__(self, blank: Blank, terms: Iterable[Term], supports: Iterable[Support] = ()) -> None:
        self.blank, self.terms, self.supports = blank, list(terms), list(supports)
        self.comm = blank.mesh.comm
        V, u = blank.V, blank.u
        self.u = compat.petsc_vector(u)
        v, w = ufl.TestFunction(V), ufl.TrialFunction(V)
        self._forms: list[Any] = [term for term in self.terms if hasattr(term, "energy")]
        self._discrete: list[Any] = [term for term in self.terms if not hasattr(term, "energy")]
        self._stiff = self._having("stiffness")
        if not self._forms:
            raise InputError(
                f"the scene of {blank.name} has no elastic term; allowed is a membrane, or another with an energy"
            )
        residuals, tangents = zip(*(_variations(term, u, v, w) for term in self._forms))
        self._residual = compat.form(sum(residuals[1:], residuals[0]))
        self._tangent = compat.form(sum(tangents[1:], tangents[0]))
        self._energies = [compat.form(term.energy) for term in self._forms]
        self._inverted = compat.form(_wall(blank)) if blank.mesh.geometry.dim == 2 else None
        self._supported()
        # a viscous drag [N/mm] on the nodes' way from `origin`
        self.drag, self.origin = 0.0, None
        self.support_work = Work()
        self._f = self.u.duplicate()
        self._free = self.u.duplicate()
        self._free.set(1.0)
        self._free.array[self.held] = 0.0

    def _supported(self):
        """Degrees of freedom held by the supports, and DOLFINx's view of them."""
        V, gdim = self.blank.V, self.blank.mesh.geometry.dim
        x = self.blank.coordinates()
        owned = V.dofmap.index_map.size_local
        self.dofs_of: dict[str, np.ndarray] = {}
        self._nodes: list[np.ndarray] = []
        held = np.zeros(len(x) * gdim, dtype=bool)
        for support in self.supports:
            nodes = np.flatnonzero(support.where(x.T))
            if self.comm.allreduce(int((nodes < owned).sum())) == 0:
                raise InputError(f"support {support.name} holds no node of {self.blank.name}; allowed are 1 or more")
            self._nodes.append(nodes)
            held[nodes[:, None] * gdim + np.asarray(support.components)] = True
            self.dofs_of[support.name] = nodes[nodes < owned, None] * gdim + np.arange(gdim)
        dofs = np.flatnonzero(held).astype(np.int32)
        zero = PETSc.ScalarType(0)
        self._bcs = [fem.dirichletbc(zero, dofs[dofs % gdim == i], V.sub(i)) for i in range(gdim)]
        self.held = dofs[dofs < owned * gdim]

    def check_held(self) -> None:
        """Raise InputError, naming the motion, if the supports let the blank move as a rigid body."""
        gdim = self.blank.mesh.geometry.dim
        node, axis = np.divmod(self.held, gdim)
        low, high = (corner[:, None] for corner in self.blank.extent())
        x = (self.blank.along(self.blank.coordinates()[node].T) - (low + high) / 2) / (high - low).max()
        turns = [(0, 1)] if gdim == 2 else [(1, 2), (2, 0), (0, 1)]
        moves = [1.0 * (axis == i) for i in range(gdim)]
        held = np.array(moves + [x[i] * (axis == j) - x[j] * (axis == i) for i, j in turns])
        stiffness, motions = np.linalg.eigh(self.comm.allreduce(held @ held.T, MPI.SUM))
        if stiffness[0] > 1e-9 * max(stiffness[-1], 1.0):
            return
        names = [f"move along its {axis}" for axis in ("length", "width", "normal")[:gdim]]
        names += [f"turn about its {axis}" for axis in (("normal",) if gdim == 2 else ("length", "width", "normal"))]
        free = names[np.abs(motions[:, 0]).argmax()]
        if any(free.split()[0] in getattr(term, "holds", ()) for term in self.terms):
            return
        supports = ", ".join(support.name for support in self.supports) or "none"
        raise InputError(
            f"the supports ({supports}) leave {self.blank.name} free to {free}; allowed are supports that hold it against every rigid motion"
        )

    def _having(self, method: str) -> list[Any]:
        return [term for term in self.terms if hasattr(term, method)]

    def contacts(self) -> list[Any]:
        """The terms that tell how deep a tool reaches into the sheet."""
        return self._having("deepest")

    def at(self, load: float) -> None:
        """Set the load factor of the terms that depend on it, and take them back to the last accepted state."""
        for term in self._having("at"):
            term.at(load)

    def accept(self) -> None:
        """Let the terms that remember take the present state as the last one."""
        for term in self._having("accept"):
            term.accept()

    def revise(self) -> bool:
        """Let terms change what they held during a solve; whether any did, on all ranks."""
        return any([term.revise() for term in self._having("revise")])

    def work(self) -> float:
        """Work of the terms' loads and tools since the last accepted state [N mm]."""
        return self.comm.allreduce(sum(term.work() for term in self._having("work")))

    def memory(self) -> dict[str, np.ndarray]:
        """What accepted states left in the terms and the supports, {name: array (owned nodes, k)}."""
        memory = {f"{i} {key}": v for i, term in enumerate(self._having("memory")) for key, v in term.memory().items()}
        states = self.support_work.memory()
        nodal = np.zeros((self._f.local_size, len(states), 4))  # of each state: whether known, load, force and place
        nodal[:, :, :2] = states[:, :2]
        if states.shape[1] > 2:
            nodal[self.held, :, 2:] = states[:, 2:].reshape(len(states), 2, -1).transpose(2, 0, 1)
        return memory | {"supports": nodal.reshape(-1, 4 * len(states) * self.blank.mesh.geometry.dim)}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Give terms and supports back their `memory`, of the present displacement and load."""
        for i, term in enumerate(self._having("memory")):
            term.recall({key: memory[f"{i} {key}"] for key in term.memory()})
        states = len(self.support_work.memory())
        nodal = memory["supports"].reshape(-1, states, 4)
        known = nodal[:, :, :2].max(0, initial=0.0)
        self.comm.Allreduce(MPI.IN_PLACE, known, MPI.MAX)  # a rank may have no node
        self.support_work.recall(np.hstack([known, nodal[self.held, :, 2:].transpose(1, 2, 0).reshape(states, -1)]))

    def held_values(self, load: float) -> np.ndarray:
        """Displacements of this rank's held degrees of freedom at a load factor, along the frame's axes, (held,)
        [mm]."""
        x, gdim = self.blank.coordinates(), self.blank.mesh.geometry.dim
        values = np.zeros(x.shape[0] * gdim)
        for support, nodes in zip(self.supports, self._nodes):
            value = (
                support.value(x[nodes].T, load).T
                if callable(support.value)
                else load * np.asarray(support.value, float)
            )
            components = list(support.components)
            values[nodes[:, None] * gdim + np.asarray(components)] = value[..., components]
        return values[self.held]

    def set(self, x: PETSc.Vec) -> None:
        """Make x the displacement [mm]."""
        x.copy(self.u)
        self.u.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)

    def energies(self) -> dict[str, float]:
        """Energy of each kind at the present displacement, {kind: N mm}; loads store none."""
        kinds = self._all_energies()
        kinds.pop(None, None)
        return kinds

    def _all_energies(self):
        """The same with the potential of loads, as None."""
        with phase("assemble"):
            parts = [(term.energy_kind, fem.assemble_scalar(form)) for term, form in zip(self._forms, self._energies)]
            parts += [(term.energy_kind, term.stored()) for term in self._having("stored")]
            parts += [(None, term.potential()) for term in self._having("potential")]
        total = self.comm.allreduce(np.array([value for _, value in parts]), MPI.SUM)
        kinds = dict.fromkeys((kind for kind, _ in parts), 0.0)
        for (kind, _), value in zip(parts, total):
            kinds[kind] += float(value)
        return kinds

    def energy(self) -> float:
        """Energy and potential of loads at the present displacement [N mm], `INVERTED` if a cell is turned inside out."""
        if self._inverted:
            with phase("assemble"):
                wall = fem.assemble_scalar(self._inverted)
            if self.comm.allreduce(wall) > 0:
                return self.INVERTED
        return sum(self._all_energies().values()) + self.drag_energy()

    def drag_energy(self) -> float:
        """Potential of the drag at the present displacement [N mm]."""
        return 0.5 * self.drag * self._dragged().norm() ** 2 if self.drag else 0.0

    def _dragged(self):
        moved = self.u - self.origin
        moved.array[self.held] = 0
        return moved

    def residual(self, r: PETSc.Vec) -> None:
        """Internal forces on the free degrees of freedom into r, zero on the held ones [N]; keeps them all."""
        with phase("assemble"):
            with self._f.localForm() as local:
                local.set(0)
            fem_petsc.assemble_vector(self._f, self._residual)
            if self._discrete:
                with self._f.localForm() as local:
                    for term in self._discrete:
                        term.add_forces(local.array)
            self._f.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            self._f.copy(r)
            r.array[self.held] = 0
            if self.drag:
                r.axpy(self.drag, self._dragged())

    def create_matrix(self) -> PETSc.Mat:
        """Matrix for `tangent`, which tells multigrid the rigid motions."""
        A = fem_petsc.create_matrix(self._tangent)
        if self._stiff:
            names, numbers = A.getLGMap()
            self._extra = self._sparsity(A)
            self._fill_extra()
            fem_petsc.assemble_matrix(A, self._tangent)  # as unused places are given up
            A.assemble()
            A.axpy(1.0, self._extra, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            A.setLGMap(names, numbers)
        A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        x = self.u.duplicate()
        x.array[:] = self.blank.along(self.blank.coordinates().T).T.ravel()[: x.local_size]
        A.setNearNullSpace(PETSc.NullSpace().createRigidBody(x))
        return A

    def tangent(self, A: PETSc.Mat, held: bool = True) -> None:
        """Second derivative of the energy into A; unit rows and columns where `held` [N/mm]."""
        with phase("assemble"):
            A.zeroEntries()
            fem_petsc.assemble_matrix(A, self._tangent, bcs=self._bcs if held else [])
            A.assemble()
            if self._stiff:
                self._fill_extra()
                if held:
                    self._extra.diagonalScale(self._free, self._free)
                A.axpy(1.0, self._extra, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            if self.drag:
                A.shift(self.drag)

    def _sparsity(self, A):
        """Empty matrix, of A's sizes, for the stiffness of the terms that are no forms; how their triplets fill it."""
        rows, cols = (np.concatenate(part) for part in zip(*(term.stiffness()[:2] for term in self._stiff)))
        size, (low, high) = A.size[0], A.getOwnershipRange()
        keys, self._entry = np.unique(rows.astype(np.int64) * size + cols, return_inverse=True)
        rows, cols = np.divmod(keys, size)
        rows, counts = np.unique(rows, return_counts=True)
        self._csr = rows.astype(PETSc.IntType), np.append(0, counts.cumsum()).astype(PETSc.IntType), cols.astype(PETSc.IntType)  # fmt: skip
        room = np.full(high - low, counts.max(initial=0), dtype=PETSc.IntType)  # as ranks add to others' rows
        extra = PETSc.Mat().create(self.comm)
        extra.setSizes(A.getSizes())
        extra.setType("aij")
        extra.setPreallocationNNZ((np.minimum(room, high - low), room))
        extra.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        return extra

    def _fill_extra(self):
        values = np.concatenate([term.stiffness()[2] for term in self._stiff])
        rows, starts, cols = self._csr
        summed = np.bincount(self._entry, values, len(cols))
        self._extra.zeroEntries()
        self._extra.setValuesIJV(starts, cols, summed, addv=PETSc.InsertMode.ADD, rowmap=rows)
        self._extra.assemble()

    def anticipate(self) -> None:
        """Let terms see the present residual before the tangent for the next correction is asked, after `residual`."""
        for term in self._having("anticipate"):
            term.anticipate(self._f.array)

    def held_forces(self) -> np.ndarray:
        """Forces of the supports on this rank's held degrees of freedom, after `residual`, (held,) [N]."""
        return self._f.array[self.held].copy()

    def force_scale(self) -> float:
        """Norm of the nodal forces that the sheet bears from supports, loads and tools after `residual`, what a residual is
        measured by [N]. Forces that meet in a node, as under a blank holder, cancel, but for `PINCH` of them."""
        net, pinch = np.zeros(self._f.local_size), 0.0
        for term in self._having("pushes"):
            given = term.pushes().ravel()
            net[: given.size] += given
            pinch += float((given**2).sum())
        net[self.held] = self._f.array[self.held]
        return np.sqrt(self.comm.allreduce(float(net @ net) + self.PINCH**2 * pinch))

    def compliances(self) -> list[tuple[PETSc.Vec, float]]:
        """Vectors c and numbers k [N/mm] of what tools moved by force take from the tangent, c c^T / k each."""
        found = []
        for term in self._having("compliance"):
            given = term.compliance()
            if given and given[1] > 0:
                c = self.u.duplicate()
                c.set(0.0)
                c.array[: given[0].size] = given[0].ravel()
                c.array[self.held] = 0
                found.append((c, given[1]))
        return found

    def virial(self) -> np.ndarray:
        """Sum over the nodes of force times undeformed position along the frame's axes, (gdim, gdim) [N mm].

        In equilibrium it is the first Piola-Kirchhoff stress integrated over the blank's volume.
        """
        owned, gdim = self.blank.V.dofmap.index_map.size_local, self.blank.mesh.geometry.dim
        forces = self._f.array.reshape(-1, gdim)[:owned]
        return self.comm.allreduce(forces.T @ self.blank.along(self.blank.coordinates()[:owned].T).T, MPI.SUM)

    def reaction(self, name: str) -> np.ndarray:
        """Force of support `name` on the blank along the axes of the frame, (gdim,), after `residual` [N].

        Raises InputError if there is no support of that name.
        """
        if name not in self.dofs_of:
            raise InputError(f"support {name!r} is not of this scene; allowed are {', '.join(self.dofs_of)}")
        return self.comm.allreduce(self._f.array[self.dofs_of[name]].sum(0), MPI.SUM)
