"""Nodes of `MorleyCells` beyond the rank: motions in, forces and stiffness out."""

import functools
from types import ModuleType

import numpy as np
from scipy import sparse

from .morley import MorleyCells, Section, Shape
from .nodes import CoupledNodes, GatheredNodes
from .term import Triplets


class Stencil:
    """The nodes that the 12 of each of this rank's cells are, mirror images counted apart.

    operator, own: as `MorleyCells` gives them for the cells; apart: edges do not bend together;
    columns: which of the nodes each of a cell's 12 is, (cells, 12); count: how many there are;
    coupled: pairs of them that a cell's energy couples; slopes (cells, 3, 2): of the corners'
    functions
    """

    def __init__(
        self, cells: MorleyCells, operator: np.ndarray, own: np.ndarray, apart: bool = False
    ) -> None:
        self._dim, self._mirrors = cells.corners.shape[2], cells.mirrors
        keys = cells.nodes * len(cells.mirrors) + cells.codes
        keys, columns = np.unique(keys, return_inverse=True)
        self.columns = columns.reshape(cells.nodes.shape)
        self._nodes, self._codes = np.divmod(keys, len(cells.mirrors))
        self._mirrored = np.flatnonzero(self._codes)
        self._gathered = GatheredNodes(cells.blank, self._nodes)
        self.count = len(keys)
        entries = np.ones(columns.size), (columns.ravel(), np.arange(columns.size))
        self._on_nodes = sparse.csr_matrix(entries, shape=(self.count, columns.size))
        bends = operator != 0 if apart else (operator != 0).any(1, keepdims=True)
        bends[:, :, :3] = True
        couples = (bends[:, :, :, None] & bends[:, :, None]).any(1)
        of_cells = self.columns[:, : operator.shape[2]]
        self.coupled = CoupledNodes(self._nodes, of_cells, couples, self._dim)
        self.slopes = np.ascontiguousarray(cells.slopes)
        self._undeformed = cells.corners, self.slopes, operator, own
        self.cells = cells

    @functools.cached_property
    def hinges(self) -> "Stencil":
        """The stencil of each edge as a hinge of the two cells at it, by itself."""
        own = self.cells.hinged * self._undeformed[3].any()
        return Stencil(self.cells, self.cells.hinges, own, apart=True)

    @functools.cached_property
    def loops(self) -> ModuleType:
        """`metal_cells`, which imports numba: a sheet in a plane does without."""
        from . import metal_cells

        return metal_cells

    def displacement(self) -> np.ndarray:
        """Motion of nodes and mirror images along the frame's axes, (count, gdim) [mm]."""
        return self._with_images(self._gathered.displacement())

    def _with_images(self, U):
        at = self._mirrored
        U[at] = np.einsum("nij,nj->ni", self._mirrors[self._codes[at]], U[at])
        return U

    def summed(self, forces: np.ndarray) -> np.ndarray:
        """Forces on nodes and images (count, gdim) of those on the cells' (cells, 12, gdim) [N]."""
        return self._on_nodes @ forces.reshape(-1, self._dim)

    def add_forces(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add forces (count, gdim) [N], which this overwrites, to f (local dofs,) on any rank."""
        at = self._mirrored
        forces[at] = np.einsum("nij,ni->nj", self._mirrors[self._codes[at]], forces[at])
        self._gathered.add(forces, f)

    def shape(self, U: np.ndarray) -> Shape:
        """The shape of the cells at the `displacement` U (count, 3)."""
        return self.loops.shape(*self._undeformed, U, self.columns)

    def add_difference(self, one: Section, other: Section, v: np.ndarray, f: np.ndarray) -> None:
        """Add to f (owned dofs,) what a section's stiffness gives along v, less that of another."""
        motion, forces = self._with_images(self._gathered.values(v)), np.zeros((self.count, 3))
        for section, factor in ((one, 1.0), (other, -1.0)):
            along = motion, factor, forces
            self.loops.add_bending_along(section, self.slopes, self.columns, *along)
        self.add_forces(forces, f)

    def triplets(self, blocks: np.ndarray) -> Triplets:
        """As `Term.tangent` gives them, from blocks (pairs, gdim, gdim) of the `coupled` [N/mm],
        which this turns into those of the nodes that images stand for."""
        i, j = (self._codes[end] for end in self.coupled.ends)
        for mirror, transposed in ((i, True), (j, False)):
            at = mirror > 0
            R = self._mirrors[mirror[at]]
            blocks[at] = R.swapaxes(1, 2) @ blocks[at] if transposed else blocks[at] @ R
        return self.coupled.rows, self.coupled.cols, blocks.ravel()
