"""Uniaxial tension of a woven strip along its yarns, built."""

import math
from typing import Any

import numpy as np

from ..identification.curves import Curve
from ..job.job import Result
from ..results import measures
from ..runtime.errors import InputError
from ..scene.supports import Supports, clamped_ends, rolling_ends
from .strip import StripSetup


class TensileSetup(StripSetup):
    """A `Tensile` on its mesh."""

    def choose(self) -> None:
        super().choose()
        self.turned = math.radians(self.data.turned)

    def supports(self) -> Supports:
        """Grips at both ends."""
        ends = clamped_ends if self.data.grips == "clamped" else rolling_ends
        return ends(self.stroke)

    def is_compared(self, curve: Curve) -> bool:
        """True for a tension test along the yarns that the run pulls."""
        data = self.data
        if data.fibre_angle % 90 or data.yarn_angle != 90 or data.weave_angle not in (None, 90):
            raise InputError(
                f"`measured` {data.measured} is of yarns along the load and at right angles; "
                "allowed is `fibre_angle` 0 or 90, with neither `yarn_angle` nor `weave_angle`"
            )
        return curve.test == ("uniaxial_b" if data.fibre_angle % 180 else "uniaxial_a")

    def as_measured(
        self, curve: Curve, thickness: float, length: float, width: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Curve of the strip at the same strain of the grips."""
        if curve.free is None:
            self.warnings.append(
                f"`measured` {curve.file} is of held sides (lateral: held), while the sides of the "
                "run's strip are free, which lowers its force"
            )
        force = curve.responses[0].values * thickness * width
        return curve.strains[:, curve.abscissa] * length, force

    def quantities(self, result: Result) -> dict[str, Any]:
        """Strains at the middle, of 98 % of the area and extreme, and the width at the middle."""
        near = self.near_centre() * self.blank.areas()
        at_middle = measures.mean(self.comm, result.fields["log_eps_22"], near)
        ranges, width = self.ranges(result), (self.high - self.low)[1]
        section = width * self.data.fabric.thickness
        return ranges | {
            "log_eps_22_middle": at_middle if self.has_centre else None,
            "log_eps_11_max": ranges["log_eps_11"][1],
            "log_eps_22_min": ranges["log_eps_22"][0],
            "nominal_stress_MPa": result.rows[-1]["reaction_N"] / section,
            "width_at_middle_mm": self._width_at_middle(),
            **self.against_curves(result),
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


def strains_across(result: Result) -> str:
    """Sentence on the strain along yarns b at the middle, which finer meshes keep, and on the least
    of a cell, which they need not."""
    at = "no cell at the middle"
    if result.number("log_eps_22_middle") is not None:
        middle = result.formatted("log_eps_22_middle", ".2f", 100)
        at = f"log strain along yarns b at the middle {middle} %"
    least = result.formatted("log_eps_22_min", ".2f", 100)
    return f"{at} (least of a cell {least} %, which a finer mesh may lower)"
