"""What presses, alone: points pressed by a law, a tool in balance."""

import numpy as np
import pytest
from scipy.optimize import brentq

import fabric_fenicsx as ff
from fabric_fenicsx.contact.pressure_law import (
    FaceLaw,
    between_faces,
    contact_response,
    face_of,
    find_balance,
    with_secant_stiffness,
)
from fabric_fenicsx.material.homogeneous import nominal

FACE = FaceLaw(1000.0, 1e-3)
SOFT = FaceLaw.compacted(0.2, 16.0, 1e-3)
THIN = FaceLaw.compacted(0.1, 8.0, 2e-3)
BOTH, OF_POINTS = between_faces(SOFT, THIN), FaceLaw.of_points([FACE, SOFT], np.arange(4) % 2)
LAWS = FACE, SOFT, BOTH, OF_POINTS, SOFT.grown(np.array([1.0, 1.3, 0.8, 1.1]))
AREAS = np.array([1.0, 2.0, 3.0, 4.0])
UP = np.tile([0.0, 0.0, 1.0], (4, 1))
FLAT = np.zeros((4, 3, 3))


def pressed(law, z):
    """Points at heights z (n,) over a plane."""
    return contact_response(law, AREAS, z, UP, FLAT)


@pytest.mark.parametrize("law", LAWS)
def test_forces_blocks_and_depths_belong_to_the_energy(law):
    z, h = np.array([1e-2, -5e-4, -3e-3, -0.12]), 1e-7
    now, up, down = (pressed(law, z + d) for d in (0, h, -h))
    force = -(up.energy - down.energy) / (2 * h)
    assert now.forces[:, 2] == pytest.approx(force, rel=1e-6, abs=1e-9)
    assert now.forces[:, 2] == pytest.approx(AREAS * now.pressure)
    stiffness = -(up.forces - down.forces)[:, 2] / (2 * h)
    assert now.blocks[:, 2, 2] == pytest.approx(stiffness, rel=1e-5, abs=1e-6)
    for e in (0.0, 1e-5, 1e-3, 0.08):
        assert law.depth(law(np.full(4, e))[1]) == pytest.approx(np.full(4, e), rel=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_a_point_that_others_pull_off_leaves_the_face_in_one_correction(law):
    """With the law's own slope its depth would be about halved."""
    depth = 0.5e-3
    now = pressed(law, np.full(4, -depth))
    secant = with_secant_stiffness(law, AREAS, now, -2 * now.pressure)
    step = now.forces[:, 2] / secant.blocks[:, 2, 2]
    assert step == pytest.approx(depth)
    assert now.forces[:, 2] / now.blocks[:, 2, 2] == pytest.approx(depth / 2, rel=0.01)


@pytest.mark.parametrize("start", [-3.0, 0.5, 4.0])
def test_a_tool_is_found_where_its_force_is_in_balance(start):
    """On a law that starts with slope 0, after a gap of 1 mm."""
    seen = []

    def look(travel):
        seen.append(travel)
        e = max(travel - 1.0, 0.0)
        return 50 * e**2, 100 * e, max(1.0 - travel, 0.0)

    assert find_balance(2.0, look, start, reach=0.25, soft=0.01)
    assert seen[-1] == pytest.approx(1.2) and len(seen) < 40
    assert not find_balance(1.0, lambda travel: (0.0, 0.0, 1.0), 0.0, 0.25, 0.01)


FABRIC = ff.load("komeili")


def test_faces_of_two_fabrics_share_the_pressure():
    e = np.array([0.0, 1e-4, 1e-3, 0.03, 0.1])
    p = BOTH(e)[1]
    assert SOFT.depth(p) + THIN.depth(p) == pytest.approx(e, rel=1e-9, abs=1e-15)
    assert between_faces(SOFT, SOFT)(2 * e)[1] == pytest.approx(SOFT(e)[1])


def test_compaction_is_straight_from_10_mpa_on():
    """Before it is p_0 (e^y - 1 - y) at the depth L (1 - e^(-y / n)), also of a grown face."""
    L, n, p_0 = 0.2, 16.0, 1e-3
    y = brentq(lambda y: p_0 * (np.exp(y) - 1 - y) - 10.0, 1, 20)
    hard, slope = L * (1 - np.exp(-y / n)), p_0 * n / L * np.exp(y / n) * (np.exp(y) - 1)
    below = L * (1 - np.exp(-(y - 0.01) / n))
    places = np.array([below, hard + 1e-3])
    right = [p_0 * (np.exp(y - 0.01) - 1 - y + 0.01), 10.0 + 1e-3 * slope]
    assert SOFT(places)[1] == pytest.approx(right, rel=1e-9)
    grown = SOFT.grown(np.array([2.0, 2.0]))
    assert grown(2 * places)[1] == pytest.approx(right, rel=1e-9)
    assert face_of(FABRIC, 10.0).length == pytest.approx(1.07427 / 2, rel=1e-5)


def test_rigid_faces():
    """Metal yields nothing to a fabric; nor does a fabric that keeps its thickness."""
    metal, rigid = face_of(ff.load_metal("dc04"), 10.0), FABRIC.replace(compaction=None)
    assert between_faces(metal, SOFT) == between_faces(SOFT, metal) == SOFT
    stiffer = metal._replace(penalty=2 * metal.penalty)
    assert between_faces(stiffer, metal) == metal
    assert rigid.thickness_under(0.0) == rigid.thickness_under(5.0) == FABRIC.thickness
    assert face_of(rigid, 10.0).is_rigid and not face_of(FABRIC, 10.0).is_rigid
    assert face_of(FABRIC, 10.0, penalty=700.0).penalty == 700.0


@pytest.mark.parametrize("radius, counted", [(8.0, 8.0), (np.inf, 5.0)])
def test_default_penalty(radius, counted):
    """A sheet stretched by 2 % along both directions over a ball presses into it by 1.25 % of its
    thickness, less what the law is smoothed over, 30 % of that; a flat tool counts as 10
    thicknesses."""
    metal = ff.Metal(186600.0, 0.3, ff.Swift(500.0, 0.0005, 0.2), thickness=0.5)
    fabric = FABRIC.replace(compaction=None, thickness=0.5)
    pulls = 2 * 500.0 * 0.0405**0.2, nominal(FABRIC, np.array([[0.02, 0.02, 0.0]]))[0].sum() / 1.02
    for material, pull in zip((metal, fabric), pulls):
        law = face_of(material, radius)
        assert law.penalty == pytest.approx(pull / counted / 0.0125, rel=1e-6)
        assert law.smoothing == pytest.approx(0.3 * 0.0125 * 0.5)
