"""Nets of yarns that do not stretch, against their own geometry."""

import math

import numpy as np
import pytest

from fabric_fenicsx.coupons.pin_jointed import PinJointedStrip

RIGHT = math.pi / 2


def at_angle(degrees, length=200.0, width=50.0):
    return PinJointedStrip(length, width, math.radians(degrees), math.radians(degrees) + RIGHT)


def deformed(strip, displacement, x, y):
    """Places of the net p(alpha) + q(beta), from the turns of the yarns alone, by the lengths of
    yarn between clamps."""
    a, b = strip.a, strip.b
    to_yarns = np.linalg.inv([[np.cos(a), np.cos(b)], [np.sin(a), np.sin(b)]])
    places = to_yarns @ [x, y]
    moved = np.array([x, y], float)
    for own, angle, turn in zip(range(2), (a, b), strip.turns(displacement)):
        corners = [np.repeat([0, strip.length], 2), np.tile([0, strip.width], 2)]
        ends = np.sort(to_yarns[own] @ corners)[1:3]  # the stretch between the clamps
        share = np.clip(places[own], *ends) - ends[0 if to_yarns[own, 0] > 0 else 1]
        change = np.exp(1j * (angle + turn)) - np.exp(1j * angle)
        moved += np.outer([change.real, change.imag], share)
    return moved


@pytest.mark.parametrize("a, b", [(45, 135), (60, 150), (-40, 50), (50, -40), (25, 95), (20, -50)])
def test_clamps_move_rigidly_and_yarns_keep_their_lengths(a, b):
    strip = PinJointedStrip(200.0, 50.0, math.radians(a), math.radians(b))
    d = 3.0
    y = np.linspace(0, 50, 11)
    np.testing.assert_allclose(deformed(strip, d, 0 * y, y), [0 * y, y], atol=1e-10)
    np.testing.assert_allclose(deformed(strip, d, 0 * y + 200, y), [0 * y + 200 + d, y], atol=1e-10)
    rng = np.random.default_rng(1)
    x, y = rng.uniform((0, 0), (200, 50), (200, 2)).T
    moves = [
        (deformed(strip, d, x + h, y + k) - deformed(strip, d, x - h, y - k)) / 2e-5
        for h, k in ((1e-5, 0), (0, 1e-5))
    ]
    gradient = np.stack(moves, 1)  # of places, (2, 2, n)
    fa, fb = (np.einsum("ijn,j->in", gradient, [np.cos(k), np.sin(k)]) for k in (strip.a, strip.b))
    (_, _), distance = strip.held(x, y)
    off = distance > 1e-3
    for f in (fa, fb):
        np.testing.assert_allclose(np.linalg.norm(f[:, off], axis=0), 1, atol=1e-8)
    initial = math.acos(math.cos(strip.b - strip.a))
    gamma = initial - np.arccos((fa * fb).sum(0))
    np.testing.assert_allclose(strip.shear_angles(x, y, d)[off], gamma[off], atol=1e-7)
    assert strip.shear_angle(d) == pytest.approx(strip.shear_angles([100], [25], d)[0], abs=1e-12)
    rested = strip.shear_angle(d) + 1.2 - initial
    assert strip.shear_angle(d, rest=1.2) == pytest.approx(rested, abs=1e-12)


def test_formulas_of_the_literature():
    for d in (1.0, 10.0, 30.0):
        exact = RIGHT - 2 * math.acos((150 + d) / (math.sqrt(2) * 150))
        assert abs(at_angle(45).shear_angle(d)) == pytest.approx(exact, rel=1e-12)
    t, d = math.radians(30), 10.0
    gaps = (200 * math.cos(t) - 50 * math.sin(t)) * (200 * math.sin(t) - 50 * math.cos(t))
    sine = d * (2 * (200 - 50 * math.sin(2 * t)) + d) / (2 * gaps)
    assert abs(at_angle(30).shear_angle(d)) == pytest.approx(math.asin(sine), rel=1e-12)
    assert abs(at_angle(60).shear_angle(d)) == pytest.approx(math.asin(sine), rel=1e-12)
    assert math.isnan(at_angle(45).shear_angle(63))  # taut at 62.1 mm


def test_yarns_from_clamp_to_clamp_lock():
    """tan of 14.04 deg is 50 / 200."""
    names = {0: "yarns a", 14: "yarns a", 14.1: "", 75.9: "", 76: "yarns b", 90: "yarns b"}
    for degrees, yarns in names.items():
        strip = at_angle(degrees)
        assert strip.locked.startswith(yarns) and bool(strip.locked) == bool(yarns)
        assert math.isnan(strip.shear_angle(1e-3)) == bool(yarns)


def test_distance_to_where_yarns_begin_to_end_in_a_clamp():
    """Of yarns at 30 and 150 deg, and at right angles: from lines along them from the corners."""
    for degrees, x, y in ((30, 20, 25), (45, 25, 5), (45, 100, 25)):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        strip = PinJointedStrip(200.0, 50.0, math.radians(degrees), math.radians(180 - degrees))
        end = min(x, 200 - x)
        expected = min(abs(y * c - end * s), abs((50 - y) * c - end * s))
        assert strip.held([x], [y])[1] == pytest.approx(expected)
