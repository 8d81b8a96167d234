"""A ball pressed into a stretched round membrane, against the equations of an axisymmetric one."""

import numpy as np
import pytest
from builders import Elastic, march, near, sheet
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

import fabric_fenicsx as ff
from fabric_fenicsx.solve.newton import Newton

STIFFNESS, NU, STRETCH = 100.0, 0.3, 1.05  # E h [N/mm]; of the membrane as it is clamped
RIM, BALL, T, DEPTH = 50.0, 12.0, 0.4, 20.0  # radii, thickness, travel of the ball [mm]
TOUCHED = BALL + T / 2  # radius of the middle surface on the ball


def pulls(a, b):
    """Forces per undeformed length [N/mm] along and around, of stretches a and b."""
    e, f = (a**2 - 1) / 2, (b**2 - 1) / 2
    return STIFFNESS / (1 - NU**2) * np.array([(e + NU * f) * a, (f + NU * e) * b])


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
    blank = sheet(RIM, RIM, nx, nx, spatial=True, shape=quarter_of_a_disc)

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
    scene, told = ff.Scene(blank, [Elastic(STIFFNESS, NU), contact], supports), []

    def keep(state):
        told.append((depth(state.load), 4 * contact.force()[2]))

    assert not march(Newton(scene), 10, on_accept=keep).reason
    return np.array([each for each in told if each[0] > 3]).T


@pytest.mark.parametrize("nx, error", [(8, 0.02), (16, 0.005)])
def test_force_over_depth(nx, error):
    depths, told = forces(nx)
    assert abs(told) == pytest.approx([exact(each) for each in depths], rel=error)
