"""The check of own laws, terms and surfaces: right ones agree, what is wrong is named."""

from dataclasses import dataclass

import numpy as np
import pytest
from builders import Elastic, Springs, dome, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.material.functions import log
from fabric_fenicsx.material.laws import LAWS
from fabric_fenicsx.runtime.rules import above_zero

KOMEILI = ff.load("komeili")
BALL = ff.Sphere(radius=30)
NEAR = np.random.default_rng(0).uniform(20, 22, (200, 3)) * [1, -1, 1]


def test_the_papers_law():
    table = ff.check_derivatives(KOMEILI)
    assert table.startswith("law coupled: derivatives agree") and table.count("\n") == 11


def test_a_law_whose_stresses_are_not_its_energys():
    @dataclass(frozen=True)
    class Wrong(ff.Law):
        law = "wrong"
        rules = {"E": above_zero("stress")}
        E: float

        def energy(self, eps_a, eps_b, gamma):
            return self.E * eps_a**2 / 2, self.E * eps_b**2 / 2, self.E * gamma**2 / 2

        def derivatives(self, eps_a, eps_b, gamma, second=True):
            found = super().derivatives(eps_a, eps_b, gamma, second)
            return found._replace(first=found.first * [[1], [1], [1.5]])

    del LAWS["wrong"]
    words = "law wrong: tau and differences of energies differ by 0.33 of the largest at"
    with pytest.raises(ff.InputError, match=words):
        ff.check_derivatives(Wrong(3.0))


def _of_shear(shear):
    """A law of stiff yarns with this energy of shear."""

    @dataclass(frozen=True)
    class Soft(ff.Law):
        law = "soft"

        def energy(self, eps_a, eps_b, gamma):
            return 1500 * eps_a**2, 1500 * eps_b**2, shear(gamma)

    del LAWS["soft"]
    return Soft()


@pytest.mark.parametrize(
    "shear, words",
    [
        (lambda g: 0.015 * g**2 + 0.006 * g, "the stress tau of law soft is 0.006 MPa in fabric"),
        (lambda g: 0.015 * g**2 - 0.1 * g**4, "the energy is below that at rest by 1 of the larg"),
        (
            lambda g: 0.0148 * g**2 + 1e-4 * (log(1 - 2 * g) + 2 * g),
            "the energy is not a number at",
        ),
    ],
)
def test_a_law_whose_shear_energy_is_wrong(shear, words):
    """Though it is little beside that of the yarns."""
    with pytest.raises(ff.InputError, match=words) as error:
        ff.check_derivatives(_of_shear(shear))
    assert "differ by inf" not in str(error.value)


@pytest.mark.parametrize("surface", [BALL, ff.Plane((0, 0, 1), (0, 1, 1)), ff.Offset(BALL, 1.0)])
def test_surfaces_of_the_package(surface):
    assert "agree" in ff.check_derivatives(surface, NEAR)


class Ball(ff.Surface):
    """A ball of 30 mm about the origin with factors that should be 1."""

    radii = 30.0, np.inf

    def __init__(self, gap=1.0, normal=1.0, curvature=1.0):
        self.gap, self.normal, self.curvature = gap, normal, curvature

    def nearest(self, points, reach):
        found = BALL.nearest(points, reach)
        return ff.Nearest(*(k * v for k, v in zip(vars(self).values(), found)))


@pytest.mark.parametrize(
    "wrong, words",
    [
        ({"normal": -1.0}, "Ball: normals and differences of gaps differ by 2 of the largest"),
        ({"curvature": 1.1}, "Ball: curvatures and differences of normals differ by 0.09"),
        ({"gap": 2.0, "normal": 2.0, "curvature": 2.0}, "Ball: gaps and distances along the"),
        ({"normal": np.nan}, "Ball: normals and differences of gaps are not numbers at"),
        ({"gap": np.nan}, r"Ball: it finds no nearest point at \(.*\); allowed are points near"),
    ],
)
def test_a_wrong_surface(wrong, words):
    assert "agree" in ff.check_derivatives(Ball(), NEAR)
    with pytest.raises(ff.InputError, match=words):
        ff.check_derivatives(Ball(**wrong), NEAR)


@pytest.mark.parametrize("by, agrees", [(4e-5, True), (7e-5, False)])
def test_a_gap_may_be_1e_4_off(by, agrees):
    """The foot of a gap that is too large by a share is below the surface by twice that share."""
    ball = Ball(1 + by, 1 + by, 1 + by)
    if agrees:
        assert "agree" in ff.check_derivatives(ball, NEAR)
    else:
        with pytest.raises(ff.InputError, match="Ball: gaps and distances along"):
            ff.check_derivatives(ball, NEAR)


