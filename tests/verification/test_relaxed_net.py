"""The net of least energy of a bias test, against its own conditions and a simulated test."""

import math
from dataclasses import dataclass

import pytest
from nets.relaxed_net import relaxed_net

import fabric_fenicsx as ff
from fabric_fenicsx.core.rules import above_zero


@dataclass(frozen=True)
class Stiff(ff.Law):
    """Yarns that hardly stretch, and linear shear."""

    law = "stiff"
    rules = {"E": above_zero("stress"), "G": above_zero("stress")}
    E: float
    G: float

    def energy(self, eps_a, eps_b, gamma):
        """The parts along a, along b and in shear [MPa]."""
        return self.E * eps_a**2 / 2, self.E * eps_b**2 / 2, self.G * gamma**2 / 2


LAW = Stiff(E=2e4, G=0.1, thickness=0.5)


def test_the_force_is_the_slope_of_the_energy():
    low, net, high = (relaxed_net(LAW, 200, 50, stroke, 120) for stroke in (14.9, 15, 15.1))
    assert net.force == pytest.approx((high.energy - low.energy) / 0.2, rel=1e-4)


def test_a_simulated_test_takes_it():
    """The usual formula gives 7.92 deg near the middle."""
    test = ff.BiasExtension(LAW, length=200, width=50, nx=32, strain=0.05)
    run = test.job(steps=3).run().summary
    net = relaxed_net(LAW, 200, 50, 10, 240)
    angle = math.degrees(net.shear_angle(radius=50 / 8))
    assert run["quantities"]["centre_shear_angle_deg"] == pytest.approx(angle, abs=0.05)
    assert run["energy"]["strain"] == pytest.approx(net.energy, rel=2e-3)
    assert run["reaction_N"] == pytest.approx(net.force, rel=2e-3)
