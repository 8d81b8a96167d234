"""Bending of fabric as tests tell it: in files, at a point, and in a sheet."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_bvp

import fabric_fenicsx as ff
from fabric_fenicsx.material.bending import GRAVITY

FALLING = ff.MeasuredBending(
    curvature=(0, 0.005, 0.02, 0.1), moment_a=(0, 0.04, 0.1, 0.2), moment_b=(0, 0.02, 0.05, 0.1)
)
KOMEILI = ff.load("komeili")


def test_the_moment_is_the_energy_s_derivative_and_odd():
    k = np.linspace(-0.15, 0.15, 31)
    both = np.stack([k, k], axis=1)
    found = FALLING.respond(both, 1.0)
    for yarn, moment in enumerate(found.moment.T):
        assert moment == pytest.approx(-moment[::-1])
        work = quad(lambda c: FALLING.respond(np.array([[c, c]]), 1.0).moment[0, yarn], 0, 0.15)[0]
        assert found.energy[-1, yarn] == pytest.approx(work, rel=1e-7)
    h = 1e-7
    high, low = (FALLING.respond(both + s * h, 1.0) for s in (1, -1))
    assert (high.energy - low.energy) / (2 * h) == pytest.approx(found.moment, abs=1e-7)
    assert (high.moment - low.moment) / (2 * h) == pytest.approx(found.slope, rel=1e-3)


def test_a_cantilever_of_this_length_droops_by_41_5_deg():
    """The line from the edge to the end of the strip, by the elastica under its own weight."""
    L, weight = 200.0, GRAVITY * 0.75
    D = ff.MeasuredBending(cantilever_a=L, cantilever_b=L).stiffnesses(0.75)[0]

    def slope(s, y):
        return np.array([y[1], weight * (L - s) * np.cos(y[0]) / D, np.cos(y[0]), np.sin(y[0])])

    s = np.linspace(0, L, 50)
    start = np.array([0 * s, 0 * s, s, 0 * s])
    end = solve_bvp(slope, lambda a, b: np.array([a[0], b[1], a[2], a[3]]), s, start).y[:, -1]
    assert np.degrees(np.arctan2(abs(end[3]), end[2])) == pytest.approx(41.5, abs=1.0)


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
    moment = stiffness * curvature + 0.05 * way
    test = ff.MeasuredBending(curvature=tuple(curvature), moment_a=tuple(moment))
    assert test.thresholds == pytest.approx((0.05, 0.05))
    at = np.array([-0.2, -0.1, 0.0, 0.1, 0.2])
    below = 8.0 if min(curvature) < 0 else 5.0
    found = test.respond(np.stack([at, at], 1), 1.0)
    assert found.moment[:, 0] == pytest.approx(np.where(at < 0, below, 5.0) * at)
    work = quad(lambda c: test.respond(np.array([[c, c]]), 1.0).moment[0, 0], 0, -0.2)[0]
    assert found.energy[0, 0] == pytest.approx(work, rel=1e-7)


def on_a_cylinder(fabric, kappa, angle=0.0):
    """Scene of a strip that is laid on a cylinder of this curvature, and its bending."""
    blank = ff.Blank.rectangle(60, 20, nx=24, ny=8, fibre_angle=angle, spatial=True)
    bending = ff.Bending(modulus=1.0)
    scene = ff.Scene(blank, [ff.Membrane(fabric), bending], ff.clamped_ends(0.1))
    x = blank.coordinates()[:, 0]
    bent = np.column_stack([np.sin(kappa * x) / kappa - x, 0 * x, (1 - np.cos(kappa * x)) / kappa])
    blank.u.x.array[:] = bent.ravel()
    return scene, bending


@pytest.mark.parametrize("sign", [1, -1])
def test_a_strip_is_bent_over_each_of_its_faces(sign):
    """It takes the energy of this face, and friction the threshold's."""
    measured = ff.MeasuredBending(curvature=(-0.1, 0, 0, 0.1), moment_a=(-0.85, -0.05, 0.05, 0.55))
    kappa = 0.03
    scene, _ = on_a_cylinder(KOMEILI.replace(bending=measured), sign * kappa)
    energies, both = scene.energies(), np.array([[sign * kappa, 0.0], [-sign * kappa, 0.0]])
    here, other = 1200 * measured.respond(both, 0.75).energy[:, 0]
    assert energies["bending"] == pytest.approx(here, rel=0.1) and abs(here / other - 1) > 0.15
    assert energies["yarn_friction"] == pytest.approx(1200 * 0.05 * (kappa - 0.001), rel=0.1)


@pytest.mark.parametrize("angle", [0, 90])
def test_a_strip_bent_to_a_cylinder(angle):
    """It takes the energy of its curvature, and its forces are the energy's derivatives."""
    kappa = 0.03
    scene, bending = on_a_cylinder(KOMEILI.replace(bending=FALLING), kappa, angle)
    blank = scene.blank
    both = FALLING.respond(np.array([[kappa, kappa]]), 0.75).energy[0]
    energy = scene.energies()["bending"]
    assert energy == pytest.approx(60 * 20 * both[angle // 90], rel=0.1)  # ends are free
    blank.u.x.array[2::3] += 0.004 * blank.coordinates()[:, 1] ** 2  # as slopes have kinks at 0
    ff.check_derivatives(bending, scene, size=1e-4)
