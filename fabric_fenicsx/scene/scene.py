"""A scene: a blank, its terms and its supports."""

from collections.abc import Iterable, Mapping

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..core.errors import InputError
from ..core.timing import phase
from ..energy.assembly import Assembly
from ..energy.fingerprint import entries, of_values, plain
from ..energy.output import arrays
from ..energy.term import Term, bind, check_answers, overrides
from ..energy.work import STATES
from ..sheet.blank import Blank
from .rigid_motions import check_held, is_held_by_friction
from .supports import FixedDofs, Supports

OF_CELLS = "cells "  # begins the names of arrays in cells


class Scene:
    """A sheet with its terms and supports, at a load factor from 0 to 1.

    Its energy is the sum of the energies of `terms`. A run minimises it at fixed supports,
    step by step up to the full load. Raises InputError without an elastic term, for a term of
    another scene, and for a support that holds no node.

    Parameters
    ----------
    blank
        The sheet, or a stack of sheets.
    terms
        Objects that store or take energy, as `Membrane`, `Bending` or `Contact`. The scene knows
        of them what `Term` says; each belongs to one scene.
    supports
        Prescribed displacements, or a function of the blank that returns them.

    Examples
    --------
    >>> blank = ff.Blank.rectangle(40, 20, nx=4)
    >>> scene = ff.Scene(blank, [ff.Membrane(ff.load("komeili"))], ff.clamped_ends(0.2))
    >>> scene.energies()
    {'strain': 0.0}
    """

    INVERTED = 1e30  # the energy where a cell is turned inside out
    # of forces that cancel in a node, with which residuals of an unloaded sheet are compared
    PINCH = 1e-3

    @phase("setup")
    def __init__(self, blank: Blank, terms: Iterable[Term], supports: Supports = ()) -> None:
        self.blank, self.terms = blank, list(terms)
        for term in self.terms:
            bind(term, self)
        self.u = compat.petsc_vector(blank.u)
        if not any(term.energy is not None or "stretch" in term.resists for term in self.terms):
            raise InputError(f"the scene of {blank.name} has no elastic term; it needs a membrane")
        self._assembly = Assembly(blank, self.terms)
        self.keeping = [term for term in self.terms if overrides(term, "contact_prediction")]
        self.has_lagged_terms = any(overrides(term, "update_lagged") for term in self.terms)
        self._checked = self.was_loaded = False  # by a run, which leaves the state of the start
        self._fixed_in_matrix: dict[bool, np.ndarray] = {}  # and in the narrow one
        is_plane = blank.mesh.geometry.dim == 2
        self._inverted = compat.form(blank.inverted_area()) if is_plane else None
        self.supports = FixedDofs(blank, supports(blank) if callable(supports) else supports)
        # a viscous drag [N/mm] on the nodes' displacement since `origin`
        self.drag, self.origin = 0.0, None
        self.forces, self._free = self.u.duplicate(), self.u.duplicate()
        self._mark_free()

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that share the blank."""
        return self.blank.mesh.comm

    def _mark_free(self):
        self._free.set(1.0)
        self._free.array[self.fixed_dofs] = 0.0

    @property
    def fixed_dofs(self) -> np.ndarray:
        """This rank's degrees of freedom that supports fix now, (fixed,)."""
        return self.supports.dofs

    def release_locating_supports(self) -> None:
        """Drop supports that only locate, if friction holds the sheet in its accepted state."""
        if self.supports.locates and is_held_by_friction(self.blank, self.terms):
            self.supports.release_locating_supports()
            self._mark_free()

    def check_held(self) -> str:
        """See `rigid_motions.check_held`."""
        return check_held(self.blank, self.terms, self.supports)

    def check_start(self) -> None:
        """Raise InputError if no run can begin: see `Blank.check_unmoved`, `check_held` and
        `Term.check_start`, and for terms that do not answer as they should."""
        self.blank.check_unmoved()
        self.check_held()
        for term in self.terms:
            term.check_start()
        if not self._checked:
            self.set_load(0.0)
            self.accept()
            for term in self.terms:
                check_answers(term)
            self.memory()
            self._checked = True

    @phase("contact")
    def set_load(self, load: float) -> None:
        """Set the load factor, and take the terms back to the last accepted state in all else."""
        for term in self.terms:
            term.set_load(load)

    def accept(self) -> None:
        """Let the terms take the present state as the last accepted one."""
        for term in self.terms:
            term.accept()

    def reject(self) -> None:
        """Let terms and supports forget what they noted since the last accepted state."""
        self.supports.work.reject()
        for term in self.terms:
            term.reject()

    @phase("contact")
    def on_prediction(self) -> None:
        """Show terms the present displacement as the prediction of the next state."""
        for term in self.terms:
            term.on_prediction()

    @phase("contact")
    def update_lagged(self) -> bool:
        """Let terms update what they lag; True if any did, on all ranks."""
        return any([term.update_lagged() for term in self.terms])

    def work(self) -> float:
        """Work of the terms' loads and tools since the last accepted state [N mm]."""
        return self.comm.allreduce(sum(term.work() for term in self.terms))

    def memory(self) -> dict[str, np.ndarray]:
        """Memory of terms and supports, named as in `memory_of`."""
        return memory_of(self.terms) | {"supports": self.supports.memory()}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Give terms and supports back their `memory`, of the present displacement and load. Raises
        InputError, on all ranks, if a term's memory is another one then."""
        for i, term in enumerate(self.terms):
            recall(term, i, memory)
        self.supports.recall(memory["supports"])

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
        """Energy and potential of loads now [N mm], `INVERTED` if a cell is turned inside out."""
        if self._inverted and self.comm.allreduce(fem.assemble_scalar(self._inverted)) > 0:
            return self.INVERTED
        return sum(self._assembly.energies().values()) + self.drag_energy()

    def drag_energy(self) -> float:
        """Potential of the drag at the present displacement [N mm]."""
        return 0.5 * self.drag * self._dragged().norm() ** 2 if self.drag else 0.0

    def _dragged(self):
        moved = self.u - self.origin
        moved.array[self.fixed_dofs] = 0
        return moved

    @phase("assemble")
    def residual(self, r: PETSc.Vec) -> None:
        """Make r the internal forces, 0 at fixed degrees of freedom [N]; `forces` keeps all."""
        self._assembly.residual(self.forces)
        self.forces.copy(r)
        r.array[self.fixed_dofs] = 0
        if self.drag:
            r.axpy(self.drag, self._dragged())

    def create_matrix(self, narrow: bool = False) -> PETSc.Mat:
        """A matrix for `tangent`, with the rigid motions for multigrid."""
        A, self._fixed_in_matrix[narrow] = self._assembly.create_matrix(narrow), self.fixed_dofs
        x = self.u.duplicate()
        x.array[:] = self.blank.along(self.blank.coordinates().T).T.ravel()[: x.local_size]
        A.setNearNullSpace(PETSc.NullSpace().createRigidBody(x))
        return A

    @phase("assemble")
    def tangent(self, A: PETSc.Mat, with_supports: bool = True, narrow: bool = False) -> None:
        """Make A the energy's second derivative [N/mm], or the narrow one, with unit rows at
        supports."""
        bcs, free = (self.supports.bcs, self._free) if with_supports else ((), None)
        self._assembly.tangent(A, bcs, free, narrow)
        if self.drag:
            A.shift(self.drag)

    @phase("linear_solve")
    def add_remainder(self, v: PETSc.Vec, f: PETSc.Vec) -> None:
        """Add to f what the tangent gives along v beyond the narrow one that was made last."""
        self._assembly.add_remainder(v, f, self._free)

    @phase("contact")
    def contact_prediction(self) -> np.ndarray:
        """Sum of the terms' motions to the last accepted gaps, 0 at supports (owned dofs,) [mm]."""
        motion = np.sum([term.contact_prediction() for term in self.keeping], 0)
        motion[self.fixed_dofs] = 0.0
        return motion

    def places_changed(self, narrow: bool = False) -> bool:
        """True if the last matrix, on any rank, lacks places or was made for other supports."""
        fixed = self._fixed_in_matrix.get(narrow)
        return self.fixed_dofs is not fixed or self._assembly.places_changed(narrow)

    @phase("contact")
    def use_secant_stiffness(self) -> None:
        """Let terms use secant stiffnesses in the tangent of the next correction."""
        for term in self.terms:
            term.use_secant_stiffness(self.forces.array)

    @phase("assemble")
    def force_scale(self) -> float:
        """Norm of the nodal forces of supports, loads and tools, after `residual`, with which a
        residual is compared [N]. Forces that meet in a node cancel, as under a blank holder, but
        for `PINCH` of them."""
        net, pinch = np.zeros(self.forces.local_size), 0.0
        for given in self.applied_forces():
            net[: given.size] += given
            pinch += float((given**2).sum())
        net[self.fixed_dofs] = self.forces.array[self.fixed_dofs]
        return np.sqrt(self.comm.allreduce(float(net @ net) + self.PINCH**2 * pinch))

    def compliances(self) -> list[tuple[PETSc.Vec, float]]:
        """Vectors c and numbers k [N/mm] of tools moved by force: c c^T / k softens the tangent."""
        softenings = []
        for along, k in filter(None, (term.compliance() for term in self.terms)):
            if k > 0:
                c = self.u.duplicate()
                c.set(0.0)
                c.array[: along.size] = along
                c.array[self.fixed_dofs] = 0
                softenings.append((c, k))
        return softenings

    def reaction(self, name: str) -> np.ndarray:
        """Force of support `name` on the blank along the axes of the frame, after `residual`,
        (gdim,) [N]. Raises InputError if there is no support of that name."""
        return self.supports.reaction(name, self.forces)

    def applied_forces(self) -> list[np.ndarray]:
        """Forces of each tool and load (owned dofs,) [N]."""
        return self._assembly.applied_forces()

    def fingerprint(self) -> dict[str, object]:
        """What a run that is resumed must agree in: parameters of the terms, largest displacement
        of the supports and directions of the yarns, the same on any number of ranks."""
        facts: dict[str, object] = {"terms": ", ".join(term.name for term in self.terms)}
        for i, term in enumerate(self.terms, 1):
            of = f"of term {i}, {term.name}"
            for name, attribute in term.fingerprint.items():
                facts |= {f"{k} {of}": number for k, number in entries(attribute, name).items()}
            for name, (_, x, values) in term.fields.items():
                facts[f"values of {name} {of}"] = of_values(self.comm, x, values[:, None])
        facts["supports"] = ", ".join(support.name for support in self.supports)
        farthest = self.comm.allreduce(abs(self.supports.values(1.0)).max(initial=0.0), MPI.MAX)
        facts["largest displacement of supports [mm]"] = plain(float(farthest))
        whole, yarns = self.blank.whole, "directions of the yarns"
        if whole.straight:
            facts[yarns] = np.round(whole.straight, 9).tolist()
        else:
            facts[yarns] = of_values(self.comm, self.blank.centres(), np.hstack(whole.yarns()))
        return facts


