"""Uniaxial tension of a woven strip along its yarns, built."""

import math
from typing import Any

import numpy as np

from ..identification.curves import Curve
from ..job.job import Result
from ..results import measures
from ..runtime.errors import InputError
from ..scene.supports import Supports, clamped_ends, rolling_ends
from .strip import INNER_ORDER, StripSetup


class TensileSetup(StripSetup):
    """A `Tensile` on its mesh."""

    @property
    def turned(self) -> float:
        """Angle from x to the length [rad]."""
        return math.radians(self.data.turned)

    def supports(self) -> Supports:
        """Grips at both ends."""
        ends = clamped_ends if self.data.grips == "clamped" else rolling_ends
        return ends(self.stroke)

    def order(self) -> float:
        """As in `Setup`: of meshes that are halved, 1.5 to 1.6 with linear cells, 1.8 to 1.9 with
        others, and less with inner points."""
        if self.data.integration == "inner":
            return INNER_ORDER
        return 1.5 if self.data.element in ("P1", "Q1") else 1.75

    def is_compared(self, curve: Curve) -> bool:
        """As in `StripSetup`: a tension test along the yarns that the run pulls."""
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
        """As in `StripSetup`: the strain is that of the grips."""
        if curve.free is None:
            self.warnings.append(
                f"`measured` {curve.file} is of held sides (lateral: held), while the sides of the "
                "run's strip are free, which lowers its force"
            )
        force = curve.responses[0].values * thickness * width
        return curve.strains[:, curve.abscissa] * length, force

    def quantities(self, result: Result) -> dict[str, Any]:
        """Strains at the middle, of 98 % of the area and extreme, and the width at the middle."""
        fields, blank, comm = result.fields, self.blank, self.comm
        area, degrees = blank.areas(), np.degrees(fields["shear_angle"])
        width = (self.high - self.low)[1]
        near = measures.near(comm, blank.midpoints(), self.centre, width / 8)
        strains = {name: fields[name] for name in ("log_eps_11", "log_eps_22")}
        reaction = result.rows[-1]["reaction_N"]
        at_middle = measures.mean(comm, fields["log_eps_22"], near * area)
        extremes = {k: measures.extremes(comm, e) for k, e in strains.items()}
        return {
            "log_eps_22_middle": at_middle if self.has_centre else None,
            **extremes,
            **{f"{k}_98_percent": measures.bulk(comm, e, area) for k, e in strains.items()},
            "shear_angle_98_percent_deg": measures.bulk(comm, degrees, area),
            "nominal_stress_MPa": reaction / (width * self.data.fabric.thickness),
            "log_eps_11_max": extremes["log_eps_11"][1],
            "log_eps_22_min": extremes["log_eps_22"][0],
            "eps_a": measures.extremes(comm, fields["eps_a"]),
            "eps_b": measures.extremes(comm, fields["eps_b"]),
            "shear_angle_deg": measures.extremes(comm, degrees),
            "shear_angle_max_deg": math.degrees(
                max(map(abs, measures.extremes(comm, fields["shear_angle"])))
            ),
            "width_at_middle_mm": self._width_at_middle(),
            **self.against_curves(result),
        }

    def _width_at_middle(self):
        """Width of the deformed strip at its middle, of the nodes within 2 % of its length."""
        blank, low, high = self.blank, self.low, self.high
        x, u = blank.along(blank.coordinates().T), blank.u.x.array.reshape(-1, len(low)).T
        distance = np.abs(x[0] - (low + high)[0] / 2)
        nearest = measures.extremes(self.comm, distance)[0]
        there = distance <= nearest + 0.02 * (high - low)[0]
        edges = measures.extremes(self.comm, (x + u)[1][there])
        return edges[1] - edges[0]


def strains_across(result: Result) -> str:
    """Words for the strain along yarns b at the middle, which finer meshes keep, and of the cell
    with the least, which they need not."""
    at = "no cell at the middle"
    if result.number("log_eps_22_middle") is not None:
        middle = result.formatted("log_eps_22_middle", ".2f", 100)
        at = f"log strain along yarns b at the middle {middle} %"
    least = result.formatted("log_eps_22_min", ".2f", 100)
    return f"{at} (least of a cell {least} %, which a finer mesh may lower)"
