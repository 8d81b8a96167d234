"""OpenRadioss' results beside ours."""

from pathlib import Path

import numpy as np
import pytest
from bench.explicit_code import curve, shear_angles

import fabric_fenicsx as ff

FOLDER = Path(__file__).parents[2] / "studies/reference/openradioss"


def test_the_bias_test_of_an_explicit_code():
    """On the same triangles with the same law: inertia and damping are what differs."""
    fabric = ff.load(FOLDER / "tab.toml")
    strip = ff.BiasExtension(fabric, element="P1", nx=40, ny=10, pattern="crossed")
    rows = strip.job(steps=20).run().rows
    mine = np.array([(row["displacement_mm"], row["reaction_N"]) for row in rows])
    displacement, theirs = curve(FOLDER / "bias_extension.csv")
    ours = np.interp(displacement, *mine.T)
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
