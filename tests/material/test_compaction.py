"""Compaction and fibres of a fabric in its material file."""

import math

import mpmath
import numpy as np
import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.material.compaction import growth, log_compaction

KOMEILI = ff.load("komeili")


def test_fibre_volume_fraction():
    """0.75 g/cm3 of fabric, of fibres of 2.5 g/cm3; half the thickness, or half the area, has twice
    the share."""
    fabric = KOMEILI.replace(fibre_density=2.5)
    assert fabric.fibre_volume_fraction(1.0) == pytest.approx(0.3)
    assert fabric.fibre_volume_fraction(0.5) == pytest.approx(0.6)
    assert fabric.fibre_volume_fraction(1.0, 0.8) == pytest.approx(0.3 / 0.8)
    glass = KOMEILI.replace(thickness=0.5, density=0.6, fibre_density=2.54, fibre_share=0.6)
    assert glass.fibre_volume_fraction(0.5) == pytest.approx(0.142, abs=5e-4)  # with its matrix
    with pytest.raises(InputError, match="fibre_density of material komeili is not known"):
        KOMEILI.fibre_volume_fraction(1.0)


def test_thickness_under_pressure():
    """p = p_0 (e^y - 1 - y), h = h_0 e^(-y / n), from the thickness under a pressure of its own."""
    y = np.array([1e-5, 9e-4, 1.1e-3, 0.3, 2.0, 7.0])
    with mpmath.workdps(40):
        pressure = np.array([float(mpmath.exp(v) - 1 - v) for v in y])
    assert growth(y) == pytest.approx(pressure, rel=1e-12)
    assert log_compaction(pressure) == pytest.approx(y, rel=1e-12)
    ply = ff.Compaction(12.0, onset=2e-3, pressure=2e-3 * pressure[3])
    told = ply.thickness(2e-3 * pressure)
    assert told == pytest.approx(np.exp((0.3 - y) / 12), rel=1e-12)
    fabric = KOMEILI.replace(compaction=ply, thickness=0.4)
    assert fabric.thickness_under(2e-3 * pressure[4]) == pytest.approx(0.4 * math.exp(-1.7 / 12))
    assert fabric.replace(compaction=None).thickness_under(9.0) == 0.4
    assert KOMEILI.thickness_under(1.0) == pytest.approx(0.697, abs=5e-4)  # n = 16, p_0 = 1 kPa
