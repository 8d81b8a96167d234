"""Bending: the yarns' resistance to being curved, out of the sheet and, if wanted, within it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import sparse

from ...runtime.errors import InputError
from ...runtime.rules import FROM_ZERO
from ..materials import fabric_of
from ..term import SceneFacts, Term, Triplets
from .morley import MorleyCells, Where
from .stencil import Stencil


def plate_stiffness(modulus: float, thickness: float) -> float:
    """Bending stiffness E t^3 / 12 [N mm] of a strip, per width, of `modulus` E [MPa] and
    `thickness` t [mm]."""
    return modulus * thickness**3 / 12


class _State(NamedTuple):
    """At a displacement U (nodes, gdim): energy [N mm] and forces on the nodes (nodes, gdim)
    [N]."""

    U: np.ndarray
    energy: float
    forces: np.ndarray


class Bending(Term):
    """Energy 1/2 D_a |x,aa|^2 + 1/2 D_b |x,bb|^2 + 1/2 D_t |x,ab|^2 over the undeformed sheet.

    x,aa is the second derivative of the deformed position along yarn a, x,ab the twist. Their parts
    normal to the deformed cell count in full, their parts tangent to it times `in_plane`. Curvature
    of the undeformed sheet takes no energy. The operator is that of `morley.MorleyCells`. Normals
    are lagged, so within a step the energy is quadratic. The part of its derivative from turning
    normals is lagged, too, so the forces are exact at each accepted state.

    Parameters
    ----------
    D_a, D_b, D_t : float
        Stiffnesses [N mm], D_b by default D_a. An isotropic plate without lateral contraction has
        D_t = 2 D_a. With D_t = 0 only the membrane resists pure twist, which is a saddle along the
        yarns' diagonals.
    in_plane : float
        Factor from 0 on D_a, D_b and D_t for bending within the sheet, the only bending of a plane
        blank. It gives shear bands a width of about sqrt(in_plane D / membrane stiffness in shear).
    symmetric, clamped : callable or sequence of callables
        Functions of points (3, n) [mm] to a mask (n,). Each of `symmetric` marks the blank's edge
        in one plane of symmetry, where supports must hold it; `clamped` marks edges whose tangent
        plane is held. All other edges are free of moment.
    modulus, twist_modulus : float
        E of both yarns and G [MPa], in place of D_a, D_b, D_t: D_a = D_b = E t^3 / 12 and D_t =
        G t^3 / 3, with the thickness t of the scene's fabric.

    Raises
    ------
    InputError
        On all ranks, for a blank other than of linear triangles (P1, or P2 with straight sides),
        negative stiffnesses, a modulus beside D_a or without a fabric, a plane blank without
        `in_plane`, or edges not found.

    Examples
    --------
    >>> strip = ff.Blank.rectangle(20, 10, nx=2, spatial=True)
    >>> bending = ff.Bending(modulus=100.0, twist_modulus=1.0)
    >>> scene = ff.Scene(strip, [ff.Membrane(ff.load("komeili")), bending], ff.clamped_ends(0.1))
    >>> bending.stiffnesses.round(2).tolist()  # D_a, D_b, D_t [N mm] of t = 1 mm
    [8.33, 8.33, 0.33]
    """

    name = energy_kind = "bending"

    def __init__(
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
    ) -> None:
        self.in_plane = FROM_ZERO.check("`in_plane` of the bending", in_plane)
        self._edges = symmetric, clamped
        self.resists = ("turn",) if symmetric or clamped else ()
        if modulus is not None and D_a is None:
            given = {"modulus": modulus, "twist_modulus": twist_modulus}
        elif modulus is None and D_a is not None:
            given = {"D_a": D_a, "D_b": D_a if D_b is None else D_b, "D_t": D_t}
        else:
            raise InputError("bending needs one of `D_a` and `modulus`")
        self._given = {
            name: FROM_ZERO.check(f"`{name}` of the bending", value)
            for name, value in given.items()
        }

    def set_up(self, scene: SceneFacts) -> None:
        blank, given, fabric = scene.blank, self._given, fabric_of(scene, self.part)
        if blank.mesh.geometry.dim == 2 and not self.in_plane:
            raise InputError(
                f"bending of {blank.name} needs a blank made with `spatial=True`, or `in_plane` "
                "above 0"
            )
        blank.check_triangulated("bending")
        if "modulus" in given:
            if fabric is None:
                raise InputError(
                    f"`modulus` of the bending of {blank.name} needs a fabric, which no term of "
                    "the scene has; `D_a` needs none"
                )
            D = plate_stiffness(given["modulus"], fabric.thickness)
            self.stiffnesses = np.array(
                [D, D, 4 * plate_stiffness(given["twist_modulus"], fabric.thickness)]
            )
        else:
            self.stiffnesses = np.array([given["D_a"], given["D_b"], given["D_t"]], float)
        self._cells, self._dim = MorleyCells(blank, *self._edges), blank.mesh.geometry.dim
        operator, curved = self._cells.curvature(self.stiffnesses)
        if not self.part.is_whole:
            here = self._cells.of(self.part.cells)
            operator, curved, self._cells = operator[here], curved[here], self._cells.only(here)
        self._weights = self._cells.area[:, None] * self.stiffnesses
        self._own_curvature = np.where(
            np.abs(curved) < 1e-10 * np.abs(curved).max(initial=1e-300), 0, curved
        )
        if np.abs(curved).max(initial=0) * np.sqrt(self._cells.area.max(initial=0)) < 1e-10:
            self._own_curvature[:] = 0  # flat but for rounding
        self._now: _State | None = None
        self._gathered(operator)
        self.accept()

    # -- what a scene calls

    def accept(self) -> None:
        """Take normals from the present displacement."""
        U, dim = self._stencil.displacement(), self._dim
        own, self._now = self._own_curvature, None
        self._offset, self._directions = np.zeros_like(own), np.tile(np.eye(dim), (len(own), 1, 1))
        self._shares = np.full(dim, self.in_plane)  # of the stiffness, along these directions
        self._turning, self._origin = None, U
        P = np.broadcast_to(self.in_plane * np.eye(dim), (len(own), dim, dim))
        if dim == 3:
            corners = self._cells.corners + U[self._stencil.columns[:, :3]]
            edges, axes = np.roll(corners, -2, 1) - np.roll(corners, -1, 1), self._axes(corners)
            normal = axes[:, 2]
            self._shares = np.array([1.0, self.in_plane, self.in_plane] if self.in_plane else [1.0])
            self._directions = axes[:, [2, 0, 1]][:, : len(self._shares)].copy()
            P = P + (1 - self.in_plane) * normal[:, :, None] * normal[:, None]
            turned = np.einsum("cki,ckj->cij", axes, self._axes(self._cells.corners))
            self._offset = own - np.einsum("cij,ckj->cki", turned, own)
            torque = np.cross(self._bent(U)[1], self._curvature(U)).sum(1)
            area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)  # twice
            # gradients of the shape functions
            slopes = np.cross(normal[:, None], edges) / area[:, None, None]
            along = -np.einsum("ci,cni->cn", np.cross(torque, normal), slopes)
            turning = np.zeros((len(own), 12, dim))
            turning[:, :3] = along[:, :, None] * normal[:, None]
            self._turning = self._stencil.summed(turning)
        blocks = (self._pair_weights @ P.reshape(len(P), dim * dim)).reshape(-1, dim, dim)
        self._triplets = self._stencil.triplets(self._coupled, blocks)

    def stored(self) -> float:
        """Energy of this rank's owned cells [N mm]."""
        return self._state().energy

    def add_forces(self, f: np.ndarray) -> None:
        self._stencil.add_forces(self._state().forces.copy(), f)

    def tangent(self) -> Triplets:
        """As in `Term`, of this rank's owned cells' energy [N/mm]: a cell reaches over two
        neighbours, further than a rank's ghosts."""
        return self._triplets

    def curvatures(self) -> np.ndarray:
        """Second derivatives x,aa, x,bb, x,ab in each owned cell along the frame's axes,
        (cells, 3, gdim) [1/mm]."""
        return self._curvature(self._stencil.displacement())

    # --

    def _axes(self, corners):
        """Unit vectors along the first yarn, across it and normal to the cells with these corners,
        (cells, 3, 3)."""
        a = np.einsum("cn,cni->ci", self._cells.along_a, corners)
        a /= np.linalg.norm(a, axis=1, keepdims=True)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return np.stack([a, np.cross(normal, a), normal], 1)

    def _state(self):
        """Energy and forces at the present displacement, computed once."""
        U = self._stencil.displacement()
        if self._now is None or not np.array_equal(U, self._now.U):
            energy, _, forces = self._bent(U)
            if self._turning is not None:
                energy += float(np.vdot(self._turning, U - self._origin))
                forces += self._turning
            self._now = _State(U, energy, forces)
        return self._now

    def _bent(self, U):
        """Energy [N mm], moments (cells, 3, gdim), conjugate to the cells' curvatures [N mm mm],
        and forces on the nodes (nodes, gdim) [N], without what turning normals add."""
        bent = (self._operator @ U).reshape(self._offset.shape) + self._offset
        along = np.einsum("ckx,cax->cka", bent, self._directions)
        moment = self._weights[:, :, None] * self._shares * along
        moments = moment @ self._directions
        forces = self._operator.T @ moments.reshape(-1, self._dim)
        return 0.5 * float(np.vdot(along, moment)), moments, forces

    def _curvature(self, U):
        return (self._operator @ U).reshape(self._own_curvature.shape) + self._own_curvature

    def _gathered(self, operator):
        """Take the cells' `operator` (cells, 3, 12), and note who is needed where."""
        self._stencil = Stencil(self._cells)
        cell, k, n = at = np.nonzero(operator)
        entries = operator[at], (3 * cell + k, self._stencil.columns[cell, n])
        shape = 3 * len(operator), self._stencil.count
        self._operator = sparse.csr_matrix(entries, shape=shape)
        # the stiffness of a pair of nodes is the sum over cells of a number times the cell's P
        products = np.einsum("ck,cki,ckj->cij", self._weights, operator, operator, optimize=True)
        at, self._coupled = np.nonzero(products), self._stencil.coupled(products != 0)
        entries = products[at], (self._coupled.places[at], at[0])
        shape = self._coupled.count, len(operator)
        self._pair_weights = sparse.csr_matrix(entries, shape=shape)
