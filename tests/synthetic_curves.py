"""Test curves that the law predicts, with noise."""

import dataclasses

import numpy as np

from fabric_fenicsx.identification import curves as data
from fabric_fenicsx.identification.curves import CompactionTest, Curve, Response, Sheet
from fabric_fenicsx.identification.curves.model import unit_inside
from fabric_fenicsx.material.compaction import Compaction
from fabric_fenicsx.material.homogeneous import lateral_strain, nominal
from fabric_fenicsx.material.laws.coupled import WovenFabric

# strains of synthetic tests at their end: eps_a, eps_b [-], gamma [deg]; the first and last are
# reached from 0 together
_Plan = dict[str, tuple[str, tuple[float | None, float | None, float | None]]]
_PAPER: _Plan = {
    "uniaxial_a": ("uniaxial_a", (0.03, 0, 0)),
    "uniaxial_b": ("uniaxial_b", (0, 0.03, 0)),
    "biaxial_1_1": ("biaxial", (0.02, 0.02, 0)),
    "biaxial_1_2": ("biaxial", (0.01, 0.02, 0)),
    "biaxial_2_1": ("biaxial", (0.02, 0.01, 0)),
    "shear": ("shear", (0, 0, 45)),
    "shear_tension_a": ("shear", (0.005, 0, 45)),
    "shear_tension_b": ("shear", (0, 0.005, 45)),
}
_MORE: _Plan = {
    "free_a": ("uniaxial_a", (0.03, None, 0)),
    "free_b": ("uniaxial_b", (None, 0.03, 0)),
    "tension_compression_a": ("biaxial", (0.03, -0.06, 0)),
    "tension_compression_b": ("biaxial", (-0.06, 0.03, 0)),
    "compression_a": ("compression_a", (-0.1, 0, 0)),
    "compression_b": ("compression_b", (0, -0.1, 0)),
    "shear_compression_a": ("shear", (-0.1, 0, 45)),
    "shear_compression_b": ("shear", (0, -0.1, 45)),
}
PLANS = {"paper": _PAPER, "all": _PAPER | _MORE}


def synthesise(
    fabric: WovenFabric,
    plan: str = "all",
    noise: float = 0.0,
    seed: int = 1,
    points: int = 30,
    balanced: bool | None = None,
) -> tuple[Sheet, tuple[Curve, ...]]:
    """Sheet and curves of a plan, with normal noise of each column's largest value, stated if above
    0; balanced: what the sheet says, by default what the fabric is."""
    random = np.random.default_rng(seed)
    stated = ("maximum", noise) if noise else None
    balanced = fabric.is_balanced if balanced is None else balanced
    curves = []
    for name, (test, ends) in PLANS[plan].items():
        kind = data.TESTS[test]
        places = [data.STRAINS.index(c) for c in kind.strains]
        along = 1 - ends.index(None) if None in ends else None
        strains = np.tile([e or 0.0 for e in ends], (points, 1)) * [1, 1, np.pi / 180]
        strains[:, places] *= np.arange(1, points + 1)[:, None] / points
        exact = strains.copy()
        if along is not None:
            exact[:, 1 - along] = lateral_strain(fabric, along, strains[:, along])
        stress = dict(zip(("sigma_a", "sigma_b", "tau"), nominal(fabric, exact).T))
        values = {c: stress[c] for c in kind.measured if c in stress}
        if along is not None:
            values[data.STRAINS[1 - along]] = exact[:, 1 - along]
        responses = []
        for c, v in values.items():
            v = v + noise * np.abs(v).max() * random.standard_normal(points)
            responses.append(Response(c, unit_inside(c), v, np.ones(points)))
        abscissa = max(places, key=lambda k: np.ptp(strains[:, k]))
        what = f"{name}.csv", test, strains, tuple(responses), np.arange(points), abscissa
        curves.append(Curve(*what, along, stated))
    known = fabric.name, fabric.thickness, fabric.density, balanced
    sheet = Sheet(*known, fibre_density=fabric.fibre_density)
    if plan == "all" and fabric.compaction:
        pressed = synthesise_compaction(sheet, fabric.compaction, noise, seed, points)
        sheet = dataclasses.replace(sheet, compaction=(pressed,))
    return sheet, tuple(curves)


def synthesise_compaction(
    sheet: Sheet, compaction: Compaction, noise: float = 0.0, seed: int = 1, points: int = 30
) -> CompactionTest:
    """The thickness of one ply that plates press with 0.5 kPa to 1 MPa; noise, seed and points as
    in `synthesise`."""
    p = np.geomspace(5e-4, 1.0, points)
    h = sheet.thickness * compaction.thickness(p)
    h = h + noise * h.max() * np.random.default_rng(seed).standard_normal(points)
    response = Response("thickness", "mm", h, np.ones(points))
    stated = ("maximum", noise) if noise else None
    return CompactionTest("compaction.csv", p, response, np.arange(points), stated)
