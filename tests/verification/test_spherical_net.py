"""Nets of rigid and of stiff yarns, and a ball in a membrane."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from builders import march, near, sheet
from nets import spherical_net
from nets.relaxed_net import relaxed_net
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

import fabric_fenicsx as ff
from fabric_fenicsx.core.rules import above_zero
from fabric_fenicsx.solve.newton import Newton


def exact_angle(s):
    """p = pi/2 - omega at s = u v / R^2: s p'' + p' = cos(p), so of the power series of p, cos(p)
    and sin(p) = q at s = 0 the coefficients follow from one another."""
    p, c, q = np.zeros((3, 61))
    c[0] = 1.0
    for k in range(60):
        p[k + 1] = c[k] / (k + 1) ** 2
        slope = np.arange(1, k + 2) * p[1 : k + 2]
        c[k + 1] = -(q[k::-1] @ slope) / (k + 1)
        q[k + 1] = c[k::-1] @ slope / (k + 1)
    return np.polyval(p[::-1], s)


@pytest.mark.parametrize("s", [0.0, 1e-4, 9.9e-4, 1.1e-3, 0.1, 0.5, 0.9])
def test_shear_angle_to_ten_digits(s):
    found = spherical_net.shear_angle(s, 1.0, 1.0)
    assert found == pytest.approx(exact_angle(s), rel=1e-10, abs=1e-14)


def test_the_net_is_that_of_a_published_draping_code():
    """KinDrape's hemisphere, with pieces of 0.075 R (Krogh et al. 2021, doi 10.1007/s00158-021-
    02925-z; run at its commit ae9f14e)."""
    place = np.array([0.225, 0.375, 0.525, 0.675, 0.75])
    found = np.degrees(spherical_net.shear_angle(place, place, 1.0))
    assert found == pytest.approx([2.90, 8.05, 15.72, 25.81, 31.66], abs=0.02)


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


A, B, FLOOR, RATE, STRETCH = 60.0, 120.0, 0.4, 2.0, 1.05  # [MPa], [-]; STRETCH: as it is clamped
RIM, BALL, T, DEPTH = 50.0, 12.0, 0.4, 20.0  # radii, thickness, travel of the ball [mm]
TOUCHED = BALL + T / 2  # radius of the middle surface on the ball


def pulls(a, b):
    """Forces per undeformed length [N/mm] along and around, of stretches a and b: derivatives of
    (A e^3 + B e^2) k(f) + (A f^3 + B f^2) k(e), k(e) = (1 - FLOOR) exp(RATE e) + FLOOR."""
    e = np.array([a - 1, b - 1])
    grown = (1 - FLOOR) * np.exp(RATE * e)
    energy, slope = (A * e + B) * e**2, (3 * A * e + 2 * B) * e
    return T * (slope * (grown[::-1] + FLOOR) + energy[::-1] * RATE * grown)


def stretch(pull, around):
    """Along a meridian, of a pull along it [N/mm]."""
    return brentq(lambda a: pulls(a, around)[0] - pull, 0.7, 4.0)


def membrane(pole, edge):
    """Radius of the rim and its distance from the pole along the axis [mm], and the force [N], of a
    membrane with this stretch at the pole that touches the ball up to the undeformed radius
    `edge`."""
    how = {"rtol": 1e-8, "atol": 1e-10}

    def on_ball(R, y):  # polar angle on the ball, pull
        around = TOUCHED * np.sin(y[0]) / R
        along = stretch(y[1], around)
        return [along / TOUCHED, (pulls(along, around)[1] * np.cos(y[0]) - y[1]) / R]

    start = 1e-6
    begun = [pole * start / TOUCHED, pulls(pole, pole)[0]]
    angle, pull = solve_ivp(on_ball, (start, edge), begun, **how).y[:, -1]
    rise = edge * pull * np.sin(angle)

    def free(R, y):  # radius, depth, R times the pull along the radius
        size = np.hypot(y[2], rise)
        along = stretch(size / R, y[0] / R)
        return [along * y[2] / size, along * rise / size, pulls(along, y[0] / R)[1]]

    begun = [TOUCHED * np.sin(angle), TOUCHED * (1 - np.cos(angle)), edge * pull * np.cos(angle)]
    radius, depth, _ = solve_ivp(free, (edge, RIM), begun, **how).y[:, -1]
    return radius, depth, 2 * np.pi * rise


def exact(depth):
    """Force on the ball at a depth [N]."""
    goal = np.array([STRETCH * RIM, depth])
    guess = STRETCH + 0.17 * (depth / DEPTH) ** 2, 7.0 * (depth / DEPTH) ** 0.47
    found, _, settled, words = fsolve(lambda p: membrane(*p)[:2] - goal, guess, full_output=True)
    assert settled == 1, words
    return membrane(*found)[2]


def quarter_of_a_disc(x):
    """The square of a quarter, with its far sides on the rim."""
    square, far = x[:, :2] / RIM, x.max(1) / RIM
    round_ = far / np.maximum(np.hypot(*square.T), 1e-300)
    return x * ((1 - far) * 0.8 + far * round_)[:, None]


def forces(nx):
    """Depths [mm] and forces of the ball [N]."""
    radial = {"a": lambda x: np.arctan2(x[1], x[0])}
    blank = sheet(RIM, RIM, nx, nx, spatial=True, shape=quarter_of_a_disc, **radial)
    yarn = ff.Yarn(a=A, b=B, d=1.0, p_min=FLOOR, c=RATE)
    fabric = ff.WovenFabric(yarn, yarn, s1=1.0, thickness=T, density=1.0)

    def depth(load):
        return DEPTH * max(load - 0.1, 0.0) / 0.9

    def clamped(x, load):
        return np.vstack([(STRETCH - 1) * min(load / 0.1, 1.0) * x[:2], 0 * x[:1]])

    sphere = ff.Sphere(BALL, (0, 0, -TOUCHED))
    ball = ff.Tool(sphere, path=lambda load: (0, 0, depth(load)), name="ball")
    contact = ff.Contact(ball, T, 1000.0)
    supports = [
        ff.Support("rim", lambda x: np.hypot(x[0], x[1]) > RIM - 1e-6, (0, 1, 2), clamped),
        *(ff.Support("xy"[k], near(k, 0.0), (k,)) for k in (0, 1)),
    ]
    scene, told = ff.Scene(blank, [ff.Membrane(fabric), contact], supports), []

    def keep(state):
        told.append((depth(state.load), 4 * contact.force()[2]))

    assert not march(Newton(scene), 5, on_accept=keep).reason
    return np.array([each for each in told if each[0] > 10]).T


def test_force_over_depth():
    """Errors fall with the square of the size of the cells."""
    (depths, coarse), (_, fine) = map(forces, (8, 16))
    told = [exact(each) for each in depths]
    assert abs(coarse) == pytest.approx(told, rel=0.02)
    assert abs(fine) == pytest.approx(told, rel=0.005)
    assert abs(4 * fine - coarse) / 3 == pytest.approx(told, rel=1e-3)
