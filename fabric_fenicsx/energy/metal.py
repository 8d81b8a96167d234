"""Sheet metal: elastic-plastic membrane and bending in one, at points through the thickness."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mpi4py import MPI
from numpy.polynomial.legendre import Legendre

from ..core.errors import InputError
from ..core.rules import Rule
from ..material.metal import Metal
from ..material.plasticity import (
    Hencky,
    Response,
    elastic_energy,
    hencky,
    respond,
    volume_change,
    von_mises,
)
from . import metal_cells
from .bending import TWIST, plate_stiffness
from .morley import Section, Shape, Where, morley_cells
from .nodes import Stencil
from .output import Value, joined, largest, last, least, on_part
from .term import SceneFacts, Term, Triplets

# from strains 11, 22, 2 12 to half the changes of C as mean and shears, see `hencky`
MEAN_AND_SHEARS = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 1.0]])


class _State(NamedTuple):
    """Cells at one displacement: shape, strains and response at points (cells * points), and the
    conjugates of the mid-surface's strains and curvature (cells, 3) [N mm]."""

    U: np.ndarray
    shape: Shape
    strain: Hencky
    response: Response
    forces: np.ndarray
    moments: np.ndarray


def through_thickness(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Places from -1/2 to 1/2 and weights (points,), which sum to one: Lobatto's rule over each
    half. So faces and middle are among the places, and elastic bending is exact. Raises InputError
    unless points is an odd number from 5."""
    rule = Rule("an odd number from 5", lambda v: v >= 5 and v % 2 == 1, int)
    points = rule.check("`points` of the metal", points)
    n = (points + 1) // 2
    P = Legendre.basis(n - 1)
    x = np.concatenate([[-1.0], np.sort(P.deriv().roots().real), [1.0]])
    w = 1 / (n * (n - 1) * P(x) ** 2) / 2
    x = (x + 1) / 4
    ends = np.concatenate([w[1:][::-1], [2 * w[0]], w[1:]])
    return np.concatenate([-x[:0:-1], x]), ends


class SheetMetal(Term):
    """Elastic-plastic energy of a metal sheet on linear triangles in space.

    At a height z along the cell's normal the sheet stretches as C - 2 z (kappa - kappa0) says
    (Kirchhoff and Love). C = F^T F is the cell's; kappa is its normal curvature from
    `morley_cells`, on orthonormal axes, with the cell's current normal. So rigid motions
    take no energy. Strain is logarithmic, E = 1/2 ln C; elastic and plastic strain
    add up [1]_; stress is plane and Kirchhoff's. Within a step the energy is the incremental
    potential of `material.plasticity`. Thickness is that of the undeformed sheet, times the elastic
    change of volume over that of area. z follows it from one accepted state to the next, at fixed
    stress. Kinds of energy: "metal" elastic, "plastic" dissipated.

    Parameters
    ----------
    metal : Metal
        Elasticity, hardening and thickness, as `load_metal` gives them.
    points : int
        Through the thickness, odd, from 5. Moments of 11 are within 1 % at any curvature, those of
        5 within 9 %, and within 0.5 % from 9 times the curvature at which the sheet yields.
    symmetric, clamped : callable or sequence of callables
        As in `Bending`.

    Raises
    ------
    InputError
        On all ranks, for other points, for a blank other than of linear triangles in space, and for
        edges not found.

    References
    ----------
    Miehe, Apel and Lambrecht, Comput. Methods Appl. Mech. Eng. 191, 2002.

    Examples
    --------
    >>> sheet = ff.Blank.rectangle(20, 10, nx=2, spatial=True)
    >>> steel = ff.SheetMetal(ff.load_metal("dc04"))
    >>> scene = ff.Scene(sheet, [steel], ff.clamped_ends(0.1))
    >>> sheet.u.interpolate(lambda x: (0.01 * x[0], 0 * x[0], 0 * x[0]))
    >>> sorted(kind for kind, energy in scene.energies().items() if energy > 0)
    ['metal', 'plastic']
    """

    name, energy_kind = "sheet metal", "metal"

    def __init__(
        self,
        metal: Metal,
        points: int = 11,
        symmetric: Where | Sequence[Where] = (),
        clamped: Where | Sequence[Where] = (),
    ) -> None:
        self.metal, self._edges = metal, (symmetric, clamped)
        self._places, self._weights = through_thickness(points)
        self.resists = ("stretch", "turn") if symmetric or clamped else ("stretch",)

    def set_up(self, scene: SceneFacts) -> None:
        blank, metal = scene.blank, self.metal
        if not (blank.triangulated and blank.mesh.geometry.dim == 3):
            raise InputError(
                f"metal of {blank.name} does not support plane sheets or these cells; expected P1, "
                "and P2 with straight sides, in space"
            )
        D = plate_stiffness(metal.E, metal.thickness) / (1 - metal.nu**2)
        plate = D * np.array([[1, metal.nu, 0], [metal.nu, 1, 0], [0, 0, 2 * (1 - metal.nu)]])
        cells = morley_cells(self.part, plate, *self._edges)
        curvature = (TWIST[:, None] * each for each in (cells.operator, cells.curved))
        self._stencil = Stencil(cells, *curvature)
        self._volumes = cells.area[:, None] * metal.thickness * self._weights
        undeformed = self._stencil.shape(np.zeros_like(self._stencil.displacement()))
        self._rest, shape = undeformed.curvature, self._volumes.shape
        self._elastic, self._plastic = np.zeros((*shape, 3)), np.zeros(shape)
        self._count_from(undeformed)

    @property
    def material(self) -> Metal:
        return self.metal

    def accept(self) -> None:
        state = self._state()
        self._elastic = state.response.elastic.reshape(self._elastic.shape)
        self._plastic = state.response.plastic.reshape(self._plastic.shape)
        self._count_from(state.shape)

    def stored(self) -> float:
        return sum(self.energies().values())

    def energies(self) -> dict[str | None, float]:
        """As in `Term`; infinite where the sheet is curved within its thickness."""
        response = self._state().response
        kinds = {
            "metal": np.vdot(self._volumes, elastic_energy(self.metal, response.elastic)),
            "plastic": np.vdot(self._volumes, self.metal.hardening.work(response.plastic)),
        }
        return {kind: float(v) if np.isfinite(v) else np.inf for kind, v in kinds.items()}

    def add_forces(self, f: np.ndarray) -> None:
        state = self._state()
        given = state.shape, self._stencil.slopes, state.forces, state.moments
        self._stencil.add_forces(self._stencil.summed(metal_cells.forces(*given)), f)

    def tangent(self) -> Triplets:
        state, stencil = self._state(), self._stencil
        given = state.shape, stencil.slopes, state.forces, state.moments, self._sections(state)
        blocks = metal_cells.stiffness(*given, stencil.coupled.places, stencil.coupled.count)
        return stencil.triplets(blocks)

    def preconditioner(self) -> Triplets:
        """See `Term`: each edge as a hinge of two cells, apart from others and stretching."""
        state, stencil, hinges = self._state(), self._stencil, self._stencil.hinges
        plane, mixed, bending = self._sections(state)
        bent, none = hinges.shape(stencil.displacement()), np.zeros_like(mixed)
        spread = TWIST[:, None] * stencil.cells.spread
        moments = np.einsum("cke,ck->ce", spread, state.moments)
        diagonal = spread.swapaxes(1, 2) @ bending @ spread * np.eye(3)
        self._linear = (
            Section(state.shape, state.moments, bending, mixed),
            Section(bent, moments, diagonal, none),
        )
        given = bent, stencil.slopes, state.forces, moments, np.stack([plane, none, diagonal])
        blocks = metal_cells.stiffness(*given, hinges.coupled.places, hinges.coupled.count)
        return hinges.triplets(blocks)

    def add_remainder(self, v: np.ndarray, f: np.ndarray) -> None:
        self._stencil.add_difference(*self._linear, v, f)

    def _sections(self, state):
        strain, response = state.strain, state.response
        first = strain.first @ MEAN_AND_SHEARS
        second = MEAN_AND_SHEARS.T @ strain.second(2 * response.stress) @ MEAN_AND_SHEARS
        return metal_cells.sections(first, 2 * response.tangent, second, self._volumes, self._z)

    def cell_memory(self) -> dict[str, np.ndarray]:
        """Accepted elastic strains (cells, 3 points), and equivalent plastic (cells, points)."""
        rows, many = self.part.rows, self._stencil.cells.per_cell
        return {"elastic": rows(self._elastic, many), "plastic": rows(self._plastic, many)}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        at = self.part.cells
        self._elastic = memory["elastic"][at].reshape(self._elastic.shape)
        self._plastic = memory["plastic"][at].reshape(self._plastic.shape)
        self._count_from(self._stencil.shape(self._stencil.displacement()))

    def history(self) -> dict[str, Value]:
        """`max_plastic_strain` and `min_metal_thickness_mm`, of all metal of the scene."""
        comm, plastic = self.blank.mesh.comm, self._state().response.plastic
        most = comm.allreduce(plastic.max(initial=0.0), MPI.MAX)
        thinnest = comm.allreduce(self.thickness().min(initial=np.inf), MPI.MIN)
        return {"max_plastic_strain": largest(most), "min_metal_thickness_mm": least(thinnest)}

    def summary(self) -> dict[str, Value]:
        """The metal's name and the number of points, of a stack by sheet."""
        facts = {"metal": self.metal.name, "points_through_metal": len(self._places)}
        if self.part.is_whole:
            return {name: last(value) for name, value in facts.items()}
        return {"metals": joined({self.part.name: facts})}

    def cell_fields(self) -> dict[str, Value]:
        """The largest equivalent plastic strain through the thickness, the thickness, and von
        Mises' stress (Cauchy) on the face that normals point from, the top, and on the other."""
        response, shape = self._state().response, self._plastic.shape
        volume = np.exp(volume_change(self.metal, response.elastic))
        stress = (von_mises(response.stress) / volume).reshape(shape)
        strain = self._of_cells(response.plastic.reshape(shape).max(1)).max(1)
        thickness, top, bottom = (
            self._of_cells(values).mean(1)
            for values in (self.thickness(), stress[:, -1], stress[:, 0])
        )
        return {
            "equivalent_plastic_strain": on_part(self.part, strain, "-"),
            "metal_thickness": on_part(self.part, thickness, "mm"),
            "von_mises_top": on_part(self.part, top, "MPa"),
            "von_mises_bottom": on_part(self.part, bottom, "MPa"),
        }

    def thickness(self) -> np.ndarray:
        """Present thickness of the flat triangles of this rank's cells, (triangles,) [mm]."""
        state = self._state()
        return self._thickness(state.shape, state.response.elastic.reshape(self._elastic.shape))

    def _of_cells(self, values):
        return values.reshape(-1, self._stencil.cells.per_cell)

    def _thickness(self, shape, elastic):
        volume = volume_change(self.metal, np.einsum("cpk,p->ck", elastic, self._weights))
        area = np.linalg.norm(np.cross(shape.base[:, :, 0], shape.base[:, :, 1]), axis=1)
        return self.metal.thickness * np.exp(volume) / area

    def _count_from(self, shape):
        """Take z and the total strains of this shape, from which elastic strains count."""
        self._z = self._thickness(shape, self._elastic)[:, None] * self._places
        self._from = self._strain(shape).strain
        self._now: _State | None = None

    def _state(self):
        U = self._stencil.displacement()
        if self._now is None or not np.array_equal(U, self._now.U):
            shape = self._stencil.shape(U)
            strain = self._strain(shape)
            trial = self._elastic.reshape(-1, 3) + strain.strain - self._from
            response = respond(self.metal, trial, self._plastic.ravel())
            stress = np.einsum("nkj,nk->nj", strain.first, 2 * response.stress) @ MEAN_AND_SHEARS
            stress = stress.reshape(self._elastic.shape) * self._volumes[:, :, None]
            moments = -np.einsum("cp,cpk->ck", self._z, stress)
            self._now = _State(U, shape, strain, response, stress.sum(1), moments)
        return self._now

    def _strain(self, shape):
        """Logarithmic strains at all points, (cells * points)."""
        a, b = np.moveaxis(shape.base, 2, 0)
        aa, bb, ab = ((x * y).sum(1) for x, y in ((a, a), (b, b), (a, b)))
        C = np.stack([(aa + bb) / 2, (aa - bb) / 2, ab], -1)
        bent = (shape.curvature - self._rest) @ MEAN_AND_SHEARS.T
        return hencky((C[:, None] - self._z[:, :, None] * bent[:, None]).reshape(-1, 3))
