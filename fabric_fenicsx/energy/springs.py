"""Springs from nodes of a sheet to fixed anchors, as those of clamps around a blank."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import ufl
from mpi4py import MPI
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.rules import FROM_ZERO
from .assembly import assembled
from .load import vector_on
from .nodes import CoupledNodes, values_at
from .output import Value, joined, total
from .term import SceneFacts, Term, Triplets


class Springs(Term):
    """Springs that pull nodes of the sheet towards fixed anchors.

    Each pulls with preload + stiffness * elongation, and never pushes: below 0 it is slack. With
    only a preload the pull is constant, as of a weight over a roller. Stored energies count from
    where the sheet lies undeformed, so they are below 0 where springs have helped to move it.
    history.csv has the sum of the pulls, summary.json their force on the sheet, too.

    - where: function of undeformed points (3, n) [mm] to a mask (n,). If it marks sides of the
      sheet's outer edge, at both of their ends, each node on them counts by its share of their
      length; otherwise all nodes count alike
    - stiffness, preload: [N/mm] and [N], of all these springs together, from 0, not both 0. So they
      do not depend on the mesh. Of a quarter they are those of the modelled part
    - anchor: point (gdim,) [mm] to which all go; or arm: vector (gdim,) [mm] from each undeformed
      node to its own anchor, so that all are parallel
    - name: in history, summary and errors

    Raises InputError for numbers out of their range, unless one of `anchor` and `arm` is given, for
    a `where` that marks no node, and for an anchor at a node.

    Examples
    --------
    >>> strip = ff.Blank.rectangle(20, 10, nx=2)
    >>> clip = ff.Springs(lambda x: x[0] > 19.9, 2.0, preload=1.0, arm=(50, 0))
    >>> held = ff.Support("left", lambda x: x[0] < 0.1, (0, 1))
    >>> scene = ff.Scene(strip, [ff.Membrane(ff.load("komeili")), clip], [held])
    >>> strip.u.interpolate(lambda x: (-0.01 * x[0], 0 * x[1]))
    >>> round(clip.pull(), 6)  # 1 N and 2 N/mm of 0.2 mm
    1.4
    """

    name, energy_kind = "springs", "springs"

    def __init__(
        self,
        where: Callable[[np.ndarray], np.ndarray],
        stiffness: float,
        preload: float = 0.0,
        *,
        anchor: ArrayLike | None = None,
        arm: ArrayLike | None = None,
        name: str = "springs",
    ) -> None:
        self.name = name
        self._stiffness = FROM_ZERO.check(f"stiffness of {name} [N/mm]", stiffness)
        self._preload = FROM_ZERO.check(f"preload of {name} [N]", preload)
        if (anchor is None) == (arm is None):
            raise InputError(f"{name} need one of `anchor` and `arm`")
        self.where, self.arm = where, arm
        self._vector: tuple = ("anchor", anchor) if arm is None else ("arm", arm)

    def set_up(self, scene: SceneFacts) -> None:
        blank, gdim = scene.blank, scene.blank.mesh.geometry.dim
        shares = self._shares()
        nodes = np.flatnonzero(shares)
        self._share, x = shares[nodes], blank.along(blank.coordinates()[nodes].T).T
        name, vector = self._vector
        vector = blank.frame @ vector_on(blank, f"{name} of {self.name} [mm]", vector)
        self._from_anchor = (x if self.arm is None else 0 * x) - vector
        self._lengths = np.linalg.norm(self._from_anchor, axis=1)
        size = np.ptp(blank.extent(), axis=0).max()
        if blank.mesh.comm.allreduce(self._lengths.min(initial=np.inf), MPI.MIN) < 1e-6 * size:
            raise InputError(
                f"{self.name} have an anchor at one of their nodes, so they have no direction; "
                "expected an anchor away from all nodes"
            )
        self._dofs = gdim * nodes[:, None] + np.arange(gdim)
        first, each = blank.V.dofmap.index_map.local_range[0], np.arange(len(nodes))
        self._alone = CoupledNodes(first + nodes, each[:, None], dim=gdim)

    def _shares(self):
        """Share of each owned node, (owned nodes,), 0 where it has no spring; 1 in all."""
        blank = self.blank
        owned, gdim = blank.V.dofmap.index_map.size_local, blank.mesh.geometry.dim
        where = partial(values_at, self.where)
        try:
            side = ufl.TestFunction(blank.V)[0] * self.part.ds(where)
            shares = assembled(side)[::gdim]
        except InputError:  # none is marked, on any rank
            shares = (self.part.nodes & where(blank.coordinates()[:owned].T)).astype(float)
        if not (whole := blank.mesh.comm.allreduce(float(shares.sum()))):
            raise InputError(
                f"`where` of {self.name} selects no node of {self.part.name or blank.name}; "
                "expected 1 or more"
            )
        return shares / whole

    def _now(self):
        """Direction from the anchor (n, gdim), length [mm] and pull of each whole spring [N]."""
        away = self._from_anchor + self.blank.u.x.array[self._dofs]
        length = np.maximum(np.linalg.norm(away, axis=1), 1e-9 * self._lengths)
        pull = self._preload + self._stiffness * (length - self._lengths)
        return away / length[:, None], length, np.maximum(pull, 0.0)

    def stored(self) -> float:
        (_, length, pull), k = self._now(), self._stiffness
        if not k:
            return float(self._preload * self._share @ (length - self._lengths))
        return float(self._share @ (pull**2 - self._preload**2)) / (2 * k)

    def add_forces(self, f: np.ndarray) -> None:
        forces = self.applied_forces()
        f[: len(forces)] -= forces

    def tangent(self) -> Triplets:
        """As in `Term`: a block (gdim, gdim) for each node [N/mm]."""
        away, length, pull = self._now()
        along = away[:, :, None] * away[:, None, :]
        stiff = np.where(pull > 0, self._stiffness, 0.0)[:, None, None] * along
        stiff += (pull / length)[:, None, None] * (np.eye(away.shape[1]) - along)
        return self._alone.rows, self._alone.cols, (self._share[:, None, None] * stiff).ravel()

    def applied_forces(self) -> np.ndarray:
        away, _, pull = self._now()
        f = np.zeros(self.blank.V.dofmap.index_map.size_local * self.blank.mesh.geometry.dim)
        f[self._dofs] = -(self._share * pull)[:, None] * away
        return f

    def pull(self) -> float:
        """Sum of what the springs pull, whatever their directions, of all ranks [N]."""
        return self.blank.mesh.comm.allreduce(float(self._share @ self._now()[2]))

    def force(self) -> np.ndarray:
        """Force of all springs on the sheet along x, y, z, (gdim,) [N]."""
        away, _, pull = self._now()
        return self.blank.mesh.comm.allreduce(-(self._share * pull) @ away) @ self.blank.frame

    def history(self) -> dict[str, Value]:
        return {f"{'_'.join(self.name.split())}_pull_N": total(self.pull())}

    def summary(self) -> dict[str, Value]:
        longer = (self._now()[1] - self._lengths).max(initial=-np.inf)
        facts = {
            "pull_N": self.pull(),
            "force_N": self.force().tolist(),
            "largest_elongation_mm": self.blank.mesh.comm.allreduce(float(longer), MPI.MAX),
        }
        return {"springs": joined({self.name: facts})}
