"""Friction between yarns at a point."""

import numpy as np

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
