"""Compaction and fibres of a fabric in its material file."""

import math

import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.runtime.errors import InputError

KOMEILI = ff.load("komeili")


def test_fibre_volume_fraction():
    """0.75 g/cm3 of fabric, of fibres of 2.5 g/cm3; half the thickness, or half the area, has twice
    the share."""
    fabric = KOMEILI.replace(fibre_density=2.5)
    assert fabric.fibre_volume_fraction(1.0) == pytest.approx(0.3)
    assert fabric.fibre_volume_fraction(0.5) == pytest.approx(0.6)
    sheared = math.cos(math.radians(30))
    assert fabric.fibre_volume_fraction(1.0, sheared) == pytest.approx(0.3 / sheared)
    thin = fabric.replace(thickness=0.2)  # of the same density
    assert thin.fibre_volume_fraction(0.2) == pytest.approx(0.3)
    glass = KOMEILI.replace(thickness=1.0, density=0.6, fibre_density=2.54, fibre_share=0.6)
    assert glass.fibre_volume_fraction(1.0) == pytest.approx(0.142, abs=5e-4)  # with its matrix
    with pytest.raises(InputError, match="fibre_density of material komeili is not known"):
        KOMEILI.fibre_volume_fraction(1.0)
