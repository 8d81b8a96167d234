"""Bending of fabric as tests tell it: in files, at a point, and in a sheet."""

import numpy as np
import pytest
from scipy.integrate import quad

import fabric_fenicsx as ff


def test_stiffness_of_cantilevers():
    """Weight times the cube of half the overhang, of each yarn: 9.81 m/s^2 of 375 g/m^2."""
    test = ff.MeasuredBending(cantilever_a=200.0, cantilever_b=160.0)
    assert test.stiffnesses(0.375) == pytest.approx([3.67875, 1.88352])


def test_a_loop_that_is_not_even():
    """Its threshold is the median of half its width, but for where less than half of that is left;
    there the way up tells the elastic part. Yarns stick up to 2 % of the largest curvature."""
    k = np.array([0.01, 0.02, 0.03, 0.04, 0.05])
    half = np.array([0.05, 0.06, 0.08, 0.016, 0.0])
    up, down = 5 * k + half, (5 * k - half)[-2::-1]
    test = ff.MeasuredBending(curvature=(0, *k, *k[-2::-1], 0), moment_a=(0, *up, *down, -0.05))
    assert test.thresholds == pytest.approx((0.06, 0.06))
    assert test.stuck == pytest.approx(0.001)
    bent = ff.MeasuredBending(curvature=(0, 0.01, 0.05), moment_a=(0.02, 0.12, 0.22))
    told = bent.respond(np.array([[0.01, -0.07]]), 1.0)  # beyond the end, by the last slope, 2.5
    assert told.moment == pytest.approx(np.array([[0.1, -0.25]]))
    two = ff.MeasuredBending(curvature=(-0.2, 0, 0, 0.1), moment_a=(-1.1, -0.04, 0.06, 0.9))
    assert two.stuck == pytest.approx(0.004) and two.thresholds == pytest.approx((0.06, 0.06))
    elastic = [0.05, 0.1, 0.15, 0.156, 0.19]
    assert test.respond(np.stack([k, -k], 1), 1.0).moment[:, 0] == pytest.approx(elastic)


UP = np.linspace(0, 0.2, 11)
MEASURED = {  # curvatures, and which way each is reached
    "a threshold": (UP, 1 + 0 * UP),
    "two faces": ([-0.2, -0.1, 0, 0, 0.1, 0.2], [-1, -1, -1, 1, 1, 1]),
    "a loop": (np.r_[UP, UP[-2::-1]], np.repeat([0, 1, -1], [1, 10, 10])),
    "a loop of two faces": (
        np.r_[UP, UP[-2::-1], -UP[1:], -UP[-2::-1]],
        np.repeat([0, 1, -1, 1], [1, 10, 20, 10]),
    ),
}


@pytest.mark.parametrize("kind", MEASURED)
def test_faces_thresholds_and_loops_of_measured_curves(kind):
    """The lower face is 1.6 times as stiff, where it is measured."""
    curvature, way = map(np.asarray, MEASURED[kind])
    stiffness = np.where(curvature < 0, 8.0, 5.0)
    moment = stiffness * curvature + 0.05 * way + 0.01 * (kind == "a loop of two faces")
    test = ff.MeasuredBending(curvature=tuple(curvature), moment_a=tuple(moment))
    assert test.thresholds == pytest.approx((0.05, 0.05))
    at = np.array([-0.3, -0.1, 0.0, 0.1, 0.3])
    below = 8.0 if min(curvature) < 0 else 5.0
    found = test.respond(np.stack([at, at], 1), 1.0)
    assert found.moment[:, 0] == pytest.approx(np.where(at < 0, below, 5.0) * at)
    work = quad(lambda c: test.respond(np.array([[c, c]]), 1.0).moment[0, 0], 0, -0.3)[0]
    assert found.energy[0, 0] == pytest.approx(work, rel=1e-7)
    high, low = (test.respond(np.array([[k, k]]), 1.0).moment for k in (0.1501, 0.1499))
    assert test.respond(np.full((1, 2), 0.15), 1.0).slope == pytest.approx((high - low) / 2e-4)
