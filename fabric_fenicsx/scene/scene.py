"""A scene: a blank, the terms that store or take energy in it, and its supports."""

from collections.abc import Collection, Iterable
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..mechanics.assembly import Assembly
from ..mechanics.reports import Fields, arrays, told
from ..mechanics.roles import (
    Anticipates,
    DrivenByForce,
    Lagged,
    LooselyLagged,
    Penetrated,
    Pressing,
    Remembers,
    RemembersCells,
    Stretched,
    Touching,
    Warns,
)
from ..mechanics.term import Term
from ..mechanics.term_checks import bind, check_answers, check_number
from ..mechanics.work import Work
from ..runtime.errors import InputError
from ..runtime.timing import phase
from ..sheets.blank import Blank
from ..tools.tool import Tool
from .supports import Supports, check_held, locating_warning

OF_CELLS = "cells "  # before the names of what terms remember of cells
# what every sheet and every summary has without terms
OF_A_SHEET = "u", "yarn_coordinate_a", "yarn_coordinate_b", "rank", "part"
OF_A_SUMMARY = (
    *("study", "ranks", "converged", "stroke_reached", "reason", "element", "dofs", "cells"),
    *("terms", "steps_accepted", "steps_rejected", "newton_iterations", "energy", "reaction_N"),
    *("energy_imbalance", "energy_imbalance_largest", "branches", "quantities", "error"),
    *("warnings", "wall_s", "peak_memory_mib", "versions"),
)


