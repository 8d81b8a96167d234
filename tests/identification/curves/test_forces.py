"""The power balances behind shear forces."""

import math

import numpy as np
import pytest
from scipy.integrate import trapezoid

from fabric_fenicsx.identification.curves import bias_normalised
from fabric_fenicsx.identification.curves.forces import response
from fabric_fenicsx.material.homogeneous import nominal
from fabric_fenicsx.material.kernel import evaluate
from fabric_fenicsx.material.presets import PRESETS

KOMEILI = PRESETS["komeili"]


def test_shear_force_is_the_part_of_the_traction_along_the_yarn():
    """F_sh / t = S12 of the kernel at unstrained yarns, so tau t = F_sh cos(gamma)."""
    g = np.linspace(0.1, 1.2, 12)
    C = np.stack([np.ones(12), np.sin(g), np.sin(g), np.ones(12)], -1).reshape(-1, 2, 2)
    tau = nominal(KOMEILI, np.outer(g, [0, 0, 1]))[:, 2]
    found = response("F_sh", tau, g, "shear", {}, 1.2)
    S = evaluate(KOMEILI, cauchy_green=C).S
    assert found.gain * tau / 1.2 == pytest.approx(S[:, 0, 1], rel=1e-12)
    assert tau == pytest.approx((0.02506 - 0.18679 * g + 0.56239 * g**2) * g, rel=1e-12)


def test_forces_do_the_work_that_the_fabric_stores():
    """The integral of the crosshead force over its way is the energy of all zones."""
    g = np.linspace(0, math.radians(50), 20001)
    t, W, H, frame, fabric = 1.2, 115.0, 230.0, 200.0, 140.0

    def tau(g):
        return (0.02506 - 0.18679 * g + 0.56239 * g**2) * g

    def energy(g):
        return 0.02506 * g**2 / 2 - 0.18679 * g**3 / 3 + 0.56239 * g**4 / 4

    bias = response("F", g, g, "bias_extension", {"height": H, "width": W}, t)
    force = bias.gain * tau(g) + bias.half * tau(g / 2)
    way = (H - W) * (np.cos(g / 2) + np.sin(g / 2) - 1)
    stored = t * (W * (2 * H - 3 * W) / 2 * energy(g[-1]) + W**2 * energy(g[-1] / 2))
    assert trapezoid(force, way) == pytest.approx(stored, rel=1e-7)
    lengths = {"frame_length": frame, "fabric_length": fabric}
    force = response("F", g, g, "picture_frame", lengths, t).gain * tau(g)
    way = 2 * frame * np.cos(math.pi / 4 - g / 2)
    assert trapezoid(force, way) == pytest.approx(t * fabric**2 * energy(g[-1]), rel=1e-7)


def test_normalisation_of_a_bias_test():
    """The formula of Cao et al. gives F_sh = tau t / cos(gamma) of the force of the law."""
    g = np.linspace(0.01, math.radians(50), 400)
    tau = lambda g: (0.02506 - 0.18679 * g + 0.56239 * g**2) * g  # noqa: E731
    for H, W in ((230.0, 115.0), (450.0, 150.0)):
        bias = response("F", g, g, "bias_extension", {"height": H, "width": W}, 1.2)
        force = bias.gain * tau(g) + bias.half * tau(g / 2)
        found = bias_normalised(g, force, H, W)
        # what is left is the interpolation at gamma / 2
        assert found == pytest.approx(1.2 * tau(g) / np.cos(g), rel=2e-4, abs=5e-5 * tau(g[-1]))
