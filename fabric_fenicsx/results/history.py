"""history.csv: one row an accepted step, written as it comes."""

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mpi4py import MPI

from ..solve.stepping import Accepted

ENERGIES = ("strain", "bending", "contact", "friction", "viscous")
COLUMNS = (
    "step", "load", "displacement_mm", "reaction_N", "strain_energy_Nmm", "bending_energy_Nmm", "contact_energy_Nmm",
    "friction_energy_Nmm", "viscous_energy_Nmm", "external_work_Nmm", "energy_imbalance", "iterations",
    "saddles", "shifts", "line_search_cuts", "cuts", "negative_pivots", "residual_N", "force_scale_N", "min_stability", "wall_s",
)  # fmt: skip


class History:
    """Rows of `COLUMNS`, kept as dicts in `rows` on every rank and flushed one by one to `path` on rank 0.

    rows: those of a run that is resumed.
    """

    def __init__(self, path: Path, comm: MPI.Comm, rows: Iterable[dict[str, Any]] = ()) -> None:
        self.rows = list(rows)
        self._file = open(path, "w", newline="") if comm.rank == 0 else None
        if self._file:
            self._writer = csv.DictWriter(self._file, COLUMNS)
            self._writer.writeheader()
            self._writer.writerows(self.rows)
            self._file.flush()

    def add(self, accepted: Accepted, displacement: float, reaction: float, min_stability: float) -> None:
        """Append an `Accepted` state at which the grips moved by `displacement` [mm] under `reaction` [N].

        min_stability: least ellipticity indicator of all points, see `material.stability`; a band is the material's only where it is negative.
        """
        report = accepted.report
        stored = sum(accepted.energies.values())
        row = {
            "step": len(self.rows), "load": accepted.load, "displacement_mm": displacement, "reaction_N": reaction,
            "external_work_Nmm": accepted.external_work,
            "energy_imbalance": abs(accepted.external_work - stored) / max(abs(stored), 1e-300) if accepted.load else 0.0,
            "saddles": report.saddles, "iterations": report.iterations, "shifts": report.shifts, "line_search_cuts": report.cuts, "cuts": accepted.cuts,
            "negative_pivots": report.negative_pivots, "residual_N": report.residuals[-1] if report.residuals else 0.0,
            "force_scale_N": report.scale, "min_stability": min_stability, "wall_s": round(accepted.wall, 4),
        } | {f"{kind}_energy_Nmm": accepted.energies.get(kind, 0.0) for kind in ENERGIES}  # fmt: skip
        self.rows.append(row)
        if self._file:
            self._writer.writerow(row)
            self._file.flush()

    def close(self) -> None:
        """Close the file."""
        if self._file:
            self._file.close()
