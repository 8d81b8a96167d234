"""Forming with one setting after another made finer: what each costs and how far off it is."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

# setting -> its values, the last one the reference of the others; all else as the options say
SWEEPS = {
    "nx": (12, 24, 47, 94),
    "steps": (10, 20, 40, 160),
    "lag": (1.0, 0.1, 0.01, 0.001),
    "path_tolerance": (1e-1, 1e-2, 1e-3, 1e-6),
    "penalty": (200.0, 800.0, 3200.0, 12800.0),
    "slip": (0.8, 0.4, 0.1, 0.01),
}
QUICK_SWEEPS = {"nx": (6, 10), "steps": (5, 10)}
JUDGED = "punch_force_N", "shear_angle_max_deg", "draw_in_mm", "strain_energy_Nmm"


def row(name: str, value: float, summary: Mapping[str, Any]) -> dict[str, Any]:
    """A line of the table: the `summary` of a run with setting `name` at `value`."""
    s, q = summary, summary["quantities"]
    return {
        "factor": name,
        "value": value,
        "cells": s["cells"],
        "steps": s["steps_accepted"],
        "rejected": s["steps_rejected"],
        "iterations": s["newton_iterations"],
        "wall_s": s["wall_s"]["total"],
        "memory_mib": s["peak_memory_mib"],
        "punch_force_N": q["punch_force_N"],
        "shear_angle_max_deg": q["shear_angle_max_deg"],
        "draw_in_mm": q["draw_in"]["largest_mm"],
        "strain_energy_Nmm": s["energy"]["strain"],
        "penetration_of_thickness": q["penetration_of_thickness"],
        "energy_imbalance": s["energy_imbalance"],
        "viscous_of_strain_energy": q["viscous_of_strain_energy"],
    }


def judge(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Add to the rows of one setting their relative errors, of the last and finest one; a sentence
    for each."""
    finest = rows[-1]
    for each in rows:
        for quantity in JUDGED:
            each[f"error_{quantity}"] = each[quantity] / finest[quantity] - 1
        shear = each["shear_angle_max_deg"] - finest["shear_angle_max_deg"]
        yield (
            f"{each['factor']} {each['value']:g}: {each['wall_s']:.3g} s, {each['iterations']} "
            f"iterations; off {finest['value']:g}'s: punch force "
            f"{each['error_punch_force_N']:.2%}, shear angle {shear:.2f} deg, draw-in "
            f"{each['draw_in_mm'] - finest['draw_in_mm']:.3f} mm, strain energy "
            f"{each['error_strain_energy_Nmm']:.2%}"
        )
