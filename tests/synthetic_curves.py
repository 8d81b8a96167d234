"""Test curves that the law predicts, with noise."""

import dataclasses

import numpy as np

from fabric_fenicsx.identification import curves as data
from fabric_fenicsx.identification.curves import CompactionTest, Curve, Response, Sheet
from fabric_fenicsx.identification.curves.model import unit_inside
from fabric_fenicsx.material.homogeneous import lateral_strain, nominal

# strains of synthetic tests at their end: eps_a, eps_b [-], gamma [deg]; the first and last are
# reached from 0 together
_PAPER = {
    "uniaxial_a": ("uniaxial_a", (0.03, 0, 0)),
    "uniaxial_b": ("uniaxial_b", (0, 0.03, 0)),
    "biaxial_1_1": ("biaxial", (0.02, 0.02, 0)),
    "biaxial_1_2": ("biaxial", (0.01, 0.02, 0)),
    "biaxial_2_1": ("biaxial", (0.02, 0.01, 0)),
    "shear": ("shear", (0, 0, 45)),
    "shear_tension_a": ("shear", (0.005, 0, 45)),
    "shear_tension_b": ("shear", (0, 0.005, 45)),
}
_MORE = {
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


def synthesise(fabric, plan="all", noise=0.0, seed=1, points=30, balanced=None):
    """Sheet and curves that the law predicts for the tests of a plan, with compaction in "all".

    noise: standard deviation, normal, of each column's largest value; stated in the curves if above
    0. balanced: what the sheet says, by default what the fabric is.
    """
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


def bias_displacement(gamma, height, width):
    """Of the clamp [mm], of a strip whose yarns, at 45 deg, do not stretch."""
    return (height - width) * (np.sqrt(2) * np.cos(np.pi / 4 - gamma / 2) - 1)


def bias_test(force, gamma, height, width, noise):
    """A raw bias test of a fabric of 1.2 mm; noise: a share of each value."""
    keys, strains = {"height": height, "width": width}, np.outer(gamma, [0, 0, 1])
    responses = (data.model.response("F", force, gamma, "bias_extension", keys, 1.2),)
    more = {"displacement": bias_displacement(gamma, height, width), "keys": keys}
    rows, stated = np.arange(len(gamma)), ("value", noise)
    return Curve("bias.csv", "bias_extension", strains, responses, rows, 2, noise=stated, **more)


def synthesise_compaction(sheet, compaction, noise=0.0, seed=1, points=30):
    """The thickness of one ply that plates press with 0.5 kPa to 1 MPa."""
    p = np.geomspace(5e-4, 1.0, points)
    h = sheet.thickness * compaction.thickness(p)
    h = h + noise * h.max() * np.random.default_rng(seed).standard_normal(points)
    response = Response("thickness", "mm", h, np.ones(points))
    stated = ("maximum", noise) if noise else None
    return CompactionTest("compaction.csv", p, response, stated)
