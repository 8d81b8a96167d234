"""Built tests of a strip that a moving grip pulls, with measured curves laid over the run's."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ..identification.curves import Curve, read
from ..job.job import Result
from ..meshes.specimen import can_be_graded
from ..results import measures
from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..scene.scene import Scene
from .measured import Measured
from .setup import CouponSetup

GRADED = 0.2  # nominal strain up to which the mesh of a bias test is graded by default
SAME_ANGLE = 1e-6  # [deg], within which yarns count as at +-45 deg
SAME = 0.01  # of a length, by which specimens that count as equal may differ


class StripSetup(CouponSetup):
    """A strip, gripped at its ends, of which one moves by `stroke` [mm]; a subclass says how its
    yarns lie. `laid`: the measured curves."""

    def choose(self) -> None:
        """Choose pattern and element."""
        data, chosen = self.data, dict[str, str]()
        off = math.remainder(data.fibre_angle - 45.0, 90.0), data.yarn_angle - 90.0
        at_45 = max(map(abs, off)) < SAME_ANGLE
        if data.pattern is None and not data.sheet_file:
            chosen["pattern"] = "crossed" if at_45 or self._has_yarns_along() else "yarns"
            if at_45 and data.strain <= GRADED and can_be_graded(data.length, data.width):
                chosen["pattern"] = "graded"  # thin cells would fold in deep shear
        if getattr(data, "in_plane_bending", 0.0) and not data.element and abs(off[0]) < SAME_ANGLE:
            chosen["element"] = "P1"
        self.data = replace(data, **chosen)

    def _has_yarns_along(self):
        """True if yarns lie along the load."""
        yarns = self.data.fibre_angle, self.data.fibre_angle + self.data.yarn_angle
        return any(abs(math.remainder(yarn, 180.0)) <= 1.0 for yarn in yarns)

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Displacement [mm] and reaction [N] of the moving grip."""
        return load * self.stroke, float(scene.reaction("moving grip")[0])

    def is_compared(self, curve: Curve) -> bool:
        """True for a measured curve of this kind of test."""
        raise NotImplementedError

    def as_measured(
        self, curve: Curve, thickness: float, length: float, width: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Displacement (n,) [mm] and force (n,) [N] of a strip of these sizes [mm] by `curve`, of a
        sheet of this thickness [mm]; doubts are added to `warnings`."""
        raise NotImplementedError

    def integration(self) -> str:
        """Points of P2 cells: inner where cells off the yarns would lock, but not where yarns lie
        along the load, as their tension does not lock."""
        data, blank = self.data, self.blank
        if data.integration or not (blank.degree == 2 and blank.triangulated):
            return super().integration()
        follow = data.pattern == "yarns" or blank.whole.follows_yarns()
        return "full" if self._has_yarns_along() or follow else "inner"

    def on_other_cells(self) -> Any:
        """Quadratic cells along the yarns, which do not lock; None for outlines, own meshes,
        in-plane bending, and if the run has such cells."""
        data = self.data
        follows = data.pattern in ("yarns", "graded")
        if data.sheet_file or follows or getattr(data, "in_plane_bending", 0.0):
            return None
        coarse = data.on_coarser_mesh(times=4 if self.blank.degree == 1 else 2)
        return replace(coarse, pattern="yarns", element="P2", integration=None)

    def prepare(self) -> None:
        """Set stroke, centre and measured curves, with their warnings."""
        file, (length, width) = self.data.sheet_file, self.high - self.low
        self.stroke, self.centre = self.data.strain * length, (self.low + self.high) / 2
        self.has_centre = measures.covers(self.blank, self.centre)
        if file and width > length:
            self.warnings.append(
                f"{file} is {length:.4g} mm along x, in which it is pulled, and "
                f"{width:.4g} mm along y: turn it by 90 deg if it is a strip along y"
            )
        if not self.has_centre:
            self.warnings.append("the sheet has a hole at its centre, so nothing is known there")
        self.laid = self._measured(length, width) if self.data.measured else []

    def _measured(self, length, width):
        """The measured curves; InputError for those that can't be compared."""
        file, thickness = self.data.measured, self.data.fabric.thickness
        sheet, found = read(file)
        fitting = [curve for curve in found if self.is_compared(curve)]
        if not fitting:
            tests = " and ".join(sorted({curve.test for curve in found})) or "compaction"
            raise InputError(
                f"`measured` {file} has no test for this study but {tests}; "
                f"allowed is {self.data.COMPARED}"
            )
        if abs(sheet.thickness / thickness - 1) > SAME:
            self.warnings.append(
                f"`measured` {file} is of a sheet of {sheet.thickness:g} mm, the material "
                f"of {thickness:g} mm; forces are compared, not stresses"
            )
        laid = []
        for curve in fitting:
            self.warnings += [f"`measured` {curve.file}: {words}" for words in curve.remarks]
            self.warnings += filter(None, [self._other_size(curve, length, width)])
            displacement, force = self.as_measured(curve, sheet.thickness, length, width)
            first = displacement[np.flatnonzero(force)[0]]
            if first > self.stroke * (1 + 1e-9):
                raise InputError(
                    f"`measured` {curve.file} begins at {rounded(first, 4)} mm, and the run ends "
                    f"at {rounded(self.stroke, 4)} mm; allowed is a `strain` above "
                    f"{rounded(first / length)}"
                )
            laid.append(Measured(curve.file, curve.test, displacement, force))
        return laid

    def _other_size(self, curve, length, width):
        own = {"length": length, "height": length, "width": width}
        given = {key: size for key, size in curve.keys.items() if key in own}
        if all(abs(size / own[key] - 1) <= SAME for key, size in given.items()):
            return ""
        sizes = " and ".join(f"{key} {size:g} mm" for key, size in given.items())
        return (
            f"`measured` {curve.file} is of a strip of {sizes}, the run of one of "
            f"{length:g} x {width:g} mm; its forces are converted to that size, which strips "
            "follow only roughly"
        )

    def near_centre(self) -> np.ndarray:
        """Mask of the owned cells within an eighth of the width of the centre (cells,)."""
        radius = (self.high - self.low)[1] / 8
        return measures.near(self.comm, self.blank.midpoints(), self.centre, radius)

    def ranges(self, result: Result) -> dict[str, Any]:
        """Least and largest strains and shear angles, and those between which 98 % of the area
        lies."""
        fields, found = result.fields, dict[str, Any]()
        area = self.blank.areas()
        for name in ("log_eps_11", "log_eps_22", "eps_a", "eps_b", "shear_angle"):
            values, unit = fields[name], ""
            if name == "shear_angle":
                values, unit = np.degrees(values), "_deg"
            found[name + unit] = measures.extremes(self.comm, values)
            found[f"{name}_98_percent{unit}"] = measures.bulk(self.comm, values, area)
        low, high = found["shear_angle_deg"]
        return found | {"shear_angle_max_deg": max(-low, high)}

    def reference_curves(self) -> dict[str, tuple]:
        """The measured curves."""
        return {
            f"measured: {each.file.removesuffix('.csv')}": (each.displacement, each.force)
            for each in self.laid
        }

    def against_curves(self, result: Result) -> dict[str, Any]:
        """Quantities by which the run differs from each measured curve, see `Measured`."""
        return {"measured": [m.against(result.rows) for m in self.laid]} if self.laid else {}
