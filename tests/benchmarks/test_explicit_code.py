"""OpenRadioss' results beside ours."""

from pathlib import Path

import numpy as np
import pytest
from bench.explicit_code import bias_curve, formed_places, punch_force, shear_angles

import fabric_fenicsx as ff

FOLDER = Path(__file__).parents[2] / "studies/reference/openradioss"


def test_the_bias_test_of_an_explicit_code():
    """On the same triangles with the same law: inertia and damping are what differs."""
    fabric = ff.load(FOLDER / "tab.toml")
    strip = ff.BiasExtension(fabric, element="P1", nx=40, ny=10, pattern="crossed")
    rows = strip.job(steps=20).run().rows
    displacement, theirs = bias_curve(FOLDER)
    ours = np.interp(
        displacement, [r["displacement_mm"] for r in rows], [r["reaction_N"] for r in rows]
    )
    at = {d: k for k, d in enumerate(displacement)}
    assert ours[at[10]] == pytest.approx(theirs[at[10]], rel=0.005)
    assert ours[at[19]] == pytest.approx(theirs[at[19]], rel=0.002)
    late = displacement >= 5
    assert np.abs(ours - theirs)[late].max() < 0.01 * theirs.max()


def test_shear_angles_of_triangles():
    """Of a square that is sheared, stretched and turned in space, with yarns along its sides."""
    flat = np.array([[[0, 0], [1, 0], [0, 2]], [[3, 0], [3, 1], [2, 0]]], float)
    gamma = np.radians(25)
    F = np.array([[1.1, 0.9 * np.sin(gamma)], [0, 0.9 * np.cos(gamma)], [0, 0]])
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    assert shear_angles(flat, flat @ (turn @ F).T, 0) == pytest.approx([25, 25])
    assert shear_angles(flat, flat @ (turn @ np.eye(3, 2)).T, 45) == pytest.approx([0, 0], abs=1e-6)


@pytest.mark.parametrize("angle, shear", [(0, 51.40), (45, 45.22)])
def test_the_formed_plies_that_are_kept(angle, shear):
    """Their largest shear angle; a node's place, and one between nodes; the force grows."""
    x, y = np.meshgrid(np.linspace(0, 235, 48), np.linspace(0, 135, 28), indexing="ij")
    corners = np.column_stack([x.ravel(), y.ravel()])
    formed = formed_places(FOLDER, angle, corners)
    assert formed[0, :2] == pytest.approx([0, 0], abs=0.01) and 44 < formed[0, 2] < 46
    node = np.arange(47 * 28).reshape(47, 28)[:, :-1].ravel()
    centre = corners[node] + 2.5
    triangles = np.stack([corners[node], corners[node + 28], centre], 1)
    places = np.stack([formed[node], formed[node + 28], formed_places(FOLDER, angle, centre)], 1)
    assert shear - 3 < shear_angles(triangles, places, angle).max() < shear + 0.01
    stroke, force = punch_force(FOLDER, angle)
    assert stroke[-1] == 59.5 and (np.diff(force[stroke > 10]) > 0).all()
