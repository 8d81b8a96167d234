"""Metals at a point: hardening, logarithmic strain, plasticity, files."""

import numpy as np
import pytest
from scipy.integrate import quad

from fabric_fenicsx.material.metal import HardeningTable, Swift, Voce, load_metal
from fabric_fenicsx.material.plasticity import elastic_energy, hencky, respond, von_mises

DC04 = load_metal("dc04")
CURVES = {
    "swift": DC04.hardening,
    "ideal": Swift(159.0, 1.0, 0.0),
    "voce": Voce(159.0, 180.0, 14.0),
    # a plateau, then rising steeper
    "table": HardeningTable((0.0, 0.01, 0.02, 0.1, 0.3), (159.0, 159.0, 165.0, 260.0, 390.0)),
}


def metal(curve):
    return DC04.replace(hardening=CURVES[curve])


def test_curves_by_their_formulas():
    """K (eps0 + p)^n, Y0 + Q (1 - e^(-b p)); a table goes on at its last slope, PCHIP's of three
    points: 3 (h1 + h2) / ((2 h2 + h1) / d1 + (h2 + 2 h1) / d2) and at the end (d2 (2 h2 + h1) - d1
    h2) / (h1 + h2)."""
    p = np.array([0.0, 0.05, 0.3])
    assert Swift(500.0, 0.01, 0.5).stress(p) == pytest.approx(500 * np.sqrt(0.01 + p))
    assert Voce(160.0, 180.0, 14.0).stress(p) == pytest.approx(160 + 180 * (1 - np.exp(-14 * p)))
    table = HardeningTable((0.0, 0.1, 0.3), (160.0, 260.0, 330.0))
    end = (350 * 0.5 - 1000 * 0.2) / 0.3  # below 0, where PCHIP takes 0
    assert end < 0
    assert table.stress(np.array([0.1, 0.3, 0.9])) == pytest.approx([260.0, 330.0, 330.0])
    table = HardeningTable((0.0, 0.1, 0.3), (160.0, 260.0, 400.0))
    end = (700 * 0.5 - 1000 * 0.2) / 0.3
    assert table.stress(np.array([0.4, 0.8])) == pytest.approx([400 + 0.1 * end, 400 + 0.5 * end])


def test_dc04_yields_as_the_paper_says():
    """159 MPa at 0.05 % of plastic strain; 310 MPa of tensile strength K n^n e^(eps0 - n)."""
    curve = DC04.hardening
    assert (DC04.E, DC04.nu, DC04.thickness, DC04.density) == (186600.0, 0.3, 1.0, 7.85)
    assert curve.stress(np.array([5e-4]))[0] == pytest.approx(159.0, rel=1e-9)
    assert curve.K * 0.2**0.2 * np.exp(curve.eps0 - 0.2) == pytest.approx(310.0, rel=1e-9)


@pytest.mark.parametrize("curve", CURVES)
def test_slope_and_work_belong_to_the_stress(curve):
    curve, p, h = CURVES[curve], np.array([1e-4, 0.007, 0.013, 0.05, 0.2, 0.37, 1.0]), 1e-6
    slope = (curve.stress(p + h) - curve.stress(p - h)) / (2 * h)
    assert curve.slope(p) == pytest.approx(slope, rel=1e-5, abs=1e-6)
    for end in p:
        kinks = [k for k in (0.01, 0.02, 0.1, 0.3) if k < end]
        exact = quad(lambda q: curve.stress(np.array([q]))[0], 0, end, points=kinks or None)[0]
        assert curve.work(np.array([end]))[0] == pytest.approx(exact, rel=1e-8)


def test_logarithmic_strain_is_that_of_the_spectral_form():
    """From C = 1 on to stretches of 3, with both derivatives."""
    rng = np.random.default_rng(1)
    sizes = np.geomspace(1e-9, 0.9, 60)[:, None]
    direction = rng.normal(size=(60, 2))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    mean = rng.uniform(0.5, 2, (60, 1))
    C = np.hstack([mean, mean * sizes * direction])
    found, h, weights = hencky(C), 1e-6, rng.normal(size=(60, 3))
    for (m, d, o), strain in zip(C, found.strain):
        values, vectors = np.linalg.eigh([[m + d, o], [o, m - d]])
        E = (vectors * np.log(values) / 2) @ vectors.T
        exact = [(E[0, 0] + E[1, 1]) / 2, (E[0, 0] - E[1, 1]) / 2, E[0, 1]]
        assert strain == pytest.approx(exact, rel=1e-9, abs=1e-14)
    for k in range(3):
        more, less = (hencky(C + sign * h * np.eye(3)[k]) for sign in (1, -1))
        change = (more.strain - less.strain) / (2 * h)
        assert np.abs(change - found.first[:, :, k]).max() < 1e-7 * np.abs(found.first).max()
        change = np.einsum("ni,nij->nj", weights, more.first - less.first) / (2 * h)
        second = found.second(weights)
        assert np.abs(change - second[:, k]).max() < 1e-6 * np.abs(second).max()


def states(n=400, seed=0):
    """Trial strains (n, 3) from far within to far beyond yielding, and plastic strains (n,)."""
    rng = np.random.default_rng(seed)
    trial = rng.normal(size=(n, 3)) * np.geomspace(1e-5, 0.5, n)[:, None]
    return trial, rng.uniform(0, 0.4, n) * (rng.uniform(size=n) < 0.7)


def potential(metal, trial, plastic):
    after = respond(metal, trial, plastic, tangent=False)
    work = metal.hardening.work
    return elastic_energy(metal, after.elastic) + work(after.plastic) - work(plastic)


@pytest.mark.parametrize("curve", CURVES)
def test_stress_ends_on_the_hardening_curve(curve):
    trial, plastic = states()
    found = respond(metal(curve), trial, plastic)
    limit = CURVES[curve].stress(found.plastic)
    grows = found.plastic > plastic
    assert 100 < grows.sum() < 300
    assert von_mises(found.stress)[grows] == pytest.approx(limit[grows], rel=1e-12)
    assert (von_mises(found.stress) <= limit * (1 + 1e-12)).all()
    # what flows is volume-preserving shear along the stress
    flow = (trial - found.elastic)[grows]
    along = found.stress[grows] * [1, 3, 3] / (2 * limit[grows, None])
    assert flow == pytest.approx((found.plastic - plastic)[grows, None] * along, abs=1e-13)


@pytest.mark.parametrize("curve", CURVES)
def test_stress_and_tangent_are_derivatives_of_the_potential(curve):
    trial, plastic = states()
    made, found = metal(curve), respond(metal(curve), trial, plastic)
    h = 1e-8 + 1e-5 * np.linalg.norm(trial, axis=1)
    for k in range(3):
        step = h[:, None] * np.eye(3)[k]
        ends = [potential(made, trial + s * step, plastic) for s in (1, -1)]
        rise = (ends[0] - ends[1]) / (2 * h)
        assert np.abs(rise - 2 * found.stress[:, k]).max() < 1e-6 * np.abs(found.stress).max()
        more, less = (respond(made, trial + s * step, plastic).stress for s in (1, -1))
        change, size = (more - less) / (2 * h[:, None]), np.abs(found.tangent).max((1, 2))
        error = np.abs(change - found.tangent[:, :, k]).max(1) / size
        # but where the difference has a kink of yielding or of a table within it
        assert (error < 1e-6).mean() > 0.985
    assert found.tangent == pytest.approx(found.tangent.swapaxes(1, 2), rel=1e-12, abs=1e-9)
