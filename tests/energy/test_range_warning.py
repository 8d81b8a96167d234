"""States beyond the strains that a law's numbers are for."""

import math

import pytest
from builders import alone, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.energy.membrane_warnings import range_warnings
from fabric_fenicsx.material.laws.tabulated import Curve

YARN = Curve((-0.05, 0.0, 0.01, 0.03), (-0.5, 0.0, 35.0, 135.0))
TABLE = ff.TabulatedFabric(
    YARN, Curve(YARN.x[1:], YARN.y[1:]), Curve((0.0, 0.3, 0.6), (0.0, 0.1, 0.4))
)


def told(fabric, displacement):
    """Of columns of cells that are wider and wider: at 80 (k / 16)^2 mm."""
    blank = sheet(80, 20, 16, 4, shape=lambda x: x * (x / 80) ** (1, 0, 0))
    membrane = alone(blank, ff.Membrane(fabric))
    membrane.blank.u.interpolate(displacement)
    return range_warnings(membrane)


@pytest.mark.mpi
def test_share_of_the_area_and_the_furthest_strain_are_told():
    assert told(TABLE, lambda x: [0.03 * x[0] + 0.3 * x[1], -0.2 * x[1]]) == []
    assert told(TABLE, lambda x: [-0.0499 * x[0], 0 * x[1]]) == []
    (words,) = told(TABLE, lambda x: [0.01 * x[0] + 0.05 * (x[0] - 45) * (x[0] > 45), 0 * x[1]])
    start = "in 43.8 % of blank eps_a is beyond the table of warp, which ends at 3 %"
    assert words.startswith(start)
    assert "it reaches 6 %; there the stress stays at the table's last" in words
    (words,) = told(TABLE, lambda x: [-0.06 * x[0], 0 * x[1]])
    assert "eps_a is beyond the table of warp, which ends at -5 %: it reaches -6 %" in words
    for turn in (-0.7, 0.7):  # of yarns a alone
        c, s = math.cos(turn), math.sin(turn)
        (words,) = told(TABLE, lambda x: [(c - 1) * x[0], s * x[0]])  # noqa: B023
        end = "ends at 34.38 deg: it reaches 40.11 deg"
        assert f"gamma is beyond the table of shear, which {end}" in words
