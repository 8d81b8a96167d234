"""Comparisons with references and explicit codes."""

import csv
from pathlib import Path

import numpy as np
import pytest
from bench.explicit_code import curve, shear_angles
from bench.reference import estimate
from bench.strips import GRID, curve_distance, field_distance

import fabric_fenicsx as ff

REFERENCE = Path(__file__).parents[2] / "studies" / "reference"


def test_fields_are_compared_as_a_camera_sees_them():
    """A finer mesh's displacements are nearer to the kept ones; a uniform shift changes no
    strain."""
    kept = np.loadtxt(REFERENCE / "bias10_grid.csv", delimiter=",", skiprows=1)
    x, u = GRID, kept[:, 2:].reshape(GRID.shape)
    assert kept[:, :2] == pytest.approx(x.reshape(-1, 2))
    assert field_distance(45.0, u + 3.0, u) == pytest.approx((0, 0), abs=1e-9)
    stretched = x * [0.01, 0.0]
    strain, angle = field_distance(45.0, stretched, 2 * stretched)
    E1, E2 = 0.01 + 0.01**2 / 2, 0.02 + 0.02**2 / 2
    assert strain == pytest.approx((E2 - E1) / E2, rel=1e-9)
    shear = np.degrees(np.diff([np.arctan2(k**2 - 1, 2 * k) for k in (1.01, 1.02)]))
    assert angle == pytest.approx(abs(shear[0]), rel=1e-9)


def test_a_curve_is_compared_as_a_reader_interpolates_it():
    """Of load squared, read off between two points: the chord is 1/4 above it in the middle; and
    half of it."""
    load = np.linspace(0, 1, 5)
    reference = np.stack([load, 3 * load**2])
    assert curve_distance([[0, 1], [0, 3]], reference) == pytest.approx(0.25)
    assert curve_distance([load, 1.5 * load**2], reference) == pytest.approx(0.5)


def test_a_series_is_extrapolated_with_its_own_order():
    """1 + 3 h^2 on h, h/2, h/4 gives 1; the bar reaches to the finest value and to the checks."""
    series = [1 + 3 * h**2 for h in (1, 0.5, 0.25)]
    found = estimate(series)
    assert found == pytest.approx((1, series[-1] - 1, 2))
    assert estimate(series, [0.5]).error == pytest.approx(0.5)
    found = estimate([1.0, 1.3, 1.2])  # not monotone: the finest, of no order
    assert found == (1.2, pytest.approx(0.2), None)


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


@pytest.mark.long
def test_a_coarse_ply_is_near_the_explicit_one(launch):
    done = launch("openradioss", "--nx", 12, "--steps", 10, "--no-pictures")
    assert done.status == 0, done.err
    with open(done.folder / "openradioss.csv", newline="") as file:
        (row,) = csv.DictReader(file)
    found = {name: float(value) for name, value in row.items()}
    assert found["nodes_apart_rms_mm"] < 2
    assert abs(found["shear_angle_max_deg"] - found["shear_angle_max_openradioss_deg"]) < 5
    assert found["punch_force_apart_rms_relative"] < 0.1
    assert "nodes_apart_rms_mm" in done.out + done.err
