"""All differences between DOLFINx 0.5.2 (Debian 12), 0.9 (Debian 13) and 0.11, in newer names.

To drop Debian 12, delete what stands under `OLD`.
"""

from typing import Any

import basix
import dolfinx
import dolfinx.geometry
import dolfinx.la
import dolfinx.plot
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh
from mpi4py import MPI
from petsc4py import PETSc
from ufl.core.expr import Expr

from .core.jit_cache import TIMEOUT, compiled
from .core.processes import end_with_reader

VERSION = tuple(int(n) for n in dolfinx.__version__.split(".")[:2])
OLD, NEW = VERSION < (0, 8), VERSION >= (0, 11)
if not OLD:
    import basix.ufl
ADD = (dolfinx.la.ScatterMode if OLD else dolfinx.la.InsertMode).add  # values of ghosts

end_with_reader()  # after petsc4py, which has a handler of its own

# None touches NaN: without errno sqrt is one instruction, without traps both sides of a conditional
# may be computed side by side; sums may be taken in another order and quotients as products; and
# instructions are ordered for few registers.
C_FLAGS = (
    "-O3 -fno-math-errno -fno-trapping-math -fno-signed-zeros -fassociative-math "
    "-freciprocal-math -fschedule-insns -fsched-pressure"
).split()


def jit(**more: Any) -> dict[str, Any]:
    """Keyword argument of DOLFINx with the options for compiling, and `more` of FFCx."""
    options = {"cffi_extra_compile_args": C_FLAGS, "timeout": TIMEOUT} | more
    return {"jit_params": options} if OLD else {"jit_options": options}


def create_mesh(
    comm: MPI.Comm, cells: np.ndarray, points: np.ndarray, cell: str, degree: int
) -> Mesh:
    """Distributed mesh of `cells` (m, k), in DOLFINx order, and `points` (n, gdim) [mm]; each rank
    gives its part.

    cell: "triangle" or "quadrilateral", of geometric degree `degree`.
    """
    gdim = points.shape[1]
    if OLD:
        # FFCx 0.5 sets the variant itself when it first compiles, and forms made after that would
        # be other ones
        element = ufl.VectorElement(
            "Lagrange",
            ufl.Cell(cell, geometric_dimension=gdim),
            degree,
            dim=gdim,
            variant="equispaced",
        )
        return dolfinx.mesh.create_mesh(comm, cells=cells, x=points, domain=ufl.Mesh(element))
    domain = ufl.Mesh(basix.ufl.element("Lagrange", cell, degree, shape=(gdim,)))
    # what is OLD's default; NEW asks how many cells may meet at an edge
    how = (dolfinx.mesh.GhostMode.shared_facet, *((2,) if NEW else ()))
    ghosts = dolfinx.mesh.create_cell_partitioner(*how)
    return dolfinx.mesh.create_mesh(comm, cells=cells, x=points, e=domain, partitioner=ghosts)


def to_dolfinx_order(cell: str, nodes: int) -> np.ndarray:
    """Permutation p with cells[:, p] in DOLFINx order if cells are in gmsh's; for `nodes` nodes a
    cell."""
    return np.asarray(dolfinx.cpp.io.perm_gmsh(getattr(dolfinx.mesh.CellType, cell), nodes))


def cell_name(mesh: Mesh) -> str:
    """ "triangle" or "quadrilateral"."""
    name = mesh.ufl_cell().cellname
    return name if NEW else name()


def is_affine(mesh: Mesh) -> bool:
    """True if every cell has one tangent plane: straight-sided triangles."""
    return cell_name(mesh) == "triangle" and geometry_degree(mesh) == 1


def geometry_degree(mesh: Mesh) -> int:
    """Polynomial degree of the cells' shape."""
    return mesh.geometry.cmaps[0].degree if NEW else mesh.geometry.cmap.degree


def geometry_dofmap(mesh: Mesh) -> np.ndarray:
    """Geometry nodes of each local cell (owned first, then ghosts), (cells, k)."""
    if not OLD:
        return mesh.geometry.dofmaps[0] if NEW else mesh.geometry.dofmap
    dofmap, n = mesh.geometry.dofmap, geometry_degree(mesh) + 1
    nodes = n * (n + 1) // 2 if cell_name(mesh) == "triangle" else n**2
    return dofmap.array.reshape(dofmap.num_nodes, nodes)


