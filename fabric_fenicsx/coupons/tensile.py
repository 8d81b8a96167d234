"""Uniaxial tension of a woven strip along its yarns."""

from dataclasses import dataclass

import numpy as np

from ..core.fields import choice, documented, quantity
from ..core.rules import FINITE
from ..job.job import Result
from ..results import measures
from ..scene.supports import Supports, clamped_ends, rolling_ends
from ..sheet.sheet import Values, declared_again
from .strip import Strip


@documented
@dataclass(frozen=True, kw_only=True)
class Tensile(Strip):
    """Uniaxial tension of a woven strip along its yarns.

    Raises
    ------
    InputError
        For a value that is not allowed; by `build` for a mesh that does not fit.

    References
    ----------
    Figs 8 and 10 of Schäfer et al.

    Examples
    --------
    >>> test = ff.Tensile(length=100, strain=0.01, nx=4, element="P1")
    >>> result = test.job(steps=2).run()
    >>> round(result.summary["reaction_N"], 1)  # N
    647.6
    """

    NAME = "tensile"
    HEADLINES = ("log_eps_22_middle", "width_at_middle_mm", "nominal_stress_MPa")

    strain: float = declared_again(Strip, "strain", default=0.03)
    grips: str = choice(
        "clamped",
        ("clamped", "rollers"),
        "rollers let the ends contract, so the state is homogeneous",
    )
    turned: float = quantity(0.0, FINITE, "rotation of the whole test in the plane [deg]")

    def supports(self) -> Supports:
        """Grips at both ends."""
        ends = clamped_ends if self.grips == "clamped" else rolling_ends
        return ends(self.stroke)

    def quantities(self, result: Result) -> Values:
        """Strains at the middle, of 98 % of the area and extreme, and the width at the middle."""
        near = self.near_centre() * self.blank.areas()
        at_middle = measures.mean(self.comm, result.fields["log_eps_22"], near)
        ranges, width = self.ranges(result), (self.high - self.low)[1]
        section = width * self.fabric.thickness
        return ranges | {
            "log_eps_22_middle": at_middle if self.has_centre else None,
            "log_eps_11_max": ranges["log_eps_11"][1],
            "log_eps_22_min": ranges["log_eps_22"][0],
            "nominal_stress_MPa": result.rows[-1]["reaction_N"] / section,
            "width_at_middle_mm": self._width_at_middle(),
        }

    def _width_at_middle(self):
        """Width of the deformed strip where its middle was: lines within cells are cut there."""
        blank, middle = self.blank, (self.low + self.high)[0] / 2
        x, u = blank.along(blank.coordinates().T), blank.u.x.array.reshape(-1, len(self.low)).T
        one, other = np.triu_indices(blank.cell_nodes.shape[1], 1)
        lines = blank.cell_nodes[:, [one, other]].swapaxes(0, 1).reshape(2, -1)
        ahead = x[0][lines] - middle
        cut = ahead.prod(0) <= 0
        (start, end), (a, b) = (x + u)[1][lines[:, cut]], ahead[:, cut]
        share = a / np.where(a == b, 1.0, a - b)
        edges = measures.extremes(self.comm, start + share * (end - start))
        return edges[1] - edges[0]
