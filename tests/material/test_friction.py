"""Friction between yarns in material files, and at a point against closed forms."""

import numpy as np
import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.material import kernel

TWO = ff.ShearFriction((0.2, 0.05), (0.01, 0.02))


def test_a_loop_of_the_kernel_is_masings():
    """Back from gamma_1 each element takes twice its strength over twice its elastic angle, and the
    area of a closed loop is what its sliding takes."""
    fabric = ff.load("komeili").replace(shear_friction=TWO)
    back = np.linspace(0.5, -0.5, 201)
    there, sliding, stress = back[::-1], np.zeros((1, 2)), []
    for gamma in np.concatenate([there[101:], back[1:], there[1:]]):
        half = [np.cos(gamma / 2), np.sin(gamma / 2)]
        F = np.array([half, half[::-1]]).T  # yarns keep their length
        now = kernel.evaluate(fabric, gradient=[F], sliding=sliding, tangent=True)
        law = kernel.evaluate(fabric, gradient=[F])
        sliding = now.sliding
        turn = 0.5 * np.array([[-half[1], half[0]], [half[0], -half[1]]])
        stress.append(((now.S - law.S)[0] * (F.T @ turn)).sum())
    stress = np.array(stress)[99:]  # from gamma_1 on and back to it
    first = TWO.respond((back[0] - back) / 2, np.zeros(1)).stress
    assert stress[:201] == pytest.approx(stress[0] - 2 * first, abs=1e-12)
    k, f = np.array(TWO.stiffness), np.array(TWO.strength)
    area = np.trapezoid if hasattr(np, "trapezoid") else np.trapz
    loop = area(stress[:201], back) + area(stress[200:], there)
    assert loop == pytest.approx((4 * f * (0.5 - f / k)).sum(), rel=1e-3)


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
