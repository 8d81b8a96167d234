"""Dirichlet conditions of a scene: degrees of freedom that supports fix, and their reactions."""

from collections.abc import Iterable, Iterator

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from ..core.errors import InputError
from ..core.formatting import percent, rounded, share
from ..energy.work import Work
from ..sheet.blank import Blank
from .supports import Support


class FixedDofs:
    """Degrees of freedom of a `blank` that `supports` fix; iterating gives the supports.

    - dofs (fixed,): those that this rank owns and that are fixed now; dofs_of: of each support
      {name: (nodes, gdim)}, with free ones of its nodes
    - bcs: the same for DOLFINx
    - locates: True while supports fix some that only locate the sheet
    - work: of all supports

    Raises InputError for a support that holds no node, or components that the blank lacks.
    """

    def __init__(self, blank: Blank, supports: Iterable[Support]) -> None:
        self.blank, self._supports = blank, list(supports)
        self.work = Work(comm=blank.mesh.comm)
        self._gdim, x = blank.mesh.geometry.dim, blank.coordinates()
        self._owned = blank.V.dofmap.index_map.size_local
        self.dofs_of: dict[str, np.ndarray] = {}
        self._nodes: list[np.ndarray] = []
        for support in self:
            nodes = np.flatnonzero(support.where(x.T))
            owned, flaw = nodes[nodes < self._owned], ""
            if not set(support.components) <= set(range(self._gdim)):
                in_space = ", or 2 on a blank made with `spatial=True`" if self._gdim == 2 else ""
                allowed = f"allowed are those from 0 to {self._gdim - 1}{in_space}"
                flaw = f"the components {support.components} of {blank.name}; {allowed}"
            elif blank.mesh.comm.allreduce(len(owned)) == 0:
                flaw = f"no node of {blank.name}; allowed are 1 or more"
            if flaw:
                raise InputError(f"support {support.name} holds {flaw}")
            self._nodes.append(nodes)
            self.dofs_of[support.name] = owned[:, None] * self._gdim + np.arange(self._gdim)
        self.locates = any(support.locates for support in self)  # until `release_locating_supports`
        self._fix(self._supports)

    def __iter__(self) -> Iterator[Support]:
        return iter(self._supports)

    def _fix(self, supports):
        """Fix the degrees of freedom of these `supports` alone."""
        V, gdim = self.blank.V, self._gdim
        fixed = np.zeros(len(self.blank.coordinates()) * gdim, dtype=bool)
        for support, nodes in zip(self, self._nodes):
            if support in supports:
                fixed[nodes[:, None] * gdim + np.array(support.components, int)] = True
        dofs = np.flatnonzero(fixed).astype(np.int32)
        zero = PETSc.ScalarType(0)
        self.bcs = [fem.dirichletbc(zero, dofs[dofs % gdim == i], V.sub(i)) for i in range(gdim)]
        self.dofs = dofs[dofs < self._owned * gdim]

    def release_locating_supports(self) -> None:
        """Drop the supports that only locate the sheet."""
        before, self.locates = self.dofs, False
        self._fix([support for support in self if not support.locates])
        self.work.keep(np.isin(before, self.dofs))

    def values(self, load: float) -> np.ndarray:
        """Displacements of `dofs` at a load factor, along the frame's axes, (fixed,) [mm]."""
        x = self.blank.coordinates()
        values = np.zeros(len(x) * self._gdim)
        for support, nodes in zip(self, self._nodes):
            axes = np.array(support.components, dtype=int)
            values[nodes[:, None] * self._gdim + axes] = support.at(x[nodes].T, load)[axes].T
        return values[self.dofs]

    def reaction(self, name: str, forces: PETSc.Vec) -> np.ndarray:
        """Force of support `name` on the blank along the axes of the frame, (gdim,) [N]; forces:
        internal ones of all degrees of freedom. Raises InputError for an unknown name."""
        if name not in self.dofs_of:
            known = ", ".join(self.dofs_of)
            raise InputError(f"support {name!r} is not of this scene; allowed are {known}")
        return self.blank.mesh.comm.allreduce(forces.array[self.dofs_of[name]].sum(0), MPI.SUM)

    def memory(self) -> np.ndarray:
        """The memory of `work` at this rank's nodes, (owned nodes, k)."""
        states = self.work.memory()
        nodal = np.zeros((self._owned * self._gdim, len(states), 4))
        nodal[:, :, :2] = states[:, :2]
        if states.shape[1] > 2:
            nodal[self.dofs, :, 2:] = states[:, 2:].reshape(len(states), 2, -1).transpose(2, 0, 1)
        return nodal.reshape(self._owned, 4 * len(states) * self._gdim)

    def recall(self, memory: np.ndarray) -> None:
        """Restore the history from `memory`."""
        states = len(self.work.memory())
        nodal = memory.reshape(-1, states, 4)
        shared = nodal[:, :, :2].max(0, initial=0.0)
        self.blank.mesh.comm.Allreduce(MPI.IN_PLACE, shared, MPI.MAX)  # a rank may have no node
        fixed = nodal[self.dofs, :, 2:].transpose(1, 2, 0).reshape(states, -1)
        self.work.recall(np.hstack([shared, fixed]))

    def _located(self, sizes):
        return {s.name: sizes[s.name] for s in self if s.locates and self.locates}

    def located_share(self, sizes: dict[str, float]) -> float:
        """Share of all forces that supports bear which only locate; sizes: see `outer_forces`."""
        return share(sum(self._located(sizes).values()), sum(sizes.values()))

    def locating_warning(self, sizes: dict[str, float]) -> str:
        """A warning if supports that only locate bear a force, else ""; sizes: as before."""
        located, most = self._located(sizes), 0.005 * sum(sizes.values())
        forces = " and ".join(
            f"{k} {rounded(force)} N" for k, force in located.items() if force > most
        )
        return forces and (
            f"supports that should only keep the sheet in its place bear {forces}, "
            f"{percent(self.located_share(sizes))} of all forces, as sheet, yarns or tools are "
            "not symmetric: the formed shape depends on them; friction of a blank holder or of "
            "tools would hold the sheet without them"
        )
