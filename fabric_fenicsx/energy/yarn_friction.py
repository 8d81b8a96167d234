"""Friction between the yarns of a membrane, as they turn towards each other."""

from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from .. import dolfinx_compat as compat
from ..material.energy import Energy
from ..material.friction import Response, ShearFriction
from ..material.laws import Law
from ..sheet.part import Part
from . import membrane_energy
from .membrane_energy import Yarns

KIND = "yarn_friction"  # of energy: in springs, and dissipated up to now


class YarnFriction(Energy):
    """Friction of a fabric's `shear_friction`, integrated over a part by a rule of its own, with
    the sliding of each element at each point.

    It stands in the place of a law in `membrane_energy`: thickness and energy are of UFL constants.
    law: the fabric in such; yarns, rest: as the membrane's; degree: of quadrature.
    """

    law = "friction between yarns"

    def __init__(
        self, part: Part, friction: ShearFriction, law: Law, yarns: Yarns, rest: Expr, degree: int
    ) -> None:
        self.thickness, self._symbols = law.thickness, law.shear_friction
        self._part, self._friction = part, friction
        mesh, count = part.blank.mesh, len(friction.stiffness)
        self._state = fem.Function(compat.quadrature_space(mesh, degree, count + 1))
        # sliding of each element and dissipation at points, of which the part's are `_at`
        self._values = self._state.x.array.reshape(-1, count + 1)
        self._at = compat.dofmap(self._state.function_space)[part.cells]
        self.rules = [(1.0, part.dx(degree))]
        _, _, gamma = membrane_energy.strains(*membrane_energy.invariants(*yarns), rest)
        self._gamma = compat.PointEvaluation(gamma, mesh, degree, part.cells)
        self._energy = compat.form(membrane_energy.energy(yarns, rest, self, self.rules))
        start = np.repeat(self._gamma()[..., None], count + 1, -1)
        start[..., -1] = 0.0
        self._values[self._at] = start

    def energy(self, eps_a: Any, eps_b: Any, gamma: Any) -> tuple[Any, Any, Any]:
        """As of a law: of this step, and dissipated before."""
        *sliding, dissipated = ufl.split(self._state)
        assert self._symbols
        return 0.0, 0.0, self._symbols.energy(gamma, sliding) + dissipated

    def stored(self) -> float:
        """Energy of this rank's cells, elastic and dissipated up to now [N mm]."""
        return fem.assemble_scalar(self._energy)

    def response(self) -> Response:
        """At all points (cells, points), before `accept`."""
        return self._friction.respond(self._gamma(), self._values[self._at][..., :-1])

    def accept(self) -> None:
        now, known = self.response(), self._values[self._at]
        dissipated = known[..., -1:] + now.dissipated[..., None]
        self._values[self._at] = np.concatenate([now.sliding, dissipated], -1)

    def memory(self) -> np.ndarray:
        """Sliding and dissipation, in rows for `Term.cell_memory`."""
        known = self._values[self._at]
        return self._part.rows(known.reshape(-1, known.shape[-1]), known.shape[1])

    def recall(self, rows: np.ndarray) -> None:
        self._values[self._at] = rows[self._part.cells].reshape(*self._at.shape, -1)
