"""Compression parameters as Figs 12 to 14 of Schäfer et al. vary them, and a formed ply in one
row."""

import textwrap
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from fabric_fenicsx.material.laws import Law

BASE = {"p_min": 0.75, "E_C": 1.3, "s_C": 100.0}  # E_C [MPa] = 2 d, of a yarn in compression
VARIED = {
    "p_min": (0.0, 0.125, 0.25, 0.375, 0.5, 0.75, 1.0),
    "E_C": (0.13, 1.3, 13.0, 130.0, 1300.0),
    "s_C": (10.0, 100.0, 1000.0),
}
FIGURES = {"p_min": 12, "E_C": 13, "s_C": 14}


def variants(names: Iterable[str]) -> list[tuple[str, float, dict[str, float]]]:
    """Each of the parameters `names` varied alone: (name, value, all values)."""
    return [(name, value, BASE | {name: value}) for name in names for value in VARIED[name]]


def changed(fabric: Law, values: Mapping[str, float]) -> Law:
    """`fabric` with these values of p_min, E_C and s_C."""
    return fabric.replace(p_min=values["p_min"], d=values["E_C"] / 2, s_C=values["s_C"])


def with_lost_ellipticity(grid: Any) -> Any:
    """A ply's PyVista grid with the cell field `ellipticity_lost`, 1 where it is."""
    grid.cell_data["ellipticity_lost"] = (grid.cell_data["stability_ellipticity"] < 0) * 1.0
    return grid


def shear_contrast(grid: Any) -> float:
    """Contrast of the shear angle of a ply's PyVista grid [deg], as in `postprocess.shape`."""
    from fabric_fenicsx.results import shape

    return float(np.degrees(shape.contrast(grid, "shear_angle")))


def row(
    name: str, value: float, summary: Mapping[str, Any], contrast: float, reason: str
) -> dict[str, Any]:
    """A line of parameters.csv of a ply with parameter `name` = `value`: its `summary` as in
    summary.json, contrast of the shear angle [deg], reason why it was not formed, or ""."""
    q = summary["quantities"]
    return {
        "figure": FIGURES[name],
        "parameter": name,
        "value": value,
        "stroke_reached": summary["stroke_reached"],
        "shear_angle_max_deg": q["shear_angle_max_deg"],
        "contrast_deg": contrast,
        "cells_that_lost_ellipticity": q["cells_that_lost_ellipticity"],
        "ellipticity_min": q["stability_ellipticity_min"],
        "log_eps_11_min": q["log_eps_11"][0],
        "log_eps_22_min": q["log_eps_22"][0],
        "draw_in_largest_mm": q["draw_in"]["largest_mm"],
        "punch_force_N": summary["reaction_N"],
        "reason": reason,
    }


def title(row: Mapping[str, Any]) -> str:
    """Title of a ply's map: its parameter and, if it was not formed to the end, the load that was
    reached and the reason."""
    words = f"{row['parameter']} = {row['value']:g}"
    if row["reason"]:
        words += f": ends at load {row['stroke_reached']:.2f}\n"
        words += textwrap.fill(row["reason"].split(";")[0], 55)
    return words
