"""Parts of a blank, to which terms are restricted: sheets of a stack, patches of a sheet."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import ufl
from dolfinx.mesh import locate_entities_boundary, meshtags
from mpi4py import MPI

from .. import dolfinx_compat as compat
from ..runtime.errors import InputError

if TYPE_CHECKING:
    from .blank import Blank

SAME = 1e-15  # by which directions may differ that are taken as one


class Part:
    """Cells of a `blank`: a sheet of a stack, a patch, or all of it.

    - name: "" if it is all of the blank; thickness: of a stack's sheet, otherwise None [mm]
    - cells (n,): this rank's owned cells
    - nodes (owned nodes,): mask of those at the part's cells, also at cells of other ranks
    - straight: directions of yarns a and b where they are the same in all cells, otherwise None
    - orthogonal: whether the yarns are so in every point
    """

    def __init__(
        self,
        blank: "Blank",
        name: str = "",
        local_cells: np.ndarray | None = None,
        thickness: float | None = None,
        orthogonal: bool | None = None,
    ) -> None:
        mesh = blank.mesh
        self.blank, self.name, self.thickness = blank, name, thickness
        self.is_whole = local_cells is None
        owned = mesh.topology.index_map(2).size_local
        local = np.arange(len(compat.dofmap(blank.V))) if local_cells is None else local_cells
        self.cells = local[local < owned].astype(np.int32)
        count = blank.V.dofmap.index_map.size_local
        at = compat.dofmap(blank.V)[local].ravel()
        self.nodes = np.zeros(count, dtype=bool)
        self.nodes[at[at < count]] = True
        fibres = [field.x.array.reshape(-1, mesh.geometry.dim) for field in (blank.a0, blank.b0)]
        self.straight = _common(mesh.comm, [values[self.cells] for values in fibres])
        crossed = self.straight is not None or compat.is_affine(mesh)
        self.orthogonal = crossed if orthogonal is None else orthogonal and crossed
        if not self.is_whole:
            self._tags = meshtags(mesh, 2, np.sort(self.cells), np.ones(len(self.cells), np.int32))

    def dx(self, degree: int | None = None) -> ufl.Measure:
        """Integration over the part, exact for polynomials of this degree on cells with straight
        sides; None: what UFL estimates. On P1 the displacement is of degree 1, so its square needs
        2, on P2 4; with less, nothing tells that the energy is off.

        All parts of a blank have the same subdomain number, so that they share compiled forms. So
        a form must not mix parts.
        """
        metadata = {} if degree is None else {"quadrature_degree": degree}
        if self.is_whole:
            return ufl.Measure("dx", self.blank.mesh, metadata=metadata)
        return ufl.Measure(
            "dx", self.blank.mesh, subdomain_data=self._tags, subdomain_id=1, metadata=metadata
        )

    def ds(
        self, edge: Callable[[np.ndarray], np.ndarray], degree: int | None = None
    ) -> ufl.Measure:
        """Integration over those sides at the part's outer edge that `edge` marks, a function of
        points (3, n) [mm] to a mask (n,), true at both ends of a side; degree: as in `dx`.
        InputError, on all ranks, if it marks none."""
        mesh = self.blank.mesh
        mesh.topology.create_connectivity(1, 2)
        sides = np.unique(locate_entities_boundary(mesh, 1, edge)).astype(np.int32)
        cells = mesh.topology.connectivity(1, 2)
        of = np.array([cells.links(side)[0] for side in sides], dtype=np.int32)
        sides = sides[np.isin(of, self.cells)]
        if mesh.comm.allreduce(len(sides), MPI.SUM) == 0:
            where = f"{self.name}, part of {self.blank.name}" if self.name else self.blank.name
            raise InputError(
                f"the edge marks no side of {where}; allowed is a function of points (3, n) that "
                "is true at both ends of some sides"
            )
        tags = meshtags(mesh, 1, sides, np.ones(len(sides), dtype=np.int32))
        metadata = {} if degree is None else {"quadrature_degree": degree}
        return ufl.Measure("ds", mesh, subdomain_data=tags, subdomain_id=1, metadata=metadata)

    def put(self, fields: dict[str, np.ndarray], name: str, values: np.ndarray) -> None:
        """Make `values` (cells, ...) field `name` of the blank's owned cells; other parts' values
        stay, and of two terms on one part the last one's. Cells without any get NaN, in whole
        numbers 0."""
        if self.is_whole:
            fields[name] = values
            return
        shape = self.blank.mesh.topology.index_map(2).size_local, *values.shape[1:]
        is_float = np.issubdtype(values.dtype, np.floating)
        none = np.full(shape, np.nan if is_float else 0, dtype=values.dtype)
        fields.setdefault(name, none)[self.cells] = values


def _common(comm: MPI.Comm, fields: list[np.ndarray]) -> list[list[float]] | None:
    """The vectors that fields (cells, k) have in all cells of all ranks, None if one differs."""
    values = np.hstack(fields)
    low = comm.allreduce(values.min(0, initial=np.inf), np.minimum)
    high = comm.allreduce(values.max(0, initial=-np.inf), np.maximum)
    return high.reshape(len(fields), -1).tolist() if (high - low).max() <= SAME else None
