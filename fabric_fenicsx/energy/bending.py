"""Bending: the yarns' resistance to being curved, out of the sheet and, if wanted, within it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from mpi4py import MPI

from ..core.errors import InputError
from ..core.rules import FROM_ZERO
from ..material.bending import MeasuredBending
from ..material.friction import Response, respond
from ..material.homogeneous import nominal
from ..material.laws import Law
from .fabric_states import KIND
from .materials import fabric_of, thickness_shares
from .morley import Section, Shape, Where, morley_cells
from .nodes import Stencil
from .term import SceneFacts, Term, Triplets

TWIST = np.array([1.0, 1.0, 2.0])  # times x,aa, x,bb, x,ab: the curvatures of a `Shape`


def plate_stiffness(modulus: float, thickness: float) -> float:
    """Bending stiffness E t^3 / 12 [N mm] per width, of `modulus` E [MPa] and thickness t [mm]."""
    return modulus * thickness**3 / 12


def shortest_wave(fabric: Law, D: float, strain: float) -> float:
    """Length [mm] below which a yarn of bending stiffness `D` [N mm] shortens by `strain` before it
    buckles: Euler's 2 pi sqrt(D / P), P being the force per width at which the law has that
    strain; inf if it has none."""
    force = -float(nominal(fabric, np.array([[-strain, 0.0, 0.0]]))[0, 0]) * fabric.thickness
    return 2 * np.pi * np.sqrt(D / force) if force > 0 else np.inf


class _State(NamedTuple):
    """At a displacement U (nodes, gdim): energy [N mm]; in space the shape of cells, with the
    slopes out of their edges instead of the curvature, what is conjugate to these (cells, 3)
    [N mm] and its derivative (cells, 3, 3), and friction's response."""

    U: np.ndarray
    energy: float
    shape: Shape | None = None
    moments: np.ndarray | None = None
    section: np.ndarray | None = None
    friction: Response | None = None


