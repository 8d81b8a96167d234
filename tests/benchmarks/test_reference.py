"""Curves and fields are compared with the references as a reader and a camera see them; how values
are extrapolated."""

from pathlib import Path

import numpy as np
import pytest
from bench.reference import estimate
from bench.strips import GRID, curve_distance, field_distance

REFERENCE = Path(__file__).parents[2] / "studies" / "reference"


def test_fields_are_compared_as_a_camera_sees_them():
    """A finer mesh's displacements are nearer to the kept ones; a uniform shift changes no
    strain."""
    kept = np.loadtxt(REFERENCE / "bias10_grid.csv", delimiter=",", skiprows=1)
    x, u = GRID, kept[:, 2:].reshape(GRID.shape)
    assert kept[:, :2] == pytest.approx(x.reshape(-1, 2))
    assert field_distance(45.0, u + 3.0, u) == pytest.approx((0, 0), abs=1e-9)
    stretched = x * [0.01, 0.0]
    strain, angle = field_distance(45.0, stretched, 2 * stretched)
    E1, E2 = 0.01 + 0.01**2 / 2, 0.02 + 0.02**2 / 2
    assert strain == pytest.approx((E2 - E1) / E2, rel=1e-9)
    shear = np.degrees(np.diff([np.arctan2(k**2 - 1, 2 * k) for k in (1.01, 1.02)]))
    assert angle == pytest.approx(abs(shear[0]), rel=1e-9)


def test_a_curve_is_compared_as_a_reader_interpolates_it():
    """Of load squared, read off between two points: the chord is 1/4 above it in the middle; and
    half of it."""
    load = np.linspace(0, 1, 5)
    reference = np.stack([load, 3 * load**2])
    assert curve_distance([[0, 1], [0, 3]], reference) == pytest.approx(0.25)
    assert curve_distance([load, 1.5 * load**2], reference) == pytest.approx(0.5)


def test_a_series_is_extrapolated_with_its_own_order():
    """1 + 3 h^2 on h, h/2, h/4 gives 1; the bar reaches to the finest value and to the checks."""
    series = [1 + 3 * h**2 for h in (1, 0.5, 0.25)]
    found = estimate(series)
    assert found == pytest.approx((1, series[-1] - 1, 2))
    assert estimate(series, [0.5]).error == pytest.approx(0.5)
    found = estimate([1.0, 1.3, 1.2])  # not monotone: the finest, of no order
    assert found == (1.2, pytest.approx(0.2), None)
