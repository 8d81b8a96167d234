"""A scene: a blank, the terms that store or take energy in it, and its supports."""

from collections.abc import Iterable

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..mechanics.assembly import Assembly
from ..mechanics.output import arrays, asked
from ..mechanics.protocols import Anticipates, DrivenByForce, KeepsGaps, Touching
from ..mechanics.term import Term, overrides
from ..mechanics.term_checks import bind, check_answers, check_number
from ..runtime.errors import InputError
from ..runtime.timing import phase
from ..sheets.blank import Blank
from .dirichlet import HeldDofs
from .rigid_motions import check_held, is_held_by_friction
from .supports import Supports

OF_CELLS = "cells "  # before the names of what terms remember of cells
PLACES = ("", "memory"), (OF_CELLS, "cell_memory")


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
        self.comm = blank.mesh.comm
        for term in self.terms:
            bind(term, self)
        self.u = compat.petsc_vector(blank.u)
        if not any(term.energy is not None or "stretch" in term.resists for term in self.terms):
            raise InputError(
                f"the scene of {blank.name} has no elastic term; allowed is a membrane or the like"
            )
        self._assembly = Assembly(blank, self.terms)
        self._lagged = [term for term in self.terms if overrides(term, "update_lagged")]
        self._anticipating = [term for term in self.terms if isinstance(term, Anticipates)]
        self._keeping = [term for term in self.terms if isinstance(term, KeepsGaps)]
        self._driven = [term for term in self.terms if isinstance(term, DrivenByForce)]
        self._checked = False
        self._held_in_matrix: np.ndarray | None = None
        self.was_loaded = False  # whether a run has left the state that terms and sheet began in
        self._inverted = (
            compat.form(blank.inverted_area()) if blank.mesh.geometry.dim == 2 else None
        )
        self.supports = HeldDofs(blank, supports(blank) if callable(supports) else supports)
        # a viscous drag [N/mm] on the nodes' displacement since `origin`
        self.drag, self.origin = 0.0, None
        self.forces, self._free = self.u.duplicate(), self.u.duplicate()
        self._note_held()

    def _note_held(self):
        self.held = self.supports.dofs
        self._free.set(1.0)
        self._free.array[self.held] = 0.0

    def let_go(self) -> None:
        """Free what supports only locate, if friction holds the sheet in its accepted state."""
        if self.supports.locates and is_held_by_friction(self.blank, self.terms):
            self.supports.let_go()
            self._note_held()

    def check_held(self) -> str:
        """Raise InputError, naming the motion, if the scene lets the blank move as a rigid body; a
        sentence to warn with if only the shapes of tools may hold it, else ""."""
        return check_held(self.blank, self.terms, self.supports)

    def check_start(self) -> None:
        """Raise InputError if the scene can't begin: as `check_held`, as terms of tools do, and
        for terms that do not answer as they should."""
        self.check_held()
        for term in self.terms:
            if isinstance(term, Touching):
                term.check_start()
        if not self._checked:
            self.set_load(0.0)
            self.accept()
            for term in self.terms:
                check_answers(term)
                check_number(term, "work", term.work())
            self.memory()
            self._checked = True

    def set_load(self, load: float) -> None:
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
    def is_lagged(self) -> bool:
        """Whether terms hold something during a solve."""
        return bool(self._lagged)

    def work(self) -> float:
        """Work of the terms' loads and tools since the last accepted state [N mm]."""
        return self.comm.allreduce(sum(term.work() for term in self.terms))

    def memory(self) -> dict[str, np.ndarray]:
        """What accepted states left in terms and supports, {name: array (owned nodes, k)}, or
        (owned cells, k) where the name begins with `OF_CELLS`."""
        return memory_of(self.terms) | {"supports": self.supports.memory()}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Give terms and supports back their `memory`, of the present displacement and load."""
        for i, term in enumerate(self.terms):
            given = {key: memory[f"{place}{i} {key}"] for place, key in _memory(term)}
            if overrides(term, "recall"):
                self._recall(term, given)
        self.supports.recall(memory["supports"])

    def _recall(self, term, given):
        """InputError, on all ranks, if the term's memory is another one then."""
        try:
            term.recall(given)
        except KeyError as error:
            raise InputError(
                f"`recall` of term {term.name} asks for {error}; allowed is what its memory has: "
                f"{', '.join(given)}"
            ) from error
        lost = [
            key
            for (_, key), now in _memory(term).items()
            if not np.allclose(now, given[key], 1e-9, 1e-9 * _largest(given[key]), equal_nan=True)
        ]
        if lost := self.comm.allreduce(lost):
            raise InputError(
                f"`recall` of term {term.name} leaves {lost[0]} other than it was given; allowed "
                "is to take back all that `memory` and `cell_memory` give"
            )

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
            self._assembly.residual(self.forces)
            self.forces.copy(r)
            r.array[self.held] = 0
            if self.drag:
                r.axpy(self.drag, self._dragged())

    def create_matrix(self) -> PETSc.Mat:
        """Matrix for `tangent`, which tells multigrid the rigid motions."""
        A, self._held_in_matrix = self._assembly.create_matrix(), self.held
        x = self.u.duplicate()
        x.array[:] = self.blank.along(self.blank.coordinates().T).T.ravel()[: x.local_size]
        A.setNearNullSpace(PETSc.NullSpace().createRigidBody(x))
        return A

    def tangent(self, A: PETSc.Mat, held: bool = True) -> None:
        """Second derivative of the energy into A; unit rows and columns where `held` [N/mm]."""
        given = (self.supports.bcs, self._free) if held else ()
        with phase("assemble"):
            self._assembly.tangent(A, *given)
            if self.drag:
                A.shift(self.drag)

    @property
    def keeps_gaps(self) -> bool:
        """Whether terms tell a `motion_to_gaps`."""
        return bool(self._keeping)

    def motion_to_gaps(self) -> np.ndarray:
        """Sum of the terms' motions to the gaps of the last accepted state, 0 where held (owned
        dofs,) [mm]."""
        motion = np.sum([term.motion_to_gaps() for term in self._keeping], 0)
        motion[self.held] = 0.0
        return motion

    def places_changed(self) -> bool:
        """Whether `tangent` has other places than the matrix made last, on any rank: a matrix gives
        up those that supports leave empty."""
        return self.held is not self._held_in_matrix or self._assembly.places_changed()

    def anticipate(self) -> None:
        """After `residual`: let terms see it before the tangent for the next correction."""
        for term in self._anticipating:
            term.anticipate(self.forces.array)

    def held_forces(self) -> np.ndarray:
        """Forces of the supports on this rank's held degrees of freedom, after `residual`
        (held,) [N]."""
        return self.forces.array[self.held].copy()

    def force_scale(self) -> float:
        """After `residual`: norm of the nodal forces that the sheet bears from supports, loads and
        tools, what a residual is measured by [N]. Forces that meet in a node, as under a blank
        holder, cancel, but for `PINCH` of them."""
        net, pinch = np.zeros(self.forces.local_size), 0.0
        for given in self.applied_forces():
            net[: given.size] += given
            pinch += float((given**2).sum())
        net[self.held] = self.forces.array[self.held]
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

    def reaction(self, name: str) -> np.ndarray:
        """Force of support `name` on the blank along the axes of the frame, (gdim,), after
        `residual` [N].

        Raises InputError if there is no support of that name.
        """
        return self.supports.reaction(name, self.forces)

    def applied_forces(self) -> list[np.ndarray]:
        """Forces of each tool and load (owned dofs,) [N]."""
        return self._assembly.applied_forces()


def _largest(values):
    return np.abs(values).max(initial=0.0, where=np.isfinite(values))


def memory_of(terms: Iterable[Term]) -> dict[str, np.ndarray]:
    """What accepted states left in `terms`, by their numbers; see `Scene.memory`."""
    memory: dict[str, np.ndarray] = {}
    for i, term in enumerate(terms):
        memory |= {f"{place}{i} {key}": v for (place, key), v in _memory(term).items()}
    return memory


def _memory(term: Term) -> dict[tuple[str, str], np.ndarray]:
    """What a term remembers, {("" or `OF_CELLS`, name): array}."""
    memory: dict[tuple[str, str], np.ndarray] = {}
    for place, method in PLACES:
        if overrides(term, method):
            found = arrays(term, method, asked(term, method, "array"))
            memory |= {(place, name): values for name, values in found.items()}
    return memory