def memory_of(terms: Iterable[Term]) -> dict[str, np.ndarray]:
    """Memory of `terms`, {name: array (owned nodes, k)}, or (owned cells, k) where the name begins
    with `OF_CELLS`; then follow the term's number and its own name for the array."""
    return {
        f"{place}{i} {key}": values
        for i, term in enumerate(terms)
        for (place, key), values in _memory(term).items()
    }


def rescale_loads(memory: Mapping[str, np.ndarray], share: float) -> None:
    """Multiply the load factors of states in a scene's `memory`, as of `Work`, by `share`."""
    for name, values in memory.items():
        if name == "supports":
            values.reshape(-1, STATES, 4)[:, :, 1] *= share
        elif name.endswith(" work"):
            values.reshape(len(values), STATES, -1)[:, :, 1] *= share


def recall(term: Term, number: int, memory: dict[str, np.ndarray]) -> None:
    """Give a term back its part of `memory`. Raises InputError, on all ranks, if it did not take
    it."""
    saved = {key: memory[f"{place}{number} {key}"] for place, key in _memory(term)}
    term.recall(saved)
    lost = []
    for (_, key), values in _memory(term).items():
        scale = np.abs(saved[key]).max(initial=0.0, where=np.isfinite(saved[key]))
        if not np.allclose(values, saved[key], 1e-9, 1e-9 * scale, equal_nan=True):
            lost.append(key)
    if lost := term.blank.mesh.comm.allreduce(lost):
        raise InputError(
            f"`recall` of term {term.name} does not restore {lost[0]}; it must restore all that "
            "`memory` and `cell_memory` return"
        )


def _memory(term):
    """Arrays by (beginning of their name, own name)."""
    return {
        (place, key): values
        for place, method in (("", "memory"), (OF_CELLS, "cell_memory"))
        for key, values in arrays(term, method, getattr(term, method)()).items()
    }
