"""Estimated errors of runs beside true ones: which runs, and how good the estimates are.

`benchmarks/error_estimates.py` makes the runs; docs/errors.md says which were not blind.
"""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fabric_fenicsx.results import measures
from fabric_fenicsx.results.error import field_differences
from fabric_fenicsx.results.result import Result

from .reference import curve_distance, reference_curve

Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A run of `test` with these options; all other options have their defaults."""

    test: str
    element: str
    nx: int
    pattern: str = "crossed"
    fibre_angle: float = 0.0

    def __str__(self) -> str:
        turned = f" {self.fibre_angle:g} deg" if self.test == "forming" else ""
        return f"{self.test}{turned} {self.element} {self.pattern} {self.nx}"


def _cases(test, element, pattern, *sizes, angle=0.0):
    return [Case(test, element, nx, pattern, angle) for nx in sizes]


STRIP_CASES = [
    *_cases("tensile", "P1", "crossed", 16, 24, 32, 48, 64),
    *_cases("tensile", "P2", "crossed", 12, 16, 24, 32, 48),
    *_cases("tensile", "P3", "crossed", 12, 16, 24),
    *_cases("tensile", "Q1", "crossed", 24, 48),
    *_cases("tensile", "Q2", "crossed", 16, 32),
    *_cases("tensile", "P2", "unstructured", 24, 48),
    *_cases("tensile", "P2", "left", 32),
    *_cases("bias10", "P1", "graded", 24, 32, 48, 64),
    *_cases("bias10", "P2", "graded", 24, 32, 48),
    *_cases("bias10", "P2", "crossed", 24, 32, 48),
    *_cases("bias10", "P1", "crossed", 32, 64),
    *_cases("bias10", "P3", "crossed", 16, 24),
    *_cases("bias10", "P2", "unstructured", 32, 48),
    *_cases("bias10", "P2", "left", 32),
    *_cases("bias30", "P2", "crossed", 24, 32, 48),
    *_cases("bias30", "P1", "crossed", 48),
]
OFF_AXIS_CASES = [
    *_cases("off30", "P2", "left", 24, 37),
    *_cases("off30", "P2", "crossed", 20, 28),
    *_cases("off30", "P2", "unstructured", 24, 35),
    *_cases("off20", "P2", "left", 37),
    *_cases("off20", "P2", "crossed", 28),
    *_cases("off20", "P2", "unstructured", 35),
    *_cases("off10", "P2", "left", 37),
    *_cases("off10", "P2", "crossed", 28),
    *_cases("off10", "P2", "unstructured", 35),
]
# forces of fine meshes [N], see docs/off_axis.md
OFF_AXIS = {
    "off30": {"reaction_N": {"value": 1.990, "error": 0.003}},
    "off20": {"reaction_N": {"value": 0.7135, "error": 0.002}},
    "off10": {"reaction_N": {"value": 95.96, "error": 0.3}},
}
FORMING_CASES = [
    *_cases("forming", "P1", "crossed", 8, 12, 16),
    *_cases("forming", "P1", "crossed", 8, 12, angle=45.0),
]
QUICK_CASES = [*_cases("tensile", "P2", "crossed", 8, 12)]
# what true errors are to, where studies/reference does not say
FINEST = {
    "tensile": Case("tensile", "P2", 96),
    "bias10": Case("bias10", "P2", 96, "graded"),
    "forming 0": Case("forming", "P1", 32),
    "forming 45": Case("forming", "P1", 24, fibre_angle=45.0),
}
QUICK_FINEST = {"tensile": Case("tensile", "P2", 24)}


def cases(quick: bool = False) -> list[Case]:
    """All of them, or few."""
    return QUICK_CASES if quick else [*STRIP_CASES, *OFF_AXIS_CASES, *FORMING_CASES]


def finest_of(case: Case, quick: bool = False) -> Case | None:
    """The run that is the reference of a case, None if there is none."""
    name = f"forming {case.fibre_angle:g}" if case.test == "forming" else case.test
    return (QUICK_FINEST if quick else FINEST).get(name)


def compare(
    case: Case,
    result: Result,
    finest: Result | None,
    known: Mapping[str, Mapping[str, float]] | None = None,
    folder: Path | None = None,
) -> list[Row]:
    """A row for each quantity of a run with estimated errors: true error, estimated one, what the
    true one is known to, and whether the estimate covers it.

    finest: the run that errors are to; known: quantities of the reference of a strip with values
    and error bars, which count more, and so does its curve, if it is in a `folder`.
    """
    errors, rows = result.summary["error"], []

    def add(quantity, true, bar):
        row = {"case": str(case), "test": case.test, "quantity": quantity, "true": float(abs(true))}
        row |= {"estimated": errors[quantity], "known_to": bar}
        rows.append(row | {"covered": bool(errors[quantity] + bar >= abs(true))})

    if known:
        for name, other in (("reaction_N", "reaction_N"), ("strain_energy_Nmm", "energy_Nmm")):
            if other in known:
                value = result.number(name)
                assert value is not None
                add(name, value - known[other]["value"], known[other]["error"])
    if known and folder:
        reference = reference_curve(folder, case.test)
        curve = np.array([(row["load"], row["reaction_N"]) for row in result.rows]).T
        scale = abs(reference[1, -1])
        add("curve_N", scale * curve_distance(curve, reference), known["reaction_N"]["error"])
    if finest is None:
        return rows
    for name in errors:
        mine, theirs = result.number(name), finest.number(name)
        if mine is not None and theirs is not None and name not in {r["quantity"] for r in rows}:
            add(name, mine - theirs, 0.0)
    if not known:
        fine = np.array([(row["load"], row["reaction_N"]) for row in finest.rows]).T
        curve = np.array([(row["load"], row["reaction_N"]) for row in result.rows]).T
        add("curve_N", abs(fine[1, -1]) * curve_distance(curve, fine), 0.0)
    area, comm = result.scene.blank.areas(), result.scene.comm
    for name, apart in field_differences(result, finest).items():
        root = float(np.sqrt(measures.mean(comm, apart**2, area) or 0.0))
        shear = name == "shear_angle"
        quantity = "shear_angle_rms_deg" if shear else f"{name}_rms"
        add(quantity, float(np.degrees(root)) if shear else root, 0.0)
    return rows


def judge(rows: Sequence[Row]) -> list[Row]:
    """For each quantity, and for all: number of cases, share that estimates cover, and sharpness,
    the median of estimated over true errors, of those that are known well enough to tell."""
    found = []
    for name in ["all", *dict.fromkeys(row["quantity"] for row in rows)]:
        mine = [row for row in rows if name in ("all", row["quantity"])]
        sharp = [r["estimated"] / r["true"] for r in mine if r["true"] > 2 * r["known_to"]]
        covered = sum(row["covered"] for row in mine)
        found.append(
            {
                "quantity": name,
                "cases": len(mine),
                "covered": covered / len(mine),
                "estimated_over_true": statistics.median(sharp) if sharp else None,
            }
        )
    return found


def line(row: Row) -> str:
    """A row of `judge` as text."""
    ratio = row["estimated_over_true"]
    words = "-" if ratio is None else f"{ratio:.2g}"
    return (
        f"{row['quantity']:34s} {row['cases']:4d} cases, {100 * row['covered']:5.1f} % covered, "
        f"estimated over true error {words} (median)"
    )


def draw(path: Path, rows: Sequence[Row]) -> None:
    """Estimated errors over true ones, both relative to the largest true one of the quantity and
    test; above the line estimates cover the truth."""
    from fabric_fenicsx.plot.pictures import curves

    largest: dict[tuple[str, str], float] = {}
    for row in rows:
        key = row["test"], row["quantity"]
        largest[key] = max(largest.get(key, 1e-300), row["true"])
    series: dict[str, Sequence] = {}
    for test, style in zip(
        dict.fromkeys(row["test"] for row in rows), ("C0o", "C1s", "C2^", "C3D")
    ):
        for local, shape in ((False, style), (True, style[:2] + "x")):
            mine = [r for r in rows if r["test"] == test]
            mine = [r for r in mine if (r["quantity"] not in WHOLE) == local]
            scale = [largest[test, r["quantity"]] for r in mine]
            true = [max(r["true"] / s, 1e-6) for r, s in zip(mine, scale)]
            bars = [max(r["estimated"] / s, 1e-6) for r, s in zip(mine, scale)]
            label = f"{test}, {'strains' if local else 'force, energy, curve'}"
            series[label] = true, bars, shape
    series["estimated = true"] = [1e-4, 1], [1e-4, 1], "k-"
    labels = "true error, of the test's largest", "estimated error, of the same"
    curves(path, series, *labels, scale="log")


WHOLE = "reaction_N", "strain_energy_Nmm", "curve_N", "nominal_stress_MPa", "punch_force_N"
