"""A strip that a moving grip pulls: what its tests have in common."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..core.fields import quantity
from ..core.rules import POSITIVE, SHARE
from ..job.job import Result
from ..results import measures
from ..scene.scene import Scene
from ..sheet.sheet import SheetFields, Values, declared_again
from ..sheet.specimen import can_be_graded
from .coupon import Coupon, CouponSetup


@dataclass(frozen=True, kw_only=True)
class Strip(Coupon):
    """A strip of `fabric`, gripped at its ends, of which one moves."""

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
        off = math.remainder(self.fibre_angle - 45.0, 90.0), self.yarn_angle - 90.0
        at_45 = max(map(abs, off)) < self.ANGLE_TOLERANCE
        if self.pattern is None and not self.sheet_file:
            values["pattern"] = "crossed" if at_45 or self._has_yarns_along() else "yarns"
            if at_45 and self.strain <= self.MAX_GRADED and can_be_graded(length, width):
                values["pattern"] = "graded"
        bends = getattr(self, "in_plane_bending", 0.0)
        if bends and not self.element and abs(off[0]) < self.ANGLE_TOLERANCE:
            values["element"] = "P1"
        return values

    def points_of_p2(self, cells_follow_yarns: bool) -> str:
        """Inner where cells off the yarns would lock, but not where yarns lie along the load, as
        their tension does not lock."""
        return "full" if cells_follow_yarns or self._has_yarns_along() else "inner"

    def _has_yarns_along(self):
        yarns = self.fibre_angle, self.fibre_angle + self.yarn_angle
        return any(abs(math.remainder(yarn, 180.0)) <= 1.0 for yarn in yarns)


class StripSetup(CouponSetup):
    """A strip, gripped at its ends, of which one moves by `stroke` [mm]; a subclass says how its
    yarns lie."""

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Displacement [mm] and reaction [N] of the moving grip."""
        return load * self.stroke, float(scene.reaction("moving grip")[0])

    def coarser(self) -> Strip | None:
        """As in `CouponSetup`, on quadratic cells along the yarns, which do not lock, but for
        outlines, own meshes, in-plane bending, and if the run has such cells."""
        data, sides = self.data, self.high - self.low
        follows = data.pattern in ("yarns", "graded")
        coarse = data.coarser(sides, 4 if self.blank.degree == 1 else 2)
        bends = getattr(data, "in_plane_bending", 0.0)
        if data.sheet_file or follows or bends or not coarse:
            return super().coarser()
        return replace(coarse, pattern="yarns", element="P2", integration=None)

    def prepare(self) -> None:
        """Set stroke and centre, with their warnings."""
        file, (length, width) = self.data.sheet_file, self.high - self.low
        self.stroke, self.centre = self.data.strain * length, (self.low + self.high) / 2
        self.has_centre = measures.covers(self.blank, self.centre)
        if file and width > length:
            sizes = f"{length:.4g} mm along x, in which it is pulled, and {width:.4g} mm along y"
            words = f"{file} is {sizes}: turn it by 90 deg if it is a strip along y"
            self.warnings.append(words)
        if not self.has_centre:
            self.warnings.append("the sheet has a hole at its centre, so nothing is known there")

    def near_centre(self) -> np.ndarray:
        """Mask of the owned cells within an eighth of the width of the centre (cells,)."""
        radius = (self.high - self.low)[1] / 8
        return measures.near(self.comm, self.blank.midpoints(), self.centre, radius)

    def ranges(self, result: Result) -> Values:
        """Least and largest strains and shear angles, and those between which 98 % of the area
        lies."""
        found, area = Values(), self.blank.areas()
        for name in ("log_eps_11", "log_eps_22", "eps_a", "eps_b", "shear_angle"):
            values, unit = result.fields[name], ""
            if name == "shear_angle":
                values, unit = np.degrees(values), "_deg"
            found[name + unit] = measures.extremes(self.comm, values)
            found[f"{name}_98_percent{unit}"] = measures.bulk(self.comm, values, area)
        low, high = found["shear_angle_deg"]
        return found | {"shear_angle_max_deg": max(-low, high)}
