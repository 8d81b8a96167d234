"""A strip that a moving grip pulls: what its tests have in common."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from ..core.fields import quantity
from ..core.rules import POSITIVE, SHARE
from ..job.job import Result
from ..results import measures
from ..scene.scene import Scene
from ..scene.supports import Supports, clamped_ends
from ..sheet.sheet import SheetFields, Values, declared_again
from ..sheet.specimen import blocks
from .coupon import Coupon


@dataclass(frozen=True, kw_only=True)
class Strip(Coupon):
    """A strip of `fabric`, gripped at its ends, of which one moves by `stroke`; a subclass says how
    its yarns lie."""

    CHEAP_FROM = 1000
    SIDES = {"length": 200.0, "width": 50.0}
    MAX_GRADED: ClassVar[float] = 0.2  # nominal strain, from where on graded cells would fold
    ANGLE_TOLERANCE: ClassVar[float] = 1e-6  # [deg], within which yarns count as at +-45 deg

    length: float = quantity(
        None, POSITIVE, "of the specimen, along the load (200, or the mesh's) [mm]"
    )
    width: float = quantity(None, POSITIVE, "of the specimen (50, or the mesh's) [mm]")
    strain: float = quantity(0.10, SHARE, "nominal strain at full load: 0.1 is 10 %")
    pattern: str = declared_again(
        SheetFields,
        "pattern",
        default=None,
        help="how rectangles are divided into cells (crossed with yarns along the length; at +-45 "
        "deg graded up to 20 % strain, else crossed; yarns at other angles)",
    )

    def defaults(self, nx: int) -> Values:
        """As in `Coupon`: also pattern and element, by the yarns."""
        values = super().defaults(nx)
        length, width = (values.get(name, getattr(self, name)) for name in self.SIDES)
        if self.pattern is None and not self.sheet_file:
            values["pattern"] = "crossed" if self.at_45 or self._has_yarns_along() else "yarns"
            count = blocks(length, width)
            if self.at_45 and self.strain <= self.MAX_GRADED and count:
                values["pattern"] = "graded"
                if "nx" in values:
                    # at least as many across as in a strip of four widths
                    values["nx"] = count * -(-nx // min(count, 4))
        if self.at_45 and not self.element and getattr(self, "bend_within", False):
            values["element"] = "P1"
        return values

    @property
    def at_45(self) -> bool:
        """True if yarns lie at +-45 deg to the load."""
        off = math.remainder(self.fibre_angle - 45.0, 90.0), self.yarn_angle - 90.0
        return max(map(abs, off)) < self.ANGLE_TOLERANCE

    def points_of_p2(self, cells_follow_yarns: bool) -> str:
        """Inner where cells off the yarns would lock, but not where yarns lie along the load, as
        their tension does not lock."""
        return "full" if cells_follow_yarns or self._has_yarns_along() else "inner"

    def _has_yarns_along(self):
        yarns = self.fibre_angle, self.fibre_angle + self.yarn_angle
        return any(abs(math.remainder(yarn, 180.0)) <= 1.0 for yarn in yarns)

    def supports(self) -> Supports:
        """Grips at both ends."""
        return clamped_ends(self.stroke)

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Displacement [mm] and reaction [N] of the moving grip."""
        return load * self.stroke, float(scene.reaction("moving grip")[0])

    def coarser(self) -> Self | None:
        """As in `Coupon`, but for outlines, own meshes, in-plane bending and quadratic `graded`
        cells on cells along the yarns, which do not lock: quadratic ones, of such a run cubic."""
        degree, as_usual = self.blank.degree, getattr(self, "bend_within", False)
        cubic = degree > 1 and self.pattern == "yarns"
        times = 3 if cubic else 4 if degree == 1 and not self._has_yarns_along() else 2
        coarse = self.with_larger_cells(self.high - self.low, times)
        as_usual = as_usual or self.sheet_file or (degree > 1 and self.pattern == "graded")
        if as_usual or not coarse:
            return super().coarser()
        values: Values = {"pattern": "yarns", "element": "P3" if cubic else "P2"}
        values["integration"] = None
        return replace(coarse, **values)

    @property
    def stroke(self) -> float:
        """Displacement of the moving grip at full load [mm]."""
        return self.strain * (self.high - self.low)[0]

    @property
    def has_centre(self) -> bool:
        """True if a cell lies at the centre; on all ranks together."""
        return measures.covers(self.blank, (self.low + self.high) / 2)

    def sheet_warnings(self) -> list[str]:
        """On a strip along y, and a hole at the centre."""
        length, width = self.high - self.low
        sizes = f"{length:.4g} mm along x, in which it is pulled, and {width:.4g} mm along y"
        across = f"{self.sheet_file} is {sizes}: turn it by 90 deg if it is a strip along y"
        hole = "the sheet has a hole at its centre, so there are no values there"
        doubts = {across: self.sheet_file and width > length, hole: not self.has_centre}
        return [words for words, is_true in doubts.items() if is_true]

    def near_centre(self) -> np.ndarray:
        """Mask of the owned cells within an eighth of the width of the centre (cells,)."""
        (_, width), centre = self.high - self.low, (self.low + self.high) / 2
        return measures.near(self.comm, self.blank.midpoints(), centre, width / 8)

    def ranges(self, result: Result) -> Values:
        """Least and largest strains and shear angles, and those between which 98 % of the area
        lies."""
        found, area = Values(), self.blank.areas()
        for name in ("log_eps_11", "log_eps_22", "eps_a", "eps_b", "shear_angle"):
            values, unit = result.fields[name], ""
            if name == "shear_angle":
                values, unit = np.degrees(values), "_deg"
            found[name + unit] = measures.extremes(self.comm, values)
            bulk = measures.quantiles(self.comm, values, area, (0.01, 0.99))
            found[f"{name}_98_percent{unit}"] = bulk  # extremes at corners grow as cells shrink
        low, high = found["shear_angle_deg"]
        return found | {"shear_angle_max_deg": max(-low, high)}