class Bending(Term):
    """Energy 1/2 D_a |x,aa|^2 + 1/2 D_b |x,bb|^2 + 1/2 D_t |x,ab|^2 over the undeformed sheet.

    x,aa is the second derivative of the deformed position along yarn a, x,ab the twist. Their parts
    normal to the deformed cell count in full, their tangential parts times `in_plane`, or by
    `in_plane_stiffness`. Curvature of the undeformed sheet takes no energy. The operator is that of
    `morley_cells`, and normals are those of the current state, so rigid motions take no energy,
    however large. A
    fabric's `bending_friction` acts in parallel on the normal curvatures along both yarns, as the
    kind of energy "yarn_friction".

    Parameters
    ----------
    D_a, D_b, D_t : float
        Stiffnesses [N mm], D_b by default D_a. An isotropic plate without lateral contraction has
        D_t = 2 D_a. With D_t = 0 only the membrane resists pure twist, which is a saddle along the
        yarns' diagonals.
    in_plane : float
        Factor from 0 on D_a, D_b and D_t for bending within the sheet, the only bending of a plane
        blank.
    in_plane_stiffness : float
        Additional in-plane bending stiffness B of both yarns per width [N mm], besides
        `in_plane`. It gives shear bands a width of about sqrt(B / G t), G being the law's tangent
        in shear and t the thickness, which cells of half that resolve.
    symmetric, clamped : callable or sequence of callables
        Functions of points (3, n) [mm] to a mask (n,). Each of `symmetric` marks the blank's edge
        in one plane of symmetry, where supports must hold it; `clamped` marks edges whose tangent
        plane is fixed. All other edges are free of moment.
    modulus, twist_modulus : float
        E of both yarns and G [MPa], instead of D_a, D_b, D_t: D_a = D_b = E t^3 / 12 and D_t =
        G t^3 / 3, with the thickness t of the scene's fabric. A fabric's `bending`, as measured,
        replaces `modulus`; `in_plane` then refers to its initial slopes.

    Raises
    ------
    InputError
        On all ranks, for a blank other than of linear triangles (P1, or P2 with straight sides),
        negative stiffnesses, a modulus together with D_a or without a fabric, a plane blank without
        bending within it, a curved one with it, or edges not found.

    Examples
    --------
    >>> strip = ff.Blank.rectangle(20, 10, nx=2, spatial=True)
    >>> bending = ff.Bending(modulus=100.0, twist_modulus=1.0)
    >>> scene = ff.Scene(strip, [ff.Membrane(ff.load("komeili")), bending], ff.clamped_ends(0.1))
    >>> bending.stiffnesses.round(2).tolist()  # D_a, D_b, D_t [N mm] of t = 1 mm
    [8.33, 8.33, 0.33]
    """

    name = energy_kind = "bending"
    # and the sheet's weight [N/mm^2]
    _measured: tuple[MeasuredBending, float] | None = None

    def __init__(  # noqa: PLR0913
        self,
        D_a: float | None = None,
        D_b: float | None = None,
        D_t: float = 0.0,
        in_plane: float = 0.0,
        symmetric: Where | Sequence[Where] = (),
        clamped: Where | Sequence[Where] = (),
        *,
        modulus: float | None = None,
        twist_modulus: float = 0.0,
        in_plane_stiffness: float = 0.0,
    ) -> None:
        self._edges = symmetric, clamped
        self.resists = ("turn",) if symmetric or clamped else ()
        if (modulus is None) == (D_a is None):
            raise InputError("bending needs one of `D_a` and `modulus`")
        stiffness = {"modulus": modulus, "twist_modulus": twist_modulus}
        if modulus is None:
            stiffness = {"D_a": D_a, "D_b": D_a if D_b is None else D_b, "D_t": D_t}
        within = {"in_plane": in_plane, "in_plane_stiffness": in_plane_stiffness}
        numbers = stiffness | within
        checked = {k: FROM_ZERO.check(f"`{k}` of the bending", v) for k, v in numbers.items()}
        self._in_plane, self._given = [checked.pop(name) for name in within], checked

    def set_up(self, scene: SceneFacts) -> None:
        blank, fabric = scene.blank, fabric_of(scene, self.part)
        if blank.mesh.geometry.dim == 2 and not any(self._in_plane):
            raise InputError(
                f"bending of {blank.name} needs a blank made with `spatial=True`, or `in_plane`"
            )
        blank.check_triangulated("bending")
        self._set_stiffnesses(fabric)
        ratio, own = self._in_plane
        most = self.stiffnesses if self.stiffnesses.any() else np.array([own, own, 0.0])
        cells = morley_cells(self.part, most, *self._edges)
        is_curved = np.abs(cells.curved).max(initial=0) * np.sqrt(cells.area.max(initial=0)) > 1e-10
        weights = self._weights(scene, cells)
        within = ratio * weights + cells.area[:, None] * [own, own, 0.0]
        # modes that `within` misses would have a stiffness of `weights - within`, which may be < 0
        is_blind = blank.mesh.geometry.dim == 3 and (cells.within != cells.operator).any()
        is_off = is_curved or is_blind and (within > weights * (1 + 1e-9)).any()
        if blank.mesh.comm.allreduce(bool(is_off), MPI.LOR) and any(self._in_plane):
            raise InputError(
                f"`in_plane` of the bending of {blank.name} needs a sheet that is flat undeformed "
                "and, on crossed cells in space, must give no more stiffness than out of the plane"
            )
        flat = cells.curved * is_curved  # but for rounding
        self._cells = cells._replace(curved=flat, spread=TWIST[:, None] * cells.spread)
        self._stencil = Stencil(cells, cells.bends, cells.own * is_curved)
        self._section = (weights - within) / TWIST**2
        # stiffness of all second derivatives along each axis, of pairs of nodes
        both = cells.within * within[:, :, None]
        products, pairs = both.swapaxes(1, 2) @ cells.within, self._stencil.coupled
        here, size = pairs.places >= 0, self._stencil.count
        within = np.bincount(pairs.places[here], products[here], pairs.count)
        self._matrix = scipy.sparse.csr_matrix((within, pairs.ends), shape=(size, size))
        if not any(self._in_plane):
            self._matrix.eliminate_zeros()
        self._rest: np.ndarray | float = 0.0
        self._now: _State | None = None
        self._friction = np.zeros((2, 2, 0))
        if blank.mesh.geometry.dim == 3:
            undeformed = self._stencil.shape(0 * self._stencil.displacement())
            self._rest = self._curvature(_angles(undeformed.curvature)[0])
            self._friction = _elements(fabric, self._measured and self._measured[0])
        sliding = np.zeros((len(cells.area), *self._friction.shape[1:]))
        self._slid = {"sliding": sliding, "dissipated": 0 * cells.area}

    def _set_stiffnesses(self, fabric):
        self.stiffnesses = np.array([*self._given.values()], float)
        if "modulus" not in self._given:
            return
        if fabric is None:
            raise InputError(f"`modulus` of bending of {self.blank.name} needs a fabric, or `D_a`")
        D, D_t = (plate_stiffness(each, fabric.thickness) for each in self._given.values())
        self.stiffnesses = np.array([D, D, 4 * D_t])
        if fabric.bending:
            self._measured = fabric.bending, fabric.density * fabric.thickness
            self.stiffnesses[:2] = fabric.bending.stiffnesses(self._measured[1])

    def _weights(self, scene, cells):
        """Areas times stiffnesses of the cells (cells, 3), of a sheet as thick as it is there."""
        weights = cells.area[:, None] * self.stiffnesses
        if "modulus" in self._given:
            x = cells.corners.mean(1) @ self.blank.frame @ np.eye(len(self.blank.frame), 3)
            by_modulus = slice(2, 3) if self._measured else slice(3)
            weights[:, by_modulus] *= thickness_shares(scene, self.part, x)[:, None] ** 3
        return weights

    @property
    def within(self) -> float:
        """The softer yarns' stiffness against bending within the sheet [N mm]."""
        return self._in_plane[0] * float(self.stiffnesses[:2].min()) + self._in_plane[1]

    def stored(self) -> float:
        return self._state().energy

    def energies(self) -> dict[str | None, float]:
        kinds = super().energies()
        if friction := self._state().friction:
            dissipated = self._slid["dissipated"]
            kinds[KIND] = float(self._cells.area @ (friction.energy.sum(1) + dissipated))
        return kinds

    def accept(self) -> None:
        if friction := self._state().friction:
            dissipated = self._slid["dissipated"] + friction.dissipated.sum(1)
            self._slid = {"sliding": friction.sliding, "dissipated": dissipated}
            self._now = None

    def cell_memory(self) -> dict[str, np.ndarray]:
        """Sliding between yarns, and what it has dissipated, of the triangles of each cell."""
        if not self._friction.size:
            return {}
        many = self._cells.per_cell
        return {name: self.part.rows(each, many) for name, each in self._slid.items()}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        if self._friction.size:
            at = self.part.cells
            self._slid = {k: memory[k][at].reshape(v.shape) for k, v in self._slid.items()}
            self._now = None

    def add_forces(self, f: np.ndarray) -> None:
        U, _, shape, moments, *_ = self._state()
        forces = self._matrix @ U
        if shape:
            columns, count = self._stencil.columns, self._stencil.count
            forces += self._stencil.loops.bending_forces(shape, moments, columns, count)
        self._stencil.add_forces(forces, f)

    def tangent(self) -> Triplets:
        """As in `Term` [N/mm]: a cell reaches over two neighbours, beyond a rank's ghosts."""
        U, _, shape, moments, section, _ = self._state()
        pairs = self._stencil.coupled
        blocks = np.zeros((pairs.count, *2 * U.shape[1:]))
        if any(self._in_plane):  # of pairs in their order
            blocks += self._matrix.data[:, None, None] * np.eye(U.shape[1])
        if shape:
            self._stencil.loops.add_bending(shape, moments, section, pairs.places, blocks)
        return self._stencil.triplets(blocks)

    def preconditioner(self) -> Triplets:
        """See `Term`: each edge as a hinge of the two cells at it, by itself."""
        U, _, shape, moments, section, _ = self._state()
        if any(self._in_plane) or shape is None:
            self._linear = None
            return self.tangent()
        hinges, diagonal = self._stencil.hinges, section * np.eye(3)
        bent, mixed = hinges.shape(U), np.zeros_like(section)
        self._linear = (
            Section(shape, moments, section, mixed),
            Section(bent, moments, diagonal, mixed),
        )
        blocks = np.zeros((hinges.coupled.count, 3, 3))
        hinges.loops.add_bending(bent, moments, diagonal, hinges.coupled.places, blocks)
        return hinges.triplets(blocks)

    def add_remainder(self, v: np.ndarray, f: np.ndarray) -> None:
        if self._linear:
            self._stencil.add_difference(*self._linear, v, f)

    def curvatures(self) -> np.ndarray:
        """x,aa, x,bb, x,ab in each owned cell along the frame's axes, (cells, 3, gdim) [1/mm]."""
        U = self._stencil.displacement()[self._stencil.columns]
        return self._cells.operator @ U + self._cells.curved

    def _state(self):
        U = self._stencil.displacement()
        if self._now is None or not np.array_equal(U, self._now.U):
            energy = 0.5 * float(np.vdot(U, self._matrix @ U))
            self._now = self._bent(U, energy) if U.shape[1] == 3 else _State(U, energy)
        return self._now

    def _bent(self, U, energy):
        """The state with what is normal to the cells; energy: of bending within the sheet."""
        shape, section, friction = self._stencil.shape(U), self._section, None
        angles, slope, growth = _angles(shape.curvature)
        bent = self._curvature(angles) - self._rest
        moments = section * bent
        energy += 0.5 * float(np.vdot(moments, bent))
        if self._measured:
            measured, weight = self._measured
            along = measured.respond(bent[:, :2], weight)
            # instead of the straight line of its slopes at the start
            area = self._cells.area[:, None]
            start = area * self.stiffnesses[:2]
            straight = start * bent[:, :2]
            energy += float((area * along.energy - 0.5 * straight * bent[:, :2]).sum())
            section = section.copy()
            moments[:, :2] += area * along.moment - straight
            section[:, :2] += area * along.slope - start
        if self._friction.size:
            stiffness, slides = self._friction
            friction = respond(stiffness, slides, bent[:, :2], self._slid["sliding"])
            section, area = section.copy(), self._cells.area[:, None]
            moments[:, :2] += area * friction.stress
            section[:, :2] += area * friction.tangent
        given = self._cells.spread, slope, growth, moments, section
        moments, section = self._stencil.loops.at_edges(*given)
        return _State(U, energy, shape, moments, section, friction)

    def _curvature(self, angles):
        """Curvatures (cells, 3), 11, 22, 2 12, from angles (cells, 3) at the cells' edges."""
        return np.einsum("cke,ce->ck", self._cells.spread, angles)


def _elements(fabric, measured):
    """Stiffness [N mm] of the elements of friction of each yarn, and the curvature at which they
    slide [1/mm], (2, 2, k): those of a fabric's `bending_friction`, and of thresholds."""
    elements = []
    if friction := fabric and fabric.bending_friction:
        elements = [[k, k, f / k, f / k] for k, f in zip(friction.stiffness, friction.strength)]
    if measured and any(measured.thresholds):
        slides = 2 * [measured.stuck]
        elements.append([*(f / measured.stuck for f in measured.thresholds), *slides])
    return np.array(elements).reshape(-1, 2, 2).transpose(1, 2, 0)


def _angles(slopes):
    """Angles by which cells are bent at their edges, of slopes relative to the cell, and their
    first and second derivatives. On an arc of equal cells in rows, which turns by w from cell to
    cell, slopes are sin(w) / 2, and the angles w / 2 but for terms of w^5."""
    square = slopes * slopes
    return slopes * (1 + 2 / 3 * square), 1 + 2 * square, 4 * slopes
