"""Radioss' LAW58: its stresses by hand."""

import numpy as np
import pytest
from fabrics import LAW58


def test_stresses_as_the_guide_lists_them():
    e, g = np.array([-0.1, 0.0, 0.01, 0.05]), np.array([0.0, 0.4, 0.8, 1.2])
    sigma_a, sigma_b, tau = LAW58.derivatives(e, e, -g).first
    pull = np.where(e > 0, 1335 * e - 2000 * e**2, 1.335 * e)
    assert sigma_a == pytest.approx(pull, rel=1e-13)
    assert sigma_b == pytest.approx(np.where(e > 0, 900 * e, 0.9 * e), rel=1e-13)
    G = 0.6 * np.cos(0.8) ** 2
    beyond = G * np.tan(g) + (0.025 - G) * np.tan(0.8)
    assert tau == pytest.approx(-np.where(g > 0.8, beyond, 0.025 * np.tan(g)), rel=1e-13)


def test_beyond_their_softening_yarns_hold_their_stress():
    """As in OpenRadioss, E^2 / 2B."""
    fabric = LAW58.replace(E_a=100.0, E_b=100.0, B_a=2000.0)
    e, none = np.array([0.04, 0.05, 0.08, 0.12, 0.5]), np.zeros(5)
    parts, (sigma_a, sigma_b, _), tangent = fabric.derivatives(e, e, none)
    assert sigma_a == pytest.approx([2.4, 2.5, 2.5, 2.5, 2.5], rel=1e-14)
    assert sigma_b == pytest.approx(100 * e, rel=1e-14)
    assert parts[1:, 0] == pytest.approx(1 / 12 + 2.5 * (e[1:] - 0.05), rel=1e-14)
    assert tangent[0, 2:] == pytest.approx(0, abs=1e-12)
