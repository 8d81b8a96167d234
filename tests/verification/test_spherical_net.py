"""The net on a sphere against its equation with 30 digits, and against a published draping code."""

import mpmath
import numpy as np
import pytest
from nets import spherical_net


def exact_angle(s):
    """omega at s = u v / R^2 by mpmath, from the power series of the equation at s = 0.

    With p = pi/2 - omega: s p'' + p' = cos(p), so of p, cos(p) and sin(p) = q the coefficients
    follow from one another.
    """
    with mpmath.workdps(30):
        n = 60
        p, c, q = ([mpmath.mpf(0)] * (n + 1) for _ in range(3))
        c[0] = mpmath.mpf(1)
        for k in range(n):
            p[k + 1] = c[k] / (k + 1) ** 2
            slope = [(m + 1) * p[m + 1] for m in range(k + 1)]
            c[k + 1] = -mpmath.fsum(q[k - m] * slope[m] for m in range(k + 1)) / (k + 1)
            q[k + 1] = mpmath.fsum(c[k - m] * slope[m] for m in range(k + 1)) / (k + 1)
        return mpmath.polyval(p[::-1], mpmath.mpf(s))


@pytest.mark.parametrize("s", [0.0, 1e-4, 9.9e-4, 1.1e-3, 0.1, 0.5, 0.9])
def test_shear_angle_to_ten_digits(s):
    found = spherical_net.shear_angle(s, 1.0, 1.0)
    assert found == pytest.approx(float(exact_angle(s)), rel=1e-10, abs=1e-14)


def test_the_net_is_that_of_a_published_draping_code():
    """KinDrape's hemisphere, with pieces of 0.075 R (Krogh et al. 2021, doi 10.1007/s00158-021-
    02925-z; run at its commit ae9f14e)."""
    place = np.array([0.225, 0.375, 0.525, 0.675, 0.75])
    found = np.degrees(spherical_net.shear_angle(place, place, 1.0))
    assert found == pytest.approx([2.90, 8.05, 15.72, 25.81, 31.66], abs=0.02)
