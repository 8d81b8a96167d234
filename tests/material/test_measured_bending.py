"""Bending, compaction and friction of fabrics."""

import math

import mpmath
import numpy as np
import pytest
from scipy.integrate import quad

import fabric_fenicsx as ff
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.material import kernel
from fabric_fenicsx.material.compaction import growth, log_compaction


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


TWO = ff.ShearFriction((0.2, 0.05), (0.01, 0.02))


def test_tangents_of_the_kernel_are_those_of_its_stresses(random_states):
    C, a, b = random_states(50)
    fabric = ff.load("komeili").replace(shear_friction=TWO)
    given = {"fibres": (a, b), "sliding": (0.1, -0.2)}
    K = kernel.evaluate(fabric, cauchy_green=C, tangent=True, **given).tangent
    for k, (i, j) in enumerate(((0, 0), (1, 1), (0, 1))):
        dC, S = np.zeros((2, 2)), []
        dC[i, j] = dC[j, i] = 2e-7 / (1 + (i != j))
        for sign in (1, -1):
            S.append(kernel.evaluate(fabric, cauchy_green=C + sign * dC, **given).S)
        change = ((S[0] - S[1]) / 2e-7)[:, [0, 1, 0], [0, 1, 1]]
        assert np.abs(change - K[:, :, k]).max() < 1e-6 * np.abs(K).max()


def test_elements_slide_at_their_strengths():
    """Strains of 0.03 and 0.5 where elements slid by 0.1 and -0.2: springs of 0.05 and 0.4 bear up
    to 0.05 and 0.4, what is beyond is lost, and the kernel has both."""
    z = np.array([[-0.07, 0.23], [0.4, 0.7]])
    k, f = np.array([0.2, 0.05]), np.array([0.01, 0.02])
    elastic = np.array([[-0.05, 0.23], [0.05, 0.4]])
    lost = (f * np.abs(z - elastic)).sum(1)
    found = TWO.respond(np.array([0.03, 0.5]), np.array([0.1, -0.2]))
    assert found.stress == pytest.approx((k * elastic).sum(1))
    assert found.dissipated == pytest.approx(lost)
    assert found.energy == pytest.approx((k * elastic**2 / 2).sum(1) + lost)
    assert found.sliding == pytest.approx([0.1, -0.2] + z - elastic)
    assert found.tangent == pytest.approx([0.05, 0.0])
    for gamma, energy in zip((0.03, 0.5), found.energy):
        F, fabric = [[1.0, np.sin(gamma)], [0.0, np.cos(gamma)]], ff.load("fabric")
        rubs = fabric.replace(shear_friction=TWO)
        rubbing = kernel.evaluate(rubs, gradient=F, sliding=(0.1, -0.2))
        plain = kernel.evaluate(fabric, gradient=F)
        assert rubbing.energy[0] - plain.energy[0] == pytest.approx(energy)
        assert rubbing.energy_parts[0, 2] - plain.energy_parts[0, 2] == pytest.approx(energy)
        assert TWO.energy(gamma, (0.1, -0.2)) == pytest.approx(energy)
