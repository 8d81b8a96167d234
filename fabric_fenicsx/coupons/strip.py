"""Tests of a strip that a moving grip pulls, and measured curves laid over the simulated one."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..identification import curves
from ..identification.curves import Curve
from ..job.job import Result
from ..mechanics.shell.membrane import Membrane
from ..results.curve import Curves
from ..runtime.errors import InputError
from ..runtime.fields import number, text
from ..runtime.formatting import percent, rounded
from ..runtime.rules import POSITIVE, SHARE
from ..scene.scene import Scene
from .scenario import Scenario

SAME = 0.01  # of a length, by which specimens that count as equal may differ
# of forces with inner points: smaller than most strips' own, so that estimates cover their errors
INNER_ORDER = 0.5


@dataclass(frozen=True)
class Measured:
    """A measured curve, as the moving grip of the run's strip would show it: `displacement` (n,)
    [mm] and `force` (n,) [N], of a `file` of the kind `test`."""

    file: str
    test: str
    displacement: np.ndarray
    force: np.ndarray

    def rows(self) -> list[dict[str, float]]:
        """As rows of a history."""
        return [
            {"displacement_mm": float(d), "reaction_N": float(f)}
            for d, f in zip(self.displacement, self.force)
        ]

    def against(self, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """How far the simulated force is from the measured one at the measured points that the
        `rows` of a history cover [N], and over the largest measured force there."""
        d, force = (np.array([row[k] for row in rows]) for k in ("displacement_mm", "reaction_N"))
        there = self.displacement <= d[-1] * (1 + 1e-9)
        found: dict[str, Any] = {"file": self.file, "test": self.test}
        found |= {"points": len(there), "points_covered": int(there.sum())}
        names = "from_mm", "to_mm", "rms_N", "largest_N", "rms_of_peak", "largest_of_peak"
        x, measured = self.displacement[there], self.force[there]
        if not measured.any():  # of a run that ended early
            return found | dict.fromkeys(names)
        off = np.interp(x, d, force) - measured
        rms, largest = np.sqrt(np.mean(off**2)), np.abs(off).max()
        peak = np.abs(measured).max()
        return found | dict(
            zip(names, map(float, (x[0], x[-1], rms, largest, rms / peak, largest / peak)))
        )


@dataclass(kw_only=True)
class StripTest(Scenario):
    """A strip of `fabric`, gripped at its ends, of which one moves; a subclass says how its yarns
    lie.

    After construction `low` and `high` (2,), the corners of the sheet, and `stroke`, of the grip,
    are there [mm], and `laid`, the measured curves.
    """

    COMPARED: ClassVar[str] = ""  # tests that can be laid over the curve, in words

    length: float = number(
        None, POSITIVE, "of the specimen, along the load (200, or the mesh's) [mm]"
    )
    width: float = number(None, POSITIVE, "of the specimen (50, or the mesh's) [mm]")
    strain: float = number(0.10, SHARE, "nominal strain at full load: 0.1 is 10 %")
    measured: str | None = text(
        None,
        "test to lay over the curve: a CSV file as `identify` reads it, or a folder of some",
        "FILE|DIR",
    )

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Displacement [mm] and reaction [N] of the moving grip."""
        return load * self.stroke, float(scene.reaction("moving grip")[0])

    # -- what a subclass says

    def is_compared(self, curve: Curve) -> bool:
        """Whether a measured curve is of this kind of test."""
        raise NotImplementedError

    def as_measured(
        self, curve: Curve, thickness: float, length: float, width: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Displacement (n,) [mm] and force (n,) [N] of a strip of these sizes [mm] that `curve`
        tells, of a sheet of this thickness [mm]; doubts are added to `warnings`."""
        raise NotImplementedError

    # -- what a subclass uses

    def fabric_membrane(self) -> Membrane:
        """As in `Scenario`: by default with inner points where cells off the yarns would lock, but
        not where yarns lie along the load, as their tension does not lock."""
        blank = self.blank
        if self.integration is None and blank.degree == 2 and blank.triangulated:
            yarns = self.fibre_angle, self.fibre_angle + self.yarn_angle
            along = any(abs(math.remainder(yarn, 180.0)) <= 1.0 for yarn in yarns)
            follow = self.pattern == "yarns" or blank.whole.follows_yarns()
            self.integration = "full" if along or follow else "inner"
        return super().fabric_membrane()

    def grip(self) -> None:
        """Set `low`, `high` and `stroke` from the blank."""
        self.low, self.high = self.blank.extent()
        length, width = (self.high - self.low)[:2]
        self.stroke = self.strain * length
        if self.sheet_file and width > length:
            self.warnings.append(
                f"{self.sheet_file} is {length:.4g} mm along x, in which it is pulled, and "
                f"{width:.4g} mm along y: turn it by 90 deg if it is a strip along y"
            )

    def take_measured(self) -> None:
        """Set `laid`, the measured curves; InputError for those that can't be compared."""
        self.laid: list[Measured] = []
        if not self.measured:
            return
        sheet, found = _read(Path(self.measured))
        fitting = [curve for curve in found if self.is_compared(curve)]
        if not fitting:
            tests = " and ".join(sorted({curve.test for curve in found}))
            raise InputError(
                f"`measured` {self.measured} has no test for this study but {tests}; "
                f"allowed is {self.COMPARED}"
            )
        if abs(sheet.thickness / self.fabric.thickness - 1) > SAME:
            self.warnings.append(
                f"`measured` {self.measured} is of a sheet of {sheet.thickness:g} mm, the material "
                f"of {self.fabric.thickness:g} mm; forces are compared, not stresses"
            )
        length, width = map(float, (self.high - self.low)[:2])
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
            self.laid.append(Measured(curve.file, curve.test, displacement, force))

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

    def beside(self) -> Curves:
        """The measured curves, for curve.png."""
        return {
            f"measured: {each.file.removesuffix('.csv')}": (each.displacement, each.force)
            for each in self.laid
        }

    def against_curves(self, result: Result) -> dict[str, Any]:
        """For the quantities: what `Measured.against` says of each measured curve."""
        return {"measured": [m.against(result.rows) for m in self.laid]} if self.laid else {}


def measured_lines(result: Result) -> list[str]:
    """What a study says of its measured curves, a line each."""
    return [
        f"{found['file']}: simulated and measured force differ by {rounded(found['rms_N'])} N "
        f"r.m.s. and {rounded(found['largest_N'])} N at most, {percent(found['rms_of_peak'])} and "
        f"{percent(found['largest_of_peak'])} of the largest measured, from "
        f"{rounded(found['from_mm'])} to {rounded(found['to_mm'])} mm "
        f"({found['points_covered']} of {found['points']} points)"
        for found in result.summary["quantities"].get("measured", [])
        if found["rms_N"] is not None
    ]


def _read(path):
    """Sheet and curves of a data set, or of one of its files."""
    if path.name == "sheet.toml":
        path = path.parent
    if path.is_dir():
        return curves.read(path)
    beside = path.with_name("sheet.toml")
    for file in (path, beside):
        if not file.is_file():
            raise InputError(
                f"`measured` {path}: there is no {file}; allowed is a CSV file with a sheet.toml "
                "beside it, or their folder, as `identify` reads them"
            )
    sheet = curves.read_sheet(beside)
    return sheet, (curves.read_curve(path, sheet.thickness, sheet.stated),)