class Scene:
    """Residual, tangent and energy of `terms` on a `blank` with `supports`, at a load factor in
    [0, 1].

    terms: binds each to this scene; all that is known of them is what `Term` says. Only those given
    are compiled and assembled. supports: a list, or a function of the blank that makes one.
    Raises InputError without an elastic term, for a term of another scene, and for a support that
    holds no node.
    """

    INVERTED = 1e30  # the energy told where a cell is turned inside out
    # of forces that cancel in a node, by which residuals of an unloaded sheet are measured
    PINCH = 1e-3

    def __init__(self, blank: Blank, terms: Iterable[Term], supports: Supports = ()) -> None:
        self.blank, self.terms = blank, list(terms)
        self.supports = list(supports(blank) if callable(supports) else supports)
        self.comm = blank.mesh.comm
        for term in self.terms:
            bind(term, self)
        self.u = compat.petsc_vector(blank.u)
        if not any(term.energy or "stretch" in term.resists for term in self.terms):
            raise InputError(
                f"the scene of {blank.name} has no elastic term; allowed is a membrane or the like"
            )
        self._assembly = Assembly(blank, self.terms)
        self._lagged = [term for term in self.terms if isinstance(term, Lagged)]
        self._anticipating = [term for term in self.terms if isinstance(term, Anticipates)]
        self._driven = [term for term in self.terms if isinstance(term, DrivenByForce)]
        self._checked = False
        self._inverted = (
            compat.form(blank.inverted_area()) if blank.mesh.geometry.dim == 2 else None
        )
        self._supported()
        # a viscous drag [N/mm] on the nodes' displacement since `origin`
        self.drag, self.origin = 0.0, None
        self.support_work = Work()
        self._f, self._free = self.u.duplicate(), self.u.duplicate()
        self._free.set(1.0)
        self._free.array[self.held] = 0.0

    def _supported(self):
        """Degrees of freedom held by the supports, and DOLFINx's view of them."""
        blank, V, gdim = self.blank, self.blank.V, self.blank.mesh.geometry.dim
        x = blank.coordinates()
        owned = V.dofmap.index_map.size_local
        self.dofs_of: dict[str, np.ndarray] = {}
        self._nodes: list[np.ndarray] = []
        held = np.zeros(len(x) * gdim, dtype=bool)
        for support in self.supports:
            if not set(support.components) <= set(range(gdim)):
                raise InputError(
                    f"support {support.name} holds the components {tuple(support.components)} of "
                    f"{blank.name}; allowed are those from 0 to {gdim - 1}"
                    + (", or 2 on a blank made with `spatial=True`" if gdim == 2 else "")
                )
            nodes = np.flatnonzero(support.where(x.T))
            if self.comm.allreduce(int((nodes < owned).sum())) == 0:
                raise InputError(
                    f"support {support.name} holds no node of {blank.name}; allowed are 1 or more"
                )
            self._nodes.append(nodes)
            held[nodes[:, None] * gdim + np.asarray(support.components)] = True
            self.dofs_of[support.name] = nodes[nodes < owned, None] * gdim + np.arange(gdim)
        dofs = np.flatnonzero(held).astype(np.int32)
        zero = PETSc.ScalarType(0)
        self._bcs = [fem.dirichletbc(zero, dofs[dofs % gdim == i], V.sub(i)) for i in range(gdim)]
        self.held = dofs[dofs < owned * gdim]

    def check_held(self) -> str:
        """Raise InputError, naming the motion, if the scene lets the blank move as a rigid body; a
        sentence to warn with if only the shapes of tools may hold it, else ""."""
        return check_held(self)

    def check_start(self) -> None:
        """Raise InputError if the scene can't begin: as `check_held`, as terms of tools do, and
        for terms that do not answer as they should."""
        self.check_held()
        for term in self.terms:
            if isinstance(term, Touching):
                term.check_start()
        if not self._checked:
            self.at(0.0)
            self.accept()
            for term in self.terms:
                check_answers(term)
                check_number(term, "work", term.work())
            self._checked = True

    def at(self, load: float) -> None:
        """Set the load factor, and take the terms back to the last accepted state in all else."""
        for term in self.terms:
            term.set_load(load)

    def accept(self) -> None:
        """Let the terms take the present state as the last accepted one."""
        for term in self.terms:
            term.accept()

    def update_lagged(self) -> bool:
        """Let terms update what they held during a solve; whether any did, on all ranks."""
        return any([term.update_lagged() for term in self._lagged])

    @property
    def rough(self) -> float:
        """The largest `loose_tolerance` of the terms."""
        found = [each.loose_tolerance for each in self.terms if isinstance(each, LooselyLagged)]
        return max(found, default=0.0)

    def work(self) -> float:
        """Work of the terms' loads and tools since the last accepted state [N mm]."""
        return self.comm.allreduce(sum(term.work() for term in self.terms))

    def memory(self) -> dict[str, np.ndarray]:
        """What accepted states left in terms and supports, {name: array (owned nodes, k)}, or
        (owned cells, k) where the name begins with `OF_CELLS`."""
        memory: dict[str, np.ndarray] = {}
        for i, term in enumerate(self.terms):
            memory |= {f"{i} {key}": values for key, values in _nodal_memory(term).items()}
            memory |= {f"{OF_CELLS}{i} {key}": v for key, v in _cell_memory(term).items()}
        states = self.support_work.memory()
        # of each state: whether known, load, force and place
        nodal = np.zeros((self._f.local_size, len(states), 4))
        nodal[:, :, :2] = states[:, :2]
        if states.shape[1] > 2:
            nodal[self.held, :, 2:] = states[:, 2:].reshape(len(states), 2, -1).transpose(2, 0, 1)
        return memory | {
            "supports": nodal.reshape(-1, 4 * len(states) * self.blank.mesh.geometry.dim)
        }

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Give terms and supports back their `memory`, of the present displacement and load."""
        for i, term in enumerate(self.terms):
            given = {key: memory[f"{i} {key}"] for key in _nodal_memory(term)}
            given |= {key: memory[f"{OF_CELLS}{i} {key}"] for key in _cell_memory(term)}
            if isinstance(term, (Remembers, RemembersCells)):
                term.recall(given)
        states = len(self.support_work.memory())
        nodal = memory["supports"].reshape(-1, states, 4)
        known = nodal[:, :, :2].max(0, initial=0.0)
        self.comm.Allreduce(MPI.IN_PLACE, known, MPI.MAX)  # a rank may have no node
        self.support_work.recall(
            np.hstack([known, nodal[self.held, :, 2:].transpose(1, 2, 0).reshape(states, -1)])
        )

    def held_values(self, load: float) -> np.ndarray:
        """Displacements of this rank's held degrees of freedom at a load factor, along the frame's
        axes, (held,) [mm]."""
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

    @phase("assemble")
    def energies(self) -> dict[str, float]:
        """Energy of each kind at the present displacement, {kind: N mm}; loads store none."""
        return {k: energy for k, energy in self._assembly.energies().items() if k is not None}

    @phase("assemble")
    def energy(self) -> float:
        """Energy and potential of loads at the present displacement [N mm], `INVERTED` if a cell is
        turned inside out."""
        if self._inverted and self.comm.allreduce(fem.assemble_scalar(self._inverted)) > 0:
            return self.INVERTED
        return sum(self._assembly.energies().values()) + self.drag_energy()

    def drag_energy(self) -> float:
        """Potential of the drag at the present displacement [N mm]."""
        return 0.5 * self.drag * self._dragged().norm() ** 2 if self.drag else 0.0

    def _dragged(self):
        moved = self.u - self.origin
        moved.array[self.held] = 0
        return moved

    def residual(self, r: PETSc.Vec) -> None:
        """Internal forces on the free degrees of freedom into r, zero on the held ones [N]; keeps
        them all."""
        with phase("assemble"):
            self._assembly.residual(self._f)
            self._f.copy(r)
            r.array[self.held] = 0
            if self.drag:
                r.axpy(self.drag, self._dragged())

    def create_matrix(self) -> PETSc.Mat:
        """Matrix for `tangent`, which tells multigrid the rigid motions."""
        A = self._assembly.create_matrix()
        x = self.u.duplicate()
        x.array[:] = self.blank.along(self.blank.coordinates().T).T.ravel()[: x.local_size]
        A.setNearNullSpace(PETSc.NullSpace().createRigidBody(x))
        return A

    def tangent(self, A: PETSc.Mat, held: bool = True) -> None:
        """Second derivative of the energy into A; unit rows and columns where `held` [N/mm]."""
        given = (self._bcs, self._free) if held else ()
        with phase("assemble"):
            self._assembly.tangent(A, *given)
            if self.drag:
                A.shift(self.drag)

    def fits(self) -> bool:
        """Whether the matrix made last has the places of the present `tangent`, on all ranks."""
        return self._assembly.fits()

    def anticipate(self) -> None:
        """After `residual`: let terms see it before the tangent for the next correction."""
        for term in self._anticipating:
            term.anticipate(self._f.array)

    def held_forces(self) -> np.ndarray:
        """Forces of the supports on this rank's held degrees of freedom, after `residual`
        (held,) [N]."""
        return self._f.array[self.held].copy()

    def force_scale(self) -> float:
        """After `residual`: norm of the nodal forces that the sheet bears from supports, loads and
        tools, what a residual is measured by [N]. Forces that meet in a node, as under a blank
        holder, cancel, but for `PINCH` of them."""
        net, pinch = np.zeros(self._f.local_size), 0.0
        for given in self._assembly.applied_forces():
            net[: given.size] += given
            pinch += float((given**2).sum())
        net[self.held] = self._f.array[self.held]
        return np.sqrt(self.comm.allreduce(float(net @ net) + self.PINCH**2 * pinch))

    def compliances(self) -> list[tuple[PETSc.Vec, float]]:
        """Vectors c and numbers k [N/mm] of what tools moved by force take from the tangent,
        c c^T / k each."""
        found = []
        for term in self._driven:
            given = term.compliance()
            if given and given[1] > 0:
                c = self.u.duplicate()
                c.set(0.0)
                c.array[: given[0].size] = given[0]
                c.array[self.held] = 0
                found.append((c, given[1]))
        return found

    def virial(self) -> np.ndarray:
        """Sum over the nodes of force times undeformed position along the frame's axes,
        (gdim, gdim) [N mm]: in equilibrium the first Piola-Kirchhoff stress integrated over the
        blank's volume."""
        owned, gdim = self.blank.V.dofmap.index_map.size_local, self.blank.mesh.geometry.dim
        forces = self._f.array.reshape(-1, gdim)[:owned]
        return self.comm.allreduce(
            forces.T @ self.blank.along(self.blank.coordinates()[:owned].T).T, MPI.SUM
        )

    def reaction(self, name: str) -> np.ndarray:
        """Force of support `name` on the blank along the axes of the frame, (gdim,), after
        `residual` [N].

        Raises InputError if there is no support of that name.
        """
        if name not in self.dofs_of:
            raise InputError(
                f"support {name!r} is not of this scene; allowed are {', '.join(self.dofs_of)}"
            )
        return self.comm.allreduce(self._f.array[self.dofs_of[name]].sum(0), MPI.SUM)

    def outer_forces(self) -> dict[str, float]:
        """Sizes of nodal forces added up, after `residual`: of supports, and "" of all else [N]."""
        sizes = {name: abs(self._f.array[dofs]).sum() for name, dofs in self.dofs_of.items()}
        sizes[""] = sum(abs(given).sum() for given in self._assembly.applied_forces())
        return {name: self.comm.allreduce(float(size)) for name, size in sizes.items()}

    # -- results

    def tools(self) -> list[Tool]:
        """The tools whose surface the sheet may touch."""
        return list(dict.fromkeys(term.tool for term in self.terms if isinstance(term, Touching)))

    def tool_force(self, tool: Tool) -> np.ndarray:
        """Force of `tool` on the sheet in the last accepted state, (3,) [N]."""
        pressing = [term for term in self.terms if isinstance(term, Pressing)]
        return sum((term.tool_force() for term in pressing if term.tool is tool), np.zeros(3))

    def history(self, taken: Collection[str] = ()) -> dict[str, Any]:
        """What the terms add to the present state's row of history.csv, beside the columns
        `taken`."""
        return {name: each.value for name, each in told(self.terms, "history", taken).items()}

    def summary(self) -> dict[str, Any]:
        """What the terms say of themselves and the present state in summary.json."""
        given = told(self.terms, "summary", OF_A_SUMMARY)
        return {"terms": [t.name for t in self.terms]} | {k: v.value for k, v in given.items()}

    def cell_fields(self) -> Fields:
        """Fields of the present state on this rank's owned cells, (cells, ...)."""
        return Fields(told(self.terms, "cell_fields", OF_A_SHEET))

    def nodal_fields(self) -> Fields:
        """Fields of the present state at this rank's nodes, ghosts too, (nodes, ...)."""
        fields = Fields(told(self.terms, "nodal_fields", OF_A_SHEET))
        for name, values in fields.items():
            fields[name] = self.blank.with_ghosts(values)
        return fields

    def deepest(self) -> tuple[float, str]:
        """How deep a tool or another sheet was in a sheet in any accepted state, over the sheet's
        thickness, and in words which one and where."""
        terms = [term for term in self.terms if isinstance(term, Penetrated)]
        depths = [term.penetration_of_thickness() for term in terms]
        if not any(depths):
            return 0.0, ""
        i = int(np.argmax(depths))
        return depths[i], terms[i].where_deepest()

    def overstretched(self, strain: float) -> float:
        """Share of the sheet's area, 0 to 1, in which yarns are stretched by more than `strain`."""
        terms = [term for term in self.terms if isinstance(term, Stretched)]
        return max((term.overstretched(strain) for term in terms), default=0.0)

    def warnings(self) -> list[str]:
        """What speaks against the present state though nothing failed, in words."""
        given = [term.warnings() for term in self.terms if isinstance(term, Warns)]
        found = [text for each in given for text in ([each] if isinstance(each, str) else each)]
        return found + [text for text in [locating_warning(self)] if text]


def _nodal_memory(term: Any) -> dict[str, np.ndarray]:
    own = isinstance(term, Remembers)
    return arrays(term, "memory", term.memory()) if own else {}


def _cell_memory(term: Any) -> dict[str, np.ndarray]:
    own = isinstance(term, RemembersCells)
    return arrays(term, "cell_memory", term.cell_memory()) if own else {}