@pytest.mark.parametrize("count, agrees", [(4, True), (5, False)])
def test_2_percent_of_the_places_may_be_kinks(count, agrees):
    limit = np.sort(NEAR[:, 0])[-count]

    class Kinked(Ball):
        def nearest(self, points, reach):
            found = super().nearest(points, reach)
            found.normal[points[:, 0] > limit - 1e-3] *= -1
            return found

    if agrees:
        assert "agree" in ff.check_derivatives(Kinked(), NEAR)
    else:
        with pytest.raises(ff.InputError, match="normals and differences of gaps differ"):
            ff.check_derivatives(Kinked(), NEAR)


def test_a_surface_with_corners_sharper_than_it_says():
    ball = Ball()
    ball.radii = 40.0, np.inf
    words = "Ball: radii of curvature and least `radii` differ by 0.25 .* the radius is 30 mm"
    with pytest.raises(ff.InputError, match=words):
        ff.check_derivatives(ball, NEAR)


@pytest.mark.parametrize("times", [0.9, 1.1])
def test_a_bound_beyond_the_distance_is_named(times):
    """Points that a tool touches would be passed over."""

    class Bounded(ff.ImplicitSurface):
        radii = 30.0, np.inf

        def implicit(self, x):
            r = np.linalg.norm(x, axis=0)
            slope = x / r
            return r - 30, slope, (np.eye(3)[:, :, None] - slope[:, None] * slope) / r

        def bound(self, F, x):
            return times * abs(F)

    if times < 1:
        assert "agree" in ff.check_derivatives(Bounded(), NEAR)
    else:
        with pytest.raises(ff.InputError, match="`bound` and distances that it must not exceed"):
            ff.check_derivatives(Bounded(), NEAR)


class Hardening(Springs):
    """A spring of stiffness 1 + u^2 at each component, with factors."""

    def __init__(self, force=1.0, stiffness=1.0):
        self.force, self.stiffness = force, stiffness

    def stored(self):
        return float((self.u() ** 2 / 2 + self.u() ** 4 / 4).sum())

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
        ({}, ""),
        ({"force": 1.2}, "springs: forces and differences of energies differ by 0.17 of"),
        ({"stiffness": 0.9}, "springs: tangent and differences of forces differ by 0.1 of"),
        ({"stiffness": 1 - 1.2e-4}, "tangent and differences of forces differ by 0.00012 of"),
        ({"stiffness": 1 - 0.8e-4}, ""),
    ],
)
def test_terms(wrong, words):
    springs = Hardening(**wrong)
    scene = ff.Scene(sheet(20.0, 10.0, 6, 3), [Elastic(), springs], ff.clamped_ends(1.0))
    scene.u.set(0.5)
    before = scene.u.array.copy()
    if words:
        with pytest.raises(ff.InputError, match=words):
            ff.check_derivatives(springs, scene, size=0.1)
    else:
        assert "agree" in ff.check_derivatives(springs, scene, size=0.1)
        about = 1e-3 * (20 * 10 / 72) ** 0.5  # of a cell
        assert f"about {about:.3g} mm, the `size`" in ff.check_derivatives(springs, scene)
    assert np.array_equal(scene.u.array, before)


@pytest.mark.parametrize("sign, told", [(1, False), (-1, True)])
def test_a_term_that_drives_the_sheet_is_told(sign, told):
    class Driving(Hardening):
        def stored(self):
            return sign * super().stored()

        def tangent(self):
            dofs, _, values = super().tangent()
            return dofs, dofs, sign * values

    springs = Driving(force=sign)
    scene = ff.Scene(sheet(20.0, 10.0, 6, 3), [Elastic(), springs], ff.clamped_ends(1.0))
    table = ff.check_derivatives(springs, scene, size=0.1)
    assert ("N mm: below 0 it drives the sheet" in table) == told


@pytest.mark.versions
@pytest.mark.mpi
def test_terms_of_the_package_in_a_scene():
    """Among them a tool moved by force, which takes from the tangent."""
    ply = dome(KOMEILI, nx=6, holder=ff.ForceHolder())
    for term in ply.scene.terms:
        assert "agree" in ff.check_derivatives(term, ply.scene, load=0.02), term.name
