"""What the checks of `verification` and the studies' library find."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from builders import Elastic, Springs, alone, dome, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.material import stability
from fabric_fenicsx.material.functions import log
from fabric_fenicsx.material.laws import LAWS
from fabric_fenicsx.results import shape
from fabric_fenicsx.studies.lib import compression_parameters as parameters
from fabric_fenicsx.studies.lib.single_element import compare
from fabric_fenicsx.studies.lib.stability_maps import kernel_difference, stability_maps

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
        (lambda g: soft(g) + 0.006 * g, 1.0, "the stress tau of law soft is 0.006 MPa without"),
        (lambda g: soft(g) - 0.1 * g**4, 1.0, "energy at rest and its minimum differ by 1 of"),
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
        ({"radius": 40.0}, "Ball: radii of curvature and smallest `radii` differ by 0.25 of the"),
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
        ({"sign": -1}, "N mm: a negative energy drives the sheet"),
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


@dataclass(frozen=True)
class Off(ff.WovenFabric):
    """Komeili's with stresses a thousandth above those of its energy."""

    law = "off"

    def derivatives(self, eps_a, eps_b, gamma, second=True):
        found = super().derivatives(eps_a, eps_b, gamma, second)
        return found._replace(first=1.001 * found.first)


del LAWS["off"]
OFF = Off(KOMEILI.warp, KOMEILI.weft, KOMEILI.s1, KOMEILI.s2, KOMEILI.s3, thickness=0.8)


def test_a_law_that_is_a_thousandth_off():
    assert 0.9e-3 < kernel_difference(OFF, np.linspace(-0.1, 0.05, 4)) < 1.001e-3
    blank = sheet(1.0, 1.0, 1, 1, cell="quadrilateral")
    found = compare({"off": OFF}, blank, ff.Membrane, 4, 1e-10)
    summary = alone(blank, ff.Membrane(OFF)).summary()
    for mismatch in (found.kernel_mismatch, summary["kernel_mismatch"].value):
        assert mismatch == pytest.approx(1e-3, rel=0.01)
    for path, off in found.differences.items():
        assert 0.7e-3 < off["kernel"] < 1.001e-3, path  # of the stresses' norm
        assert off["elements"] < 1e-9, path  # which follow the energy
    assert found.largest["kernel"] == pytest.approx(1e-3, rel=0.01)
    row = list(found.rows())[-1]  # free tension: the lateral strain has no stress
    assert (row["path"], row["eps_a"], row["gamma_deg"]) == ("free uniaxial a", 0.03, 0)
    assert abs(row["sigma_b_closed_form_MPa"]) < 1e-9
    sigma = [row[f"sigma_a_{leg}_MPa"] for leg in ("closed_form", "elements", "kernel")]
    assert sigma == pytest.approx(np.array([1, 1, 1.001]) * sigma[0], rel=1e-8)
    sheared = [row for row in found.rows() if row["path"] == "pure shear"][-1]
    g = np.radians(sheared["gamma_deg"])
    tau = (0.02506 - 0.18679 * g + 0.56239 * g**2) * g
    assert (sheared["gamma_deg"], sheared["tau_closed_form_MPa"]) == pytest.approx((60, tau))


def test_maps_of_stability(unbalanced):
    """By rows eps_b, at the angle of their picture; shares are those of states."""
    strains = np.array([-0.15, -0.05, 0.03])
    maps, shares = stability_maps(unbalanced, strains)
    found = maps["p_min"]["40 deg", "p_min 0.25"]
    fabric = unbalanced.replace(p_min=0.25)
    for i, eps_b in enumerate(strains):
        for j, eps_a in enumerate(strains):
            C = np.array([1 + eps_a, 1 + eps_b]) ** 2
            across = np.sin(np.radians(40)) * np.sqrt(C.prod())
            state = np.array([[C[0], across, C[1], np.radians(40)]])  # I4, I6, I8, gamma
            single = stability.evaluate(fabric, state)
            assert found[0][i, j] == pytest.approx(single.convexity[0])
            assert found[1][i, j] == pytest.approx(single.ellipticity[0])
    for k, name in enumerate(("convexity", "ellipticity")):
        lost = (found[k] < 0).sum() / 9
        assert shares["40 deg, p_min 0.25"][name] == pytest.approx(lost, abs=1e-4)


def test_parameters_of_compression(monkeypatch):
    assert parameters.changed(KOMEILI, {"p_min": 0.5, "E_C": 13.0, "s_C": 10.0}).warp.d == 6.5
    varied = parameters.variants(["E_C", "s_C"])
    assert len(varied) == 8 and varied[0] == ("E_C", 0.13, {"p_min": 0.75, "E_C": 0.13, "s_C": 100})
    data = {"stability_ellipticity": np.array([-1e-6, 0.0, 1e-6])}
    grid = parameters.with_lost_ellipticity(SimpleNamespace(cell_data=data))
    assert grid.cell_data["ellipticity_lost"].tolist() == [1, 0, 0]
    monkeypatch.setattr(shape, "contrast", lambda grid, name: 0.1 if name == "shear_angle" else 0)
    assert parameters.shear_contrast(None) == pytest.approx(np.degrees(0.1))
    q = {"shear_angle_max_deg": 1, "cells_that_lost_ellipticity": 2}
    q |= {"stability_ellipticity_min": 4, "log_eps_11": (5, 0), "log_eps_22": (6, 0)}
    q["draw_in"] = {"largest_mm": 7, "smallest_mm": 0}
    summary = {"quantities": q, "stroke_reached": 8, "reaction_N": 3}
    row = parameters.row("s_C", 10.0, summary, 9, "")
    assert list(row.values()) == [14, "s_C", 10.0, 8, 1, 9, 2, 4, 5, 6, 7, 3, ""]
