"""Maps over the yarn strains of where the law loses convexity and ellipticity, and of how far its
kernel is from its closed form."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from fabric_fenicsx.material import stability
from fabric_fenicsx.material.homogeneous import conjugate, gradient
from fabric_fenicsx.material.kernel import evaluate
from fabric_fenicsx.material.laws import Law
from fabric_fenicsx.material.laws.base import stresses_of_energy

LOW, HIGH = -0.20, 0.08  # yarn strains of the maps
GAMMA = 0, 20, 40  # deg
P_MIN = 0.0, 0.1, 0.25, 0.4, 0.5, 0.75, 1.0
AS_GIVEN = {"as given": ({}, 0), "p_min 0.25": ({"p_min": 0.25}, 0)}
SHEARED: dict[str, tuple[dict[str, float], float]] = {f"{g} deg": ({}, g) for g in GAMMA}
# picture -> ({column: changed parameters}, {row: (changed parameters, gamma in deg)})
PICTURES: Mapping[str, tuple[Mapping[str, Any], Mapping[str, tuple[Any, float]]]] = {
    "p_min": ({f"p_min {p:g}": {"p_min": p} for p in P_MIN}, SHEARED),
    "c": ({f"c {v:g}": {"c": v} for v in (5, 10, 23.67, 40, 80)}, AS_GIVEN),
    "d": ({f"d {v:g} MPa": {"d": v} for v in (0.065, 0.65, 6.5, 65, 650)}, AS_GIVEN),
    "s_C": (
        {f"s_C {v:g}": {"s_C": v} for v in (0, 10, 100, 300, 1000)},
        {k: v for k, v in SHEARED.items() if v[1]},
    ),
}

# (convexity, ellipticity) indicators (n, n) by (row, column) of a picture
Panels = dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]


def stability_maps(
    fabric: Law, strains: np.ndarray
) -> tuple[dict[str, Panels], dict[str, dict[str, float]]]:
    """For each of PICTURES its `Panels`, over eps_a and eps_b of `strains` (n,); and for each panel
    the shares of the map in which convexity, ellipticity and stability out of plane are lost."""
    maps: dict[str, Panels] = {}
    shares = {}
    for name, (columns, rows) in PICTURES.items():
        maps[name] = {}
        for row, (common, gamma) in rows.items():
            for column, changed in columns.items():
                states = stability.invariants(strains, strains[:, None], np.radians(gamma))
                found = stability.evaluate(fabric.replace(**common | changed), states)
                maps[name][row, column] = found.convexity, found.ellipticity
                shares[f"{row}, {column}"] = {
                    indicator: round(float((getattr(found, indicator) < 0).mean()), 4)
                    for indicator in ("convexity", "ellipticity", "out_of_plane")
                }
    return maps, shares


def kernel_difference(fabric: Law, strains: np.ndarray) -> float:
    """Largest difference of the kernel's nominal stresses from the closed form, over eps_a and
    eps_b of `strains` (n,) at shear angles GAMMA; relative, or to s1 where they are smaller."""
    worst = 0.0
    for gamma in np.radians(GAMMA):
        states = [v.ravel() for v in np.broadcast_arrays(strains[:, None], strains, gamma)]
        F = gradient(*states)
        kernel = conjugate(F @ evaluate(fabric, gradient=F).S, F)
        closed = np.stack(stresses_of_energy(fabric, *states), -1)
        scale = np.maximum(np.linalg.norm(closed, axis=1), fabric.shear_stiffness)
        worst = max(worst, float((np.abs(kernel - closed).max(1) / scale).max()))
    return worst
