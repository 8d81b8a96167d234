"""Stresses of homogeneous states, and the state of free tension."""

import numpy as np
import pytest
from scipy.special import lambertw

from fabric_fenicsx.material.homogeneous import conjugate, gradient, lateral_strain, nominal
from fabric_fenicsx.material.kernel import evaluate
from fabric_fenicsx.material.presets import PRESETS

KOMEILI = PRESETS["komeili"]


def test_conjugate_stresses_do_the_work_of_the_gradient():
    """P : dF of a change of each strain."""
    random = np.random.default_rng(2)
    strains = random.uniform([-0.1, -0.1, -1.0], [0.05, 0.05, 1.0], (20, 3))
    P, h = random.normal(size=(20, 2, 2)), 1e-6
    ends = [[gradient(*(strains + s * h * e).T) for s in (1, -1)] for e in np.eye(3)]
    work = np.transpose([(P * (more - less)).sum((1, 2)) / (2 * h) for more, less in ends])
    assert conjugate(P, gradient(*strains.T)) == pytest.approx(work, rel=1e-7, abs=1e-8)
    a, b = np.moveaxis(gradient(*strains.T), 2, 0)
    assert np.linalg.norm(a, axis=1) == pytest.approx(1 + strains[:, 0])
    cosine = (a * b).sum(1) / (1 + strains[:, :2]).prod(1)
    assert np.arcsin(cosine) == pytest.approx(strains[:, 2])


def test_nominal_stresses_and_their_tangents(unbalanced):
    """By differences of the kernel's energy."""
    e, h = np.array([[0.02, -0.05, 0.4], [-0.03, 0.01, -0.7], [0.03, 0.02, 0.0]]), 1e-6

    def energy(e):
        la, lb, s = 1 + e[:, 0], 1 + e[:, 1], np.sin(e[:, 2])
        C = np.stack([la**2, la * lb * s, la * lb * s, lb**2], -1).reshape(-1, 2, 2)
        return evaluate(unbalanced, cauchy_green=C).energy

    slopes = [(energy(e + h * axis) - energy(e - h * axis)) / (2 * h) for axis in np.eye(3)]
    assert np.allclose(np.transpose(slopes), nominal(unbalanced, e), rtol=1e-6, atol=1e-7)
    a, b = (nominal(unbalanced, e + h * k) - nominal(unbalanced, e - h * k) for k in np.eye(3)[:2])
    rates = np.stack([a[:, 0], b[:, 0], b[:, 1]]) / (2 * h)
    assert np.allclose(rates, unbalanced.derivatives(*e.T).second[:3], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("along", [0, 1])
def test_free_tension_has_a_closed_root(unbalanced, along):
    """2 d_b eps_b + T_a(eps_a) (1 - p_min) c exp(c eps_b) = 0, by Lambert's function; from any
    start."""
    strain = np.linspace(1e-4, 0.04, 9)
    y, across = (unbalanced.warp, unbalanced.weft)[:: 1 - 2 * along]
    pull = (y.a * strain**3 + y.b * strain**2) * (1 - y.p_min) * y.c
    exact = -lambertw(y.c * pull / (2 * across.d)).real / y.c
    for start in (None, 0.3 * exact, 3 * exact):
        assert lateral_strain(unbalanced, along, strain, start) == pytest.approx(exact, rel=1e-10)


def test_a_contraction_stays_within_its_bounds():
    assert lateral_strain(KOMEILI.replace(c=0.5, d=1e-3), 0, np.array([0.03])) == -0.99
