"""Friction between yarns at a point."""

import numpy as np
import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.material import kernel

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
        rubbing = kernel.evaluate(
            fabric.replace(shear_friction=TWO), gradient=F, sliding=(0.1, -0.2)
        )
        plain = kernel.evaluate(fabric, gradient=F)
        assert rubbing.energy[0] - plain.energy[0] == pytest.approx(energy)
        assert rubbing.energy_parts[0, 2] - plain.energy_parts[0, 2] == pytest.approx(energy)
        assert TWO.energy(gamma, (0.1, -0.2)) == pytest.approx(energy)
