"""What supports hold in a scene: degrees of freedom, their displacements and reactions."""

from collections.abc import Iterable

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from ..mechanics.work import Work
from ..runtime.errors import InputError
from ..runtime.formatting import percent, rounded
from ..sheets.blank import Blank
from .supports import Support

BORNE = 0.005  # of all forces from outside, more than what a support that only locates should bear


class HeldDofs:
    """Degrees of freedom of a `blank` that `supports` hold.

    - given: the supports
    - dofs (held,): those that this rank owns and that are held now; dofs_of: of each support
      {name: (nodes, gdim)}, free ones of its nodes among them
    - bcs: DOLFINx's view of them
    - locates: whether some only locate the sheet, and still hold it
    - work: of all supports

    Raises InputError for a support that holds no node, or components that the blank lacks.
    """

    def __init__(self, blank: Blank, supports: Iterable[Support]) -> None:
        self.blank, self.given, self.work = blank, list(supports), Work()
        V, gdim, x = blank.V, blank.mesh.geometry.dim, blank.coordinates()
        owned = V.dofmap.index_map.size_local
        self.dofs_of: dict[str, np.ndarray] = {}
        self._nodes: list[np.ndarray] = []
        for support in self.given:
            if not set(support.components) <= set(range(gdim)):
                raise InputError(
                    f"support {support.name} holds the components {tuple(support.components)} of "
                    f"{blank.name}; allowed are those from 0 to {gdim - 1}"
                    + (", or 2 on a blank made with `spatial=True`" if gdim == 2 else "")
                )
            nodes = np.flatnonzero(support.where(x.T))
            if blank.mesh.comm.allreduce(int((nodes < owned).sum())) == 0:
                raise InputError(
                    f"support {support.name} holds no node of {blank.name}; allowed are 1 or more"
                )
            self._nodes.append(nodes)
            self.dofs_of[support.name] = nodes[nodes < owned, None] * gdim + np.arange(gdim)
        self.locates = any(support.locates for support in self.given)  # until `let_go`
        self._hold(self.given)

    def _hold(self, supports):
        """Hold the degrees of freedom of these `supports` alone."""
        V, gdim, x = self.blank.V, self.blank.mesh.geometry.dim, self.blank.coordinates()
        held = np.zeros(len(x) * gdim, dtype=bool)
        for support, nodes in zip(self.given, self._nodes):
            if support in supports:
                held[nodes[:, None] * gdim + np.asarray(support.components, dtype=int)] = True
        dofs = np.flatnonzero(held).astype(np.int32)
        zero = PETSc.ScalarType(0)
        self.bcs = [fem.dirichletbc(zero, dofs[dofs % gdim == i], V.sub(i)) for i in range(gdim)]
        self.dofs = dofs[dofs < V.dofmap.index_map.size_local * gdim]

    @property
    def _locating(self):
        """Supports that only locate the sheet, and still hold it."""
        return [support for support in self.given if support.locates] if self.locates else []

    def let_go(self) -> None:
        """Hold no longer what supports only locate."""
        before, self.locates = self.dofs, False
        self._hold([support for support in self.given if not support.locates])
        self.work.keep(np.isin(before, self.dofs))

    def values(self, load: float) -> np.ndarray:
        """Displacements of `dofs` at a load factor, along the frame's axes, (held,) [mm]."""
        x, gdim = self.blank.coordinates(), self.blank.mesh.geometry.dim
        values = np.zeros(x.shape[0] * gdim)
        for support, nodes in zip(self.given, self._nodes):
            value = (
                support.value(x[nodes].T, load).T
                if callable(support.value)
                else load * np.asarray(support.value, float)
            )
            components = list(support.components)
            values[nodes[:, None] * gdim + np.asarray(components)] = value[..., components]
        return values[self.dofs]

    def reaction(self, name: str, forces: PETSc.Vec) -> np.ndarray:
        """Force of support `name` on the blank along the axes of the frame, (gdim,) [N]; forces:
        internal ones of all degrees of freedom. Raises InputError if there is no support of that
        name."""
        if name not in self.dofs_of:
            raise InputError(
                f"support {name!r} is not of this scene; allowed are {', '.join(self.dofs_of)}"
            )
        return self.blank.mesh.comm.allreduce(forces.array[self.dofs_of[name]].sum(0), MPI.SUM)

    def memory(self) -> np.ndarray:
        """The memory of `work`, as rows of this rank's nodes (owned nodes, k): of each state
        whether it is known, load, force and place."""
        states = self.work.memory()
        gdim, count = self.blank.mesh.geometry.dim, self.blank.V.dofmap.index_map.size_local
        nodal = np.zeros((count * gdim, len(states), 4))
        nodal[:, :, :2] = states[:, :2]
        if states.shape[1] > 2:
            nodal[self.dofs, :, 2:] = states[:, 2:].reshape(len(states), 2, -1).transpose(2, 0, 1)
        return nodal.reshape(count, 4 * len(states) * gdim)

    def recall(self, memory: np.ndarray) -> None:
        """Take back what `memory` gave."""
        states = len(self.work.memory())
        nodal = memory.reshape(-1, states, 4)
        known = nodal[:, :, :2].max(0, initial=0.0)
        self.blank.mesh.comm.Allreduce(MPI.IN_PLACE, known, MPI.MAX)  # a rank may have no node
        self.work.recall(
            np.hstack([known, nodal[self.dofs, :, 2:].transpose(1, 2, 0).reshape(states, -1)])
        )

    def located_share(self, sizes: dict[str, float]) -> float:
        """What supports that only locate the sheet bear, over all forces; sizes: of nodal forces
        added up, by supports and of all else [N]."""
        borne = sum(sizes[support.name] for support in self._locating)
        return borne / max(sum(sizes.values()), 1e-300)

    def locating_warning(self, sizes: dict[str, float]) -> str:
        """A sentence if supports that only locate the sheet bear a force, else ""; sizes: as in
        `located_share`."""
        most = BORNE * sum(sizes.values())
        borne = {s.name: sizes[s.name] for s in self._locating if sizes[s.name] > most}
        if not borne:
            return ""
        words = " and ".join(f"{name} {rounded(force)} N" for name, force in borne.items())
        return (
            f"supports that should only keep the sheet in its place bear {words}, "
            f"{percent(self.located_share(sizes))} of all forces, as sheet, yarns or tools are "
            "not symmetric: the formed shape depends on them; friction of a blank holder or of "
            "tools would hold the sheet without them"
        )
