"""The check of own laws, terms and surfaces: right ones agree, what is wrong is named."""

from dataclasses import dataclass

import numpy as np
import pytest
from builders import Elastic, Springs, dome, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.material.functions import log
from fabric_fenicsx.material.laws import LAWS

KOMEILI = ff.load("komeili")
BALL = ff.Sphere(radius=30)
NEAR = np.random.default_rng(0).uniform(20, 22, (200, 3)) * [1, -1, 1]


def told(*args, **options):
    """The table, or why there is none."""
    try:
        return ff.check_derivatives(*args, **options)
    except ff.InputError as error:
        return str(error)


def test_what_the_package_has():
    table = told(KOMEILI)
    assert table.startswith("law coupled: derivatives agree") and table.count("\n") == 11
    for surface in (BALL, ff.Plane((0, 0, 1), (0, 1, 1)), ff.Offset(BALL, 1.0)):
        assert "derivatives agree" in told(surface, NEAR)


def soft(g):
    return 0.015 * g**2


@pytest.mark.parametrize(
    "shear, factor, words",
    [
        (soft, 1.0, "derivatives agree"),
        (soft, 1.5, "law soft: tau and differences of energies differ by 0.33 of the largest at"),
        (lambda g: soft(g) + 0.006 * g, 1.0, "the stress tau of law soft is 0.006 MPa in fabric"),
        (lambda g: soft(g) - 0.1 * g**4, 1.0, "energy at rest and the least one differ by 1 of"),
        (lambda g: soft(g) + 1e-4 * (log(1 - 2 * g) + 2 * g), 1.0, "energies are not numbers at"),
    ],
)
def test_a_law_whose_shear_is_wrong(shear, factor, words):
    """Though it is little beside that of stiff yarns."""

    @dataclass(frozen=True)
    class Soft(ff.Law):
        law = "soft"

        def energy(self, eps_a, eps_b, gamma):
            return 1500 * eps_a**2, 1500 * eps_b**2, shear(gamma)

        def derivatives(self, eps_a, eps_b, gamma, second=True):
            found = super().derivatives(eps_a, eps_b, gamma, second)
            times = np.ones((3, 1)) if factor == 1 else [[1], [1], [factor]]
            return found._replace(first=found.first * times)

    del LAWS["soft"]
    found = told(Soft())
    assert words in found and "differ by inf" not in found


class Ball(ff.Surface):
    """A ball of 30 mm about the origin with factors that should be 1, whose normals are turned
    round beyond the plane x = `kink` [mm]."""

    radii = 30.0, np.inf

    def __init__(self, gap=1.0, normal=1.0, curvature=1.0, kink=np.inf, radius=30.0):
        self.factors, self.kink, self.radii = (gap, normal, curvature), kink, (radius, np.inf)

    def nearest(self, points, reach):
        found = ff.Nearest(*(k * v for k, v in zip(self.factors, BALL.nearest(points, reach))))
        found.normal[points[:, 0] > self.kink] *= -1
        return found


def kink(count):
    """Before the last so many of the places."""
    return np.sort(NEAR[:, 0])[-count] - 1e-3


@pytest.mark.parametrize(
    "wrong, words",
    [
        ({}, "derivatives agree"),
        ({"normal": -1.0}, "Ball: normals and differences of gaps differ by 2 of the largest"),
        ({"curvature": 1.1}, "Ball: curvatures and differences of normals differ by 0.09"),
        ({"gap": 2.0, "normal": 2.0, "curvature": 2.0}, "Ball: gaps and distances along the"),
        ({"normal": np.nan}, "Ball: normals and differences of gaps are not numbers at"),
        ({"gap": np.nan}, "Ball: gaps to the nearest point are not numbers at"),
        ({"radius": 40.0}, "Ball: radii of curvature and least `radii` differ by 0.25 of the"),
        # the foot of a gap that is too large by a share is below the surface by twice that share
        (dict.fromkeys(("gap", "normal", "curvature"), 1 + 4e-5), "derivatives agree"),
        (dict.fromkeys(("gap", "normal", "curvature"), 1 + 7e-5), "gaps and distances along the"),
        # 2 % of the places may be kinks
        ({"kink": kink(4)}, "derivatives agree"),
        ({"kink": kink(5)}, "normals and differences of gaps differ"),
    ],
)
def test_a_wrong_surface(wrong, words):
    assert words in told(Ball(**wrong), NEAR)


class Bounded(ff.ImplicitSurface):
    """That ball, whose bound is so many times the distance."""

    radii = 30.0, np.inf

    def __init__(self, times):
        self.times = times

    def implicit(self, x):
        r = np.linalg.norm(x, axis=0)
        slope = x / r
        return r - 30, slope, (np.eye(3)[:, :, None] - slope[:, None] * slope) / r

    def bound(self, F, x):
        return self.times * abs(F)


def test_a_bound_beyond_the_distance_is_named():
    """Points that a tool touches would be passed over."""
    assert "derivatives agree" in told(Bounded(0.9), NEAR)
    assert "`bound` and distances that it must not exceed" in told(Bounded(1.1), NEAR)


class Hardening(Springs):
    """A spring of stiffness 1 + u^2 at each component, or its negative, with factors."""

    def __init__(self, force=1.0, stiffness=1.0, sign=1):
        self.force, self.stiffness, self.sign = sign * force, sign * stiffness, sign

    def stored(self):
        return self.sign * float((self.u() ** 2 / 2 + self.u() ** 4 / 4).sum())

    def add_forces(self, f):
        f[: len(self.u())] += self.force * (self.u() + self.u() ** 3)

    def tangent(self):
        self.k = self.stiffness
        dofs, _, values = super().tangent()
        return dofs, dofs, values * (1 + 3 * self.u() ** 2)


@pytest.mark.mpi
@pytest.mark.parametrize(
    "wrong, words",
    [
        ({}, "derivatives agree"),
        ({"force": 1.2}, "springs: forces and differences of energies differ by 0.17 of"),
        ({"stiffness": 1 - 1.2e-4}, "tangent and differences of forces differ by 0.00012 of"),
        ({"stiffness": 1 - 0.8e-4}, "derivatives agree"),
        ({"sign": -1}, "N mm: below 0 it drives the sheet"),
    ],
)
def test_terms(wrong, words):
    springs = Hardening(**wrong)
    scene = ff.Scene(sheet(20.0, 10.0, 6, 3), [Elastic(), springs], ff.clamped_ends(1.0))
    scene.u.set(0.5)
    before = scene.u.array.copy()
    found = told(springs, scene, size=0.1)
    assert words in found and ("drives the sheet" in found) == ("sign" in wrong)
    if not wrong:
        about = 1e-3 * (20 * 10 / 72) ** 0.5  # of a cell
        assert f"about {about:.3g} mm, the `size`" in told(springs, scene)
    assert np.array_equal(scene.u.array, before)


@pytest.mark.versions
@pytest.mark.mpi
def test_terms_of_the_package_in_a_scene():
    """Among them a tool moved by force, which takes from the tangent."""
    ply = dome(KOMEILI, nx=6, holder=ff.ForceHolder())
    for term in ply.scene.terms:
        assert "agree" in ff.check_derivatives(term, ply.scene, load=0.02), term.name
