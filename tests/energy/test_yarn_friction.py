"""Friction between yarns in sheets: loops and what stays of a shape."""

import builders
import numpy as np
import pytest
from builders import COMM, everywhere, near, said, sheet

import fabric_fenicsx as ff

FRICTION = ff.ShearFriction((0.2, 0.05), (0.002, 0.003))
K, F = np.array(FRICTION.stiffness), np.array(FRICTION.strength)
FABRIC = ff.load("komeili").replace(s1=0.03, s2=0.0, s3=0.0, shear_friction=FRICTION, thickness=0.8)
ANGLE, SIDE = 0.4, 20.0  # [rad], [mm]


def sheared(fabric=FABRIC, path=lambda load: load, comm=COMM, **options):
    """A square whose nodes all follow pure shear up to ANGLE times a function of the load."""

    def follow(x, load):
        c, s = np.cos(ANGLE * path(load) / 2), np.sin(ANGLE * path(load) / 2)
        moved = np.array([c * x[0] + s * x[1], s * x[0] + c * x[1], x[2]])
        return (moved - x)[: blank.mesh.geometry.dim]

    blank = sheet(SIDE, SIDE, 2, 2, comm=comm, **options)
    held = ff.Support("all", everywhere, tuple(range(blank.mesh.geometry.dim)), follow)
    return ff.Scene(blank, [ff.Membrane(fabric)], [held])


@pytest.mark.versions
@pytest.mark.parametrize(
    "cell, degree, options",
    [("triangle", 2, {"integration": "inner"}), ("quadrilateral", 2, {"weave_angle": 1.3})],
)
def test_derivatives_after_an_accepted_state(unbalanced, cell, degree, options):
    blank = sheet(40.0, 20.0, 4, 2, cell=cell, degree=degree, turn=builders.rotation(), a=0.4)
    fabric = unbalanced.replace(shear_friction=FRICTION)
    with builders.compiled_as_it_stands():
        scene = ff.Scene(blank, [ff.Membrane(fabric, **options)])
        u, random = blank.u.x.array, np.random.default_rng(degree)
        for _ in range(2):
            scene.accept()
            u[:] = random.uniform(-0.2, 0.2, u.size) / degree
        ff.check_derivatives(scene.terms[0], scene, size=1e-5)
    assert scene.energies()["yarn_friction"] > 0


@pytest.mark.mpi
def test_a_loop_takes_what_its_sliding_dissipates():
    """There and back to the square, where the springs of the elements are still loaded."""
    scene = sheared(path=lambda load: 1 - abs(2 * load - 1), degree=2)
    result = ff.Job(scene, steps=40).run()
    energy, elastic = result.summary["energy"], F / K
    exact = 0.8 * SIDE**2 * (F * (2 * ANGLE - 2.5 * elastic)).sum()
    assert energy["strain"] < 1e-12
    assert energy["yarn_friction"] == pytest.approx(exact, rel=1e-9)
    assert energy["external_work"] == pytest.approx(exact, rel=2e-3)  # its kinks are between states


@pytest.mark.parametrize(
    "s1, friction",
    [(0.005, ff.ShearFriction(0.2, 0.002)), pytest.param(0.03, FRICTION, marks=pytest.mark.mpi)],
)
def test_a_square_keeps_the_angle_at_which_law_and_friction_balance(folder, s1, friction):
    """A spring alone gives way: s1 g = k (g_slid - g); or the law pushes the yarns back until
    friction at its full strength holds it: s1 g = sum f. And so it is in a run that went on."""
    fabric = FABRIC.replace(s1=s1, shear_friction=friction)
    left = 0.2 * (ANGLE - 0.01) / (s1 + 0.2) if s1 < 0.01 else F.sum() / s1
    formed = ff.Job(sheared(fabric), steps=4).run(folder, pictures=False)
    unloaded = ff.unloading(formed).run()
    angles = unloaded.scene.terms[0].invariants_at_points()[..., 3]
    assert angles == pytest.approx(np.full_like(angles, left), rel=1e-5)
    stored = 0.8 * s1 * left**2 / 2 * SIDE**2
    assert unloaded.summary["energy"]["strain"] == pytest.approx(stored, 1e-4)
    assert unloaded.summary["energy_imbalance"] < 2e-3
    assert not [each for each in said(unloaded.summary) if "keeps no shape" in each]
    again = ff.Job(sheared(fabric), steps=4).run(folder, resume=True, pictures=False)
    other = ff.unloading(again).run()
    assert other.summary["energy"] == pytest.approx(unloaded.summary["energy"], rel=1e-9)


def test_friction_counts_from_the_fabric_as_it_lies():
    """Also where that is sheared against its weave, by 0.1 rad."""
    blank = sheet(SIDE, SIDE, 2, 2, a=0.0, b=np.pi / 2 - 0.1)
    scene = ff.Scene(blank, [ff.Membrane(FABRIC, weave_angle=np.pi / 2)])
    assert scene.energies()["yarn_friction"] == pytest.approx(0, abs=1e-15)
    blank.u.interpolate(lambda x: (0 * x[0], 1e-3 * x[0]))
    exact = K.sum() * (1e-3 * np.cos(0.1) ** 2) ** 2 / 2 * 0.8 * SIDE**2
    assert scene.energies()["yarn_friction"] == pytest.approx(exact, rel=1e-3)


BENT = ff.BendingFriction(4.0, 0.1)  # k [N mm], f [N mm/mm]


def test_derivatives_of_bending_after_an_accepted_state():
    blank = sheet(20.0, 10.0, 5, 3, "unstructured", spatial=True, a=0.4)
    membrane = ff.Membrane(builders.KOMEILI.replace(bending_friction=BENT))
    scene = ff.Scene(blank, [membrane, ff.Bending(0.5, D_t=0.1, symmetric=near(0, 0.0))])
    u, random = blank.u.x.array, np.random.default_rng(1)
    for _ in range(2):
        scene.accept()
        u[:] = random.uniform(-0.5, 0.5, u.size)
    ff.check_derivatives(scene.terms[1], scene, size=1e-5)
    before = scene.energies()
    scene.accept()
    assert scene.energies() == pytest.approx(before, rel=1e-12) and before["yarn_friction"] > 0
    kept = scene.memory()
    u[:] *= 0.9
    told = scene.energies()
    scene.accept()
    scene.recall(kept)
    assert scene.energies() == pytest.approx(told, rel=1e-12)