def dofmap(space: fem.FunctionSpace) -> np.ndarray:
    """Nodes of `space` of each local cell (owned first, then ghosts), (cells, k)."""
    cells = space.dofmap.list
    return cells.array.reshape(-1, space.dofmap.dof_layout.num_dofs) if OLD else cells


def vector_space(mesh: Mesh, family: str, degree: int, dim: int) -> fem.FunctionSpace:
    """Space of vectors with `dim` components; family "Lagrange" or "DG"."""
    if OLD:
        return compiled(mesh.comm, lambda: fem.VectorFunctionSpace(mesh, (family, degree), dim=dim))
    return compiled(mesh.comm, lambda: fem.functionspace(mesh, (family, degree, (dim,))))


def quadrature_space(mesh: Mesh, degree: int, dim: int) -> fem.FunctionSpace:
    """Space of `dim` values at each point of `quadrature`, in its order."""
    kind, cell = "Quadrature", mesh.ufl_cell()
    if OLD:
        element = ufl.VectorElement(kind, cell, degree, dim=dim, quad_scheme="default")
        return compiled(mesh.comm, lambda: fem.FunctionSpace(mesh, element))
    at_points = basix.ufl.quadrature_element(cell_name(mesh), (dim,), "default", degree)
    return compiled(mesh.comm, lambda: fem.functionspace(mesh, at_points))


def form(ufl_form: ufl.Form) -> "fem.Form":
    """Compile a form, once per machine: rank 0 first, the others from its cache."""
    comm = ufl_form.ufl_domain().ufl_cargo().comm
    return compiled(comm, lambda: fem.form(ufl_form, **jit()))


def quadrature(mesh: Mesh, degree: int, drawn: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Quadrature points (n, 2) and weights (n,) of the reference cell, exact for polynomials of
    `degree`; drawn: distance of the points from its centre, over those of that rule."""
    points, weights = basix.make_quadrature(getattr(basix.CellType, cell_name(mesh)), degree)
    centre = weights @ points / weights.sum()
    return (centre + drawn * (points - centre) if drawn != 1 else points), weights


class PointEvaluation:
    """Values of a UFL expression at the quadrature points of `cells` (n,), by default owned.

    degree, drawn: of the quadrature, as in `quadrature`; weights: its weights (points,), which sum
    to the reference cell's area.
    """

    def __init__(
        self,
        expression: Expr,
        mesh: Mesh,
        degree: int,
        cells: np.ndarray | None = None,
        drawn: float = 1.0,
    ) -> None:
        points, self.weights = quadrature(mesh, degree, drawn)
        self._expression = compiled(mesh.comm, lambda: fem.Expression(expression, points, **jit()))
        self._mesh = mesh
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        self._cells = (np.arange(owned) if cells is None else cells).astype(np.int32)
        self._shape = (len(self._cells), len(self.weights), *expression.ufl_shape)

    def __call__(self) -> np.ndarray:
        """Array (cells, points a cell, *shape of the expression)."""
        given = (self._cells,) if OLD else (self._mesh, self._cells)
        return np.asarray(self._expression.eval(*given)).reshape(self._shape)


def values_at(function: fem.Function, points: np.ndarray) -> np.ndarray:
    """Values (n, components) of a function at points (n, 3), NaN where none of this rank's cells
    holds the point."""
    mesh, geometry = function.function_space.mesh, dolfinx.geometry
    collide = geometry.compute_collisions if OLD else geometry.compute_collisions_points
    tree = (geometry.BoundingBoxTree if OLD else geometry.bb_tree)(mesh, mesh.topology.dim)
    found = geometry.compute_colliding_cells(mesh, collide(tree, points), points)
    inside = np.diff(found.offsets) > 0
    values = np.full((len(points), function.function_space.dofmap.index_map_bs), np.nan)
    values[inside] = function.eval(points[inside], found.array[found.offsets[:-1][inside]])
    return values


def degree(space: fem.FunctionSpace) -> int:
    """Polynomial degree of a space of vectors."""
    element = space.ufl_element()
    return element.degree() if OLD else element.basix_element.degree


def petsc_vector(function: fem.Function) -> PETSc.Vec:
    """PETSc vector that shares the function's memory."""
    return function.vector if OLD else function.x.petsc_vec


def vtk_mesh(space: fem.FunctionSpace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """VTK cells (one flat array), cell types (cells,) and points (nodes, 3) of a Lagrange space's
    owned cells; of higher order from degree 2 on."""
    make = dolfinx.plot.create_vtk_mesh if OLD else dolfinx.plot.vtk_mesh
    return make(space)
