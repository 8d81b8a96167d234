"""A ball pressed into a stretched round membrane of yarns along radii and around them, which stays
round, against the equations of an axisymmetric one and the paper's law."""

import numpy as np
import pytest
from builders import march, near, sheet
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

import fabric_fenicsx as ff
from fabric_fenicsx.solve.newton import Newton

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

    ball = ff.Tool(
        ff.Sphere(BALL, (0, 0, -TOUCHED)), path=lambda load: (0, 0, depth(load)), name="ball"
    )
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
