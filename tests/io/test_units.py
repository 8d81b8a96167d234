"""Factors from units in files to mm, MPa, g/cm3, g/m2, N mm, 1/mm, N and rad."""

import math

import pytest

from fabric_fenicsx.io import units

FACTORS = {
    "stress": {"MPa": 1, "kPa": 1e-3, "Pa": 1e-6, "GPa": 1e3},
    "length": {"mm": 1, "cm": 10, "m": 1e3, "um": 1e-3},
    "density": {"g/cm3": 1, "kg/m3": 1e-3},
    "areal_weight": {"g/m2": 1, "kg/m2": 1e3},
    "bending_stiffness": {"Nmm": 1, "Nm": 1e3},
    "curvature": {"1/mm": 1, "1/m": 1e-3},
    "line_moment": {"N": 1, "mN": 1e-3, "Nmm/mm": 1},
}


def test_factors_of_all_units():
    assert {kind: units.factors(kind) for kind in units.UNITS} == FACTORS
    assert units.ANGLE == {"rad": 1, "deg": pytest.approx(math.pi / 180)}
    assert units.STRAIN == {"-": 1, "%": 0.01}
    per_width = {"N/mm": 2, "N/m": 2e-3, "kN/m": 2}  # of a sheet of 0.5 mm
    assert units.stresses(0.5) == FACTORS["stress"] | {"N/mm2": 1} | per_width
    assert units.suffixes("density") == {"g_per_cm3": 0, "kg_per_m3": -3}
