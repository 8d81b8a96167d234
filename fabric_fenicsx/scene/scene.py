"""A scene: a blank, the terms that store or take energy in it, and its supports."""

from collections.abc import Callable, Collection, Iterable
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..material.laws import Law
from ..material.laws.base import Material
from ..mechanics.assembly import Assembly
from ..mechanics.term import Term
from ..mechanics.term_checks import check_kind, one_number
from ..mechanics.told import OF_A_SHEET, OF_A_SUMMARY, check_arrays, told_by
from ..mechanics.work import Work
from ..runtime.errors import InputError
from ..runtime.timing import phase
from ..sheets.blank import Blank, Part
from ..tools.tool import Tool
from .supports import Supports, check_held, locating_warning

OF_CELLS = "cells "  # before the names of what terms remember of cells


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
            check_kind(term)
            term.bind(self)
        self.u = compat.petsc_vector(blank.u)
        forms = [term for term in self.terms if term.energy is not None]
        if not forms and not any("stretch" in term.resists for term in self.terms):
            raise InputError(
                f"the scene of {blank.name} has no elastic term; allowed is a membrane or the like"
            )
        self._assembly = Assembly(blank, self.terms)
        self._energies = [(term.energy_kind, compat.form(term.energy)) for term in forms]
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

    @property
    def fabric(self) -> Law | None:
        """What the sheet is made of, if one of the terms knows; of several the first."""
        return next((term.fabric for term in self.terms if term.fabric is not None), None)

    def fabric_of(self, part: Part) -> Law | None:
        """The fabric of a part of the blank, if a term on it, or on all of the blank, knows."""
        return next((term.fabric for term in self._on(part) if term.fabric is not None), None)

    def material_of(self, part: Part) -> Material | None:
        """The same of a part of fabric or of metal."""
        return next((term.made_of for term in self._on(part) if term.made_of is not None), None)

    def _on(self, part):
        """The terms that are on a part, or on all of the blank; of the whole blank all."""
        if part.is_whole:
            return self.terms
        here = part, self.blank.whole
        return [term for term in self.terms if self.blank.part(term.part_name) in here]

    def at_nodes(self, of: Callable[[Material], float]) -> float | np.ndarray | None:
        """A number of the material: one, or where parts differ one for each owned node (nodes,);
        None if it is not known of each part."""
        parts = list(self.blank.parts.values()) or [self.blank.whole]
        materials = [self.material_of(part) for part in parts]
        if not all(materials):
            return None
        numbers = [of(material) for material in materials if material]
        if len(set(numbers)) == 1:
            return numbers[0]
        found = np.zeros(self.blank.V.dofmap.index_map.size_local)
        for part, number in zip(parts, numbers):
            found[part.nodes] = number
        return found

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
        """Raise InputError if the scene can't begin: as `check_held`, and as its terms do."""
        self.check_held()
        for term in self.terms:
            term.check_start()

    def at(self, load: float) -> None:
        """Set the load factor, and take the terms back to the last accepted state in all else."""
        for term in self.terms:
            term.at(load)

    def accept(self) -> None:
        """Let the terms take the present state as the last accepted one."""
        for term in self.terms:
            term.accept()

    def update_lagged(self) -> bool:
        """Let terms update what they held during a solve; whether any did, on all ranks."""
        return any([term.update_lagged() for term in self.terms])

    @property
    def rough(self) -> float:
        """The largest `rough` of the terms."""
        return max((term.rough for term in self.terms), default=0.0)

    def work(self) -> float:
        """Work of the terms' loads and tools since the last accepted state [N mm]."""
        return self.comm.allreduce(sum(one_number(term, "work") for term in self.terms))

    def memory(self) -> dict[str, np.ndarray]:
        """What accepted states left in terms and supports, {name: array (owned nodes, k)}, or
        (owned cells, k) where the name begins with `OF_CELLS`."""
        memory: dict[str, np.ndarray] = {}
        for i, term in enumerate(self.terms):
            for method, of in (("memory", ""), ("cell_memory", OF_CELLS)):
                given = getattr(term, method)()
                check_arrays(term, method, given)
                memory |= {f"{of}{i} {key}": values for key, values in given.items()}
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
            given = {key: memory[f"{i} {key}"] for key in term.memory()}
            term.recall(given | {key: memory[f"{OF_CELLS}{i} {key}"] for key in term.cell_memory()})
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

    def energies(self) -> dict[str, float]:
        """Energy of each kind at the present displacement, {kind: N mm}; loads store none."""
        kinds = self._all_energies()
        kinds.pop(None, None)
        return kinds

    def _all_energies(self):
        """The same with the potential of loads, as None."""
        with phase("assemble"):
            parts = [(kind, fem.assemble_scalar(form)) for kind, form in self._energies]
            parts += [part for term in self.terms for part in term.stored_by_kind().items()]
            parts += [(None, one_number(term, "potential")) for term in self.terms]
        total = self.comm.allreduce(np.array([value for _, value in parts]), MPI.SUM)
        kinds = dict.fromkeys((kind for kind, _ in parts), 0.0)
        for (kind, _), value in zip(parts, total):
            kinds[kind] += float(value)
        return kinds

    @phase("assemble")
    def energy(self) -> float:
        """Energy and potential of loads at the present displacement [N mm], `INVERTED` if a cell is
        turned inside out."""
        if self._inverted and self.comm.allreduce(fem.assemble_scalar(self._inverted)) > 0:
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
        for term in self.terms:
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
        for term in self.terms:
            given = term.applied_forces()
            net[: given.size] += given
            pinch += float((given**2).sum())
        net[self.held] = self._f.array[self.held]
        return np.sqrt(self.comm.allreduce(float(net @ net) + self.PINCH**2 * pinch))

    def compliances(self) -> list[tuple[PETSc.Vec, float]]:
        """Vectors c and numbers k [N/mm] of what tools moved by force take from the tangent,
        c c^T / k each."""
        found = []
        for term in self.terms:
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
        sizes[""] = sum(abs(term.applied_forces()).sum() for term in self.terms)
        return {name: self.comm.allreduce(float(size)) for name, size in sizes.items()}

    # -- results

    def tools(self) -> list[Tool]:
        """The tools whose surface the sheet may touch."""
        return list(dict.fromkeys(tool for term in self.terms for tool in term.tools()))

    def tool_force(self, tool: Tool) -> np.ndarray:
        """Force of `tool` on the sheet in the last accepted state, (3,) [N]."""
        return sum((term.tool_force(tool) for term in self.terms), np.zeros(3))

    def history(self, taken: Collection[str] = ()) -> dict[str, Any]:
        """What the terms add to the present state's row of history.csv, see `told_by`."""
        return told_by(self.terms, "add_history", taken)

    def summary(self) -> dict[str, Any]:
        """What the terms say of themselves and the present state in summary.json."""
        facts: dict[str, Any] = {"terms": [term.name for term in self.terms]}
        return facts | told_by(self.terms, "add_summary", OF_A_SUMMARY)

    def cell_fields(self) -> dict[str, np.ndarray]:
        """Fields of the present state on this rank's owned cells, {name: array (cells, ...)}."""
        return told_by(self.terms, "add_cell_fields", OF_A_SHEET)

    def nodal_fields(self) -> dict[str, np.ndarray]:
        """Fields of the present state at this rank's nodes, ghosts too, {name: (nodes, ...)}."""
        fields = told_by(self.terms, "add_nodal_fields", OF_A_SHEET)
        return {name: self.blank.with_ghosts(values) for name, values in fields.items()}

    def units(self) -> dict[str, str]:
        """Units of the arrays that terms add to fields, {name: unit}."""
        return {name: unit for term in self.terms for name, unit in term.units.items()}

    def penetration_of_thickness(self) -> float:
        """How deep a tool was in the sheet in any accepted state, over the sheet's thickness."""
        return max((term.penetration_of_thickness() for term in self.terms), default=0.0)

    def where_deepest(self) -> str:
        """In words, what was so deep in the sheet, and where."""
        return max(self.terms, key=lambda term: term.penetration_of_thickness()).where_deepest()

    def overstretched(self, strain: float) -> float:
        """Share of the sheet's area, 0 to 1, in which yarns are stretched by more than `strain`."""
        return max((term.overstretched(strain) for term in self.terms), default=0.0)

    def warnings(self) -> list[str]:
        """What speaks against the present state though nothing failed, in words."""
        given = [term.warnings() for term in self.terms]
        found = [text for each in given for text in ([each] if isinstance(each, str) else each)]
        return found + [text for text in [locating_warning(self)] if text]
