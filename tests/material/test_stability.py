"""Stability of states, and homogeneous states."""

import numpy as np
import pytest
from fabrics import TABLE
from scipy.special import lambertw

from fabric_fenicsx.material import kernel, stability
from fabric_fenicsx.material.homogeneous import conjugate, gradient, lateral_strain, nominal
from fabric_fenicsx.material.kernel import evaluate
from fabric_fenicsx.material.laws import COUPLINGS
from fabric_fenicsx.material.presets import PRESETS

KOMEILI = PRESETS["komeili"]


def hessian(fabric, *strains):
    return stability.evaluate(fabric, stability.invariants(*strains)).hessian


@pytest.fixture(scope="module")
def fabrics(unbalanced):
    off = {f"without {name}": unbalanced.without(name) for name in COUPLINGS}
    steep = KOMEILI.replace(p_min=0.1)
    return {"unbalanced": unbalanced, "p_min 0.1": steep, "table": TABLE} | off


def acoustic(fabric, C, a, b, theta):
    """Q (n, k, 2, 2) = U D U + N·S N and N·S N (n, k) from the kernel's dS/dE and S, for N at theta
    (n, k) from a0 towards b0."""
    state = kernel.evaluate(fabric, cauchy_green=C, fibres=(a, b), tangent=True)
    w, V = np.linalg.eigh(C)
    U = np.einsum("nik,nk,njk->nij", V, np.sqrt(w), V)
    voigt = np.array([[0, 2], [2, 1]])
    D = state.tangent[:, voigt[:, :, None, None], voigt[None, None]]
    across = np.stack([-a[:, 1], a[:, 0]], -1)
    across *= np.sign((across * b).sum(1))[:, None]
    N = np.cos(theta)[..., None] * a[:, None] + np.sin(theta)[..., None] * across[:, None]
    NSN = np.einsum("nAB,ntA,ntB->nt", state.S, N, N)
    Q = np.einsum("niI,nIAJB,njJ,ntA,ntB->ntij", U, D, U, N, N, optimize=True)
    return Q + NSN[..., None, None] * np.eye(2), NSN, state.invariants


def smaller(Q):
    (a, b), (c, d) = np.moveaxis(Q, (-2, -1), (0, 1))
    return (a + d) / 2 - np.hypot((a - d) / 2, (b + c) / 2)


@pytest.mark.parametrize("p_min, lost", [(0.0, -0.2158), (0.1, -0.0798), (0.25, -0.0353)])
def test_where_convexity_is_lost(p_min, lost):
    """Yarns b compressed beside yarns a stretched by 2.5 %, from nothing to eps_b = `lost`."""
    eps_b = np.array([-1e-9, lost + 1e-4, lost - 1e-4])
    found = hessian(KOMEILI.replace(p_min=p_min), 0.025, eps_b)
    assert (found < 0).tolist() == [True, True, False]


CASES = ["unbalanced", "p_min 0.1", "table", *(f"without {name}" for name in COUPLINGS)]


@pytest.mark.parametrize("name", CASES)
def test_ellipticity_against_ten_thousand_directions(fabrics, random_states, name):
    fabric, (C, a, b) = fabrics[name], random_states(60)
    theta = np.broadcast_to(np.linspace(-np.pi / 2, np.pi / 2, 10_001)[1:], (len(C), 10_000))
    Q, NSN, invariants = acoustic(fabric, C, a, b, theta)
    found, scale = stability.evaluate(fabric, invariants), np.abs(Q).max((1, 2, 3))
    # a scan can only be above the minimum, by the square of half its spacing
    for scanned, closed in ((smaller(Q), found.acoustic), (NSN, found.out_of_plane)):
        excess = (scanned.min(1) - closed) / scale
        assert excess.min() > -1e-10 and excess.max() < 1e-6
    at = smaller(acoustic(fabric, C, a, b, found.direction[:, None])[0])[:, 0]
    assert np.abs(at - found.acoustic).max() / scale.max() < 1e-12
    assert 0 < (found.ellipticity < 0).sum() < len(C)
    least = stability.least_ellipticity(fabric, invariants)
    assert least == pytest.approx(found.ellipticity.min(), rel=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_convexity_is_the_least_eigenvalue_of_the_hessian(fabrics, name):
    """And does not depend on the initial angle."""
    fabric, rng = fabrics[name], np.random.default_rng(4)
    (ea, eb), gamma = rng.uniform(-0.2, 0.06, (2, 400)), rng.uniform(-1, 1, 400)
    aa, ab, bb, *_ = fabric.derivatives(ea, eb, gamma).second
    least = np.linalg.eigvalsh(np.array([[aa, ab], [ab, bb]]).T)[:, 0]
    same = hessian(fabric, ea, eb, gamma, np.radians(100))
    assert np.allclose(same, least, rtol=1e-9, atol=1e-9)


def test_state_at_rest_and_sides_of_the_kink():
    rest = stability.evaluate(KOMEILI, stability.invariants(0.0, 0.0))
    assert rest.convexity == 1 and rest.ellipticity == pytest.approx(1, rel=1e-12)
    assert rest.hessian == 2 * 0.65
    assert rest.acoustic == pytest.approx(KOMEILI.s1, rel=1e-12)
    e = np.array([-1e-12, 0.0, 1e-12])  # rounding must not decide the side
    assert np.ptp(hessian(KOMEILI, 0.02, e)) < 1e-8
    assert hessian(KOMEILI, 0.02, 1e-6) > 10 * hessian(KOMEILI, 0.02, 0.0)
    states = stability.invariants(np.zeros((2, 3)), [-0.1, np.nan, 0.05])
    found = stability.evaluate(KOMEILI, states).ellipticity
    assert np.array_equal(np.isnan(found), 2 * [[False, True, False]])
    assert np.isnan(stability.least_ellipticity(KOMEILI, states))
    assert stability.least_ellipticity(KOMEILI, np.empty((0, 4))) == np.inf
    e = np.linspace(-0.2, 0.08, 15)  # the decoupled baseline is convex everywhere
    least = hessian(KOMEILI.decoupled(), e[:, None], e, np.radians(40)).min()
    assert least == pytest.approx(1.3, rel=1e-12)


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
