"""history.csv: one row an accepted step, written as it comes."""

import csv
import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path

from mpi4py import MPI

from ..core.errors import InputError
from ..core.files import plain
from ..core.formatting import percent, rounded, share
from ..solve.progress import Accepted
from .verdict import Numbers

ENERGIES = "strain", "bending", "contact", "friction", "viscous"  # whose columns are always there
COLUMN = "_energy_Nmm"  # after a kind


class History:
    """Rows, kept as dicts in `rows` on every rank and flushed one by one to `path` on rank 0; after
    the columns of any run those of the scene's further energies and terms. rows: those of a run
    that is resumed."""

    def __init__(self, path: Path, comm: MPI.Comm, rows: Iterable[Numbers] = ()) -> None:
        self.rows, self._path = list[Numbers](), path if comm.rank == 0 else os.devnull
        for row in rows:
            self._append(row)

    def add(
        self,
        accepted: Accepted,
        displacement: float,
        reaction: float,
        further: Callable[[Collection[str]], Numbers],
    ) -> None:
        """Append an `Accepted` state at which the grips moved by `displacement` [mm] under
        `reaction` [N]; further: function of the columns that are taken to those that the terms
        add, `scene.output.history`. Raises InputError if these are others than before."""
        report, stored = accepted.report, sum(accepted.energies.values())
        imbalance = share(abs(accepted.external_work - stored), stored)
        row = {
            "step": len(self.rows),
            "load": accepted.load,
            "displacement_mm": displacement,
            "reaction_N": reaction,
            **{f"{kind}{COLUMN}": 0.0 for kind in ENERGIES},
            "external_work_Nmm": accepted.external_work,
            "energy_imbalance": imbalance if accepted.load else 0.0,
            "iterations": report.iterations,
            "saddles": report.saddles,
            "shifts": report.shifts,
            "line_search_cuts": report.cuts,
            "cuts": accepted.cuts,
            "negative_pivots": report.negative_pivots,
            "residual_N": report.residuals[-1] if report.residuals else 0.0,
            "force_scale_N": report.scale,
            "min_stability": None,  # which terms fill
            "wall_s": round(accepted.wall, 4),
            **{f"{kind}{COLUMN}": energy for kind, energy in accepted.energies.items()},
        }
        row = plain(row | further(row.keys() - {"min_stability"}))
        if self.rows and (other := row.keys() ^ self.rows[0].keys()):
            some = "no longer" if other & self.rows[0].keys() else "now"
            raise InputError(
                f"at load {rounded(accepted.load, 6)} the terms {some} return the column "
                f"{sorted(other)[0]} of history.csv; expected the same columns in each `history`"
            )
        self._append(row)

    def _append(self, row):
        self.rows.append(row)
        with open(self._path, "a" if self.rows[1:] else "w", newline="") as file:
            writer = csv.DictWriter(file, list(self.rows[0]))
            if not self.rows[1:]:
                writer.writeheader()
            writer.writerow(row)


def energy_balance(rows: Sequence[Numbers], energy: Mapping[str, float]) -> Numbers:
    """Agreement of work and energies [N mm] at the end and, over the largest energies, on the way,
    and loads where the path branches; energy: by kind, with `external_work`."""
    stored = sum(energy.values()) - energy["external_work"]
    kinds = [f"{kind}{COLUMN}" for kind in energy if kind != "external_work"]
    stores = [abs(sum(row[kind] for kind in kinds)) for row in rows]
    missing = [row["energy_imbalance"] * each for row, each in zip(rows, stores)]
    at = missing.index(max(missing))
    worst = share(missing[at], max(stores))
    return {
        "energy_imbalance": share(abs(energy["external_work"] - stored), stored),
        "energy_imbalance_largest": {"value": worst, "load": rows[at]["load"]},
        "branches": [row["load"] for row in rows if row["saddles"]],
    }


def stretching(energy: Mapping[str, float]) -> float:
    """What stretching stores of energies by kind, with kinds of some terms, as metal's [N mm]."""
    return energy["strain"] + sum(
        value for kind, value in energy.items() if kind not in (*ENERGIES, "external_work")
    )


def energies_of(row: Numbers) -> dict[str, float]:
    """Energies of a row by kind [N mm]."""
    return {k.removesuffix(COLUMN): v for k, v in row.items() if k.endswith(COLUMN)}


def viscous_warning(rows: Sequence[Numbers], load: float) -> str:
    """A warning when the regularisation's share of the strain energy exceeds 1 %, else ""."""
    shares = [share(row["viscous_energy_Nmm"], stretching(energies_of(row))) for row in rows[-2:]]
    if [each > 0.01 for each in shares] != [False, True]:
        return ""
    at = f"at load {rounded(load, 6)} (step {len(rows) - 1})"
    return (
        f"{at} the regularisation took {percent(shares[-1])} of the strain energy; use "
        "smaller steps (`max_step`) or check for a snap there"
    )
