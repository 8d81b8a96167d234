"""A run whose accepted states are checked anew: whether each is an equilibrium and a minimum."""

from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fabric_fenicsx.results import measures
from fabric_fenicsx.scene.scene import Scene
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.settings import Settings
from fabric_fenicsx.solve.stepping import LoadStepping

TOLERANCE = 1e-8  # of the residual over the reaction


class AuditedRun:
    """A scene taken to its end: `outcome` and `energy` [N mm] there. `faults` names accepted states
    whose residual, assembled anew, is above the tolerance or whose tangent, factorised anew, has
    negative pivots.

    steps, options: of `Settings`; tolerance: of the residual over the reaction.
    on_accept: is also called with this run and each accepted state.
    """

    def __init__(
        self,
        scene: Scene,
        steps: int = 20,
        tolerance: float = TOLERANCE,
        on_accept: Callable[["AuditedRun", Any], None] | None = None,
        **options: Any,
    ) -> None:
        self.faults: list[str] = []
        self._on_accept = on_accept
        self.scene, self.comm = scene, scene.comm
        self.size = np.ptp(scene.blank.extent(), axis=0).max()
        self.newton = Newton(scene, tolerance)
        settings = Settings(steps=steps, path_tolerance=None, **options)
        self.outcome = LoadStepping(self.newton, settings, on_accept=self._accept).run()
        self.energy = scene.energy()

    def _accept(self, accepted):
        self._audit(accepted)
        if self._on_accept:
            self._on_accept(self, accepted)

    def _audit(self, accepted):
        if accepted.load == 0:
            return
        newton, scene, tangent = self.newton, self.scene, self.newton.tangent
        r, correction = scene.u.duplicate(), scene.u.duplicate()
        scene.residual(r)
        tangent.assemble()
        norm, scale = r.norm(), scene.force_scale()
        negative = tangent.negative_pivots()
        tangent.solve_with_last_factors(r, correction)
        # of positions, through the tangent
        rounding = 2.0**-52 * self.size * tangent.A.getDiagonal().norm()
        at_rounding = (
            norm <= rounding or correction.norm(PETSc.NormType.NORM_INFINITY) <= 1e-14 * self.size
        )
        if norm > newton.tolerance * scale and not at_rounding:
            self.faults.append(
                f"residual {norm:.1e} N of {scale:.1e} N at load {accepted.load:.4g}"
            )
        if negative:
            self.faults.append(
                f"{negative} negative pivots ({accepted.report.negative_pivots} told) at load "
                f"{accepted.load:.4g}"
            )

    @property
    def reached(self) -> bool:
        """Whether it came to full load."""
        return not self.outcome.reason

    @property
    def u(self) -> np.ndarray:
        """Displacement of this rank's owned nodes, (nodes, gdim) [mm]."""
        owned = self.scene.blank.V.dofmap.index_map.size_local
        return self.scene.blank.nodal_displacement()[:owned]

    @property
    def ended_plainly(self) -> bool:
        """Whether it came to full load or said why not."""
        return self.reached or bool(self.outcome.reason)

    @property
    def ending(self) -> str:
        """Why it stopped, or that it came to full load."""
        return self.outcome.reason or "whole load"

    @property
    def state(self) -> Any:
        """The pointwise state of the membrane, the scene's first term."""
        membrane: Any = self.scene.terms[0]
        return membrane.state()[0]

    @property
    def shear(self) -> np.ndarray:
        """Shear angle at this rank's points, (cells, points) [rad]."""
        return self.state.invariants[:, :, 3]

    @property
    def eps_b(self) -> np.ndarray:
        """Strain of yarns b at this rank's points, (cells, points)."""
        return np.sqrt(self.state.invariants[:, :, 2]) - 1

    def spread_of_eps_b(self) -> float:
        """Largest less smallest strain of yarns b on all ranks."""
        low, high = measures.extremes(self.comm, self.eps_b)
        return high - low

    def largest(self, values: np.ndarray) -> float:
        """Largest magnitude of the `values` of all ranks; 0 of none."""
        return self.comm.allreduce(float(np.abs(values).max(initial=0.0)), MPI.MAX)
