"""Measured curves, as they are laid over the run of a strip."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..job.job import Result
from ..runtime.formatting import percent, rounded


@dataclass(frozen=True)
class Measured:
    """A measured curve, as the moving grip of the run's strip would show it: `displacement` (n,)
    [mm] and `force` (n,) [N], of a `file` of the kind `test`."""

    file: str
    test: str
    displacement: np.ndarray
    force: np.ndarray

    def against(self, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Distance of the simulated force from the measured one at the measured points that the
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


def measured_lines(result: Result) -> list[str]:
    """Sentences of a study on its measured curves, a line each."""
    return [
        f"{found['file']}: simulated and measured force differ by {rounded(found['rms_N'])} N "
        f"r.m.s. and {rounded(found['largest_N'])} N at most, {percent(found['rms_of_peak'])} and "
        f"{percent(found['largest_of_peak'])} of the largest measured, from "
        f"{rounded(found['from_mm'])} to {rounded(found['to_mm'])} mm "
        f"({found['points_covered']} of {found['points']} points)"
        for found in result.summary["quantities"].get("measured", [])
        if found["rms_N"] is not None
    ]
