"""Cells of a sheet: a patch, a ply of a stack, or all of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import ufl
from dolfinx.mesh import locate_entities_boundary, meshtags
from mpi4py import MPI

from .. import dolfinx_compat as compat
from ..core.errors import InputError
from .sheet_mesh import SheetMesh, bounds

MAX_OFF_YARNS = 0.5  # share of the cells off the yarns up to which a mesh follows them


class Part:
    """Cells of a `blank`: a sheet of a stack, a patch, or all of it (`name` is "" then).

    - thickness: of a stack's sheet [mm]; cells (n,): this rank's owned ones
    - nodes (owned nodes,): mask of those at the part's cells, also at cells of other ranks
    - straight: directions of yarns a and b where they are the same in all cells, otherwise None
    """

    def __init__(
        self,
        blank: SheetMesh,
        name: str = "",
        local_cells: np.ndarray | None = None,
        thickness: float | None = None,
        orthogonal: bool | None = None,
    ) -> None:
        mesh, dofmap = blank.mesh, compat.dofmap(blank.V)
        self.blank: Any = blank  # the `Blank`, which imports this
        self.name, self.thickness = name, thickness
        self.is_whole = local_cells is None
        local = np.arange(len(dofmap)) if local_cells is None else local_cells
        self.cells = local[local < mesh.topology.index_map(2).size_local].astype(np.int32)
        nodes = dofmap[local].ravel()
        self.nodes = np.zeros(blank.V.dofmap.index_map.size_local, dtype=bool)
        self.nodes[nodes[nodes < len(self.nodes)]] = True
        low, high = bounds(mesh.comm, np.hstack(self.yarns()).T)
        same = (high - low).max() <= 1e-15  # directions
        self.straight = high.reshape(2, -1).tolist() if same else None
        crossed = self.straight is not None or compat.is_affine(mesh)
        self.orthogonal = crossed if orthogonal is None else orthogonal and crossed
        if not self.is_whole:
            self._tags = meshtags(mesh, 2, np.sort(self.cells), np.ones(len(self.cells), np.int32))
        self._flat: np.ndarray | None = None
        self._growth = np.empty(0), np.empty(0)  # the displacement, and what it is there

    def yarns(self) -> list[np.ndarray]:
        """Yarns a and b in the cells, two arrays (cells, gdim)."""
        gdim = self.blank.mesh.geometry.dim
        return [f.x.array.reshape(-1, gdim)[self.cells] for f in (self.blank.a0, self.blank.b0)]

    def flat_areas(self) -> np.ndarray:
        """Undeformed areas at the local nodes, of a quadratic triangle those of its four flat ones,
        (nodes,) [mm^2]."""
        if self._flat is None:
            self._flat = self._at_nodes(self.blank.areas()[self.cells])
        return self._flat

    def growth(self) -> np.ndarray:
        """Areas at the local nodes now over undeformed ones, (nodes,), 1 off the part."""
        u, blank, (known, _) = self.blank.u.x.array, self.blank, self._growth
        if not blank.mesh.comm.allreduce(np.array_equal(u, known), MPI.LAND):
            flat = self.flat_areas()
            now = self._at_nodes((blank.areas() * blank.area_ratios())[self.cells])
            self._growth = u.copy(), np.divide(now, flat, out=np.ones_like(now), where=flat > 0)
        return self._growth[1]

    def _at_nodes(self, areas):
        k = self.blank.cell_nodes.shape[1]
        share = np.array([1, 1, 1, 3, 3, 3]) / 12 if self.blank.degree == 2 else np.full(k, 1 / k)
        return self.blank.summed((areas[:, None] * share)[..., None], self.cells)[:, 0]

    def follows_yarns(self) -> bool:
        """True if few of the cells lie off the yarns."""
        return self.share_off_the_yarns() <= MAX_OFF_YARNS

    def share_off_the_yarns(self) -> float:
        """Share of the part's cells at whose corners edges of the mesh do not run along both
        yarns, of all ranks."""
        blank, around = self.blank, self.blank.around
        corners, k = blank.corners()[self.cells], len(around)
        edges = np.roll(corners, -1, 1) - corners
        edges /= np.linalg.norm(edges, axis=2, keepdims=True)
        follows = []
        for yarn in self.yarns():
            cosine = np.abs((edges * blank.along(yarn.T).T[:, None]).sum(2))
            # a bias test's force is 3 % too large with 1 deg, 8 % with 3 deg, 22 % with 10 deg
            edge = cosine >= math.cos(math.radians(1.0))
            follows.append(edge | np.roll(edge, 1, 1))  # both of its ends
        marks = np.stack(follows, -1).astype(float)[:, np.argsort(around)]
        nodes = compat.dofmap(blank.V)[self.cells, :k]
        reached = (blank.summed(marks, self.cells)[nodes] > 0).any(1).all(1)
        off, cells = blank.mesh.comm.allreduce(np.array([(~reached).sum(), len(nodes)]), MPI.SUM)
        return float(off / cells)

    def dx(self, degree: int | None = None, drawn: float = 1.0) -> ufl.Measure:
        """Integration over the part, exact for polynomials of this degree on cells with straight
        sides; None: what UFL estimates. drawn: distance of the points from the cells' centres, over
        those of that rule. All parts share a subdomain number: a form must not mix parts."""
        metadata: dict[str, object] = {} if degree is None else {"quadrature_degree": degree}
        if degree is not None and drawn != 1:
            points, weights = compat.quadrature(self.blank.mesh, degree, drawn)
            # tuples, as UFL takes the names of forms from their text
            metadata |= {
                "quadrature_rule": "custom",
                "quadrature_points": tuple(map(tuple, points.tolist())),
                "quadrature_weights": tuple(weights.tolist()),
            }
        on = {} if self.is_whole else {"subdomain_data": self._tags, "subdomain_id": 1}
        return ufl.Measure("dx", self.blank.mesh, metadata=metadata, **on)

    def ds(
        self, edge: Callable[[np.ndarray], np.ndarray], degree: int | None = None
    ) -> ufl.Measure:
        """Integration over those sides at the part's outer edge that `edge` marks, a function of
        points (3, n) [mm] to a mask (n,), true at both ends of a side; degree: as in `dx`.
        InputError, on all ranks, if it marks none."""
        mesh = self.blank.mesh
        mesh.topology.create_connectivity(1, 2)
        # a mask of its own, as newer DOLFINx takes none that can't be written to
        marked = locate_entities_boundary(mesh, 1, lambda x: np.array(edge(x), bool))
        sides = np.unique(marked).astype(np.int32)
        cells = mesh.topology.connectivity(1, 2)
        sides = sides[np.isin([cells.links(side)[0] for side in sides], self.cells)]
        if mesh.comm.allreduce(len(sides), MPI.SUM) == 0:
            where = f"{self.name}, part of {self.blank.name}" if self.name else self.blank.name
            raise InputError(
                f"the edge marks no side of {where}; expected a function of points (3, n) that "
                "is true at both ends of some sides"
            )
        tags = meshtags(mesh, 1, sides, np.ones(len(sides), dtype=np.int32))
        metadata = {} if degree is None else {"quadrature_degree": degree}
        return ufl.Measure("ds", mesh, subdomain_data=tags, subdomain_id=1, metadata=metadata)

    def rows(self, values: np.ndarray, many: int) -> np.ndarray:
        """Values (cells many, ...) at `many` places in each of the part's cells as rows of the
        blank's owned cells, 0 elsewhere."""
        rows = np.zeros((len(self.blank.cell_nodes), many * int(np.prod(values.shape[1:]))))
        rows[self.cells] = values.reshape(-1, rows.shape[1])
        return rows

    def spread(self, values: np.ndarray) -> np.ndarray:
        """`values` (cells, ...) of the part's cells among the blank's owned cells; others get NaN,
        in whole numbers 0."""
        if self.is_whole:
            return values
        none = np.nan if np.issubdtype(values.dtype, np.floating) else 0
        shape = len(self.blank.cell_nodes), *values.shape[1:]
        spread = np.full(shape, none, dtype=values.dtype)
        spread[self.cells] = values
        return spread
